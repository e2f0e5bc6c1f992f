"""The numbers of a component are the same, whichever of the ways sets them."""

from __future__ import annotations

import re
from unittest import mock

from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import ValueRule
from ros_diagnostics_exporter.state import component
from ros_diagnostics_exporter.state.component import ComponentValues
from ros_diagnostics_exporter.state.limits import SeriesLimit

keys = st.sampled_from(["Voltage (V)", "Voltage", "Serial number", "Scaled", "Mode"])
texts = st.sampled_from(["1", "-2.5", "007", "3 V", "3 A", "nan", "on", "[1, 2]"])


def of_one_component(named: list[str]) -> st.SearchStrategy[list[tuple[tuple[str, str], ...]]]:
    """Key-values of one message after another, with the same keys."""
    return st.lists(st.tuples(*(st.tuples(st.just(each), texts) for each in named)), max_size=8)


histories = st.lists(st.lists(keys, max_size=2).flatmap(of_one_component), max_size=3).map(
    lambda parts: [pairs for part in parts for pairs in part]
)
RULES = {
    "Scaled": ValueRule(re.compile(""), re.compile("Scaled"), scale=2.0, offset=1.0),
    "Mode": ValueRule(re.compile(""), re.compile("Mode"), enum={"1": 7.0}),
}


def values_after_each(history) -> list[object]:
    rejected: list[tuple[str, str]] = []
    values = ComponentValues(
        RULES.get, (3, 20), SeriesLimit(100), lambda *reason: rejected.append(reason)
    )
    found = []
    for pairs in history:
        values.update(pairs)
        found.append(repr([(each.key, each.unit, each.number) for each in values.all]))
    return [*found, rejected]


@given(histories)
def test_a_plain_number_changes_the_same_as_any_other(history):
    found = values_after_each(history)

    with mock.patch.object(component, "parse_plain", return_value=None):
        assert found == values_after_each(history)
