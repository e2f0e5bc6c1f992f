"""The fleet in real time: advances its clock with the real one, and lets faults in between.

The only file that reads a clock and sleeps. Knows no ROS: it is handed what takes the happenings.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from virtual_robots.schema.documents import DocumentError
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.life import order, order_of
from virtual_robots.simulation.members import Happening

# Waking up for every single one of a thousand robots would cost more than their messages.
SHORTEST_SLEEP = 0.005
LONGEST_SLEEP = 0.2  # an order from outside shall not wait for the next message of some robot
LOOK_AT_FILES_EVERY = 1.0
TOO_LATE = 1.0
COMPLAIN_AGAIN_AFTER = 60.0

Take = Callable[[Happening, float], None]


class Player:
    """Plays a fleet.

    ``take`` is called with each happening and the fleet's start (seconds since the epoch);
    ``complain`` with a text when a settings file that changed cannot be used, or when this machine
    is too slow for the fleet.
    """

    def __init__(self, fleet: Fleet, take: Take, complain: Callable[[str], None]) -> None:
        self._fleet = fleet
        self._take = take
        self._complain = complain
        self._lock = threading.Lock()
        self._files = {
            member.spec.settings: _changed_at(member.spec.settings)
            for member in fleet.members.values()
            if member.spec.settings is not None
        }
        self._look_at = LOOK_AT_FILES_EVERY
        self._may_complain_at = 0.0

    def play(self, stop: threading.Event, until: float = float("inf")) -> None:
        """Let happen what is due when it is due, until ``stop`` is set or ``until`` (s) is over."""
        started, started_wall = time.monotonic(), time.time()
        while not stop.is_set():
            now = min(time.monotonic() - started, until)
            self._judge_delay(now)
            with self._lock:
                for happening in self._fleet.advance(now):
                    self._take(happening, started_wall)
                self._look_at_files(now)
            if now >= until:
                return
            wait = min(self._fleet.next_at(), until) - (time.monotonic() - started)
            stop.wait(min(max(SHORTEST_SLEEP, wait), LONGEST_SLEEP))

    def inject(self, target: str, wanted: str) -> None:
        """Obey an order to a component or a robot, from any thread.

        They are `ROBOT.COMPONENT` and `LEVEL[: MESSAGE]`, or `ROBOT` and `WHAT[: NUMBER]`.
        Raises ValueError or KeyError with the reason to refuse it.
        """
        robot, _, component = target.partition(".")
        with self._lock:
            if component:
                what, _, message = (part.strip() for part in wanted.partition(":"))
                fault = None if what == "ok" else Fault(what, self._fleet.now, message)
                self._fleet.inject(robot, component, fault)
                return
            self._fleet.member(robot)
            deed = order_of(wanted)
            self._fleet.plan(self._fleet.now, lambda _: order(self._fleet, robot, deed))

    def _judge_delay(self, now: float) -> None:
        """A fleet that cannot keep up must not be taken for one that loses messages."""
        delay = now - self._fleet.next_at()
        if delay > TOO_LATE and now >= self._may_complain_at:
            self._may_complain_at = now + COMPLAIN_AGAIN_AFTER
            self._complain(f"the robots are {delay:.1f} s late: too many for this machine now")

    def _look_at_files(self, now: float) -> None:
        if now < self._look_at or not self._files:
            return
        self._look_at = now + LOOK_AT_FILES_EVERY
        for path, changed_at in self._files.items():
            latest = _changed_at(path)
            if latest not in {None, changed_at}:
                self._files[path] = latest
                try:
                    self._fleet.reload(path)
                except DocumentError as error:
                    self._complain(f"{error}\n{path}: the settings from before stay in force")


def _changed_at(path: Path) -> int | None:
    """When the file was last written; None while an editor replaces it: it is empty or gone."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return status.st_mtime_ns if status.st_size else None
