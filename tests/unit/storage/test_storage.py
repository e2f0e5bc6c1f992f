"""What is known survives the process, and no disk can take the exporter down."""

from __future__ import annotations

import errno
import json
import logging
import os
import re
import resource
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import threading
import time
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter import events
from ros_diagnostics_exporter.api.snapshot import fleet_snapshot, targets
from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Discovery,
    Fleet,
    Robot,
    Shared,
    Source,
)
from ros_diagnostics_exporter.events import Event, Wanted
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from ros_diagnostics_exporter.robots.robot import RobotState as ExporterRobot
from ros_diagnostics_exporter.storage.database import (
    MAGIC,
    Database,
    InUseError,
    VersionError,
    is_damage,
)
from ros_diagnostics_exporter.storage.storage import Retention, Storage
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver, tree

HOT, COOL = Status(ERROR, "Motor", "Hot", "mc-1"), Status(OK, "Motor", "OK", "mc-1")
LASER = Status(OK, "Laser")


def content(path) -> dict[str, list[tuple[Any, ...]]]:
    """What is in the database of a process that may be running."""
    tables = ("robots", "faults", "events")
    with closing(sqlite3.connect(f"file:{path}?mode=ro", uri=True)) as connection:
        return {table: sorted(connection.execute(f"SELECT * FROM {table}")) for table in tables}


def edited(path, *statements: str) -> None:
    """Change the database of a process that has ended."""
    with closing(sqlite3.connect(path)) as connection, connection:
        for statement in statements:
            connection.execute(statement)


def test_what_is_restored_is_stale_until_it_is_heard(tmp_path):
    before = StateDriver()
    before.at(1)
    before.raw(HOT, LASER)
    before.keep(tmp_path / "state")

    after = before.restart(tmp_path / "state")

    motor = after.component("Motor")
    assert (motor.level, motor.before_stale, after.problem_since("Motor")) == (
        STALE,
        ERROR,
        WALL + 1,
    )
    assert after.sample("robot_up") == 0
    assert after.sample("robot_last_message_timestamp_seconds") == WALL + 1


def test_a_fault_that_goes_on_began_when_it_began(tmp_path):
    before = StateDriver()
    before.at(1)
    before.raw(HOT)
    before.at(2)
    before.keep(tmp_path / "state")
    after = before.restart(tmp_path / "state")
    after.raw(HOT)

    motor = after.component("Motor")
    assert (motor.level, motor.since, after.problem_since("Motor")) == (ERROR, WALL + 1, WALL + 1)
    assert (motor.changes, motor.before_stale) == (0, None)


def test_a_fault_that_ended_meanwhile_ends_at_the_first_status(tmp_path):
    before = StateDriver()
    before.raw(HOT)
    before.keep(tmp_path / "state")
    after = before.restart(tmp_path / "state")
    after.raw(COOL)

    motor = after.component("Motor")
    assert (motor.level, motor.since, after.problem_since("Motor")) == (OK, WALL + 5, None)
    assert motor.changes == 1


@pytest.mark.parametrize(
    ("first", "found"),
    [(HOT, []), (COOL, [("ERROR", "OK")]), (HOT._replace(level=STALE), [("ERROR", "STALE")])],
)
def test_a_restart_is_no_change_of_level(tmp_path, first, found):
    before = StateDriver(Source.RAW)
    before.raw(COOL)
    before.at(1.0)
    before.raw(HOT)
    before.keep(tmp_path / "state")
    after = before.restart(tmp_path / "state")
    after.raw(first)
    after.at(2.0)
    changes = [(each.before, each.after) for each in after.events if each.kind == "level"]
    assert changes == found


def test_what_was_ok_is_no_problem_once_it_is_heard_again(tmp_path):
    before = StateDriver()
    before.raw(COOL)
    before.keep(tmp_path / "state")
    after = before.restart(tmp_path / "state")
    after.raw(COOL)

    motor = after.component("Motor")
    assert (motor.level, after.problem_since("Motor"), motor.since, motor.changes) == (
        OK,
        None,
        WALL,
        0,
    )


def stale_is_ok() -> StateDriver:
    return StateDriver(
        components=(ComponentRule(re.compile(""), levels={STALE: OK}),), stale_after=5.0
    )


def test_a_restart_is_no_problem_where_stale_counts_as_ok(tmp_path):
    before = stale_is_ok()
    before.raw(COOL)
    before.keep(tmp_path / "state")
    after = before.restart(tmp_path / "state")

    motor = after.component("Motor")
    assert (motor.level, motor.before_stale, after.problem_since("Motor")) == (OK, None, None)
    after.at(100)
    after.now = Instant(101.0, WALL + 106)
    after.raw(HOT)
    assert (motor.level, after.problem_since("Motor")) == (ERROR, WALL + 106)


def test_a_restart_ends_no_problem_where_stale_counts_as_ok(tmp_path):
    before = stale_is_ok()
    before.raw(HOT)
    before.keep(tmp_path / "state")
    again = before.restart(tmp_path / "state")
    assert again.problem_since("Motor") is None  # it is OK, as the config has it
    again.keep(tmp_path / "state")

    for level in (ERROR, WARN):
        after = again.restart(tmp_path / "state")
        after.raw(HOT._replace(level=level))
        assert (after.level("Motor"), after.problem_since("Motor")) == (level, WALL)
        after.close()


