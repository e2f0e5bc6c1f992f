"""The fleet in real time: advances its clock with the real one, and injects faults in between.

The only file that reads a clock and sleeps. It does not import ROS.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from pathlib import Path

from virtual_robots.schema.documents import DocumentError
from virtual_robots.simulation.components import Fault
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.outputs import Output
from virtual_robots.simulation.robot_events import parse_event, trigger

# Waking up for every single one of a thousand robots would cost more than their messages.
SHORTEST_SLEEP = 0.005
LONGEST_SLEEP = 0.2  # an injected fault shall not wait for the next message of some robot
CHECK_FILES_EVERY = 1.0
TOO_LATE = 1.0
WARN_AGAIN_AFTER = 60.0

Publish = Callable[[Output, float], None]


class Player:
    """Plays a fleet.

    ``publish`` is called with each output and the fleet's start (seconds since the epoch); ``warn``
    with a text when a changed settings file is rejected, or when this machine is too slow.
    """

    def __init__(self, fleet: Fleet, publish: Publish, warn: Callable[[str], None]) -> None:
        self._fleet = fleet
        self._publish = publish
        self._warn = warn
        self._lock = threading.Lock()
        self._files = {
            robot.spec.settings: _changed_at(robot.spec.settings)
            for robot in fleet.robots.values()
            if robot.spec.settings is not None
        }
        self._next_check = CHECK_FILES_EVERY
        self._next_warning = 0.0

    def play(self, stop: threading.Event, until: float = float("inf")) -> None:
        """Run the fleet in real time until ``stop`` is set or ``until`` seconds have passed."""
        started, started_wall = time.monotonic(), time.time()
        while not stop.is_set():
            now = min(time.monotonic() - started, until)
            self._warn_if_late(now)
            with self._lock:
                for output in self._fleet.advance(now):
                    self._publish(output, started_wall)
                self._check_files(now)
            if now >= until:
                return
            wait = min(self._fleet.next_at(), until) - (time.monotonic() - started)
            stop.wait(min(max(SHORTEST_SLEEP, wait), LONGEST_SLEEP))

    def inject(self, target: str, value: str) -> None:
        """Inject a component's fault or a robot's event, from any thread.

        ``target`` and ``value`` are `ROBOT.COMPONENT` and `LEVEL[: MESSAGE]`, or `ROBOT` and
        `WHAT[: NUMBER]`. Raises ValueError or KeyError with the reason for a rejection.
        """
        robot, _, component = target.partition(".")
        with self._lock:
            if component:
                what, _, message = (part.strip() for part in value.partition(":"))
                fault = None if what == "ok" else Fault(what, self._fleet.now, message)
                self._fleet.inject(robot, component, fault)
                return
            self._fleet.robot(robot)
            event = parse_event(value)
            self._fleet.schedule(self._fleet.now, lambda _: trigger(self._fleet, robot, event))

    def _warn_if_late(self, now: float) -> None:
        """Warn, so that a slow machine is not mistaken for lost messages."""
        delay = now - self._fleet.next_at()
        if delay > TOO_LATE and now >= self._next_warning:
            self._next_warning = now + WARN_AGAIN_AFTER
            self._warn(f"the robots are {delay:.1f} s late: too many for this machine now")

    def _check_files(self, now: float) -> None:
        if now < self._next_check or not self._files:
            return
        self._next_check = now + CHECK_FILES_EVERY
        for path, changed_at in self._files.items():
            latest = _changed_at(path)
            if latest not in {None, changed_at}:
                self._files[path] = latest
                try:
                    self._fleet.reload(path)
                except DocumentError as error:
                    self._warn(f"{error}\n{path}: keeping the previous settings")


def _changed_at(path: Path) -> int | None:
    """When the file was last written; None while an editor replaces it: it is empty or gone."""
    try:
        status = path.stat()
    except FileNotFoundError:
        return None
    return status.st_mtime_ns if status.st_size else None
