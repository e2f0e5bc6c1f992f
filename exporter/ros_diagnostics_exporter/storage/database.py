"""The SQLite file of the state: schema, lock, one transaction for what changed, and how it is read.

WAL with synchronous=FULL: a transaction that was committed outlives a kill and a power cut. It
costs a flush of the disk for each transaction, of which there is one a second at most.
"""

from __future__ import annotations

import errno
import fcntl
import json
import logging
import os
import sqlite3
import stat
import threading
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from ros_diagnostics_exporter.events import OF_FAULTS, Event, Wanted, filled
from ros_diagnostics_exporter.storage.pruning import Bounds, Pruned, Pruner
from ros_diagnostics_exporter.storage.schema import (
    APPLICATION,
    INDEXES,
    TABLES_OF,
    VERSION,
    FaultOf,
    copy,
    create,
    migrate,
)
from ros_diagnostics_exporter.texts import encodable

log = logging.getLogger(__name__)

MAGIC = b"SQLite format 3\0"
FORMATS = (b"\1\1", b"\2\2")  # bytes 18 and 19 of the header: rollback journal, WAL
BUSY = 5.0  # seconds that a backup tool, for example, may hold the file
WAL_BYTES = 16 << 20  # to which the write-ahead log is cut after a checkpoint
MAX_ID = 2**52  # of an event; above 2**53, JSON numbers are not exact
BLOCK = 200  # events that are read at a time
_EVENT = TypeAdapter(Event)
_TABLES = "SELECT sql FROM sqlite_master WHERE sql <> ''"
_DAMAGE = (11, 26)  # SQLITE_CORRUPT, SQLITE_NOTADB


class InUseError(Exception):
    """Another process has the database open; the text names the file and the process."""


class ForeignError(Exception):
    """The file is the database of another program; the text names it."""


class DamagedError(Exception):
    """The file is no intact database; the text says why.

    ``suffix`` is what its name is given, before a number, when it is kept aside.
    """

    suffix = "damaged"


class LaterVersionError(DamagedError):
    """The file is of a version that this exporter does not know."""

    def __init__(self, version: int) -> None:
        known = f"{min(TABLES_OF)} to {VERSION}"
        super().__init__(f"it is of version {version}, and this exporter reads {known}")
        self.suffix = f"version-{version}"


def is_damage(error: Exception) -> bool:
    """Whether the content of the file, not the disk, a lock or a permission, is what is wrong."""
    if isinstance(error, DamagedError):
        return True
    if (code := getattr(error, "sqlite_errorcode", None)) is not None:
        return code & 0xFF in _DAMAGE
    # Python 3.10 does not say the code, and raises just this class for these two.
    return type(error) is sqlite3.DatabaseError


@dataclass
class Changes:
    """What one transaction writes; ``everything``: all other robots and faults go."""

    everything: bool
    robots: list[tuple[str, str]]  # name, JSON
    gone: list[str]
    seen: list[tuple[str, float]]
    faults: dict[tuple[str, str], str | None]  # (kind, key) -> JSON; None: it has gone
    events: Iterable[tuple[int, Event]]


class Lock:
    """Keeps a second exporter from the database, until it is closed or the process ends.

    Raises:
        InUseError: another process has it.
        OSError: the lock file cannot be made.
    """

    def __init__(self, database: Path) -> None:
        path = database.with_name(database.name + ".lock")
        self._file = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            owner = os.read(self._file, 20).decode("ascii", "replace").strip()
            os.close(self._file)
            raise InUseError(
                f"{database} is in use by another exporter (pid {owner}); "
                "give this one another --storage.path"
            ) from error
        os.truncate(self._file, 0)
        os.pwrite(self._file, b"%d\n" % os.getpid(), 0)

    def close(self) -> None:
        """Let another process have the database."""
        os.close(self._file)


def _no_fault(_event: str) -> None:
    """The fault of an event where no fleet is known."""