@pytest.mark.parametrize(
    ("status", "stays"), [(HOT, True), (COOL, False), (COOL._replace(level=STALE), True)]
)
def test_what_was_not_ok_is_not_forgotten_after_a_restart_either(tmp_path, status, stays):
    before = StateDriver(forget_after=100.0)
    before.raw(COOL)
    before.raw(status)
    before.keep(tmp_path / "state")
    again = before.restart(tmp_path / "state")
    again.keep(tmp_path / "state")
    after = again.restart(tmp_path / "state")
    after.at(200)
    assert bool(after.robot.components) == stays


def test_a_robot_that_never_published_does_not_survive_a_restart(tmp_path):
    discovery = Discovery(re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    before = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    before.state.update_graph(
        0, {f"/{n}/diagnostics": Endpoint(1) for n in ("r", "mute")}, before.now
    )
    before.at(10)
    before.raw(COOL)
    before.at(20)
    before.raw(COOL)
    before.keep(tmp_path / "state")

    after = before.restart(tmp_path / "state")
    assert set(after.state.robots) == {"r"}


def test_two_restarts_in_a_row_lose_nothing(tmp_path):
    before = StateDriver()
    before.raw(HOT)
    before.keep(tmp_path / "state")
    between = before.restart(tmp_path / "state")
    between.keep(tmp_path / "state")
    after = between.restart(tmp_path / "state")
    after.raw(HOT)

    motor = after.component("Motor")
    assert (motor.level, motor.since, after.problem_since("Motor")) == (ERROR, WALL, WALL)


def test_a_restless_component_stays_restless(tmp_path):
    before = StateDriver()
    for second in range(8):
        before.at(second)
        before.raw(HOT if second % 2 else COOL)
    before.keep(tmp_path / "state")
    after = before.restart(tmp_path / "state")

    ratio = before.sample("component_flap_ratio", component="Motor")
    assert after.sample("component_flap_ratio", component="Motor") == ratio > 0.3


def test_a_discovered_robot_that_is_away_is_known_again_if_discovery_still_wants_it(tmp_path):
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    before = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    before.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(1)}, before.now)
    before.agg(*tree(Motor=[HOT]))
    before.keep(tmp_path / "state")

    again = before.restart(tmp_path / "state")
    assert again.component("Motor").before_stale == ERROR
    assert again.robot.source is Source.AGG
    again.close()

    elsewhere = before.restart(tmp_path / "state", fleet=Fleet("f"))
    assert not elsewhere.state.robots


HOUR = 3600.0


def healthy(driver: StateDriver, path, topic: Topic, array: Array, *, hours: int) -> None:
    """An array every five minutes, the same ones all the time, saved as the exporter does."""
    driver.storage = Storage(path)
    begin = driver.now
    for turn in range(hours * 12 + 1):
        driver.now = Instant(begin.mono + turn * 300.0, begin.wall + turn * 300.0)
        driver.state.receive(topic, array, driver.now)
        driver.save()
    assert driver.storage.successful


def test_what_was_fine_for_days_is_not_forgotten_by_a_restart(tmp_path):
    before = StateDriver()
    array = Array(0.0, (COOL, LASER), 100)
    healthy(before, tmp_path / "state", Topic(0, "/r/diagnostics"), array, hours=55)
    after = before.restart(tmp_path / "state")
    after.at(5)

    assert {each.name for each in after.robot.components} == {"Motor", "Laser"}
    seen = after.sample("robot_last_message_timestamp_seconds")
    assert before.now.wall - 30 <= seen <= before.now.wall


def test_a_discovered_robot_that_falls_silent_in_a_restart_stays_known(tmp_path):
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    before = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    before.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(1)}, before.now)
    array = Array(0.0, tree(Motor=[COOL]), 100)
    healthy(before, tmp_path / "state", Topic(0, "/r/diagnostics_agg"), array, hours=55)
    after = before.restart(tmp_path / "state")
    after.at(5)

    assert after.sample("robot_up") == 0
    assert after.component("Motor").level == STALE


def test_the_last_write_has_what_was_seen_last(tmp_path):
    before = StateDriver()
    before.raw(COOL)
    before.keep(tmp_path / "state")
    before.at(7)
    before.raw(COOL)
    before.save(at_once=True)

    after = before.restart(tmp_path / "state")
    assert after.sample("robot_last_message_timestamp_seconds") == WALL + 7


def test_the_file_is_written_at_most_once_a_second_and_only_for_a_change(tmp_path):
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw(COOL)
    driver.keep(path)
    first = content(path)

    driver.at(0.5)
    driver.raw(HOT)
    driver.save()
    assert content(path) == first

    driver.at(1.5)
    driver.save()
    second = content(path)
    assert second != first

    driver.at(4)
    driver.raw(HOT)
    driver.save()
    assert content(path) == second
    assert driver.storage.written_at == WALL + 1.5


def test_only_the_robots_that_changed_are_written(tmp_path):
    path = tmp_path / "state"
    driver = StateDriver(fleet=fleet_of("r", "s"))
    receive(driver, "s", COOL)
    driver.raw(COOL)
    driver.keep(path)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE robots SET data = 'as it was' WHERE name = 's'")
    for second in range(2, 20, 3):  # "last received" of both changes, too
        driver.at(second)
        driver.raw(HOT)
        receive(driver, "s", COOL)
        driver.save()

    robots = dict(content(path)["robots"])
    assert robots["s"] == "as it was"
    assert json.loads(robots["r"])["components"][0]["level"] == ERROR


