"""What an earlier process left in the database, as far as it is valid."""

from __future__ import annotations

import json
import logging
import sqlite3
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pydantic_core
from pydantic import TypeAdapter, ValidationError

from ros_diagnostics_exporter.config.errors import first_error
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.events import Numbered, Wanted
from ros_diagnostics_exporter.faults import stored
from ros_diagnostics_exporter.faults.model import Row, fault_of
from ros_diagnostics_exporter.robots.persisted import Moment, PersistedRobot
from ros_diagnostics_exporter.storage.database import DamagedError, find_events

MAX_SALVAGED = 10_000  # events of a damaged file
MAX_NAME = 1024  # characters of a robot's name

log = logging.getLogger(__name__)

_ROBOT = TypeAdapter(PersistedRobot)
_SEEN = TypeAdapter(Moment | None)


@dataclass
class Found:
    """What an earlier process left.

    ``damage`` is what is wrong with the file, ``obstacle`` why nothing could be read, or "".
    """

    robots: dict[str, PersistedRobot] = field(default_factory=dict)
    rows: list[Row] = field(default_factory=list)
    last_event: int = 0
    written_at: float | None = None  # by its `AgeClock`
    damage: str = ""
    suffix: str = DamagedError.suffix
    obstacle: str = ""
    dropped: list[str] = field(default_factory=list)  # rows that are not valid, and why
    restored: str = ""  # what of a damaged file is restored, for the log
    salvaged: list[Numbered] = field(default_factory=list)

    def add_damage(self, what: str) -> None:
        """Note what is wrong; nothing where ``what`` is ""."""
        self.damage = "; ".join(filter(None, (self.damage, what)))

    def add_robots(self, stored_robots: Iterable[tuple[str, Any, Any]]) -> None:
        """Keep the valid ones of these: name, fields, and when last received, if later."""
        for name, fields, seen in stored_robots:
            robot = _robot(name, fields, seen)
            if isinstance(robot, PersistedRobot):
                self.robots[name] = robot
            else:
                self.dropped.append(f"robot {name!r:.60}: {robot}")

    def add_rows(self, stored_rows: Iterable[Any]) -> None:
        """Keep the valid rows of the faults."""
        self.rows, wrong = stored.parse(stored_rows)
        self.dropped += wrong

    def drop(self, rows: Iterable[Row]) -> None:
        """Leave out rows of the faults that refer to what is not there."""
        for row in rows:
            self.rows.remove(row)
            self.dropped.append(f"{stored.named(row)}: what it refers to is not there")


def decoded(text: Any) -> Any:
    """The content of a column with JSON; None if it has none."""
    try:
        return pydantic_core.from_json(text, allow_inf_nan=False)
    except (TypeError, ValueError):
        return None


def _robot(name: Any, fields: Any, seen: Any) -> PersistedRobot | str:
    """One robot, or what is wrong with it."""
    if not (isinstance(name, str) and name.isprintable() and 1 <= len(name) <= MAX_NAME):
        return "its name is not one of a robot"
    try:
        robot, last_seen = _ROBOT.validate_python(fields), _SEEN.validate_python(seen)
    except ValidationError as error:
        return first_error(error)
    return robot if last_seen is None else robot.seen_at(last_seen)


def event_fault(fleet: Fleet, event: str) -> str | None:
    """The id of the fault that an event of an earlier exporter is of; None of one of no fault."""
    try:
        return fault_of(fleet, json.loads(event))
    except (LookupError, ValueError, TypeError, AttributeError):
        return None  # of a scope or state that there no longer is, or damaged


def salvage(aside: Path, last: int) -> list[Numbered]:
    """The newest events of a damaged file, as far as they can be read, oldest first."""
    found: list[Numbered] = []
    try:
        found.extend(find_events(aside, Wanted(before=last + 1, limit=MAX_SALVAGED)))
    except sqlite3.Error as error:
        log.warning("%s: %d events of it are taken over: %s", aside, len(found), error)
    return found[::-1]
