"""An exporter's database as a recording: its events of levels and silence, as messages again.

What a robot published can only be guessed from them: an array with all of its components every
HEARTBEAT, from the event that it was received until `stale_after` before the one that it is silent.
So levels are judged to the message, and values, gaps between messages and the exporter's own
restarts are not known.
"""

from __future__ import annotations

import heapq
import json
import sqlite3
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from math import inf
from operator import itemgetter
from pathlib import Path

from pydantic import TypeAdapter, ValidationError

from ros_diagnostics_exporter.config.fleet import Fleet, Source
from ros_diagnostics_exporter.config.fleet import Robot as RobotSettings
from ros_diagnostics_exporter.events import Event, Wanted
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Instant, Level, Status, Topic
from ros_diagnostics_exporter.robots.persisted import PersistedRobot
from ros_diagnostics_exporter.storage.database import find_events, reading
from ros_diagnostics_exporter.storage.schema import APPLICATION, VERSION
from ros_diagnostics_tools import limits

HEARTBEAT = 1.0  # seconds between two arrays of a robot
_ROBOT = TypeAdapter(PersistedRobot)
_LEVELS = {"OK": Level.OK, "WARN": Level.WARN, "ERROR": Level.ERROR, "STALE": Level.STALE}
_Name = tuple[str, str]  # group, component
_Row = tuple[float, str, Array]


class EventLogError(Exception):
    """The database cannot be read; the text says why."""


def is_event_log(path: Path) -> bool:
    """Whether a file is an exporter's database, by its header; a bag in SQLite is not."""
    try:
        with path.open("rb") as file:
            return file.read(72)[68:] == APPLICATION.to_bytes(4, "big")
    except OSError:  # who reads it names what is wrong
        return False


class EventLog:
    """The database at ``path``, read by the robots of ``fleet``, as the exporter had it.

    ``places`` are the robots' topics by name, ``unknown`` the robots that the fleet does not have.

    Raises:
        EventLogError: it is damaged or of another version, or has no events.
    """

    def __init__(self, path: Path, fleet: Fleet) -> None:
        try:
            persisted = dict(_robots(path))
            events = list(find_events(path, Wanted(limit=-1)))[::-1]
        except (sqlite3.Error, ValidationError) as error:
            raise EventLogError(f"is no database of this version: {error}") from error
        self._timelines = _timelines((event for _number, event in events), persisted)
        if not self._timelines:
            raise EventLogError("has no events of robots")
        times = [event.time for _number, event in events]
        self.begin, self.end = min(times), max(times)
        settings = _settings(fleet, persisted, self.end)
        self.places = {
            name: _topic(settings[name], persisted.get(name))
            for name in self._timelines
            if name in settings
        }
        self.unknown = sorted(self._timelines.keys() - self.places.keys())
        self.others: dict[str, str] = {}
        self.warnings: list[str] = []
        self._stale_after = {name: settings[name].profile.stale_after for name in self.places}
        self.topics = set(self.places)
        self.count = round((self.end - self.begin) / HEARTBEAT) * len(self.places)

    def messages(self) -> Iterator[_Row]:
        """The arrays of all robots in order of time, by the robot's name."""
        robots = (self._of_robot(name) for name in self.places)
        return heapq.merge(*robots, key=itemgetter(0))

    def _of_robot(self, name: str) -> Iterator[_Row]:
        timeline, stale_after = self._timelines[name], self._stale_after[name]
        raw = not self.places[name].name.endswith("_agg")
        levels, up, at = timeline.at_first(), timeline.up, self.begin
        silent = [step.at for step in timeline.steps if step.up is False]
        for step in (*timeline.steps, _Step(self.end, {}, None)):
            while silent and silent[0] < step.at:
                silent.pop(0)
            last = silent[0] - stale_after if silent else inf  # of its messages
            while up and at < min(step.at, last):
                yield at, name, _array(levels, raw=raw)
                at += HEARTBEAT
            at = max(at, step.at)
            levels.update(step.levels)
            up = up if step.up is None else step.up
            if up and step.at < last:
                yield step.at, name, _array(levels, raw=raw)
                at = step.at + HEARTBEAT

    def close(self) -> None:
        """Nothing is open."""


