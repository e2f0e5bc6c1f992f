"""The fleet in real time: advances its clock with the real one, and lets faults in between.

The only file that reads a clock and sleeps. Knows no ROS: it is handed what publishes.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable

from virtual_robots.components import Fault
from virtual_robots.fleet import Fleet, Message

# Waking up for every single one of a thousand robots would cost more than their messages.
SHORTEST_SLEEP = 0.005

Publish = Callable[[Message, float], None]


class Player:
    """Plays a fleet; its methods may be called from any thread."""

    def __init__(self, fleet: Fleet, publish: Publish) -> None:
        self._fleet = fleet
        self._publish = publish
        self._lock = threading.Lock()
        self._started = time.monotonic()
        self._started_wall = time.time()
        self.worst_delay = 0.0

    def play(self, stop: threading.Event, until: float = float("inf")) -> None:
        """Publish what is due when it is due, until ``stop`` is set or ``until`` (s) is reached."""
        while not stop.is_set():
            now = min(time.monotonic() - self._started, until)
            self.worst_delay = max(self.worst_delay, now - self._fleet.next_at())
            with self._lock:
                for message in self._fleet.advance(now):
                    self._publish(message, self._started_wall)
            if now >= until:
                return
            wait = min(self._fleet.next_at(), until) - (time.monotonic() - self._started)
            stop.wait(max(SHORTEST_SLEEP, wait))

    def inject(self, target: str, order: str) -> None:
        """Obey `ROBOT.COMPONENT` and `LEVEL[: MESSAGE]`. Raises ValueError or KeyError."""
        robot, _, component = target.partition(".")
        what, _, message = (part.strip() for part in order.partition(":"))
        with self._lock:
            fault = None if what == "ok" else Fault(what, self._fleet.now, message)
            self._fleet.inject(robot, component, fault)
