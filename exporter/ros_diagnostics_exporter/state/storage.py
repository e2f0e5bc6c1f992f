"""The state file: what is known about the robots outlives the process.

One JSON file, replaced as a whole: written to a temporary file, flushed to the disk and renamed, so
that it is complete whenever the process or the machine dies. Written at most once a second, and
only when something changed. The exporter starts and runs without it: a damaged file is kept aside,
one that cannot be read is left alone, and a failed write is retried.
"""

from __future__ import annotations

import json
import logging
import os
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, NamedTuple

import pydantic_core
from pydantic import Field, TypeAdapter, ValidationError

from ros_diagnostics_exporter.faults.flapping import SLOTS
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.files import read_regular
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.state import fault_rows
from ros_diagnostics_exporter.state.limits import MAX_TEXT

if TYPE_CHECKING:  # these import the types below
    from ros_diagnostics_exporter.state.robot import Robot
    from ros_diagnostics_exporter.state.state import State

VERSION = 1
INTERVAL = 1.0  # seconds between two writes at least
LAST_SEEN_INTERVAL = 60.0  # when nothing but "last seen" has changed
LOG_INTERVAL = 60.0
MAX_BYTES = 128 * 1024 * 1024  # 100,000 components take some 40 MB
MAX_ASIDE = 10  # damaged files that are kept
MAX_NAME = 1024  # characters of a robot's name

log = logging.getLogger(__name__)

# Limits for what is read from the file: whatever passes them can be restored and shown.
_Level = Annotated[int, Field(ge=0, le=3)]
_Moment = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
_Text = Annotated[str, Field(max_length=MAX_TEXT)]


class PersistedComponent(NamedTuple):
    """One component; ``identity`` as in ``component``, times are Unix time."""

    identity: tuple[_Text, _Text, _Text]
    group: _Text
    hardware_id: _Text
    level: _Level
    before_stale: _Level | None
    since: _Moment
    problem_since: _Moment | None
    message: _Text
    slots: Annotated[tuple[_Level, ...], Field(min_length=SLOTS, max_length=SLOTS)]
    listed: _Moment
    was_ok: bool | None = None  # when last received; None: written by an earlier version


class PersistedRobot(NamedTuple):
    """One robot; ``source`` as decided, ``topic`` where it was discovered or declared."""

    domain_id: Annotated[int, Field(ge=0, le=232)]
    topic: _Text
    source: Literal["agg", "raw", "both", "auto"]
    last_seen: _Moment
    components: list[PersistedComponent]

    def as_json(self) -> dict[str, Any]:
        """The fields by name, those of the components, too."""
        return {
            **self._asdict(),
            "components": [component._asdict() for component in self.components],
        }


_Key = tuple[int, int, int, int]
_ROBOT = TypeAdapter(PersistedRobot)


