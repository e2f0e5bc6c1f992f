"""A component that changes all the time has a few events a minute."""

import pytest

from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Status
from support.state_driver import ERROR, OK, StateDriver


def levels(driver: StateDriver, component: str = "Motor") -> list[Event]:
    return [each for each in driver.events if (each.kind, each.component) == ("level", component)]


def toggle(driver: StateDriver, begin: float, times: int, message: str = "Hot") -> None:
    """Ten changes a second; it ends as OK where their number is even."""
    for number in range(times):
        driver.at(begin + number / 10)
        driver.raw(Status(OK if number % 2 else ERROR, "Motor", message), Status(OK, "Fan"))


def keep(driver: StateDriver, begin: float, end: float, level: int) -> None:
    for second in range(int(begin), int(end)):
        driver.at(float(second))
        driver.raw(Status(level, "Motor", "Hot"), Status(OK, "Fan"))


def test_one_that_changes_ten_times_a_second_has_eleven_events_a_minute():
    driver = StateDriver().raw(Status(OK, "Motor"), Status(OK, "Fan"))
    toggle(driver, 1, 3_000)  # five minutes
    assert 50 <= len(levels(driver)) <= 60
    [counted, *_more] = [each for each in levels(driver) if "times" in each.message]
    assert counted.message == "changed 590 times in 60 s; Hot"


@pytest.mark.parametrize("times", [200, 201])
def test_the_levels_of_its_events_follow_each_other_up_to_the_last(times):
    driver = StateDriver().raw(Status(OK, "Motor"), Status(OK, "Fan"))
    toggle(driver, 1, times)
    last = OK if times % 2 == 0 else ERROR
    keep(driver, 22, 70, last)

    found = levels(driver)
    assert len(found) == 11
    assert [each.before for each in found[1:]] == [each.after for each in found[:-1]]
    assert found[-1].after == ("OK" if last == OK else "ERROR")
    assert found[-1].message == f"changed {times - 10} times in 60 s; Hot"


def test_a_few_changes_are_events_each_and_another_component_has_its_own():
    driver = StateDriver().raw(Status(OK, "Motor"), Status(OK, "Fan"))
    toggle(driver, 1, 100)
    driver.raw(Status(OK, "Motor"), Status(ERROR, "Fan"))
    assert [each.after for each in levels(driver, "Fan")] == ["ERROR"]
    keep(driver, 12, 75, OK)
    assert len(levels(driver)) == 11
    toggle(driver, 75, 10)
    keep(driver, 77, 200, OK)
    assert len(levels(driver)) == 11 + 10
    assert not any("times" in each.message for each in levels(driver)[11:])


def test_one_that_is_forgotten_says_first_how_often_it_changed():
    driver = StateDriver().raw(Status(OK, "Motor"), Status(OK, "Fan"))
    toggle(driver, 1, 100)
    driver.state.forget("r", "Motor", driver.now)
    assert [each.after for each in levels(driver)[-2:]] == ["OK", "forgotten"]


@pytest.mark.parametrize(("length", "more"), [(200, ""), (201, "…"), (4_000, "…")])
def test_an_event_of_a_level_has_the_first_200_characters(length, more):
    driver = StateDriver().raw(Status(ERROR, "Motor", "x" * length))
    assert levels(driver)[0].message == "x" * 200 + more