def test_a_robot_that_is_forgotten_goes(tmp_path):
    driver = StateDriver(fleet=fleet_of("r", "s"))
    driver.keep(tmp_path / "state")
    driver.state.configure(fleet_of("r"), driver.now)
    driver.at(2)
    driver.save()
    assert [name for name, _text in content(tmp_path / "state")["robots"]] == ["r"]


def fleet_of(*names: str) -> Fleet:
    return Fleet(
        "f",
        tuple(Robot(name, topic_raw=f"/{name}/diagnostics", source=Source.RAW) for name in names),
    )


def receive(driver: StateDriver, robot: str, *statuses: Status) -> None:
    topic = Topic(0, f"/{robot}/diagnostics")
    driver.state.receive(topic, Array(0.0, statuses, 100), driver.now)


# -- damaged ---------------------------------------------------------------------------------

# What stands in a file that is not a database, and what the log says of it.
DAMAGED = {
    b"{": "it is not a database",
    b"[" * 100_000: "it is not a database",
    b"\xff\xfe": "it is not a database",
    MAGIC: "it is not a database",
    MAGIC + bytes(84): "it is not a database",
    MAGIC + b"\x10\x00\x02\x02" + bytes(10_000): "file is not a database",
}


@pytest.mark.parametrize(("raw", "what"), DAMAGED.items(), ids=map(str, range(len(DAMAGED))))
def test_a_damaged_file_is_named_kept_aside_and_survived(tmp_path, caplog, raw, what):
    path = tmp_path / "state"
    path.write_bytes(raw)
    driver = StateDriver().restart(path)
    with caplog.at_level(logging.ERROR):
        driver.save()

    assert len(caplog.records) == 1
    assert f"{path} is damaged (" in caplog.text
    assert what in caplog.text
    assert len(caplog.text) < 1000
    assert (tmp_path / "state.damaged-1").read_bytes() == raw
    assert driver.storage.successful
    assert driver.restart(path).state.robots.keys() == {"r"}


def test_a_file_is_kept_aside_with_its_log_which_is_not_of_the_next(tmp_path):
    path = tmp_path / "state"
    path.write_text("damaged")
    (tmp_path / "state-wal").write_text("log")
    driver = StateDriver().restart(path)
    driver.save()
    assert (tmp_path / "state.damaged-1-wal").read_text() == "log"


def test_what_was_written_outlives_a_power_cut(tmp_path, monkeypatch):
    made = []
    connect = sqlite3.connect

    def watched(*args: Any, **more: Any) -> sqlite3.Connection:
        made.append(connect(*args, **more))
        return made[-1]

    monkeypatch.setattr(sqlite3, "connect", watched)
    StateDriver().keep(tmp_path / "state")
    (connection,) = made
    [(synchronous,)] = connection.execute("PRAGMA synchronous")
    assert synchronous == 2  # FULL: https://sqlite.org/pragma.html#pragma_synchronous


def test_an_empty_file_is_a_new_one(tmp_path, caplog):
    (tmp_path / "state").touch()
    driver = StateDriver().restart(tmp_path / "state")
    driver.save()
    assert driver.storage.successful
    assert not caplog.text


@pytest.mark.parametrize(
    ("statement", "what"),
    [
        ("DROP TABLE faults", "its tables are not those of this version"),
        ("ALTER TABLE events ADD COLUMN more", "its tables are not those of this version"),
    ],
)
def test_a_database_with_other_tables_is_kept_aside(tmp_path, caplog, statement, what):
    path = tmp_path / "state"
    before = StateDriver()
    before.raw(HOT)
    before.keep(path)
    before.close()
    edited(path, statement)
    after = before.restart(path)
    after.save()

    assert f"{path} is damaged ({what}), 0 robots of it are restored" in caplog.text
    assert (tmp_path / "state.damaged-1").exists()
    assert after.storage.successful


@pytest.mark.parametrize(
    ("statement", "what"),
    [
        (
            "PRAGMA user_version = 4",
            "is a database of version 4, and this exporter writes version 3; ",
        ),
        (
            "PRAGMA user_version = 0",
            "is a database of version 0, and this exporter writes version 3; ",
        ),
        ("PRAGMA application_id = 1", "is the database of another program"),
    ],
)
def test_a_database_of_another_version_stays_and_stops_the_start(tmp_path, statement, what):
    path = tmp_path / "state"
    before = StateDriver()
    before.raw(HOT)
    before.keep(path)
    before.close()
    edited(path, "PRAGMA journal_mode = DELETE", statement)
    whole = path.read_bytes()

    with pytest.raises(VersionError, match=re.escape(f"{path} {what}")):
        before.restart(path)
    assert path.read_bytes() == whole
    assert not (tmp_path / "state.damaged-1").exists()


@pytest.mark.parametrize("statement", ["ANALYZE", "CREATE INDEX mine ON events (time)"])
def test_what_a_person_added_to_speed_it_up_is_no_damage(tmp_path, caplog, statement):
    path = tmp_path / "state"
    before = StateDriver()
    before.raw(HOT)
    before.keep(path)
    before.close()
    edited(path, statement)
    after = before.restart(path)
    after.save()

    assert after.component("Motor").before_stale == ERROR
    assert not caplog.text