class Storage:
    """Reads the state file at the start and writes it from then on.

    ``successful``: the last write succeeded, and no unreadable file prevents writing.
    ``written_at`` is the Unix time of the last write that succeeded (0 before the first).
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        self.successful = True
        self.written_at = 0.0
        self._blocked = False  # by a file that could not be read, and so is not overwritten
        self._tried_at = float("-inf")
        self._logged_at = float("-inf")
        self._robots: dict[str, tuple[_Key, str]] = {}
        self._fault_rows: list[Row] = []

    def load(self, state: State, now: Instant) -> None:
        """Restore what an earlier process knew.

        A damaged file is renamed to the first free of ``<path>.damaged-1`` to ``-10``, and what is
        valid in it is restored. One that cannot be read is left alone, and nothing is saved until
        it is moved away.
        """
        try:
            raw = read_regular(self._path, MAX_BYTES + 1, follow=False)
        except FileNotFoundError:
            return
        except OSError as error:
            self._block(f"cannot be read ({error.strerror}): starting without it")
            return
        robots, rows, wrong = _parse(raw)
        state.restore(robots, now)
        try:
            state.restore_faults(rows, now)
        except (LookupError, TypeError, ValueError) as error:
            wrong = f"{wrong}; " if wrong else ""
            wrong += f"its faults do not belong together: {error!r:.80}; none is restored"
        if wrong:
            self._set_aside(wrong, len(robots))

    def _block(self, what: str) -> None:
        self._blocked, self.successful = True, False
        log.error(
            "state file %s %s; nothing is saved until it is moved away, "
            "or is mended and the exporter restarted",
            self._path,
            what,
        )

    def _set_aside(self, wrong: str, restored: int) -> None:
        what = f"is damaged ({wrong}), {restored} robots of it are restored"
        names = (f"{self._path.name}.damaged-{number}" for number in range(1, MAX_ASIDE + 1))
        free = (self._path.with_name(name) for name in names)
        aside = next((path for path in free if not os.path.lexists(path)), None)
        if aside is None:
            self._block(f"{what} and cannot be kept aside: {MAX_ASIDE} such files are there")
            return
        try:
            self._path.rename(aside)
        except OSError as error:
            self._block(f"{what} and cannot be kept aside ({error.strerror})")
        else:
            log.error("state file %s %s; it is kept as %s", self._path, what, aside)

    def save(self, state: State, now: Instant, *, at_once: bool = False) -> None:
        """Write what changed, if a second has passed since the last write.

        Never raises: a failure is logged at most once a minute, and the next call retries.
        """
        if not at_once and now.mono - self._tried_at < INTERVAL:
            return
        self._tried_at = now.mono
        self._blocked = self._blocked and os.path.lexists(self._path)
        if self._blocked:
            return
        try:
            self._save(state, now, at_once=at_once)
        except OSError as error:
            self._failed(now, f"cannot be written: {error}")
        except Exception:  # noqa: BLE001 - our own fault must not end the thread unseen
            self._failed(now, "cannot be written", exc_info=True)

    def _failed(self, now: Instant, what: str, *, exc_info: bool = False) -> None:
        self.successful = False
        self._robots = {}  # encoded again, and so tried again, next time
        if now.mono - self._logged_at >= LOG_INTERVAL:
            self._logged_at = now.mono
            log.error("state file %s %s", self._path, what, exc_info=exc_info)

    def _save(self, state: State, now: Instant, *, at_once: bool) -> None:
        if at_once:
            self._robots = {}  # the last time: "last seen" to the second
        changed = self._encode(state, now)
        rows = state.fault_rows(now)
        changed, self._fault_rows = changed or rows != self._fault_rows, rows
        if changed or at_once or now.wall - self.written_at >= LAST_SEEN_INTERVAL:
            self._write(now)
            self.successful = True
            self.written_at = now.wall

    def _encode(self, state: State, now: Instant) -> bool:
        """Encode the robots that changed; whether there was one, or one has gone."""
        known: dict[str, tuple[_Key, str]] = {}
        changed = False
        for name, key, persisted in state.visit(lambda robot: self._changed(robot, now)):
            if persisted is None:
                known[name] = self._robots[name]
            else:
                known[name] = key, json.dumps(persisted.as_json(), ensure_ascii=False)
                changed = True
        changed = changed or known.keys() != self._robots.keys()
        self._robots = known
        return changed

    def _changed(self, robot: Robot, now: Instant) -> tuple[str, _Key, PersistedRobot | None]:
        """(its name, its version, what to write of it or None if that is encoded already)."""
        name, key = robot.settings.name, _key(robot)
        encoded = self._robots.get(name)
        is_encoded = encoded is not None and encoded[0] == key
        return name, key, None if is_encoded else robot.persist(now)

    def _write(self, now: Instant) -> None:
        robots = ",\n".join(
            f"{json.dumps(name, ensure_ascii=False)}:{text}"
            for name, (_key, text) in self._robots.items()
        )
        rows = ",\n".join(json.dumps(row, ensure_ascii=False) for row in self._fault_rows)
        text = (
            f'{{"version":{VERSION},"written":{now.wall!r},"robots":{{\n{robots}\n}},'
            f'"faults":[\n{rows}\n]}}\n'
        )
        raw = text.encode("utf-8", "replace")
        if len(raw) > MAX_BYTES:
            raise OSError(f"it would be larger than the {MAX_BYTES} bytes that are read again")
        beside = self._path.with_name(self._path.name + ".new")
        beside.unlink(missing_ok=True)  # of a process that was killed; O_EXCL follows no link
        descriptor = os.open(beside, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_NOFOLLOW, 0o666)
        with os.fdopen(descriptor, "wb") as file:
            file.write(raw)
            file.flush()
            os.fsync(file.fileno())
        beside.replace(self._path)


def _key(robot: Robot) -> _Key:
    """Differs when the robot has to be encoded anew, which for "last seen" is once a minute."""
    minute = int(robot.last_wall // LAST_SEEN_INTERVAL)
    return id(robot), robot.versions.structure, robot.versions.levels, minute


def _parse(raw: bytes) -> tuple[dict[str, PersistedRobot], list[Row], str]:
    """The robots and rows of faults that are valid, and what is wrong with the file; or ""."""
    if len(raw) > MAX_BYTES:
        return {}, [], f"it is larger than {MAX_BYTES} bytes"
    try:
        content = pydantic_core.from_json(raw, allow_inf_nan=False)
    except ValueError as error:
        return {}, [], f"it is not JSON: {error}"
    version = content.get("version") if isinstance(content, dict) else None
    if version != VERSION:
        return {}, [], f"its version is {version!r:.40}, not {VERSION}"
    if not isinstance(content.get("robots"), dict):
        return {}, [], "it has no robots by name"
    robots, wrong = _robots(content["robots"])
    rows, wrong_rows = fault_rows.parse(content.get("faults", []))  # version 0.1 wrote none
    return robots, rows, "; ".join(filter(None, (wrong, wrong_rows)))


def _robots(found: dict[str, Any]) -> tuple[dict[str, PersistedRobot], str]:
    whole: dict[str, PersistedRobot] = {}
    wrong: list[str] = []
    for name, fields in found.items():
        robot = _robot(name, fields)
        if isinstance(robot, PersistedRobot):
            whole[name] = robot
        else:
            wrong.append(f"robot {name!r:.60}: {robot}")
    more = f", and {len(wrong) - 1} more robots" if len(wrong) > 1 else ""
    return whole, f"{wrong[0]}{more}" if wrong else ""


def _robot(name: str, fields: Any) -> PersistedRobot | str:
    """One robot, or what is wrong with it."""
    if not (name.isprintable() and 1 <= len(name) <= MAX_NAME):
        return "its name is not one of a robot"
    try:
        return _ROBOT.validate_python(fields)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        place = ".".join(map(str, first["loc"]))
        return f"{place:.60}: {first['msg']:.120}"
