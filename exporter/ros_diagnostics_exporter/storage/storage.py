"""What is known about the robots outlives the process: what changed is written within a second.

Everything is in one SQLite file, see `database`. The exporter starts and runs without it: a damaged
file is kept aside, one that cannot be read is left alone, and a failed write is retried.
"""

from __future__ import annotations

import json
import logging
import os
import sqlite3
import threading
import time
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING

from ros_diagnostics_exporter.events import EventLog, Numbered, Wanted
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.files import read_regular
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.persisted import PersistedRobot
from ros_diagnostics_exporter.storage.database import (
    Changes,
    DamagedError,
    Database,
    ForeignError,
    InUseError,
    Lock,
    find_events,
    first_event,
    is_damage,
    rename_database,
)
from ros_diagnostics_exporter.storage.earlier import Found, decoded, event_fault, salvage
from ros_diagnostics_exporter.storage.pruning import Bounds, Early
from ros_diagnostics_exporter.storage.retention import LEAST, AgeClock, Retention
from ros_diagnostics_exporter.storage.schema import FaultOf

if TYPE_CHECKING:  # these import the types below
    from ros_diagnostics_exporter.fleet.state import FleetState
    from ros_diagnostics_exporter.robots.robot import RobotState

INTERVAL = 0.6  # seconds between two writes at least: a write included, a second at most is lost
SEEN_INTERVAL = 10.0  # when nothing but "last received" has changed
WHOLE_INTERVAL = 3600.0  # after which a robot is written again, for what changes slowly in it
LOG_INTERVAL = 60.0
HANGING = 5.0  # seconds after which a write that goes on counts as failed
LOADING = 30.0  # seconds that the start waits for the disk
CHECKING = 5.0  # seconds of these for looking for damage
MAX_ASIDE = 10  # damaged files that are kept
MAX_NAMED = 5  # rows that are dropped
ITSELF = ""  # in the place of a robot's name: the exporter, by its `AgeClock` at its last write

log = logging.getLogger(__name__)

_WRITTEN = Mark.NAMES, Mark.SERIES, Mark.LEVEL, Mark.DETAILS, Mark.CONFIG
_Key = tuple[int, int, int]