def refused(cause: str, path) -> sqlite3.Error:
    """What SQLite says about a database in this state."""
    with closing(sqlite3.connect(path)) as other, closing(sqlite3.connect(path, timeout=0)) as own:
        if cause == "locked":
            other.execute("BEGIN EXCLUSIVE")
        elif cause == "damaged":
            size = path.stat().st_size
            path.write_bytes(path.read_bytes()[:100].ljust(size, b"x"))
        elif cause == "no database":
            path.write_bytes(b"x" * 4096)
        elif cause == "too many pages":
            own.execute("PRAGMA max_page_count = 2")
        wrong = "none" if cause == "our own mistake" else "data"
        with pytest.raises(sqlite3.Error) as raised:
            own.execute(f"INSERT INTO events ({wrong}) VALUES (zeroblob(100000))")
        return raised.value


@pytest.mark.parametrize(
    ("cause", "damaged"),
    [
        ("damaged", True),
        ("no database", True),
        ("locked", False),
        ("too many pages", False),
        ("our own mistake", False),
    ],
)
def test_only_what_sqlite_calls_corrupt_is_damage(tmp_path, cause, damaged):
    path = tmp_path / "state"
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("CREATE TABLE events (data)")
    error = refused(cause, path)

    assert is_damage(error) is damaged
    del error.sqlite_errorcode  # as Python 3.10 raises it
    assert is_damage(error) is damaged


def test_the_words_locking_protocol_are_no_damage():
    assert not is_damage(sqlite3.OperationalError("locking protocol"))


WRONG = {
    "level": 7,
    "before_stale": "ERROR",
    "since": "yesterday",
    "identity": ["Motor"],
    "message": "x" * 5000,
    "hardware_id": None,
    "listed": [],
}


@pytest.mark.parametrize("field", WRONG)
def test_robots_that_are_whole_are_restored_from_a_damaged_file(tmp_path, caplog, field):
    before = StateDriver(fleet=fleet_of("r", "s"))
    before.raw(HOT)
    receive(before, "s", HOT)
    path = tmp_path / "state"
    before.keep(path)
    before.close()
    value = json.dumps(WRONG[field])
    edited(
        path,
        f"UPDATE robots SET data = json_set(data, '$.components[0].{field}', json('{value}'))"
        " WHERE name = 's'",
    )
    after = before.restart(path)
    after.save()

    assert after.component("Motor").before_stale == ERROR
    assert not after.state.robots["s"].components
    assert f"robot 's': components.0.{field}" in caplog.text
    assert "1 robots of it are restored; it is kept as" in caplog.text
    assert "fleet" in fleet_snapshot(after.state, after.now)
    assert len(list(after.log.find(Wanted(kind="level")))) == len(before.events) - 4
    again = after.restart(path)
    assert again.component("Motor").before_stale == ERROR


def test_of_several_damaged_robots_the_first_is_named(tmp_path, caplog):
    before = StateDriver(fleet=fleet_of("r", "s", "t"))
    before.raw(HOT)
    receive(before, "s", HOT)
    receive(before, "t", HOT)
    path = tmp_path / "state"
    before.keep(path)
    before.close()
    edited(path, "UPDATE robots SET data = '{}' WHERE name <> 'r'")
    after = before.restart(path)
    after.save()

    assert after.component("Motor").before_stale == ERROR
    assert "robot 's': " in caplog.text
    assert ", and 1 more robots" in caplog.text


def test_no_damaged_file_overwrites_an_earlier_one_and_ten_are_kept(tmp_path, caplog):
    path = tmp_path / "state"
    for turn in range(12):
        path.write_text(f"damaged {turn}")
        driver = StateDriver().restart(path)
        driver.save()
        assert driver.storage.successful == (turn < 10)
        driver.close()

    kept = [(tmp_path / f"state.damaged-{turn + 1}").read_text() for turn in range(10)]
    assert kept == [f"damaged {turn}" for turn in range(10)]
    assert path.read_text() == "damaged 11"
    assert "10 such files are there; nothing is saved until" in caplog.text


def test_damage_while_it_runs_is_kept_aside_and_everything_written_again(tmp_path, caplog):
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw(HOT, *(Status(OK, f"c{number}", "x" * 4000) for number in range(50)))
    driver.keep(path)
    driver.storage.close()
    with path.open("r+b") as file:
        file.seek(3 * 4096)
        file.write(b"\xff" * 4096 * 10)
    for second in (2, 4):
        driver.at(second)
        driver.raw(COOL)
        driver.save()

    assert f"kept as {path}.damaged-1" in caplog.text
    assert driver.storage.successful
    after = driver.restart(path)
    assert len(after.robot.components) == 51
    assert after.component("Motor").before_stale == OK


# -- not readable, not writable --------------------------------------------------------------


def planted(kind: str, path) -> None:
    """Put something there that cannot be read as a database."""
    target = path.with_name("target")
    target.write_text("precious")
    if kind == "link":
        path.symlink_to(target)
    elif kind == "folder":
        path.mkdir()
    elif kind == "fifo":
        os.mkfifo(path)
    else:
        path.write_text("unreadable")
        path.chmod(0)


@pytest.mark.parametrize(
    "kind",
    [
        *("link", "folder", "fifo"),
        pytest.param("mode", marks=pytest.mark.skipif(not os.getuid(), reason="root reads all")),
    ],
)
def test_what_cannot_be_read_is_left_alone_and_nothing_is_saved_until_it_has_gone(
    tmp_path, caplog, kind
):
    path = tmp_path / "state"
    planted(kind, path)
    mode = path.lstat().st_mode
    driver = StateDriver().restart(path)
    driver.raw(HOT)
    for second in range(1, 4):
        driver.now = Instant(float(second), WALL + second)
        driver.save(at_once=second == 3)
    assert not driver.storage.successful
    assert path.lstat().st_mode == mode
    assert (tmp_path / "target").read_text() == "precious"
    assert caplog.text.count(f"database {path} cannot be read") == 1
    assert sorted(each.name for each in tmp_path.iterdir()) == ["state", "target"]

    path.rename(tmp_path / "moved")
    driver.now = Instant(5.0, WALL + 5)
    driver.save()
    assert driver.storage.successful
    assert driver.restart(path).component("Motor").before_stale == ERROR


