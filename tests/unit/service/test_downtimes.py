"""Downtimes: which silences the exporter reads as one."""

from datetime import datetime, timedelta, timezone

import pytest

from ros_diagnostics_exporter import silences
from support.as_listed import read_downtimes

NOW = datetime.now(timezone.utc)


def silence(robot: str, begin: int = 0, state: str = "active"):
    """A downtime of the robot that begins in so many hours, as Alertmanager lists it."""
    times = NOW + timedelta(hours=begin), NOW + timedelta(hours=100)
    matchers = silences.downtime_matchers("hall", robot, "")
    made = silences.silence(matchers, *times, "ann", "new gears")
    return {"id": "0", "status": {"state": state}, **made}


@pytest.mark.parametrize(
    "changed",
    [
        {"status": {"state": "expired"}},
        {"endsAt": "soon"},
        {"matchers": []},
        {"matchers": None},
        {"createdBy": None},
    ],
)
def test_other_silences_are_no_downtimes(changed):
    made = silence("robot_1")
    assert len(read_downtimes([made], "hall")) == 1
    assert read_downtimes([{**made, **changed}], "hall") == []


@pytest.mark.parametrize(
    "matcher",
    [
        {"name": "robot", "value": "r.*", "isRegex": True},
        {"name": "robot", "value": "robot_1", "isRegex": False, "isEqual": False},
        {"name": "severity", "value": "warning", "isRegex": False},
        {"name": "robot", "value": "", "isRegex": False},
    ],
)
def test_a_silence_that_matches_something_else_is_none(matcher):
    made = silence("robot_1")
    others = [each for each in made["matchers"] if each["name"] != matcher["name"]]
    assert read_downtimes([{**made, "matchers": [*others, matcher]}], "hall") == []


def test_of_too_many_those_in_force_and_the_next_ones_are_kept(monkeypatch):
    monkeypatch.setattr(silences, "MOST", 3)
    made = [
        silence(f"robot_{hours}", hours, "active" if hours < 0 else "pending")
        for hours in (48, -1, 24, 1, -2)
    ]

    found = read_downtimes(made, "hall")
    assert [each.robot for each in found] == ["robot_-2", "robot_-1", "robot_1"]
