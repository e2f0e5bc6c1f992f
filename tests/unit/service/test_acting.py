"""What a form does at Alertmanager: the silences that the commands make, and an event of it."""

from datetime import datetime, timezone
from typing import Any

import pytest

from ros_diagnostics_exporter.acknowledging import (
    acknowledge,
    cancel_downtime,
    plan_downtime,
    silence,
)
from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Array, Person, Status, Topic
from ros_diagnostics_exporter.service import Service
from ros_diagnostics_exporter.silences import Alert, Silence, valid
from support.as_listed import problems, read, read_downtimes
from support.silences import BEGAN, FAULT, LABELS, SINCE, listed

NOW = BEGAN + 300.0
ANN = Person("ann", "spare\npart ordered", "10.0.0.7")


class FakeAlertmanager:
    """One that has these alerts and silences."""

    def __init__(self, *alerts: dict[str, Any], silences: list[Any] | None = None) -> None:
        self._alerts = list(alerts)
        self._silences = silences or []
        self.added: list[dict[str, Any]] = []
        self.ended: list[str] = []

    def alerts(self, _fleet: str) -> list[Any]:
        return valid(Alert, self._alerts)

    def silences(self, _fleet: str) -> list[Any]:
        return valid(Silence, self._silences)

    def end(self, silence: str) -> None:
        self.ended.append(silence)

    def add(self, made: dict[str, Any]) -> None:
        self.added.append(made)


def alert(since: str = SINCE, name: str = "RosDiagnosticsComponentCritical", **labels: str):
    of = {"alertname": name, **LABELS, **labels}
    return {
        "labels": of,
        "annotations": {"evidence": f"since {since}"},
        "status": {"state": "active"},
    }


ESCALATION = alert(name="RosDiagnosticsUnacknowledged", step="1", since=SINCE)


def as_listed(made: dict[str, Any]) -> dict[str, Any]:
    return {**made, "status": {"state": "active"}}


def test_it_is_the_silence_that_the_command_makes_but_for_steps_that_were_sent():
    by = FakeAlertmanager(alert(), ESCALATION, alert(component="Motor 2"))
    event = acknowledge(by, "f", FAULT, ANN, NOW)

    [made] = by.added
    [problem, _other] = problems([alert(), ESCALATION, alert(component="Motor 2")])
    start = datetime.fromtimestamp(NOW, timezone.utc)
    assert made == silence(problem, "ann", "spare part ordered", start)
    assert {"name": "step", "value": "1", "isRegex": True, "isEqual": False} in made["matchers"]
    [known] = read([as_listed(made)], "f")
    assert (known.author, known.is_of(BEGAN)) == ("ann", True)
    assert (event.kind, event.after, event.author, event.since) == (
        *("action", "acknowledged", "ann"),
        BEGAN,
    )
    assert event.message == "spare part ordered (from 10.0.0.7)"
    text = event_text({"kind": "action", **{k: v for k, v in vars(event).items() if v}})
    assert text == (
        "acknowledged by a form by ann, /Motor/Motor 1: spare part ordered (from 10.0.0.7)"
    )


@pytest.mark.parametrize(
    "others",
    [
        [],
        [alert("2026-01-01 11:00:00.123 +0000 UTC")],  # a later one of the same part
        [alert("yesterday")],  # anybody may have posted it
        [alert(component="Motor 2"), alert(fleet="g"), alert(robot="s"), alert(state="warning")],
    ],
)
def test_what_does_not_fire_is_not_acknowledged(others):
    by = FakeAlertmanager(*others)
    with pytest.raises(LookupError, match="no alert about it is firing"):
        acknowledge(by, "f", FAULT, ANN, NOW)
    assert by.added == []


def test_what_somebody_has_acknowledged_is_not_acknowledged_again():
    by = FakeAlertmanager(alert(), silences=[listed()])
    with pytest.raises(LookupError, match="already acknowledged by ann"):
        acknowledge(by, "f", FAULT, ANN, NOW)
    assert by.added == []


@pytest.mark.parametrize("component", ["", "Motor 1"])
def test_a_downtime_is_what_exporters_read_as_one(component):
    by = FakeAlertmanager()
    event = plan_downtime(by, "f", ("r", component, NOW, 3_600.0), ANN, NOW)

    [found] = read_downtimes([as_listed(by.added[0])], "f")
    assert (found.robot, found.component, found.author) == ("r", component, "ann")
    assert (found.start, found.end) == pytest.approx((NOW, NOW + 3_600), abs=0.01)
    assert found.comment == "spare part ordered"
    assert (event.robot, event.component, event.after) == ("r", component, "downtime")
    assert event.message.startswith("until 11:05:00 UTC: spare part ordered (from 10.0.0.7)")


