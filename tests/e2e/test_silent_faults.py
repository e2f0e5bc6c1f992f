"""Silent faults of real nodes, from what is done to them to the mail, across bad networks."""

import pytest

from experiments import silent
from support import subnets

pytestmark = pytest.mark.slow

HARDEST = silent.CASES[2:]  # that lose most, or delay
QUIET = 60.0  # seconds at the end; `./run experiment silent --quiet 60` has an hour


@pytest.mark.parametrize(
    "case", HARDEST, ids=lambda each: f"{each.loss:.0%}-{1000 * each.delay:.0f}ms"
)
@pytest.mark.timeout(silent.LONGEST + QUIET + 60)
def test_each_is_one_mail_that_names_it_and_nothing_else_is(case):
    if why := subnets.missing():
        pytest.skip(why)
    rows = list(silent.measure(case, QUIET))
    found = [(each["seen"], each["problems"], each["recoveries"], each["wrong"]) for each in rows]
    expected = [str(each["expected"]) for each in rows]
    assert found == [(each, bool(each), bool(each), "") for each in expected]
    assert expected.count("") == 1
