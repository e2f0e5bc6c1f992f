"""No disk can take the exporter down: what cannot be read or written is said and tried again."""

import errno
import os
import resource
import sqlite3
import tempfile
import threading
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

import pytest

from ros_diagnostics_exporter.events import Event, Wanted
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.storage.database import Changes, Database, InUseError
from ros_diagnostics_exporter.storage.pruning import Bounds
from ros_diagnostics_exporter.storage.storage import Storage
from support.state_driver import ERROR, OK, WALL, StateDriver

HOT, COOL = Status(ERROR, "Motor", "Hot"), Status(OK, "Motor")
DATABASE = "ros_diagnostics_exporter.storage.database"
STORAGE = "ros_diagnostics_exporter.storage.storage"
NOBODY = 65534


@pytest.fixture
def driver(path) -> StateDriver:
    """A process with a database and a hot motor, which is not written yet."""
    driver = StateDriver()
    driver.storage = Storage(path)
    driver.raw(HOT)
    return driver


def saved_at(driver: StateDriver, *seconds: float) -> bool:
    """Whether the last write at these times was successful."""
    for second in seconds:
        driver.at(second)
        driver.save()
    return driver.storage.successful


def is_restored(driver: StateDriver, path) -> bool:
    return driver.restart(path).component("Motor").before_stale == ERROR


# -- reading ---------------------------------------------------------------------------------


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


@pytest.fixture
def of_nobody():
    """A folder; where root runs this, of an ordinary user as whom the test goes on."""
    with tempfile.TemporaryDirectory() as folder:
        is_root = not os.getuid()
        if is_root:  # who may read all
            os.chown(folder, NOBODY, NOBODY)
            os.seteuid(NOBODY)
        try:
            yield Path(folder)
        finally:
            if is_root:
                os.seteuid(0)


@pytest.mark.parametrize("kind", ["link", "folder", "fifo", "mode"])
def test_what_cannot_be_read_is_left_alone_and_nothing_is_saved_until_it_has_gone(
    of_nobody, caplog, kind
):
    path = of_nobody / "state"
    planted(kind, path)
    mode = path.lstat().st_mode
    driver = StateDriver().restart(path).raw(HOT)
    for second in range(1, 4):
        driver.now = Instant(float(second), WALL + second)
        driver.save(at_once=second == 3)
    assert not driver.storage.successful
    assert path.lstat().st_mode == mode
    assert path.with_name("target").read_text() == "precious"
    assert caplog.text.count(f"database {path} cannot be read") == 1
    assert sorted(each.name for each in path.parent.iterdir()) == ["state", "target"]

    path.rename(path.with_name("moved"))
    assert saved_at(driver, 5)
    assert [each["id"] for each in driver.log.find(Wanted())][-1] == 1
    assert is_restored(driver, path)


def test_a_database_that_is_locked_is_left_alone(path, driver, edit, monkeypatch, caplog):
    monkeypatch.setattr(f"{DATABASE}.BUSY", 0.01)
    driver.keep(path)
    driver.close()
    with closing(sqlite3.connect(path)) as other:
        other.execute("PRAGMA locking_mode = EXCLUSIVE")
        other.execute("BEGIN EXCLUSIVE")
        locked = driver.restart(path)
    assert "cannot be read (database is locked): starting without it" in caplog.text
    assert not locked.storage.successful
    assert is_restored(locked, path)


def test_a_disk_that_fails_or_hangs_does_not_stop_the_start(path, monkeypatch, caplog):
    hangs = threading.Event()

    def fail(*_arguments, **_more):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    def hang(*_arguments, **_more):
        assert threading.current_thread().daemon  # else the process would not end
        hangs.wait()
        return b""

    monkeypatch.setattr(f"{STORAGE}.LOADING", 0.05)
    path.write_text("precious")
    for read, what in (
        (fail, "cannot be read (Input/output error)"),
        (hang, "no answer of the disk"),
    ):
        monkeypatch.setattr(f"{STORAGE}.read_regular", read)
        driver = StateDriver().restart(path)
        driver.save(at_once=True)
        assert not driver.storage.successful
        assert path.read_text() == "precious"
        assert what in caplog.text
        driver.close()
    hangs.set()


def test_two_exporters_do_not_share_a_database(path):
    driver = StateDriver()
    driver.keep(path)
    other, state = Storage(path), StateDriver().state
    with pytest.raises(
        InUseError, match=rf"state is in use by another exporter \(pid {os.getpid()}"
    ):
        other.load(state, driver.now)
    driver.close()
    with closing(other):
        other.load(state, driver.now)


# -- writing ---------------------------------------------------------------------------------


@pytest.fixture
def connections(monkeypatch) -> list[sqlite3.Connection]:
    """Those that are made from now on."""
    made = []
    connect = sqlite3.connect

    def watched(*args: Any, **more: Any) -> sqlite3.Connection:
        made.append(connect(*args, **more))
        return made[-1]

    monkeypatch.setattr(sqlite3, "connect", watched)
    return made


def test_what_was_written_outlives_a_power_cut(path, connections):
    StateDriver().keep(path)
    (connection,) = connections
    [(synchronous,)] = connection.execute("PRAGMA synchronous")
    assert synchronous == 2  # FULL: https://sqlite.org/pragma.html#pragma_synchronous


