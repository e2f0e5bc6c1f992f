"""A database of each earlier version is migrated after a copy, with its robots, faults and events.

The rows are what exporters of these versions wrote for a motor that is ERROR and a laser that is
OK.
"""

import json
import sqlite3
from contextlib import closing
from typing import Any

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.events import Wanted
from ros_diagnostics_exporter.faults.model import fault_id
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.storage import schema
from ros_diagnostics_exporter.storage.schema import APPLICATION, TABLES_OF, VERSION
from support.state_driver import ERROR, WALL, StateDriver

SLOTS = {"slots": [0] * 19 + [2, 2], "last": WALL + 16}
JUDGED = {"confirm_after": 10.0, "planned_stale": False, "stale_is_critical": False}
MOTOR = {"settings": JUDGED, "level": 2, "since": WALL + 1, "counted": True, "flaps": SLOTS}
FAULT = {"since": WALL + 1, "confirmed": WALL + 11, "labels": {}, "evidence": "Hot"}
ROBOT = {
    "labels": {},
    "confirm_after": 10.0,
    "flap_interval": 15.0,
    "presence_interval": 60.0,
    "declared": True,
    "presence": "up",
    "maintenance": False,
    "returned_until": WALL + 11,
    "total": 2,
    "counted": False,
    "history": None,
}
# What the last exporters of version 3 wrote in addition.
MORE = {
    "component": {
        "settings": {**JUDGED, "behind": []},
        "flaps": {**SLOTS, "changed": [WALL + 1]},
        "explained_until": None,
    },
    "problem": {"fault": {**FAULT, "capabilities": "", "details": {"level": "ERROR"}}},
}
IDENTITY = ["component", "critical", "", "r", "", "Motor", "", "", "", ""]
FAULTS = [
    ("fleet", [], {"grace_until": WALL + 30, "settled_at": WALL + 40}),
    ("robot", ["r"], ROBOT),
    ("component", ["r", "", "Motor"], MOTOR),
    ("problem", IDENTITY, {"since": WALL + 1, "clock": WALL + 1, "verdict": 3, "fault": FAULT}),
]
BEGAN = {
    "time": WALL + 11,
    "kind": "fault_began",
    "robot": "r",
    "component": "Motor",
    "message": "Hot",
    "scope": "component",
    "state": "critical",
    "severity": "critical",
    "since": WALL + 1,
}
EVENTS = [
    {"time": WALL, "kind": "robot", "robot": "r", "after": "known"},
    BEGAN,
    {**BEGAN, "scope": "rocket"},  # of another version
]


def component(version: int, name: str, level: int) -> dict[str, Any]:
    """A component of a robot as that version wrote it."""
    was = {"slots": [level] * 21} if version == 2 else {}
    return {
        "identity": [name, "", ""],
        "group": "",
        "hardware_id": "",
        "level": level,
        "before_stale": None,
        "since": WALL + 1,
        "problem_since": None,
        "message": "",
        "listed": WALL + 19,
        "was_ok": not level,
        **was,
    }


def write(path, version: int) -> None:
    """Make the database of an exporter of that version."""
    components = [component(version, "Motor", ERROR), component(version, "Laser", 0)]
    robot = {
        "domain_id": 0,
        "topic": "/r/diagnostics_agg",
        "source": "raw",
        "last_seen": WALL + 19,
        "components": components,
        "origin": "declared",
    }
    with closing(sqlite3.connect(path)) as connection, connection:
        for statement in TABLES_OF[version]:
            connection.execute(statement)
        connection.execute("CREATE INDEX events_of_robot ON events (robot)")
        connection.execute("INSERT INTO robots VALUES ('r', ?)", (json.dumps(robot),))
        connection.execute("INSERT INTO seen VALUES ('r', ?), ('', ?)", (WALL + 19, WALL + 19))
        for kind, key, fields in FAULTS:
            more = MORE.get(kind, {}) if version == 3 else {}
            row = (kind, json.dumps(key), json.dumps(fields | more))
            connection.execute("INSERT INTO faults VALUES (?, ?, ?)", row)
        for number, event in enumerate(EVENTS, 1):
            columns = [event.get(name, "") for name in ("time", "kind", "robot", "component")]
            values = (number, *columns, event.get("after", ""), json.dumps(event))
            connection.execute("INSERT INTO events VALUES (?, ?, ?, ?, ?, ?, ?)", values)
        connection.execute(f"PRAGMA application_id = {APPLICATION}")
        connection.execute(f"PRAGMA user_version = {version}")


def started(path) -> StateDriver:
    """An exporter that was started with the database, and has written it."""
    driver = StateDriver()
    after = driver.at(19).restart(path)
    after.save()
    assert after.storage is not None
    assert after.storage.successful
    return after


EARLIER = sorted(set(TABLES_OF) - {VERSION})


def test_there_is_a_step_for_each_earlier_version():
    assert EARLIER == [2, 3]
    assert max(TABLES_OF) == VERSION


@pytest.mark.parametrize("version", EARLIER)
def test_a_database_of_an_earlier_version_is_migrated_after_a_copy(path, caplog, version):
    write(path, version)
    after = started(path)

    assert {each.name for each in after.robot.components} == {"Motor", "Laser"}
    assert after.component("Motor").before_stale == ERROR
    [fault] = after.state.faults()
    assert (fault.identity.component, fault.since, fault.evidence) == ("Motor", WALL + 1, "Hot")
    found = list(after.log.find(Wanted(fault=fault_id(Fleet("f"), fault.identity))))
    assert [each["id"] for each in found] == [2]
    assert [each["id"] for each in after.log.find(Wanted(kind="fault_began"))] == [3, 2]

    copy = path.with_name(f"state.version-{version}")
    what = f"is migrated from version {version} to {VERSION}; as it was it is kept as {copy}"
    assert f"database {path} {what}" in caplog.text
    assert "dropped" not in caplog.text
    with closing(sqlite3.connect(copy)) as connection:
        assert connection.execute("PRAGMA user_version").fetchone() == (version,)
        assert len([*connection.execute("SELECT * FROM events")]) == len(EVENTS)
    assert copy.stat().st_mode & 0o077 == 0

    caplog.clear()
    again = after.restart(path)
    assert again.state.faults() == after.state.faults()
    assert not caplog.text


def test_a_migration_that_is_interrupted_leaves_the_database_as_it_is(path, monkeypatch, caplog):
    write(path, 2)
    steps = {**schema._STEPS, 3: (*schema._STEPS[3], "SELECT interrupted")}
    with monkeypatch.context() as patch:
        patch.setattr(schema, "_STEPS", steps)
        StateDriver().restart(path).close()
    assert "cannot be read (no such column: interrupted)" in caplog.text

    assert started(path).component("Motor").before_stale == ERROR


def test_a_robot_that_is_damaged_stops_no_migration(path, edit, caplog):
    write(path, 3)
    edit("UPDATE robots SET data = 'damaged'")
    after = started(path)

    assert [fault.identity.component for fault in after.state.faults()] == ["Motor"]
    assert "1 rows are not valid and dropped, the others restored: robot 'r'" in caplog.text


def test_a_motor_of_an_earlier_version_recovers(path):
    write(path, 2)
    after = started(path)
    assert after.raw(Status(0, "Motor")).state.faults() == []