@dataclass
class _Step:
    """What changed of a robot at one time; ``up``: it was received again, or no longer."""

    at: float
    levels: dict[_Name, tuple[Level, str]]
    up: bool | None


@dataclass
class _Timeline:
    """A robot as the log has it.

    ``first`` are its components before the first step; None: it was not known then.
    """

    first: dict[_Name, tuple[Level, str] | None]
    up: bool
    steps: list[_Step]

    def at_first(self) -> dict[_Name, tuple[Level, str]]:
        """The components that were known before the first step."""
        return {name: known for name, known in self.first.items() if known is not None}


def _robots(path: Path) -> Iterator[tuple[str, PersistedRobot]]:
    with reading(path) as connection:
        [(version,)] = connection.execute("PRAGMA user_version")
        if version != VERSION:
            raise EventLogError(f"has version {version}, and this program reads {VERSION}")
        if not limits.held_columns(connection) >= {("robots", "data"), ("events", "data")}:
            raise EventLogError("has no tables robots and events")
        for name, data in connection.execute("SELECT name, data FROM robots WHERE name <> ''"):
            yield name, _ROBOT.validate_python(json.loads(data))


def _settings(
    fleet: Fleet, persisted: Mapping[str, PersistedRobot], wall: float
) -> dict[str, RobotSettings]:
    """The settings of the robots that the fleet declares, or would discover by their topics."""
    state = FleetState(fleet, Instant(0.0, wall))
    state.restore(persisted, Instant(0.0, wall))
    return {each.name: each for each in state.visit(lambda robot: robot.settings)}


def _topic(settings: RobotSettings, known: PersistedRobot | None) -> Topic:
    raw = known is not None and known.source == Source.RAW.value
    names = (settings.topic_raw, settings.topic_agg)
    return Topic(settings.domain_id, next(filter(None, names if raw else names[::-1]), ""))


def _timelines(
    events: Iterable[Event], persisted: Mapping[str, PersistedRobot]
) -> dict[str, _Timeline]:
    found: dict[str, _Timeline] = {}
    now = -inf
    for event in events:
        now = max(now, event.time)  # whatever the wall clock was set to
        if event.kind not in {"level", "robot"}:
            continue
        robot = found.get(event.robot)
        if robot is None:
            robot = found[event.robot] = _Timeline({}, up=True, steps=[])
            if event.kind == "robot":
                robot.up = event.after == "silent"
        if not robot.steps or robot.steps[-1].at != now:
            robot.steps.append(_Step(now, {}, None))
        _note(robot, robot.steps[-1], event)
    for name, robot in found.items():
        for each in persisted[name].components if name in persisted else ():
            level = Level(each.level if each.before_stale is None else each.before_stale)
            robot.first.setdefault((each.group, each.identity[0]), (level, each.message))
    return found


def _note(robot: _Timeline, step: _Step, event: Event) -> None:
    if event.kind == "robot":
        step.up = event.after == "received" if event.after != "known" else step.up
        return
    name = event.group, event.component
    known = (_LEVELS[event.before], "") if event.before else None  # "": first received then
    robot.first.setdefault(name, known)
    if event.after in _LEVELS:  # else it was forgotten
        step.levels[name] = _LEVELS[event.after], event.message


def _array(levels: Mapping[_Name, tuple[Level, str]], *, raw: bool) -> Array:
    # As numbers, as they are received: the samples show them as they are.
    if raw:
        of_raw = (Status(int(level), name, text) for (_, name), (level, text) in levels.items())
        return Array(0.0, tuple(of_raw))
    groups: dict[str, list[tuple[str, str]]] = {}
    rows = []
    for (group, name), (level, text) in levels.items():
        groups.setdefault(group, []).append((name, text))  # as an aggregator names its components
        rows.append(Status(int(level), f"{group}/{name.replace('/', ' ')}", text))
    headers = (Status(int(Level.OK), each, "", "", tuple(named)) for each, named in groups.items())
    return Array(0.0, (*(each for each in headers if each.name), *rows))
