"""What happened in a replay: faults with begin and end, and outages that were never faults."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from ros_diagnostics_exporter.config.fleet import Profile
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.fleet.state import FleetState

IDENTITY = (
    *("scope", "state", "site", "robot", "group", "component", "check", "key", "bound"),
    "severity",
)
Verdict = Literal["notified", "short", "suppressed", "silent"]
_RANKS = ("OK", "WARN", "STALE", "ERROR")  # the worse is further right


@dataclass
class Notification:
    """A fault: notified when it ``began``, and once more when it ended; None: it lasts.

    Both are the exporter's events; a fault's ``since`` is when the trouble began.
    """

    began: Event
    end: Event | None = None

    @property
    def since(self) -> float:
        """When the trouble began."""
        return self.began.time if self.began.since is None else self.began.since

    @property
    def ended(self) -> float | None:
        """When the fault did; None: it lasts."""
        return None if self.end is None else self.end.time

    @property
    def identity(self) -> tuple[str, ...]:
        """Which fault it is: its labels."""
        return identity(self.began)

    def duration(self, until: float) -> float:
        """Seconds in trouble, for one that lasts ``until`` then."""
        return (until if self.end is None else self.end.time) - self.since


def identity(event: Event) -> tuple[str, ...]:
    """Which fault an event is about."""
    return tuple(str(getattr(event, name)) for name in IDENTITY)


@dataclass
class Outage:
    """A component was not OK, or a robot silent (no component), from ``begin`` to ``end``.

    ``worst`` is the worst level, or "silent". ``verdict``: a fault came of it (notified), it was
    over before it was confirmed (short), or something suppressed it: maintenance, flapping, a
    condition, a larger cause. ``ended`` is False for one that lasts.
    """

    robot: str
    group: str
    component: str
    begin: float
    worst: str
    end: float = 0.0
    ended: bool = True
    verdict: Verdict = "short"

    @property
    def seconds(self) -> float:
        """How long it was."""
        return self.end - self.begin


class History:
    """Reads a state after each message and tick."""

    def __init__(self) -> None:
        self.notifications: list[Notification] = []
        self._lasting: dict[tuple[str, ...], Notification] = {}
        self._open: dict[tuple[str, str, str], Outage] = {}
        self._over: list[Outage] = []

    def note(self, state: FleetState) -> None:
        """Note what began and ended since the last call."""
        for event in state.take_events():
            robot = state.robots.get(event.robot)
            if event.kind == "fault_began":
                self._lasting[identity(event)] = Notification(event)
                self.notifications.append(self._lasting[identity(event)])
            elif event.kind == "fault_ended":
                self._lasting.pop(identity(event)).end = event
            elif event.kind == "level":
                self._level(event, up=robot is not None and robot.up)
            elif event.kind == "robot":
                last = 0.0 if robot is None else robot.last_wall
                self._robot(event, last)

    # -- outages -----------------------------------------------------------------------------

    def _level(self, event: Event, *, up: bool) -> None:
        key = event.robot, event.group, event.component
        outage = self._open.get(key)
        if event.after not in _RANKS or event.after == "OK":  # healthy, or removed
            self._end(key, event.time)
        elif outage is not None:
            outage.worst = max(outage.worst, event.after, key=_RANKS.index)
        elif up or event.after != "STALE":  # else its robot is silent: no trouble of its own
            self._open[key] = Outage(*key, event.time, event.after)

    def _robot(self, event: Event, last: float) -> None:
        key = event.robot, "", ""
        if event.after == "silent":
            self._open.setdefault(key, Outage(*key, last, "silent"))
        else:
            self._end(key, event.time)

    def _end(self, key: tuple[str, str, str], wall: float) -> None:
        outage = self._open.pop(key, None)
        if outage is not None:
            outage.end = wall
            self._over.append(outage)

    def outages(self, state: FleetState, until: float) -> list[Outage]:
        """All outages, by their begin, those that last ``until`` then included."""
        for outage in self._open.values():
            outage.end, outage.ended = until, False
        found = sorted((*self._over, *self._open.values()), key=lambda each: each.begin)
        notified = self._notified(until)
        for outage in found:
            spans = notified.get((outage.robot, outage.group, outage.component), ())
            if any(begin <= outage.end and outage.begin <= end for begin, end in spans):
                outage.verdict = "notified"
            elif outage.seconds >= confirm_after(state, outage.robot, outage.component):
                outage.verdict = "suppressed"
        return found

    def _notified(self, until: float) -> dict[tuple[str, str, str], list[tuple[float, float]]]:
        spans: dict[tuple[str, str, str], list[tuple[float, float]]] = {}
        for each in self.notifications:
            began = each.began
            if began.scope in {"component", "robot"}:
                key = began.robot, began.group, began.component
                end = until if each.ended is None else each.ended
                spans.setdefault(key, []).append((began.time, end))
        return spans


def confirm_after(state: FleetState, robot: str, component: str = "") -> float:
    """Seconds in trouble after which a component's problem is confirmed, or a robot's silence."""
    known = state.robots.get(robot)
    profile = Profile() if known is None else known.settings.profile
    if not component:
        return profile.stale_after + profile.confirm_after
    for each in () if known is None else known.components:
        own = None if each.rule is None else each.rule.confirm_after
        if each.name == component and own is not None:
            return own
    return profile.confirm_after
