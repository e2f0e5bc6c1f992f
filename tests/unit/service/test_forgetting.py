"""What a person forgets at one exporter of a pair, the other forgets by way of Alertmanager."""

from dataclasses import replace
from typing import Any

import pytest

from ros_diagnostics_exporter.forgetting import Forgetting
from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.silences import Forgotten, forgotten_matchers
from support.as_listed import read, read_downtimes, read_forgotten
from support.state_driver import ERROR, OK, WALL, StateDriver

HOT, LASER = Status(ERROR, "Motor", "Hot"), Status(ERROR, "Laser", "Dirty")


class SharedAlertmanager:
    """The one of both exporters: what one adds, the other reads."""

    def __init__(self) -> None:
        self.silences: list[dict[str, Any]] = []
        self.answers = True

    def add(self, silence: dict[str, Any]) -> None:
        if not self.answers:
            raise UnreachableError("it is down")
        self.silences.append({**silence, "status": {"state": "active"}})

    @property
    def forgotten(self) -> list[Forgotten]:
        return read_forgotten(self.silences, "f")


class Half:
    """An exporter of a pair, with a robot whose motor and laser are faults."""

    def __init__(self, alertmanager: SharedAlertmanager | None) -> None:
        self.driver = StateDriver()
        self.forgetting = Forgetting(self.driver.state, alertmanager)
        self.driver.raw_every(1, 20, HOT, LASER)
        assert self.faults() == {"Laser", "Motor"}

    def faults(self) -> set[str]:
        return {fault.identity.component for fault in self.driver.state.faults()}

    def forget(self, component: str | None = None) -> tuple[int, bool]:
        return self.forgetting.forget("r", component, self.driver.now)

    def follow(self) -> set[str]:
        self.forgetting.forget_passed_on(self.driver.now)
        return self.faults()


@pytest.mark.parametrize(("component", "left"), [("Motor", {"Laser"}), (None, set())])
def test_the_other_half_forgets_it_as_well(component, left):
    alertmanager = SharedAlertmanager()
    one, other = Half(alertmanager), Half(alertmanager)
    assert one.forget(component) == (2 if component is None else 1, True)
    assert one.faults() == left
    assert other.follow() == left


def test_what_is_received_again_is_judged_again_and_forgotten_no_second_time():
    alertmanager = SharedAlertmanager()
    one, other = Half(alertmanager), Half(alertmanager)
    one.forget("Motor")
    other.follow()
    for half in (one, other):
        half.driver.raw_every(1, 40, HOT, LASER)
        assert half.follow() == {"Laser", "Motor"}
    restarted = Forgetting(other.driver.state, alertmanager)
    restarted.forget_passed_on(other.driver.now)
    assert other.faults() == {"Laser", "Motor"}


def test_a_half_that_was_down_forgets_it_when_it_starts():
    alertmanager = SharedAlertmanager()
    one, other = Half(alertmanager), Half(alertmanager)
    one.forget()
    restarted = Forgetting(other.driver.state, alertmanager)
    restarted.forget_passed_on(other.driver.now)
    assert other.faults() == set()


def test_a_fault_that_was_forgotten_is_not_taken_up_from_its_alert_which_still_fires():
    alertmanager = SharedAlertmanager()
    one, other = Half(alertmanager), Half(alertmanager)
    firing = list(other.driver.state.faults())
    one.forget("Motor")
    left = one.forgetting.without_forgotten(firing)
    assert [fault.identity.component for fault in left] == ["Laser"]
    later = [replace(fault, since=WALL + 30) for fault in firing]
    assert one.forgetting.without_forgotten(later) == later


def test_without_alertmanager_the_answer_says_that_only_this_one_has_forgotten_it(caplog):
    alone = Half(None)
    assert alone.forget() == (2, False)
    assert alone.follow() == set()
    down = Half(SharedAlertmanager())
    down.forgetting._alertmanager.answers = False
    assert down.forget() == (2, False)
    assert "other exporters do not forget robot 'r' as well: it is down" in caplog.text


def test_what_the_other_half_does_not_know_stops_nothing():
    alertmanager = SharedAlertmanager()
    one, other = Half(alertmanager), Half(alertmanager)
    one.driver.raw(HOT, LASER, Status(OK, "Fan"))
    one.forget("Fan")
    assert other.follow() == {"Laser", "Motor"}
    with pytest.raises(LookupError):
        one.forget("Rocket")
    assert len(alertmanager.silences) == 1


def test_its_silence_is_no_acknowledgement_and_no_downtime():
    alertmanager = SharedAlertmanager()
    Half(alertmanager).forget()
    assert read(alertmanager.silences, "f") == []
    assert read_downtimes(alertmanager.silences, "f") == []
    assert read_forgotten(alertmanager.silences, "other") == []
    [made] = alertmanager.silences
    at = "2023-11-14T22:13:40.000000+00:00"
    named = {each["name"]: each["value"] for each in made["matchers"]}
    assert named == forgotten_matchers("f", "r", "", at)
    for wrong in ({**made, "status": {"state": "expired"}}, {**made, "matchers": 7}, None, {}):
        assert read_forgotten([wrong], "f") == []