class Database:
    """The open file; made if it is not there. For one thread at a time.

    One of an earlier version is migrated, after a copy; ``fault_of`` names its events' faults.

    Raises:
        DamagedError, sqlite3.Error: it is damaged, see `is_damage`.
        ForeignError: it is of another program.
        OSError, sqlite3.OperationalError: it cannot be opened.
    """

    def __init__(self, path: Path, fault_of: FaultOf = _no_fault) -> None:
        self._path = path
        self._fault_of = fault_of
        self._inode = _prepare(path)
        self._connection = sqlite3.connect(
            path, timeout=BUSY, isolation_level=None, check_same_thread=False
        )
        self._connection.text_factory = _decode  # a damaged text is no reason to read no further
        self._pruner = Pruner(self._connection)
        try:
            self._set_up()
        except BaseException:
            self._connection.close()
            raise

    def _set_up(self) -> None:
        connection = self._connection
        try:
            found = set(self._ask(_TABLES))
        except (UnicodeDecodeError, sqlite3.DatabaseError) as error:
            # Of SQLite's message, which quotes the schema; Python 3.10 leaves the message out.
            if isinstance(error, UnicodeDecodeError) or not str(error):
                raise DamagedError("its schema is not UTF-8") from error
            raise
        version = self._version() if found else VERSION  # before anything in it is changed
        connection.execute("PRAGMA journal_mode = WAL")
        connection.execute("PRAGMA synchronous = FULL")
        connection.execute(f"PRAGMA journal_size_limit = {WAL_BYTES}")
        if not found:
            with self._transaction():
                create(connection)
        elif not found >= set(TABLES_OF[version]):  # an index more, or ANALYZE's, is harmless
            raise DamagedError("its tables are not those of its version")
        elif version != VERSION:
            self._migrate(version)
        for statement in INDEXES:
            connection.execute(statement)

    def _version(self) -> int:
        [application], [version] = map(self._ask, ("PRAGMA application_id", "PRAGMA user_version"))
        if application != APPLICATION:
            what = "the database of another program; choose another --storage.path"
            raise ForeignError(f"{self._path} is {what}")
        if version not in TABLES_OF:
            raise LaterVersionError(version)
        return int(version)

    def _migrate(self, version: int) -> None:
        """Bring it to this version, after a copy."""
        aside = copy(self._connection, self._path, version)
        with self._transaction():
            migrate(self._connection, version, self._fault_of)
        what = "is migrated from version %d to %d; as it was it is kept as %s"
        log.warning(f"database %s {what}", self._path, version, VERSION, aside)  # noqa: G004

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    @property
    def is_moved(self) -> bool:
        """Whether another file, or none, is at the path now."""
        try:
            return _inode(os.lstat(self._path)) != self._inode
        except FileNotFoundError:
            return True

    # -- reading -----------------------------------------------------------------------------

    def check(self, seconds: float) -> str:
        """What is wrong with the file; "" if nothing was found in ``seconds``."""
        timer = threading.Timer(seconds, self._connection.interrupt)
        timer.start()
        try:
            [found] = self._ask("PRAGMA quick_check(1)")
        except sqlite3.OperationalError:
            return ""  # interrupted: what is read is checked as it is read
        finally:
            timer.cancel()
        return "" if found == "ok" else str(found).replace("\n", " ")

    def robots(self) -> Iterator[tuple[Any, Any, Any]]:
        """Of each robot its name, its JSON and when it was last received, as they are there."""
        yield from self._connection.execute(
            "SELECT name, data, time FROM robots LEFT JOIN seen ON robot = name ORDER BY name"
        )

    def written_at(self) -> float | None:
        """The time at the last write; None if there was none."""
        [found] = self._ask("SELECT max(time) FROM seen WHERE robot = ''")
        return found if isinstance(found, float) else None

    def faults(self) -> Iterator[tuple[Any, Any, Any]]:
        """Of each row of the faults its kind, key and fields, as they are there."""
        yield from self._connection.execute("SELECT kind, key, fields FROM faults")

    def last_event(self) -> int:
        """The highest id of an event; 0 if there is none."""
        [found] = self._ask("SELECT coalesce(max(id), 0) FROM events")
        return int(found) if 0 <= found <= MAX_ID else 0

    def _ask(self, query: str) -> list[Any]:
        return [value for (value,) in self._connection.execute(query)]

    # -- writing -----------------------------------------------------------------------------

    @contextmanager
    def _transaction(self) -> Iterator[None]:
        self._connection.execute("BEGIN IMMEDIATE")
        try:
            yield
            self._connection.execute("COMMIT")
        except BaseException:
            if self._connection.in_transaction:
                self._connection.execute("ROLLBACK")
            raise

    def write(self, changes: Changes, bounds: Bounds) -> Pruned:
        """Write what changed, and delete the events that are too old or too many."""
        with self._transaction():
            if changes.everything:
                for table in ("robots", "seen", "faults"):
                    self._connection.execute(f"DELETE FROM {table}")  # noqa: S608 - our own names
            self._write_robots(changes)
            self._write_faults(changes.faults)
            written = self._write_events(changes.events)
            # So that they go faster than they come.
            return self._pruner.prune(1000 + 2 * max(0, written), bounds)

    def _write_robots(self, changes: Changes) -> None:
        execute = self._connection.executemany
        gone = [(encodable(name),) for name in changes.gone]
        execute("DELETE FROM robots WHERE name = ?", gone)
        execute("DELETE FROM seen WHERE robot = ?", gone)
        execute(
            "INSERT INTO robots VALUES (?, ?)"
            " ON CONFLICT (name) DO UPDATE SET data = excluded.data",
            [(encodable(name), encodable(data)) for name, data in changes.robots],
        )
        execute(
            "INSERT OR REPLACE INTO seen VALUES (?, ?)",
            [(encodable(name), time) for name, time in changes.seen],
        )

    def _write_faults(self, rows: dict[tuple[str, str], str | None]) -> None:
        gone = [(kind, encodable(key)) for (kind, key), text in rows.items() if text is None]
        self._connection.executemany("DELETE FROM faults WHERE kind = ? AND key = ?", gone)
        self._connection.executemany(
            "INSERT OR REPLACE INTO faults VALUES (?, ?, ?)",
            [
                (kind, encodable(key), encodable(text))
                for (kind, key), text in rows.items()
                if text is not None
            ],
        )

    def _write_events(self, events: Iterable[tuple[int, Event]]) -> int:
        """Write events; returns how many."""
        return self._connection.executemany(
            "INSERT OR REPLACE INTO events VALUES (?, ?, ?, ?, ?, ?, ?, ?)",
            (_event_row(number, event) for number, event in self._pruner.note(events)),
        ).rowcount


