"""The canary: when one begins, what counts as its return, and what is counted."""

import json
from typing import Any

import pytest

from ros_diagnostics_exporter.canary import BUCKETS, FIRST, Canary, Times
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.notifications import Message, parse

WALL = 1_700_000_000.0
EVERY = 60.0


def at(seconds: float) -> Instant:
    return Instant(seconds, WALL + seconds)


def posted(start: float | str, **labels: str) -> Message:
    """What Alertmanager posts; the annotation is as Go writes a number."""
    text = start if isinstance(start, str) else f"{start:.12e}"
    alert: dict[str, Any] = {
        "status": "firing",
        "labels": {"alertname": "RosDiagnosticsCanary", "fleet": "f", "instance": "e", **labels},
        "annotations": {"summary": "It is under way.", "canary": text},
    }
    message = {"version": "4", "receiver": "canary", "alerts": [alert]}
    return parse(json.dumps(message).encode())


@pytest.fixture
def canary() -> Canary:
    """One that has just begun."""
    canary = Canary(at(0))
    canary.tick(EVERY, at(FIRST))
    return canary


def times(*seconds: float, missed: int = 0) -> Times:
    within = tuple(sum(each <= bucket for each in seconds) for bucket in BUCKETS)
    return Times(within, len(seconds) + missed, sum(seconds) + missed * EVERY)


def test_the_first_begins_half_a_minute_after_the_start_and_none_without_an_interval():
    canary = Canary(at(0))
    canary.tick(None, at(FIRST))
    assert (canary.start, canary.times) == (None, None)
    canary = Canary(at(0))
    canary.tick(EVERY, at(FIRST - 0.1))
    assert (canary.start, canary.times) == (None, times())
    canary.tick(EVERY, at(FIRST))
    assert canary.start == WALL + FIRST


def test_it_lasts_until_it_is_back_and_the_next_one_begins_an_interval_later(canary):
    canary.tick(EVERY, at(FIRST + 4))
    assert canary.receive(posted(WALL + FIRST), "f", at(FIRST + 4.5)) == 1
    assert (canary.start, canary.times) == (None, times(4.5))
    canary.tick(EVERY, at(FIRST + 4.5 + EVERY - 0.1))
    assert canary.start is None
    canary.tick(EVERY, at(FIRST + 4.5 + EVERY))
    assert canary.start == WALL + FIRST + 4.5 + EVERY


def test_one_that_does_not_come_back_counts_once_an_interval_and_not_again_when_it_does(canary):
    for seconds in range(150):
        canary.tick(EVERY, at(FIRST + seconds))
    assert canary.times == times(missed=2)
    assert canary.start == WALL + FIRST  # how long it has been waited for
    canary.receive(posted(WALL + FIRST), "f", at(FIRST + 150))
    assert (canary.start, canary.times) == (None, times(missed=2))


@pytest.mark.parametrize(
    ("message", "of_the_fleet"),
    [
        (posted(WALL + FIRST - 0.1), 1),  # that of the other exporter of a pair, or an older one
        (posted("soon"), 1),
        (posted("nan"), 1),
        (posted(""), 1),
        (posted(WALL + FIRST, fleet="g"), 0),
        (posted(WALL + FIRST, alertname="RosDiagnosticsWatchdog"), 0),
    ],
)
def test_another_message_does_not_end_it(canary, message, of_the_fleet):
    assert canary.receive(message, "f", at(FIRST + 5)) == of_the_fleet
    assert (canary.start, canary.times) == (WALL + FIRST, times())


def test_a_message_that_comes_twice_counts_once(canary):
    for _ in range(2):
        canary.receive(posted(WALL + FIRST), "f", at(FIRST + 3))
    assert canary.times == times(3.0)


def test_a_shorter_interval_holds_at_once_and_none_ends_it(canary):
    canary.receive(posted(WALL + FIRST), "f", at(FIRST + 3))
    canary.tick(3600.0, at(FIRST + 4))
    canary.tick(EVERY, at(FIRST + 3 + EVERY))
    assert canary.start is not None
    canary.tick(None, at(FIRST + 4 + EVERY))
    assert (canary.start, canary.times) == (None, None)
    canary.receive(posted(WALL + FIRST + 3 + EVERY), "f", at(FIRST + 5 + EVERY))
    canary.tick(EVERY, at(FIRST + 6 + EVERY))
    assert canary.times == times(3.0)
