"""The tables of the database, and the steps that bring those of earlier exporters to them."""

from __future__ import annotations

import json
import os
import sqlite3
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from ros_diagnostics_exporter.events import OF_FAULTS

APPLICATION = 0x524F5344  # "ROSD", for `file`
VERSION = 4
TABLES = (
    "CREATE TABLE robots (name TEXT PRIMARY KEY, data TEXT NOT NULL)",
    "CREATE TABLE seen (robot TEXT PRIMARY KEY, time REAL NOT NULL) WITHOUT ROWID",
    "CREATE TABLE faults (kind TEXT, key TEXT, fields TEXT, PRIMARY KEY (kind, key)) WITHOUT ROWID",
    (
        "CREATE TABLE events (id INTEGER PRIMARY KEY, time REAL, kind TEXT,"
        " robot TEXT, component TEXT, after TEXT, data TEXT, fault TEXT)"
    ),
)
_EARLIER = (
    *TABLES[:3],
    (
        "CREATE TABLE events (id INTEGER PRIMARY KEY,"
        " time REAL, kind TEXT, robot TEXT, component TEXT, after TEXT, data TEXT)"
    ),
)
TABLES_OF = {2: _EARLIER, 3: _EARLIER, VERSION: TABLES}  # version 1 was a JSON file
# Those of faults are few among those of levels, and pages of faults ask for them. A query has to
# name the kind itself, not as a parameter, to use their index.
OF_NO_FAULT = " AND ".join(f"kind <> {kind!r}" for kind in sorted(OF_FAULTS))
INDEXES = (
    f"CREATE INDEX IF NOT EXISTS events_of_no_fault ON events (robot) WHERE {OF_NO_FAULT}",
    "CREATE INDEX IF NOT EXISTS events_of_robot ON events (robot)",
    (
        "CREATE INDEX IF NOT EXISTS events_of_faults ON events (kind)"
        f" WHERE {' OR '.join(f'kind = {kind!r}' for kind in sorted(OF_FAULTS))}"
    ),
    "CREATE INDEX IF NOT EXISTS events_of_fault ON events (fault) WHERE fault IS NOT NULL",
)
# What a database of each earlier version needs to be of the next. Exporters of versions 2 and 3
# wrote the same tables, and fields of components that are gone.
_STEPS: dict[int, tuple[str, ...]] = {
    2: (),
    3: (
        "ALTER TABLE events ADD COLUMN fault TEXT",
        "UPDATE events SET fault = fault_of(data) WHERE json_valid(data) AND data LIKE '%since%'",
        "UPDATE robots SET data = without_old_fields(data)",
    ),
}
_OLD_FIELDS = frozenset(("problem_since", "slots", "was_ok"))  # of a robot's components

FaultOf = Callable[[str], str | None]  # the id of the fault that an event, as JSON, is of


def create(connection: sqlite3.Connection) -> None:
    """Make the tables; to be called in a transaction."""
    for statement in TABLES:
        connection.execute(statement)
    connection.execute(f"PRAGMA application_id = {APPLICATION}")
    connection.execute(f"PRAGMA user_version = {VERSION}")


def migrate(connection: sqlite3.Connection, version: int, fault_of: FaultOf) -> None:
    """Bring an earlier version's tables and rows to this one; to be called in a transaction."""
    connection.create_function("fault_of", 1, fault_of)
    connection.create_function("without_old_fields", 1, _without_old_fields)
    for number in range(version, VERSION):
        for statement in _STEPS[number]:
            connection.execute(statement)
    connection.execute(f"PRAGMA user_version = {VERSION}")


def copy(connection: sqlite3.Connection, path: Path, version: int) -> Path:
    """Keep a database as it is beside itself, before it is migrated; where the copy is.

    Raises:
        OSError, sqlite3.Error: it cannot be copied.
    """
    to = path.with_name(f"{path.name}.version-{version}")
    with suppress(FileNotFoundError):
        to.unlink()  # that of a migration which was interrupted
    os.close(os.open(to, os.O_CREAT | os.O_EXCL | os.O_WRONLY, 0o600))
    connection.execute("VACUUM INTO ?", (str(to),))
    return to


def _without_old_fields(data: str) -> str:
    """A robot's JSON without what its components no longer have; as it is if it is damaged."""
    try:
        robot = json.loads(data)
        for component in robot["components"]:
            for name in _OLD_FIELDS & component.keys():
                del component[name]
    except (ValueError, TypeError, LookupError, AttributeError):
        return data
    return json.dumps(robot, ensure_ascii=False)