def rename_database(path: Path, to: Path) -> None:
    """Rename a database that nobody has open, with its write-ahead log.

    Raises:
        OSError: it cannot be renamed.
    """
    path.rename(to)
    for suffix in ("-wal", "-shm"):  # a log that stays would be applied to the next database
        with suppress(FileNotFoundError):
            path.with_name(path.name + suffix).rename(to.with_name(to.name + suffix))


@contextmanager
def reading(path: Path) -> Iterator[sqlite3.Connection]:
    """A connection of its own that only reads; damaged text is no error."""
    uri = path.absolute().as_uri() + "?mode=ro"
    with closing(sqlite3.connect(uri, uri=True, timeout=BUSY, isolation_level=None)) as connection:
        connection.text_factory = _decode
        yield connection


def find_events(path: Path, wanted: Wanted) -> Iterator[tuple[int, Event]]:
    """The written events that match, newest first, by a connection of its own.

    Raises:
        sqlite3.Error: they cannot be read.
    """
    conditions = ["id < ?"]
    values: list[int | float | str] = [wanted.before or 1 << 62]
    index = ""
    is_by_kind = wanted.fault is None and wanted.kind in OF_FAULTS
    if wanted.fault is not None:
        index = "INDEXED BY events_of_fault "
    elif is_by_kind:
        conditions.append(f"kind = '{wanted.kind}'")
        index = "INDEXED BY events_of_faults "  # else those of all kinds are read in order
    for condition, value in (
        ("fault = ?", wanted.fault),
        ("kind = ?", None if is_by_kind else wanted.kind),
        ("robot = ?", wanted.robot),
        ("component = ?", wanted.component),
        ("after = ?", wanted.level),
        ("time >= ?", wanted.since),
        ("time < ?", wanted.until),
    ):
        if value is not None:
            conditions.append(condition)
            values.append(encodable(value) if isinstance(value, str) else value)
    query = f"SELECT id, data FROM events {index}WHERE {' AND '.join(conditions)}"  # noqa: S608
    with reading(path) as connection:
        found = connection.execute(f"{query} ORDER BY id DESC LIMIT ?", (*values, wanted.limit))
        while rows := found.fetchmany(BLOCK):
            for number, text in rows:
                event = _event(text)
                if event is not None:
                    yield number, event


def first_event(path: Path) -> float | None:
    """The time of the first event that is kept, by a connection of its own; None without one.

    Raises:
        sqlite3.Error: it cannot be read.
    """
    with reading(path) as connection:
        for (time,) in connection.execute("SELECT time FROM events ORDER BY id LIMIT 1"):
            return float(time)
    return None


def _prepare(path: Path) -> tuple[int, int]:
    """Make the file if it is not there, and look at its header; its device and inode."""
    flags = os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_NOCTTY
    descriptor = os.open(path, flags, 0o600)
    try:
        status = os.fstat(descriptor)
        if not stat.S_ISREG(status.st_mode):
            raise OSError(errno.EINVAL, "it is not a regular file")
        header = os.read(descriptor, 20)
    finally:
        os.close(descriptor)
    is_database = header.startswith(MAGIC) and header[18:] in FORMATS
    if header and not is_database:
        raise DamagedError("it is not a database")
    return _inode(status)


def _inode(status: os.stat_result) -> tuple[int, int]:
    return status.st_dev, status.st_ino


def _event_row(number: int, event: Event) -> tuple[int | float | str | None, ...]:
    # What can be asked for is apart; everything is in the JSON.
    texts = (event.kind, event.robot, event.component, event.after)
    data = json.dumps(filled(event), ensure_ascii=False)
    return number, event.time, *map(encodable, (*texts, data)), event.fault or None


def _event(data: Any) -> Event | None:
    """An event of the database; None if it is damaged."""
    try:
        return _EVENT.validate_json(data)
    except ValidationError:
        return None


def _decode(raw: bytes) -> str:
    return raw.decode("utf-8", "replace")