def test_a_disk_that_fails_to_read_does_not_stop_the_start(tmp_path, monkeypatch, caplog):
    path = tmp_path / "state"
    path.write_text("precious")

    def fail(*_arguments, **_more):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("ros_diagnostics_exporter.storage.storage.read_regular", fail)
    driver = StateDriver().restart(path)
    driver.save(at_once=True)

    assert not driver.storage.successful
    assert path.read_text() == "precious"
    assert "cannot be read (Input/output error)" in caplog.text


def test_a_disk_that_hangs_does_not_stop_the_start(tmp_path, monkeypatch, caplog):
    path = tmp_path / "state"
    path.write_text("precious")
    hangs = threading.Event()
    monkeypatch.setattr(
        "ros_diagnostics_exporter.storage.storage.read_regular",
        lambda *_a, **_m: (hangs.wait(), b"")[1],
    )
    monkeypatch.setattr("ros_diagnostics_exporter.storage.storage.LOADING", 0.05)
    driver = StateDriver().restart(path)
    driver.save(at_once=True)
    hangs.set()

    assert not driver.storage.successful
    assert path.read_text() == "precious"
    assert "no answer of the disk" in caplog.text


def test_a_write_that_hangs_counts_as_failed_and_the_events_in_memory_are_found(
    tmp_path, monkeypatch
):
    driver = StateDriver()
    driver.raw(COOL)
    driver.keep(tmp_path / "state")
    begun, hangs = threading.Event(), threading.Event()

    def hang(*_arguments, **_more):
        begun.set()
        hangs.wait()

    monkeypatch.setattr(Database, "write", hang)
    monkeypatch.setattr("ros_diagnostics_exporter.storage.storage.HANGING", 0.0)
    driver.at(2)
    driver.raw(HOT)
    thread = threading.Thread(target=driver.save)
    thread.start()
    begun.wait()
    try:
        assert not driver.storage.successful
        driver.log.record(Event(WALL + 3, "config", after="read"))
        assert [each["after"] for each in driver.log.find(Wanted(limit=2))] == ["read", "ERROR"]
    finally:
        hangs.set()
        thread.join()


def test_two_exporters_do_not_share_a_database(tmp_path):
    driver = StateDriver()
    driver.keep(tmp_path / "state")
    other, state = Storage(tmp_path / "state"), StateDriver().state
    with pytest.raises(
        InUseError, match=rf"state is in use by another exporter \(pid {os.getpid()}"
    ):
        other.load(state, driver.now)
    driver.close()
    other.load(state, driver.now)


def test_a_file_that_is_far_too_large_is_not_read_whole(tmp_path, caplog):
    path = tmp_path / "state"
    with path.open("wb") as file:
        file.truncate(1 << 30)
    StateDriver().restart(path).save()

    assert "it is not a database" in caplog.text
    assert (tmp_path / "state.damaged-1").stat().st_size == 1 << 30


@pytest.mark.parametrize("suffix", ["-wal", "-shm", ".lock"])
def test_a_planted_link_is_not_written_through(tmp_path, suffix):
    target = tmp_path / "target"
    target.write_text("precious")
    (tmp_path / f"state{suffix}").symlink_to(target)
    driver = StateDriver()
    driver.raw(HOT)

    driver.keep(tmp_path / "state")
    assert target.read_text() == "precious"


def test_the_files_are_the_users_own(tmp_path):
    driver = StateDriver()
    driver.keep(tmp_path / "data" / "exporter.db")
    files = list((tmp_path / "data").iterdir())
    assert {each.name.partition(".db")[2] for each in files} == {"", "-wal", "-shm", ".lock"}
    assert {each.stat().st_mode & 0o077 for each in (tmp_path / "data", *files)} == {0}


def test_half_of_a_character_makes_no_damaged_file(tmp_path, caplog):
    driver = StateDriver()
    driver.raw(Status(ERROR, "Motor", "Hot \ud800"))
    driver.keep(tmp_path / "state")

    assert driver.restart(tmp_path / "state").component("Motor").message == "Hot ?"
    assert not caplog.text


def test_rows_that_cannot_be_taken_are_shown_and_the_next_turn_saves(tmp_path, monkeypatch, caplog):
    driver = StateDriver()
    driver.storage = Storage(tmp_path / "state")
    driver.raw(HOT)
    driver.at(1)
    with monkeypatch.context() as patch:
        patch.setattr(driver.state, "take_fault_rows", lambda _now: 1 / 0)
        driver.save()
    assert not driver.storage.successful
    assert "ZeroDivisionError" in caplog.text

    driver.at(5)
    driver.save()
    assert driver.storage.successful


def test_a_fault_of_our_own_is_shown_and_the_next_turn_saves(tmp_path, monkeypatch, caplog):
    driver = StateDriver()
    driver.storage = Storage(tmp_path / "state")
    driver.raw(HOT)
    with monkeypatch.context() as patch:
        patch.setattr(ExporterRobot, "persist", lambda *_arguments: 1 / 0)
        for second in range(1, 4):
            driver.at(second)
            driver.save()
    assert not driver.storage.successful
    assert caplog.text.count("ZeroDivisionError") == 1

    driver.at(5)
    driver.save()
    assert driver.storage.successful
    assert driver.restart(tmp_path / "state").component("Motor").before_stale == ERROR


