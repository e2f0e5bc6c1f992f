"""The numbers of a component are the same, whichever of the ways sets them."""

import re
from unittest import mock

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import Limits, Threshold, ValueRule
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.robots import values as values_of_robots
from ros_diagnostics_exporter.robots.limits import SeriesLimit
from ros_diagnostics_exporter.robots.marks import Marks
from ros_diagnostics_exporter.robots.values import ComponentValues, ExportedValue
from support.state_driver import OK, StateDriver

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


def values_of(*, judged: bool, rejected: list[tuple[str, str]] | None = None) -> ComponentValues:
    seen = [] if rejected is None else rejected
    return ComponentValues(
        RULES.get,
        Limits(values=3, label_length=20),
        SeriesLimit(100),
        lambda *reason: seen.append(reason),
        Marks(),
        judged=judged,
    )


def values_after_each(history, *, judged=True) -> list[object]:
    rejected: list[tuple[str, str]] = []
    values = values_of(judged=judged, rejected=rejected)
    found = []
    for pairs in history:
        values.update(pairs)
        found.append(repr([(each.key, each.unit, each.number) for each in values.all]))
    return [*found, rejected]


@given(histories)
def test_a_plain_number_changes_the_same_as_any_other(history):
    found = values_after_each(history)

    with mock.patch.object(values_of_robots, "is_plain", return_value=None):
        assert found == values_after_each(history)


@given(histories)
def test_numbers_that_nothing_judges_are_the_same_when_they_are_read(history):
    *found, _rejected_at_each_reading = values_after_each(history, judged=False)

    assert found == values_after_each(history)[:-1]


@given(histories.filter(bool))
def test_numbers_that_are_read_once_are_those_of_the_last_message(history):
    values = values_of(judged=False)
    for pairs in history:
        assert not values.update(pairs)
    alone = values_of(judged=True)
    alone.update(history[-1])

    assert repr(values.all) == repr(alone.all)
    assert repr(values.exported(history[-1])) == repr(alone.exported(history[-1]))


def test_a_number_is_scaled_before_the_offset_is_added():
    rule = ValueRule(key=re.compile("Temperature"), scale=0.1, offset=-273.15)
    driver = StateDriver(values=(rule,))
    driver.raw(Status(OK, "Motor", values=(("Temperature", "2981.5"),)))
    assert driver.sample("component_value", key="Temperature") == pytest.approx(25.0)


@pytest.mark.parametrize("beside", [(), (("Mode", "docked"),)])
def test_a_plain_number_is_served_in_the_digits_of_its_driver(beside):
    driver = StateDriver()
    served = []
    for text in ("12.50", "7.10", "1e3"):  # known first, then changed; the last one is not plain
        driver.raw(Status(OK, "Motor", values=(("Temperature", text), *beside)))
        of_values = re.search(
            rb"\nros_diagnostics_component_value{.*} (.*)\n", driver.exposition.render()
        )
        served.append(of_values[1])
    assert served == [b"12.50", b"7.10", b"1000.0"]


@pytest.mark.parametrize("bound", ["low", "high"])
def test_a_number_at_its_threshold_is_not_beyond_it(bound):
    rule = ValueRule(thresholds=(Threshold(bound, "warning", 5.0),))

    found = [bool(ExportedValue("k", "", text, rule=rule).beyond) for text in ("4", "5", "6")]

    assert found == [bound == "low", False, bound == "high"]


def test_a_list_of_another_length_is_read_anew():
    values = values_of(judged=True)
    found = []
    for text in ("[1, 2]", "3", "[4, 5, 6]"):
        assert values.update((("Voltage", text),))
        found.append([each.number for each in values.all])
    assert found == [[1, 2], [3], [4, 5, 6]]


def test_a_component_is_beyond_a_threshold_with_one_number():
    rule = ValueRule(key=re.compile("Temperature"), thresholds=(Threshold("high", "warning", 5.0),))
    driver = StateDriver(values=(rule,))
    for numbers, beyond in (("1", "9"), False), (("6", "9"), True):
        pairs = tuple(zip(("Temperature", "Voltage"), numbers, strict=True))
        driver.raw(Status(OK, "Motor", values=pairs))
        assert driver.component("Motor").values.beyond is beyond


@pytest.mark.parametrize("text", ["9,5", "9.5 [%]", "9,5 %"])
def test_a_number_that_drivers_write_otherwise_is_beyond_its_threshold(text):
    rule = ValueRule(key=re.compile("Level"), thresholds=(Threshold("low", "critical", 15.0),))
    driver = StateDriver(values=(rule,))
    driver.stand(20, Status(OK, "Battery", "", "", (("Level", text),)))
    assert driver.fault_names() == {("value", "critical", "r", "Battery", "Level", "low")}
