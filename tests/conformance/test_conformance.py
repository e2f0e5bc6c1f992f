"""This project notifies as the distribution's Nagios does, but for what differs on purpose."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import pytest

from conformance.compare import Outcome, run, shrunk
from conformance.exporter import Variant, play
from conformance.histories import LEVELS, SOFT_AND_HARD, WRITTEN, drawn
from conformance.history import History
from conformance.table import PAGE, table

pytestmark = [pytest.mark.e2e, pytest.mark.slow]

EARLY = partial(play, variant=Variant(early=1.0))
SOFT_RECOVERY = partial(play, variant=Variant(soft_recovery=True))


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory) -> list[Outcome]:
    return run(tmp_path_factory.mktemp("conformance") / "all", [*WRITTEN, *drawn()])


def wrong(found: Sequence[Outcome]) -> list[Outcome]:
    return [each for each in found if not each.same and not each.reason]


def test_every_history_is_notified_the_same_or_differs_for_a_reason(outcomes):
    assert len(outcomes) >= 60
    assert not wrong(outcomes), "\n".join(map(str, wrong(outcomes)))


def test_a_reason_is_given_only_where_something_differs(outcomes):
    needless = [each.history.name for each in outcomes if each.same and each.history.reason]

    assert not needless


def test_the_table_of_the_documentation_is_that_of_this_run(outcomes):
    assert table(outcomes) in PAGE.read_text(), "run ./run conformance --write"


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_other_histories_that_are_drawn_are_notified_the_same(tmp_path, seed):
    found = wrong(run(tmp_path / "drawn", drawn(seed)))

    assert not found, shrunk(tmp_path / "shrunk", found[0].history)


@pytest.mark.parametrize(
    ("ours", "histories"),
    [(EARLY, SOFT_AND_HARD), (EARLY, LEVELS), (SOFT_RECOVERY, SOFT_AND_HARD)],
    ids=["a cycle early", "a cycle early, levels", "recovery while soft"],
)
def test_an_exporter_that_is_wrong_is_found(tmp_path, ours, histories):
    assert wrong(run(tmp_path / "wrong", histories, ours))


def test_what_differs_is_made_small(tmp_path):
    history = History("long", {"r/m": "oowowccoooccoocccwwo", "r/l": "ooccoowwwo"}, attempts=3)

    smallest = shrunk(tmp_path / "shrunk", history, EARLY).history

    assert sum(map(len, smallest.services.values())) <= 3