def test_a_database_that_is_moved_away_is_written_anew(tmp_path):
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw(HOT)
    driver.keep(path)
    path.rename(tmp_path / "moved")
    driver.at(2)
    driver.save()

    assert content(path)["robots"]
    assert len(content(path)["events"]) == len(driver.events)


# -- anything at all in the file -------------------------------------------------------------


def eventful() -> StateDriver:
    """A state with all that a file may hold: levels, groups, twins, a discovered robot."""
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    robot = Robot("r", topic_agg="/r/diagnostics_agg", topic_raw="/r/diagnostics")
    shared = Shared("/diagnostics", raw=True)
    driver = StateDriver(fleet=Fleet("f", (robot,), discoveries=(discovery,), shared=(shared,)))
    driver.agg(*tree(Motor=[HOT, Status(STALE, "Fan")], Laser=[LASER]))
    driver.state.update_graph(0, {"/d/diagnostics_agg": Endpoint(1)}, driver.now)
    for topic in ("/d/diagnostics_agg", "/diagnostics"):
        statuses = (Status(ERROR, "Twin", "1", "a"), Status(OK, "Twin", "2", "b"))
        driver.state.receive(Topic(0, topic), Array(0.0, statuses, 100), driver.now)
    return driver


EVENTFUL = eventful()
JUNK = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(),
    st.floats(),
    st.sampled_from([7, -1, 1e308, 2**63, "", "\x00", "\u202e", "a" * 5000, "OK", "agg", "both"]),
    st.text(max_size=20),
    st.lists(st.integers(0, 3), max_size=22),
    st.dictionaries(st.text(max_size=9), st.integers(), max_size=2),
)


@pytest.fixture(scope="module")
def whole(tmp_path_factory) -> Path:
    """A folder with a database, and one in which all of it is in the write-ahead log."""
    folder = tmp_path_factory.mktemp("whole")
    assert EVENTFUL.keep(folder / "live").successful
    for suffix in ("", "-wal"):
        shutil.copy(folder / f"live{suffix}", folder / f"log{suffix}")
    EVENTFUL.close()
    return folder


def use(folder: Path) -> None:
    """Start from the database in this folder, and ask for all that can be asked."""
    after = EVENTFUL.restart(folder / "state")
    after.at(1)
    after.agg(*tree(Motor=[COOL], Laser=[LASER]))
    after.samples()
    json.dumps(fleet_snapshot(after.state, after.now), allow_nan=False)
    targets(after.state, "node", None)
    for second in (2, 4):  # damage may be found only when it is written, or read
        after.at(second)
        after.save()
    assert after.storage.successful
    list(after.log.find(Wanted(limit=10_000)))
    last = [each["id"] for each in after.log.find(Wanted(kind="level", limit=1))]
    again = after.restart(folder / "state")
    assert [each["id"] for each in again.log.find(Wanted(kind="level", limit=1))] == last
    again.close()
    assert again.component("Motor").before_stale == OK


def junk_put_in(content: Any, draw: st.DrawFn) -> Any:
    """Replace something inside, at any depth; or a key of it, or leave it out."""
    inside = content.items() if isinstance(content, dict) else enumerate(content)
    places = [place for place, _inner in inside]
    if not places:
        return draw(JUNK)
    place = draw(st.sampled_from(places))
    what = draw(st.sampled_from(["deeper", "deeper", "deeper", "replace", "leave out", "key"]))
    if what == "deeper" and isinstance(content[place], dict | list):
        content[place] = junk_put_in(content[place], draw)
    elif what == "leave out":
        del content[place]
    elif what == "key" and isinstance(content, dict):
        content[draw(st.text(max_size=9))] = content.pop(place)
    else:
        content[place] = draw(JUNK)
    return content


# A column with JSON, its table, and what identifies the row.
COLUMNS = [("data", "robots", "name"), ("fields", "faults", "key"), ("key", "faults", "key")]


@given(data=st.data())
@settings(max_examples=60)
def test_any_values_in_the_file_neither_stop_the_start_nor_break_what_is_shown(whole, data):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state"
        shutil.copy(whole / "live", path)
        with closing(sqlite3.connect(path)) as connection, connection:
            column, table, key = data.draw(st.sampled_from(COLUMNS))
            rows = list(connection.execute(f"SELECT {key}, {column} FROM {table}"))
            row, text = data.draw(st.sampled_from(rows))
            junk = json.dumps(junk_put_in(json.loads(text), data.draw))
            update = f"UPDATE OR REPLACE {table} SET {column} = ? WHERE {key} = ?"
            connection.execute(update, (junk, row))
        use(Path(folder))


def test_a_component_of_which_the_name_is_damaged_does_not_stop_the_start(whole, tmp_path):
    shutil.copy(whole / "live", tmp_path / "state")
    with closing(sqlite3.connect(tmp_path / "state")) as connection, connection:
        found = "SELECT key FROM faults WHERE kind = 'component'"
        ((key,), *_) = connection.execute(found)
        short = json.dumps(json.loads(key)[:-1])
        connection.execute("UPDATE faults SET key = ? WHERE key = ?", (short, key))
    use(tmp_path)


