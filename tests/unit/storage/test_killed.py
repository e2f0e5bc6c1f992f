"""Killed at any moment, a process loses nothing that is older than a second.

A child runs the state and its database as the exporter does, with changes in the place of DDS, and
writes a journal of them; the next child goes on with the database and reports what it restored.
"""

import json
import os
import random
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

COMPONENTS = 20
ENVIRONMENT = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}

CHILD = """
import json, sys, threading, time
from pathlib import Path
from ros_diagnostics_exporter.events import EventLog, Wanted
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings, FaultSettings, Fleet, Profile, Robot, Source
)
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.storage.storage import Storage

def clocks():
    return Instant(time.monotonic(), time.time())

def journal(**entry):
    print(json.dumps(entry), flush=True)

def take_events():
    with recording:
        for event in state.take_events():
            log.record(event)

def save():
    global saving, slowest
    while True:
        time.sleep(0.1)  # as the service waits
        take_events()
        saving = time.monotonic()
        storage.save(state, log, clocks())
        slowest, saving = max(slowest, time.monotonic() - saving), None

saving, slowest = None, 0.0

profile = Profile(stale_after=5.0, confirm_after=0.2)
labels = {"site": "hall"}
robot = Robot("r", topic_raw="/r", source=Source.RAW, profile=profile, labels=labels)
path, turn = Path(sys.argv[1]), int(sys.stdin.readline())
# The parts flap, and are not to be one fault with the motor.
faults = FaultSettings(many=CauseSettings(number=100, share=1.0, absolute=None))
state = FleetState(Fleet("f", (robot,), faults=faults), clocks())
storage, recording = Storage(path), threading.Lock()
log = EventLog(storage.load(state, clocks()), storage.find_events)
storage.save(state, log, clocks())  # opens the database, from which the events are read
journal(
    components={each.name: each.message for each in state.robots["r"].components},
    faults=[
        [list(each.identity), each.since, dict(each.labels)]
        for each in state.faults() if each.identity.component == "Motor"
    ],
    events=[each["message"] for each in log.find(Wanted(kind="level", limit=1000))
            if "turn" in each.get("message", "")],
)
threading.Thread(target=save, daemon=True).start()
while True:
    turn += 1
    now = clocks()
    level = turn // 20 % 2 * 2
    changed = Status(level, f"c{turn % 20}", f"turn {turn}")
    state.receive(Topic(0, "/r"), Array(0.0, (Status(2, "Motor", "Hot"), changed), 100), now)
    state.tick(now)
    take_events()
    begun = saving
    waiting = 0.0 if begun is None else now.mono - begun
    journal(turn=turn, at=now.mono, disk=max(slowest, waiting))
    time.sleep(0.005)
"""


@contextmanager
def started(path: Path) -> Iterator[subprocess.Popen[str]]:
    """A child that begins when it is given a turn; started early, because imports take long."""
    command = [sys.executable, "-c", CHILD, str(path)]
    with subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=ENVIRONMENT
    ) as child:
        try:
            yield child
        finally:
            child.kill()


def killed(child: subprocess.Popen[str], turn: int, after: float) -> list[dict[str, Any]]:
    """The journal of a child that is killed some seconds after its first change."""
    assert child.stdin is not None
    assert child.stdout is not None
    print(turn, file=child.stdin, flush=True)
    journal = [json.loads(child.stdout.readline()), json.loads(child.stdout.readline())]
    end = time.monotonic() + after
    while time.monotonic() < end:
        journal.append(json.loads(child.stdout.readline()))
    child.kill()
    lines = [line for line in child.stdout if line.endswith("\n")]
    return journal + [json.loads(line) for line in lines]


def turn_of(message: str) -> int:
    return int(message.removeprefix("turn "))


def must_be_kept(changes: list[dict[str, Any]]) -> int:
    """The last change that is older than a second, and than what the machine was too busy for."""
    times = [each["at"] for each in changes]
    stall = max(later - time for time, later in pairwise(times))
    busy = stall + max(each["disk"] for each in changes)
    old = [each["turn"] for each in changes if each["at"] < times[-1] - 1.0 - busy]
    return max(old, default=0)


def check(restored: dict[str, Any], kept: int) -> None:
    """All that had changed up to ``kept`` is there."""
    for name, message in restored["components"].items():
        if name != "Motor":
            last = kept - (kept - int(name[1:])) % COMPONENTS
            assert turn_of(message) >= last, f"{name}: {message}"
    assert kept < COMPONENTS or len(restored["components"]) == COMPONENTS + 1
    turns = [turn_of(message) for message in restored["events"]]
    assert max(turns, default=0) >= kept
    assert len(set(turns)) == len(turns)


@pytest.mark.parametrize("rounds", [6, pytest.param(100, marks=pytest.mark.slow)])
def test_killed_at_any_moment_nothing_older_than_a_second_is_lost(path, rounds):
    moments = random.Random(rounds)
    turn = kept = compared = 0
    fault: list[Any] = []
    with ExitStack() as children:
        child = children.enter_context(started(path))
        for number in range(10 * rounds):
            # Of a busy machine's first rounds little may have to be there.
            if number >= rounds and fault and compared > rounds // 3:
                break
            following = children.enter_context(started(path))
            restored, *changes = killed(child, turn, moments.uniform(0.01, 2.2))
            check(restored, kept)
            compared += kept > 0
            assert fault in ([], restored["faults"])
            fault = fault or restored["faults"]
            turn, kept = changes[-1]["turn"], max(kept, must_be_kept(changes))
            child = following
    assert compared > rounds // 3
    assert len(fault) == 1
