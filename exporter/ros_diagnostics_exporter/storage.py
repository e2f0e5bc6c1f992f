"""The state file: what is known about the robots outlives the process.

One JSON file, replaced as a whole: written beside itself, flushed to the disk and renamed, so that
it is whole whenever the process or the machine dies. Written at most once a second, and only when
something worth remembering changed. A disk that refuses, or a file that cannot be read, is said
and survived.
"""

from __future__ import annotations

import json
import logging
import os
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.diagnostics import Instant
from ros_diagnostics_exporter.state.flapping import SLOTS
from ros_diagnostics_exporter.state.fleet import State
from ros_diagnostics_exporter.state.remembered import RememberedComponent, RememberedRobot

VERSION = 1
INTERVAL = 1.0  # seconds between two writes at least
LAST_SEEN_INTERVAL = 60.0  # when nothing but "last seen" has changed
LOG_INTERVAL = 60.0

log = logging.getLogger(__name__)


class Storage:
    """Reads the state file once and keeps it written.

    ``successful`` tells of the last attempt to write, ``written_at`` is the Unix time of the last
    that succeeded (0 before the first).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.successful = True
        self.written_at = 0.0
        self._tried_at = float("-inf")
        self._logged_at = float("-inf")
        self._robots: dict[str, tuple[tuple[int, int], str]] = {}

    def load(self, state: State, now: Instant) -> None:
        """Put back what a former process knew; a file that cannot be used is said and kept aside.

        Aside means: renamed to ``<path>.unreadable``, so that nothing is lost.
        """
        try:
            text = self._path.read_text("utf-8")
        except FileNotFoundError:
            return
        except OSError as error:
            log.error("state file %s cannot be read (%s): starting without it", self._path, error)
            return
        try:
            robots = _parse(text)
        except (ValueError, KeyError, TypeError) as error:
            aside = self._path.with_name(self._path.name + ".unreadable")
            log.error(
                "state file %s is damaged (%s): starting without it, it is kept as %s",
                self._path,
                error,
                aside,
            )
            self._set_aside(aside)
            return
        state.restore(robots, now)

    def _set_aside(self, aside: Path) -> None:
        try:
            self._path.replace(aside)
        except OSError as error:
            log.error("state file %s cannot be renamed: %s", self._path, error)

    def save(self, state: State, now: Instant, *, at_once: bool = False) -> None:
        """Write what changed since the last time, if a second has passed since then."""
        if not at_once and now.mono - self._tried_at < INTERVAL:
            return
        changed = self._encode(state, now)
        if not changed and now.wall - self.written_at < LAST_SEEN_INTERVAL and not at_once:
            return
        self._tried_at = now.mono
        try:
            self._write(now)
        except OSError as error:
            self.successful = False
            self._robots = {}  # encoded again, and so tried again, next time
            if now.mono - self._logged_at >= LOG_INTERVAL:
                self._logged_at = now.mono
                log.error("state file %s cannot be written: %s", self._path, error)
        else:
            self.successful = True
            self.written_at = now.wall

    def _encode(self, state: State, now: Instant) -> bool:
        """Encode the robots that changed; whether there was one, or one has gone."""
        known: dict[str, tuple[tuple[int, int], str]] = {}
        changed = False
        for robot in state.each():
            with state.lock:
                versions = (robot.versions.structure, robot.versions.levels)
                name = robot.settings.name
                kept = self._robots.get(name)
                if kept is None or kept[0] != versions:
                    kept = versions, json.dumps(robot.remember(now)._asdict())
                    changed = True
            known[name] = kept
        changed = changed or known.keys() != self._robots.keys()
        self._robots = known
        return changed

    def _write(self, now: Instant) -> None:
        robots = ",\n".join(
            f"{json.dumps(name)}:{text}" for name, (_v, text) in self._robots.items()
        )
        beside = self._path.with_name(self._path.name + ".new")
        with beside.open("w", encoding="utf-8") as file:
            file.write(
                f'{{"version":{VERSION},"written":{now.wall!r},"robots":{{\n{robots}\n}}}}\n'
            )
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self._path)


def _parse(text: str) -> dict[str, RememberedRobot]:
    content = json.loads(text)
    if content["version"] != VERSION:
        raise ValueError(f"its version is {content['version']}, not {VERSION}")
    return {
        str(name): RememberedRobot(
            **{**robot, "components": [_component(each) for each in robot["components"]]}
        )
        for name, robot in content["robots"].items()
    }


def _component(fields: dict[str, Any]) -> RememberedComponent:
    name, group, parting = fields["identity"]
    slots = tuple(int(slot) for slot in fields["slots"])
    if len(slots) != SLOTS:
        raise ValueError(f"component {name!r} has {len(slots)} slots, not {SLOTS}")
    return RememberedComponent(**{**fields, "identity": (name, group, parting), "slots": slots})