@given(data=st.data())
@settings(max_examples=60)
def test_any_bytes_in_the_file_neither_stop_the_start_nor_break_what_is_shown(whole, data):
    with tempfile.TemporaryDirectory() as folder:
        name = data.draw(st.sampled_from(["live", "log", "log-wal"]))
        for suffix in ("", "-wal") if name.startswith("log") else ("",):
            shutil.copy(whole / f"{name.partition('-')[0]}{suffix}", Path(folder, f"state{suffix}"))
        path = Path(folder, "state-wal" if name == "log-wal" else "state")
        raw = bytearray(path.read_bytes())
        for _ in range(data.draw(st.integers(1, 5))):
            raw[data.draw(st.integers(0, len(raw) - 1))] = data.draw(st.integers(0, 255))
        path.write_bytes(bytes(raw))
        use(Path(folder))


def test_a_file_cut_off_anywhere_is_survived(whole, tmp_path):
    raw = (whole / "live").read_bytes()
    for length in range(0, len(raw), 4093):
        folder = tmp_path / str(length)
        folder.mkdir()
        (folder / "state").write_bytes(raw[:length])
        use(folder)


def test_a_missing_file_is_the_first_start_and_no_error(tmp_path, caplog):
    StateDriver().restart(tmp_path / "state")

    assert not caplog.text


def test_a_folder_that_cannot_be_made_is_said_once_a_minute_and_tried_again(tmp_path, caplog):
    folder = tmp_path / "mount" / "folder"
    driver = StateDriver()
    driver.storage = Storage(folder / "state")
    driver.raw(HOT)
    for second in range(1, 11):
        driver.at(second)
        driver.save()
    assert not driver.storage.successful
    assert caplog.text.count("cannot be written") == 1

    folder.parent.mkdir()
    driver.at(12)
    driver.save()
    assert driver.storage.successful
    assert driver.restart(folder / "state").component("Motor").before_stale == ERROR


def test_a_disk_that_takes_no_more_leaves_what_was_written(tmp_path, caplog):
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw(HOT)
    driver.keep(path)
    before = content(path)

    driver.at(2)
    driver.raw(COOL, *(Status(OK, f"c{number}") for number in range(2000)))
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (131_072, limit[1]))  # the real error of real writes
    try:
        driver.save()
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)

    assert not driver.storage.successful
    assert "cannot be written" in caplog.text
    assert content(path) == before
    driver.at(4)
    driver.save()
    assert driver.storage.successful
    assert len(driver.restart(path).robot.components) > 400
    assert not (tmp_path / "state.damaged-1").exists()


# -- events ----------------------------------------------------------------------------------


def test_events_are_there_after_a_restart_and_ids_go_on(tmp_path):
    before = StateDriver()
    before.raw(HOT)
    before.at(1)
    before.raw(COOL)
    before.keep(tmp_path / "state")
    after = before.restart(tmp_path / "state")
    after.raw(HOT)
    after.save()

    found = list(after.log.find(Wanted()))
    ids = [each["id"] for each in found]
    assert ids == list(range(len(ids), 0, -1))
    level = [(each.get("before"), each["after"]) for each in found if each["kind"] == "level"]
    assert level == [("OK", "ERROR"), ("ERROR", "OK"), (None, "ERROR")]
    [*_more, known] = [each for each in found if each["after"] == "known"]
    assert known == {"id": ids[-1], "time": WALL, "kind": "robot", "robot": "r", "after": "known"}


@pytest.mark.parametrize(
    "wanted",
    [
        Wanted(robot="r"),
        Wanted(component="c7"),
        Wanted(kind="level", level="ERROR", limit=7),
        Wanted(since=WALL + 3, until=WALL + 6),
        Wanted(before=40, limit=5),
        Wanted(robot="nobody"),
        Wanted(before=1),
    ],
)
def test_the_database_finds_what_the_memory_finds(tmp_path, wanted):
    driver = StateDriver()
    for second in range(10):
        driver.at(second)
        driver.raw(*(Status((second + n) % 2 * ERROR, f"c{n}") for n in range(10)))
    driver.keep(tmp_path / "state")
    in_memory = list(driver.log.find(wanted))
    after = driver.restart(tmp_path / "state")
    after.save()
    before_it = replace(wanted, before=wanted.before or len(driver.events) + 1)
    assert list(after.log.find(before_it)) == in_memory


def test_old_events_go_by_age_and_size(tmp_path):
    driver = StateDriver()
    driver.storage = Storage(tmp_path / "state", Retention(seconds=100.0, size=200_000))
    for second in range(0, 4000, 20):
        driver.now = Instant(float(second), WALL + second)
        for number in range(20):
            driver.log.record(Event(driver.now.wall, "config", message=f"{number} " + "x" * 50))
        driver.save()
    events = content(tmp_path / "state")["events"]
    assert min(time for _id, time, *_texts in events) >= driver.now.wall - 100 - 20
    assert len(events) >= 100

    size = (tmp_path / "state").stat().st_size
    for second in range(4000, 4400, 2):
        driver.now = Instant(float(second), WALL + second)
        for number in range(100):
            driver.log.record(Event(driver.now.wall, "config", message=f"{number} " + "x" * 200))
        driver.save()
    driver.close()
    assert size < (tmp_path / "state").stat().st_size < 400_000
    assert content(tmp_path / "state")["events"][-1][1] == driver.now.wall


DAY = 86_400.0


def kept_events(path) -> list[float]:
    """Of how many days ago they are, those of the helper below and later ones."""
    events = content(path)["events"]
    return [(WALL - time) / DAY for _id, time, kind, *_ in events if kind == "config"]


