"""What was notified here, as Nagios' services would have been: the exporter's recorded events.

A service of Nagios that runs `check_ros_diagnostics` is about all components whose path contains
its pattern, and in the worst of their states; STALE is CRITICAL there, and a silent robot's
services are UNKNOWN. So the faults of which somebody was notified are followed in that way.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ros_diagnostics_tools.nagios.comparison.notice import HOST, Notice

OF_FAULT = {
    "warning": "WARNING",
    "falling": "WARNING",
    "intermittent": "WARNING",
    "critical": "CRITICAL",
    "stale": "CRITICAL",
}
WORST = ("UNKNOWN", "CRITICAL", "WARNING")
TOGETHER = 15.0  # seconds within which messages about one change come one after the other


Patterns = Mapping[str, str]


class EventsError(Exception):
    """What is given is no answer of the exporter's /api/v1/events."""


@dataclass(frozen=True)
class Larger:
    """A notification about many robots or components at once, in place of one for each."""

    time: float
    ended: float | None
    name: str
    robot: str = ""  # "" for all
    component: str = ""  # "" for all

    def covers(self, notice: Notice, within: float) -> bool:
        """Whether what ``notice`` is about may be part of it."""
        if self.robot not in ("", notice.robot):
            return False
        if self.component and notice.service == HOST:
            return False
        end = notice.time if self.ended is None else self.ended
        return self.time - within <= notice.time <= end + within


@dataclass
class _Service:
    """One service, or the robot itself: what of it was notified and lasts.

    ``ended`` is the last of its notices, where that is about an end.
    """

    lasting: dict[tuple[str, ...], str] = field(default_factory=dict)  # fault -> state
    notices: list[Notice] = field(default_factory=list)
    ended: Notice | None = None


@dataclass
class Here:
    """What was notified here: ``notices`` in Nagios' terms, ``larger`` what is many at once.

    ``robots`` are those that anything was recorded of.
    """

    notices: list[Notice] = field(default_factory=list)
    larger: list[Larger] = field(default_factory=list)
    robots: set[str] = field(default_factory=set)


def notified_here(
    events: Iterable[Mapping[str, Any]], services: Iterable[tuple[str, str]], patterns: Patterns
) -> Here:
    """The events of kind ``notified`` as notifications about services.

    Args:
        events: As /api/v1/events has them, in any order.
        services: Robot and service of all that Nagios has notified.
        patterns: Service -> what the path of its components contains, where not its name.

    Raises:
        EventsError: An event lacks what each has.
    """
    try:
        ordered = sorted(_notified(events), key=lambda event: (event["time"], event["id"]))
    except (KeyError, TypeError, AttributeError) as error:
        raise EventsError(f"an event has no valid {error}") from error
    known: dict[str, set[str]] = {}
    for robot, service in services:
        known.setdefault(robot, set()).add(service)
    found, tracks = Here(), dict[tuple[str, str], _Service]()
    larger: dict[tuple[str, ...], int] = {}
    for event in ordered:
        found.robots.add(event["robot"])
        if event["scope"] == "exporter":
            continue  # of the exporter
        if event["scope"] in ("site", "common") or event["state"] == "many":
            _add_larger(found, larger, event)
            continue
        for service in _services_of(event, known.get(event["robot"], set()), patterns):
            track = tracks.setdefault((event["robot"], service), _Service())
            _add(track, service, event)
    found.notices = [each for track in tracks.values() for each in track.notices]
    return found


def _notified(events: Iterable[Mapping[str, Any]]) -> Iterable[dict[str, Any]]:
    usual = dict.fromkeys(("robot", "group", "component", "check", "key", "bound", "site"), "")
    for event in events:
        if event["kind"] == "notified" and event.get("step", "") == "":
            yield {**usual, **{name: event[name] for name in ("scope", "state", "after")}, **event}


def _fault(event: Mapping[str, Any]) -> tuple[str, ...]:
    names = ("scope", "state", "site", "robot", "group", "component", "check", "key", "bound")
    return tuple(str(event[name]) for name in names)


def _services_of(event: Mapping[str, Any], known: set[str], patterns: Patterns) -> Iterable[str]:
    """The services that an event is about; of a component of none, the component itself."""
    if event["scope"] == "robot":
        return [HOST, *(sorted(known - {HOST}) if event["state"] == "silent" else ())]
    path = f"{event['group']}/{event['component']}"
    if event["check"]:
        path = event["check"]
    named = [each for each in known - {HOST} if _contains(path, patterns.get(each, each))]
    return sorted(named) or [event["component"] or event["check"]]


def _contains(path: str, pattern: str) -> bool:
    return pattern.casefold() in path.casefold()


def _add(track: _Service, service: str, event: Mapping[str, Any]) -> None:
    firing = event["after"] == "firing"
    of, state = (event["robot"], service), event["state"]
    detail = str(event["component"] or event["check"])
    if state == "flapping":
        word = "FLAPPINGSTART" if firing else "FLAPPINGSTOP"
        track.notices.append(Notice(event["time"], *of, word, detail))
        return
    if service == HOST:
        if state == "silent":
            word = "DOWN" if firing else "UP"
            track.notices.append(Notice(event["time"], *of, word, detail))
        return
    before = _worst(track.lasting)
    if firing:
        track.lasting[_fault(event)] = OF_FAULT.get(state, "UNKNOWN")
    else:
        track.lasting.pop(_fault(event), None)
    now = _worst(track.lasting)
    if now == before:
        return
    if track.ended is not None and event["time"] - track.ended.time < TOGETHER:
        track.notices.remove(track.ended)  # the WARNING below a CRITICAL ends or goes on with it
    notice = Notice(event["time"], *of, now, detail)
    track.notices.append(notice)
    track.ended = None if firing else notice


def _worst(lasting: Mapping[tuple[str, ...], str]) -> str:
    return next((state for state in WORST if state in lasting.values()), "OK")


def _add_larger(here: Here, larger: dict[tuple[str, ...], int], event: Mapping[str, Any]) -> None:
    fault = _fault(event)
    if event["after"] != "firing":
        if fault in larger:
            number = larger.pop(fault)
            here.larger[number] = replace(here.larger[number], ended=event["time"])
        return
    if fault not in larger:
        part = event["site"] if event["scope"] == "site" else event["component"] or event["robot"]
        name = f"{event['scope']} {part}".strip()
        larger[fault] = len(here.larger)
        here.larger.append(Larger(event["time"], None, name, event["robot"], event["component"]))
