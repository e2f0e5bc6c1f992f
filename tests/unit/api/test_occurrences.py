"""Each time that a fault lasted, from the events of the log in any order."""

from dataclasses import asdict, replace
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.api.occurrences import history, occurrences
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.events import Event, EventLog, Wanted
from ros_diagnostics_exporter.faults.model import fault_of

FLEET = Fleet("f", exporter="x")
MOTOR = {"scope": "component", "state": "critical", "severity": "critical", "robot": "r"}


def event(number: int, time: float, kind: str, **more: Any) -> dict[str, Any]:
    return {"id": number, "time": time, "kind": kind, **MOTOR, "component": "Motor 1", **more}


BEGAN = event(1, 110.0, "fault_began", since=100.0, message="over current")
SENT = event(2, 111.0, "notified", since=100.0, receiver="email", after="firing")
TAKEN = event(3, 120.0, "acknowledged", since=100.0, author="ann", message="on it")
ENDED = event(4, 130.0, "fault_ended", since=100.0, reason="recovered", message="OK: runs")
AGAIN = event(5, 210.0, "fault_began", since=200.0, message="hot")
OTHER = event(6, 212.0, "fault_began", since=200.0, component="Motor 2")
LEVEL = {"id": 7, "time": 100.0, "kind": "level", "robot": "r", "component": "Motor 1"}
UNDATED = {**LEVEL, "id": 8, "kind": "fault_began"}
ALL = [BEGAN, SENT, TAKEN, ENDED, AGAIN, OTHER, LEVEL, UNDATED]


@given(st.permutations(ALL))
def test_a_fault_has_its_begin_its_end_and_who_took_care_whatever_the_order(events):
    found = {(each["component"], each["since"]): each for each in occurrences(events)}

    assert len(found) == 3
    first = found["Motor 1", 100.0]
    assert (first["confirmed"], first["until"], first["reason"]) == (110.0, 130.0, "recovered")
    assert (first["evidence"], first["end"]) == ("over current", "OK: runs")
    assert first["acknowledged"] == [{"at": 120.0, "author": "ann", "comment": "on it"}]
    assert first["notified"] == [{"at": 111.0, "receiver": "email", "step": "", "after": "firing"}]
    assert first["group"] == ""
    lasting = found["Motor 1", 200.0]
    assert (lasting["until"], lasting["reason"], lasting["end"]) == (None, None, "")


def test_the_last_one_is_the_first_and_one_whose_begin_was_forgotten_has_its_end():
    found = occurrences([ENDED, AGAIN])

    assert [each["since"] for each in found] == [200.0, 100.0]
    assert (found[1]["confirmed"], found[1]["until"], found[1]["evidence"]) == (None, 130.0, "")


@pytest.fixture
def find():
    """A function that looks up events; those of a log of two robots of which one fails twice."""
    log = EventLog()
    of = {"group": "/Motor", "component": "Motor 2"}
    named = {"scope": "component", "state": "critical", "severity": "critical", **of}
    for time, kind, robot_name, more in (
        (90.0, "level", "r", of | {"before": "OK", "after": "WARN"}),
        (110.0, "fault_began", "r", named | {"since": 100.0}),
        (112.0, "notified", "r", named | {"since": 100.0, "receiver": "email", "after": "firing"}),
        (120.0, "acknowledged", "r", named | {"since": 100.0, "author": "ann"}),
        (210.0, "fault_began", "other", named | {"since": 200.0}),
        (300.0, "fault_ended", "r", named | {"since": 100.0, "reason": "recovered"}),
        (410.0, "fault_began", "r", named | {"since": 400.0}),
        (500.0, "robot", "r", {"after": "silent"}),
    ):
        event = Event(time, kind, robot_name, **more)
        if event.since is not None:
            event = replace(event, fault=fault_of(FLEET, asdict(event)))
        log.record(event)
    return lambda **wanted: list(log.find(Wanted(**wanted)))


def test_the_history_of_a_fault_is_of_its_id(find):
    last, first = history(find, fault_of(FLEET, find(kind="fault_began", robot="r", limit=1)[0]))

    assert (last["since"], last["until"]) == (400.0, None)
    assert (first["since"], first["until"], first["reason"]) == (100.0, 300.0, "recovered")
    assert [each["author"] for each in first["acknowledged"]] == ["ann"]
    assert [each["receiver"] for each in first["notified"]] == ["email"]
    assert history(find, "0123456789ab") == []
    (only,) = history(find, find(robot="other")[0]["fault"])
    assert (only["since"], only["until"]) == (200.0, None)