def with_events(path, *days: float) -> StateDriver:
    """Written, with one event as many days before now as given, in this order; kept for 90."""
    driver = StateDriver()
    driver.storage = Storage(path, Retention(seconds=90 * DAY))
    for day in days:
        driver.log.record(Event(WALL - day * DAY, "config"))
    driver.save(at_once=True)
    return driver


@pytest.mark.parametrize("restarted_first", [False, True])
@pytest.mark.parametrize("days", [-2, 100, 200])
def test_a_wall_clock_that_was_set_deletes_no_events(tmp_path, days, restarted_first):
    driver = with_events(tmp_path / "state", 80, 40, 1)
    if restarted_first:
        driver = driver.restart(tmp_path / "state", after=days * DAY)
    for second in range(1, 600, 20):
        driver.now = Instant(float(second), WALL + second + days * DAY)
        driver.log.record(Event(driver.now.wall, "config"))
        driver.save()
    assert len(kept_events(tmp_path / "state")) == 3 + 30
    for second in range(600, 700, 20):  # and is set right
        driver.now = Instant(float(second), WALL + second)
        driver.save(at_once=True)
    assert len(kept_events(tmp_path / "state")) == 3 + 30
    driver.close()


def test_an_event_of_the_future_keeps_none_of_those_after_it(tmp_path):
    driver = with_events(tmp_path / "state", -200, 95, 92, 80)
    driver.close()
    assert kept_events(tmp_path / "state") == [80]


def test_events_grow_old_after_a_long_time_off(tmp_path):
    driver = with_events(tmp_path / "state", 80, 1)
    for hour in range(1, 24 * 8):
        driver.now = Instant(3600.0 * hour, WALL + 20 * DAY + 3600.0 * hour)
        driver.save(at_once=True)
    assert kept_events(tmp_path / "state") == [1]
    driver.close()


@pytest.mark.parametrize("days", [-2, -1 / 48, 200])
def test_a_wall_clock_that_was_set_between_two_starts_delays_no_fault(tmp_path, days):
    driver = StateDriver()
    warm, weak = Status(WARN, "Motor"), Status(ERROR, "Arm")
    driver.raw_every(1, 60, warm)
    driver.raw(warm, weak)
    driver.keep(tmp_path / "state")
    assert len(driver.state.faults()) == 1
    after = driver.restart(tmp_path / "state", after=days * DAY)
    began = after.now.wall
    for second in range(1, 45):
        after.raw(warm._replace(level=ERROR), weak)
        after.now = Instant(float(second), began + second)
        after.state.tick(after.now)
    found = {(each.identity.component, each.identity.state.value) for each in after.state.faults()}
    assert found == {("Motor", "warning"), ("Motor", "critical"), ("Arm", "critical")}
    assert all(fault.since <= after.now.wall for fault in after.state.faults() if days > 0)
    assert after.robot.last_wall <= after.now.wall
    after.close()


def test_what_was_known_is_not_forgotten_before_it_can_be_received(tmp_path):
    discovery = Discovery(re.compile("/(?P<robot>[^/]+)/diagnostics"), "", source=Source.RAW)
    driver = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    driver.raw(Status(OK, "Motor"))
    driver.keep(tmp_path / "state")
    after = driver.restart(tmp_path / "state", after=200 * DAY)
    for second in range(1, 590):
        after.now = Instant(float(second), after.now.wall + 1)
        after.state.tick(after.now)
    assert after.level("Motor") == STALE
    for second in range(590, 610):
        after.now = Instant(float(second), after.now.wall + 1)
        after.state.tick(after.now)
    [robot] = after.state.robots.values()
    assert not robot.components  # the robot itself was received: it is silent until removed
    assert [each.identity.state.value for each in after.state.faults()] == ["silent"]
    after.close()


def test_events_that_come_faster_than_the_disk_are_counted_and_the_newest_kept(
    tmp_path, monkeypatch, caplog
):
    monkeypatch.setattr(events, "MAX_EVENTS", 50)
    driver = StateDriver()
    driver.keep(tmp_path / "state")
    for number in range(80):
        driver.log.record(Event(WALL, "config", message=str(number)))
    driver.at(2)
    driver.save()
    assert "30 events are lost" in caplog.text
    assert '"message": "79"' in content(tmp_path / "state")["events"][-1][-1]


# -- killed ----------------------------------------------------------------------------------

WRITER = """
import sys
from pathlib import Path
from support.state_driver import ERROR, OK, StateDriver
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.storage.storage import Storage

driver = StateDriver()
driver.storage = Storage(Path(sys.argv[1]))
for turn in range(1_000_000):
    driver.raw(*(Status((ERROR, OK)[turn % 2], f"c{n}", "x" * (turn % 50)) for n in range(50)))
    driver.save(at_once=True)
    if turn == 3:
        print("writing", flush=True)
"""


def test_killed_at_any_moment_the_file_is_whole(tmp_path, caplog):
    path = tmp_path / "state"
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    for turn in range(6):
        writer = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(path)], stdout=subprocess.PIPE, env=environment
        )
        with writer:
            assert writer.stdout.readline() == b"writing\n"
            # Any moment will do: each turn lets another part of a write go by.
            until = time.monotonic() + turn * 0.0037
            while time.monotonic() < until:
                pass
            writer.kill()
        fresh = StateDriver().restart(path)
        fresh.close()
        assert len(fresh.robot.components) == 50
    assert not caplog.text