class Storage:
    """Reads the database at the start and writes it from then on.

    ``written_at`` is the Unix time of the last write that succeeded (0 before the first).
    ``is_crowded``: what is kept of robots fills the database, and only the newest events are kept.
    ``early``: whose events went because the database was full.

    Args:
        path: The database; its folder is made if the one above it is there.
        retention: Which events are kept.
    """

    def __init__(self, path: Path, retention: Retention | None = None) -> None:
        self._path = path
        self._retention = retention or Retention()
        self._found: Found | None = None  # until the first write
        self._lock: Lock | None = None
        self._database: Database | None = None
        self._successful = True
        self.written_at = 0.0
        self.is_crowded = False
        self.early = Early()
        self._blocked = False  # by a file that could not be read, and so is not overwritten
        self._tried_at = self._logged_at = self._seen_at = float("-inf")
        self._writing_since: float | None = None
        self._everything = True  # is to be written: at the first time, and after a failure
        self._keys: dict[str, _Key] = {}  # of the robots as written
        self._seen: dict[str, float] = {}  # when the robots were last received, as written
        self._rows: dict[tuple[str, str], str] = {}  # all rows of the faults, as JSON
        self._changed_rows: dict[tuple[str, str], None] = {}
        self._last_event = 0  # that is written
        self._age = AgeClock()
        self._name_fault: FaultOf = lambda _event: None

    @property
    def path(self) -> Path:
        """The file."""
        return self._path

    @property
    def successful(self) -> bool:
        """Whether the last write succeeded, none hangs, and no file that is there prevents it."""
        return self._successful and not self._hangs

    @property
    def _hangs(self) -> bool:
        since = self._writing_since
        return since is not None and time.monotonic() - since > HANGING

    # -- at the start ------------------------------------------------------------------------

    def load(self, state: FleetState, now: Instant) -> int:
        """Restore what an earlier process knew, and return the id of its last event.

        A row that is not valid is dropped and logged. What is valid in a damaged file is restored,
        and the first write renames it to the first free of ``<path>.damaged-1`` to ``-10``, one of
        a later version to ``<path>.version-9-1``. One that cannot be read is left alone, and
        nothing is saved until it is moved away.

        Raises:
            InUseError: another exporter has the database open.
            ForeignError: it is the database of another program; it is left as it is.
        """
        self._name_fault = partial(event_fault, state.fleet)
        found = self._found = self._read_in_time()
        if found.obstacle:
            self._block(f"cannot be read ({found.obstacle}): starting without it")
            return 0
        self._age.set(found.written_at, now)
        state.restore(found.robots, now)
        found.drop(state.restore_faults(found.rows, now))
        self._rows = {key: text for key, text in map(_row_as_json, found.rows) if text}
        self._log_dropped(found.dropped)
        found.restored = f", {len(found.robots)} robots of it are restored"
        return found.last_event

    def _log_dropped(self, dropped: list[str]) -> None:
        """Name the first rows that are dropped; the first write deletes them."""
        if dropped:
            named = "; ".join(dropped[:MAX_NAMED])
            more = f"; and {len(dropped) - MAX_NAMED} more" if len(dropped) > MAX_NAMED else ""
            what = "rows are not valid and dropped, the others restored"
            log.error("database %s: %d %s: %s%s", self._path, len(dropped), what, named, more)

    def _read_in_time(self) -> Found:
        """What is in the file; read in a thread, because a disk may hang."""
        ended: list[Found | InUseError | ForeignError] = []
        thread = threading.Thread(target=lambda: ended.append(self._read()), daemon=True)
        thread.start()
        thread.join(LOADING)
        if not ended:
            return Found(obstacle=f"no answer of the disk in {LOADING:.0f} s")
        [found] = ended
        if isinstance(found, Exception):
            raise found
        return found

    def _read(self) -> Found | InUseError | ForeignError:
        try:
            return self._read_file()
        except (InUseError, ForeignError) as error:
            return error
        except OSError as error:
            return Found(obstacle=str(error.strerror))
        except sqlite3.Error as error:
            return Found(obstacle=str(error))

    def _read_file(self) -> Found:
        try:
            read_regular(self._path, 1, follow=False)
        except FileNotFoundError:
            return Found()
        self._lock = Lock(self._path)
        found = Found()
        try:
            self._database = Database(self._path, self._name_fault)
            self._read_database(self._database, found)
        except (sqlite3.Error, DamagedError) as error:
            if not is_damage(error):
                raise
            found.add_damage(str(error))
            found.suffix = getattr(error, "suffix", found.suffix)
        return found

    def _read_database(self, database: Database, contents: Found) -> None:
        """Read what is valid, up to where the file is damaged.

        Raises:
            sqlite3.Error: it cannot be read further.
        """
        contents.add_damage(database.check(CHECKING))
        contents.last_event = self._last_event = database.last_event()
        contents.written_at = database.written_at()
        contents.add_robots((name, decoded(text), seen) for name, text, seen in database.robots())
        contents.add_rows([row[0], *map(decoded, row[1:])] for row in database.faults())

    def _block(self, what: str) -> None:
        self._blocked, self._successful = True, False
        log.error(
            "database %s %s; nothing is saved until it is moved away, "
            "or is mended and the exporter restarted",
            self._path,
            what,
        )

    # -- from then on ------------------------------------------------------------------------

    def save(
        self, state: FleetState, events: EventLog, now: Instant, *, at_once: bool = False
    ) -> None:
        """Write what changed, if a second has passed since the last write.

        Never raises: a failure is logged at most once a minute, and the next call retries.
        """
        if not at_once and now.mono - self._tried_at < INTERVAL:
            return
        self._tried_at = now.mono
        self._writing_since = time.monotonic()
        try:
            self._take_rows(state, now, at_once=at_once)
            self._blocked = self._blocked and os.path.lexists(self._path)
            if not self._blocked:
                self._save(state, events, now, at_once=at_once)
        except (OSError, sqlite3.Error, InUseError, ForeignError, DamagedError) as error:
            self._failed(now, error)
        except Exception as error:  # noqa: BLE001 - our own fault must not end the thread unseen
            self._failed(now, error, exc_info=True)
        finally:
            self._writing_since = None

    def _failed(self, now: Instant, error: Exception, *, exc_info: bool = False) -> None:
        self._successful = False
        self._close_database()
        if is_damage(error) and self._found is None:
            # The next write sets it aside.
            self._found = Found(damage=str(error), last_event=self._last_event)
        self._log(now, f"cannot be written: {error}", exc_info=exc_info)

    def _log(self, now: Instant, what: str, *, exc_info: bool = False) -> None:
        if now.mono - self._logged_at >= LOG_INTERVAL:
            self._logged_at = now.mono
            log.error("database %s %s", self._path, what, exc_info=exc_info)

    def close(self) -> None:
        """Close the database, and let another process have it."""
        self._close_database()
        if self._lock is not None:
            self._lock.close()
        self._lock = None

    def _close_database(self) -> None:
        """Close it; the next write opens it and writes everything."""
        self._everything, self._keys, self._seen = True, {}, {}
        database, self._database = self._database, None
        if database is not None:
            database.close()

    # -- one write ---------------------------------------------------------------------------

    def _save(self, state: FleetState, events: EventLog, now: Instant, *, at_once: bool) -> None:
        salvaged = self._make_way()
        if self._blocked:
            return
        database = self._open()
        keys, seen, robots = self._encode(state, now)
        since = now.wall - self._seen_at
        is_due = at_once or not 0 <= since < SEEN_INTERVAL
        rows = self._rows if self._everything else self._changed_rows
        new = events.after(self._last_event)
        changes = Changes(
            everything=self._everything,
            robots=robots,
            gone=list(self._keys.keys() - keys.keys()),
            seen=self._newly_seen(seen, now) if is_due else [],
            faults={key: self._rows.get(key) for key in rows},
            events=chain(salvaged, new),
        )
        if not (robots or rows or new or is_due or self._everything or changes.gone):
            return
        retention = self._retention
        oldest = self._age.time(now) - retention.seconds
        pruned = database.write(changes, Bounds(oldest, now.wall, retention.size))
        self._note_room(has_room=pruned.has_room)
        self.early.note(pruned.early, now)
        self._keys, self._everything, self._changed_rows = keys, False, {}
        if is_due:
            self._seen, self._seen_at = seen, now.wall
        self._note_events(new, now)
        self._successful, self.written_at = True, now.wall
        self._found = None

    def _note_room(self, *, has_room: bool) -> None:
        if not has_room and not self.is_crowded:
            log.error("database %s: %s", self._path, self.crowded_reason)
        self.is_crowded = not has_room

    @property
    def crowded_reason(self) -> str:
        """What is wrong where ``is_crowded``."""
        limit = f"--storage.retention.size ({self._retention.size:,} bytes)"
        return f"what is kept of robots needs {limit}: only {LEAST:,} events are kept"

    def _note_events(self, written: list[Numbered], now: Instant) -> None:
        if not written:
            return
        lost = written[-1][0] - self._last_event - len(written)
        if self._last_event and lost > 0:
            self._log(now, f"was written too slowly: {lost} events are lost")
        self._last_event = written[-1][0]

    def _encode(
        self, state: FleetState, now: Instant
    ) -> tuple[dict[str, _Key], dict[str, float], list[tuple[str, str]]]:
        """Of all robots their version and when last received; of those that changed the JSON."""
        keys: dict[str, _Key] = {}
        seen: dict[str, float] = {}
        changed: list[tuple[str, str]] = []
        for name, key, last, persisted in state.visit(lambda robot: self._visit(robot, now)):
            keys[name], seen[name] = key, last
            if persisted is not None:
                changed.append((name, persisted.as_json()))
        return keys, seen, changed

    def _visit(
        self, robot: RobotState, now: Instant
    ) -> tuple[str, _Key, float, PersistedRobot | None]:
        """(its name, its version, when it was last received, what to write of it if anything)."""
        name, key = robot.settings.name, _key(robot)
        is_written = self._keys.get(name) == key
        return name, key, robot.last_wall, None if is_written else robot.persist(now)

    def _newly_seen(self, seen: dict[str, float], now: Instant) -> list[tuple[str, float]]:
        newer = [(name, at) for name, at in seen.items() if self._seen.get(name) != at]
        return [(ITSELF, self._age.wall(now)), *newer]

    def _take_rows(self, state: FleetState, now: Instant, *, at_once: bool) -> None:
        for row in state.take_fault_rows(now, at_once=at_once):
            key, text = _row_as_json(row)
            self._changed_rows[key] = None
            if text is None:
                self._rows.pop(key, None)
            else:
                self._rows[key] = text
        if self._everything:
            self._changed_rows = {}  # they may become many while nothing can be written

    # -- the file ----------------------------------------------------------------------------

    def _open(self) -> Database:
        """The open database, made if none is there or it was moved away."""
        if self._database is not None and self._database.is_moved:
            self._close_database()
        if self._database is None:
            self._path.parent.mkdir(mode=0o700, exist_ok=True)
            self._lock = self._lock or Lock(self._path)
            self._database = Database(self._path)
            if self._database.last_event() == 0:
                self._last_event = 0  # it is new: all that is in memory is written
        return self._database

    def _make_way(self) -> Iterable[Numbered]:
        """Rename what is at the path if it is damaged; the events to be taken over."""
        found = self._found
        if found is None:
            return ()
        if found.damage:
            self._set_aside(found)
        return found.salvaged

    def _set_aside(self, found: Found) -> None:
        """Rename a file that is damaged or of a later version, or block all writes."""
        self._close_database()
        word = "is damaged" if found.suffix == DamagedError.suffix else "cannot be used"
        what = f"{word} ({found.damage}){found.restored}"
        name = f"{self._path.name}.{found.suffix}"
        names = (f"{name}-{number}" for number in range(1, MAX_ASIDE + 1))
        free = (self._path.with_name(name) for name in names)
        aside = next((path for path in free if not os.path.lexists(path)), None)
        if aside is None:
            self._block(f"{what} and cannot be kept aside: {MAX_ASIDE} such files are there")
            return
        try:
            rename_database(self._path, aside)
        except OSError as error:
            self._block(f"{what} and cannot be kept aside ({error.strerror})")
            return
        log.error("database %s %s; it is kept as %s", self._path, what, aside)
        if found.last_event:
            found.salvaged = salvage(aside, found.last_event)
        found.damage = ""

    def find_events(self, wanted: Wanted) -> Iterator[Numbered]:
        """The written events that match, newest first; none while the disk hangs. From any thread.

        Those that cannot be read are left out, and logged.
        """
        if self._hangs or self._database is None:
            return
        try:
            yield from find_events(self._path, wanted)
        except sqlite3.Error as error:
            log.error("database %s: its events cannot be read: %s", self._path, error)

    def first_event(self) -> float | None:
        """When the first event that is written was, Unix time; None if that is not known."""
        if self._hangs or self._database is None:
            return None
        try:
            return first_event(self._path)
        except sqlite3.Error as error:
            log.error("database %s: its events cannot be read: %s", self._path, error)
            return None


def _key(robot: RobotState) -> _Key:
    """Differs when the robot has to be written anew."""
    hour = int((robot.last_wall + id(robot) % WHOLE_INTERVAL) // WHOLE_INTERVAL)
    return id(robot), robot.marks.last(*_WRITTEN), hour


def _row_as_json(row: Row) -> tuple[tuple[str, str], str | None]:
    kind, key, fields = row
    text = None if fields is None else json.dumps(fields, ensure_ascii=False)
    return (kind, json.dumps(key, ensure_ascii=False)), text