def test_a_check_for_damage_that_takes_too_long_is_given_up(path, connections):
    database = Database(path)
    connections[0].set_progress_handler(lambda: 1, 1)  # as the timer interrupts it
    assert database.check(60.0) == ""
    connections[0].set_progress_handler(None, 1)
    database.close()


def test_a_write_that_hangs_counts_as_failed_and_the_events_in_memory_are_found(path, monkeypatch):
    driver = StateDriver().raw(COOL)
    driver.keep(path)
    begun, hangs = threading.Event(), threading.Event()

    def hang(*_arguments, **_more):
        begun.set()
        hangs.wait()

    monkeypatch.setattr(Database, "write", hang)
    driver.at(2)
    thread = threading.Thread(target=driver.raw(HOT).save)
    thread.start()
    begun.wait()
    try:
        assert driver.storage.successful
        monkeypatch.setattr(f"{STORAGE}.HANGING", 0.0)
        assert not driver.storage.successful
        assert list(driver.storage.find_events(Wanted())) == []
        assert driver.storage.first_event() is None
        driver.log.record(Event(WALL + 3, "config", after="read"))
        assert [each["after"] for each in driver.log.find(Wanted(limit=2))] == ["read", "ERROR"]
    finally:
        hangs.set()
        thread.join()


@pytest.mark.parametrize("suffix", ["-wal", "-shm", ".lock"])
def test_a_planted_link_is_not_written_through(path, driver, suffix):
    target = path.with_name("target")
    target.write_text("precious")
    path.with_name(f"state{suffix}").symlink_to(target)

    driver.keep(path)
    assert target.read_text() == "precious"


def test_the_files_are_the_users_own(tmp_path):
    driver = StateDriver()
    driver.keep(tmp_path / "data" / "exporter.db")
    files = list((tmp_path / "data").iterdir())
    assert {each.name.partition(".db")[2] for each in files} == {"", "-wal", "-shm", ".lock"}
    assert {each.stat().st_mode & 0o077 for each in (tmp_path / "data", *files)} == {0}


@pytest.mark.parametrize("where", [(RobotState, "persist"), (None, "take_fault_rows")])
def test_a_fault_of_our_own_is_shown_and_the_next_turn_saves(
    path, driver, monkeypatch, caplog, where
):
    of, name = where
    with monkeypatch.context() as patch:
        patch.setattr(of or driver.state, name, lambda *_arguments, **_options: 1 / 0)
        assert not saved_at(driver, 1, 2, 3)
    assert caplog.text.count("ZeroDivisionError") == 1

    assert saved_at(driver, 5)
    assert is_restored(driver, path)


def test_a_database_that_is_moved_away_is_written_anew(path, driver, content):
    driver.keep(path)
    path.rename(path.with_name("moved"))
    saved_at(driver, 2)

    assert content()["robots"]
    assert content()["faults"]
    assert len(content()["events"]) == len(driver.events)


def test_a_folder_that_cannot_be_made_is_said_once_a_minute_and_tried_again(path, driver, caplog):
    folder = path / "folder"
    driver.storage = Storage(folder / "state")
    assert not saved_at(driver, *range(1, 11), 60)
    assert caplog.text.count("cannot be written") == 1
    assert not saved_at(driver, 61)
    assert caplog.text.count("cannot be written") == 2
    assert "Traceback" not in caplog.text

    path.mkdir()
    assert saved_at(driver, 62)
    assert is_restored(driver, folder / "state")


@contextmanager
def full_disk():
    """The real error of real writes."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (131_072, limit[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


def test_a_disk_that_takes_no_more_leaves_what_was_written(path, driver, caplog, content):
    driver.keep(path)
    before = content()

    driver.at(2)
    driver.raw(COOL, *(Status(OK, f"c{number}") for number in range(2000)))
    with full_disk():
        driver.save()
    assert not driver.storage.successful
    assert "cannot be written" in caplog.text
    assert content() == before

    assert saved_at(driver, 4)
    assert len(driver.restart(path).robot.components) > 400
    assert not path.with_name("state.damaged-1").exists()


def test_events_that_cannot_be_read_are_left_out_and_logged(path, driver, edit, caplog):
    driver.keep(path)
    edit("DROP TABLE events")
    assert list(driver.storage.find_events(Wanted())) == []
    assert driver.storage.first_event() is None
    assert caplog.text.count("its events cannot be read: no such table: events") == 2


def test_a_damaged_file_in_a_folder_that_cannot_be_written_stays(of_nobody, caplog):
    path = of_nobody / "state"
    path.write_text("damaged")
    driver = StateDriver().restart(path)
    of_nobody.chmod(0o500)
    driver.save()
    assert "cannot be kept aside (Permission denied); nothing is saved until" in caplog.text
    assert path.read_text() == "damaged"
    driver.close()


def test_a_write_that_fails_half_way_leaves_what_was_written(path):
    database = Database(path)

    def write(name, events=()):
        changes = Changes(True, [(name, "{}")], [], [(name, WALL)], {}, events)
        database.write(changes, Bounds(0.0, WALL, 1 << 30))

    def failing():
        yield 1, Event(WALL, "config")
        raise MemoryError

    write("a")
    with pytest.raises(MemoryError):
        write("b", failing())
    assert [*database.robots()] == [("a", "{}", WALL)]
    assert database.last_event() == 0
    write("c")
    assert [*database.robots()] == [("c", "{}", WALL)]
    database.close()