def test_a_downtime_may_lie_ahead():
    by = FakeAlertmanager()
    event = plan_downtime(by, "f", ("r", "", NOW + 7_200, 3_600.0), ANN, NOW)

    made = by.added[0]
    [found] = read_downtimes([as_listed(made) | {"status": {"state": "pending"}}], "f")
    assert (found.start, found.end) == pytest.approx((NOW + 7_200, NOW + 10_800), abs=0.01)
    assert event.message.startswith("from 12:05:00 UTC until 13:05:00 UTC: spare part ordered")


def planned(robot: str, component: str, hours: float, name: str) -> dict[str, Any]:
    by = FakeAlertmanager()
    plan_downtime(by, "f", (robot, component, NOW, hours * 3_600), ANN, NOW)
    return as_listed(by.added[0]) | {"id": name}


@pytest.mark.parametrize(
    ("robot", "component", "hours", "is_covered"),
    [
        ("r", "Motor 1", 2, True),
        ("r", "Motor 1", 1, True),
        ("r", "Motor 1", 3, False),
        ("r", "Motor 2", 1, False),
        ("r", "", 1, False),
        ("s", "Motor 1", 1, False),
        ("t", "Motor 1", 2, True),
    ],
)
def test_a_downtime_that_another_covers_is_not_planned(robot, component, hours, is_covered):
    """One login planned 100 of them in a second."""
    known = [planned("r", "Motor 1", 2, "a"), planned("t", "", 2, "b")]
    by = FakeAlertmanager(silences=known)
    if is_covered:
        with pytest.raises(LookupError, match="a downtime of ann covers it already"):
            plan_downtime(by, "f", (robot, component, NOW, hours * 3_600), ANN, NOW)
    else:
        plan_downtime(by, "f", (robot, component, NOW, hours * 3_600), ANN, NOW)
    assert len(by.added) == (not is_covered)


def test_just_the_downtime_that_is_meant_is_cancelled():
    known = [
        planned("r", "Motor 1", 1, "mine"),
        planned("r", "Motor 1", 2, "longer"),
        planned("r", "", 1, "of the robot"),
        planned("s", "Motor 1", 1, "of another"),
        {**planned("r", "Motor 1", 1, "over"), "status": {"state": "expired"}},
        listed(),
    ]
    by = FakeAlertmanager(silences=known)
    event = cancel_downtime(by, "f", ("r", "Motor 1", NOW + 3_600), ANN, NOW + 60)
    assert by.ended == ["mine"]
    assert (event.robot, event.component, event.author) == ("r", "Motor 1", "ann")
    text = event_text({"kind": "action", **{k: v for k, v in vars(event).items() if v}})
    assert text == (
        "downtime cancelled by a form by ann, Motor 1:"
        " it was until 11:05:00 UTC: spare part ordered (from 10.0.0.7)"
    )
    for other in (("r", "Motor 2", NOW + 3_600), ("r", "Motor 1", NOW), ("q", "", NOW + 3_600)):
        with pytest.raises(LookupError, match="no such downtime any more"):
            cancel_downtime(by, "f", other, ANN, NOW + 60)
    assert by.ended == ["mine"]


@pytest.mark.parametrize(
    ("robot", "component", "error", "said"),
    [
        ("s", "", LookupError, "there is no robot 's'"),
        ("r", "Arm", LookupError, "r has no component 'Arm'"),
        ("r", "Motor", ConnectionError, "the exporter runs without --alertmanager.url"),
        ("r", "", ConnectionError, "the exporter runs without --alertmanager.url"),
    ],
)
def test_a_downtime_is_of_what_is_there_and_needs_alertmanager(
    tmp_path, robot, component, error, said
):
    fleet = Fleet("f", (Robot("r", topic_raw="/r/diagnostics", source=Source.RAW),), exporter="x")
    service = Service(fleet, tmp_path / "fleet.yml", None)
    array = Array(0.0, (Status(0, "Motor"),), 100)
    service.state.receive(Topic(0, "/r/diagnostics"), array, read_clocks())
    with pytest.raises(error, match=said):
        service.plan_downtime(robot, component, NOW, 60.0, ANN)
