"""A damaged database is named, kept aside and survived; one of another program stays as it is."""

import json
import logging
import re
import sqlite3
from contextlib import closing

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.events import Wanted
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.storage import earlier
from ros_diagnostics_exporter.storage.database import MAGIC, ForeignError, is_damage
from support.state_driver import ERROR, OK, StateDriver, raw_fleet

HOT, COOL = Status(ERROR, "Motor", "Hot"), Status(OK, "Motor")

# What stands in a file that is not a database, and what the log says of it.
DAMAGED = {
    b"{": "it is not a database",
    MAGIC + bytes(84): "it is not a database",
    MAGIC + b"\x10\x00\x02\x02" + bytes(10_000): "file is not a database",
}


@pytest.mark.parametrize(("raw", "what"), DAMAGED.items(), ids=map(str, range(len(DAMAGED))))
def test_a_damaged_file_is_named_kept_aside_and_survived(path, caplog, raw, what):
    path.write_bytes(raw)
    driver = StateDriver().restart(path)
    with caplog.at_level(logging.ERROR):
        driver.save()

    assert len(caplog.records) == 1
    assert f"{path} is damaged (" in caplog.text
    assert what in caplog.text
    assert len(caplog.text) < 1000
    assert path.with_name("state.damaged-1").read_bytes() == raw
    assert driver.storage.successful
    assert [each["id"] for each in driver.log.find(Wanted())][-1] == 1
    assert driver.restart(path).state.robots.keys() == {"r"}


def test_a_file_is_kept_aside_with_its_log_which_is_not_of_the_next(path):
    path.write_text("damaged")
    path.with_name("state-wal").write_text("log")
    StateDriver().restart(path).save()
    assert path.with_name("state.damaged-1-wal").read_text() == "log"


def test_no_damaged_file_overwrites_an_earlier_one_and_ten_are_kept(path, caplog):
    for turn in range(12):
        path.write_text(f"damaged {turn}")
        driver = StateDriver().restart(path)
        driver.save()
        assert driver.storage.successful == (turn < 10)
        driver.close()

    kept = [path.with_name(f"state.damaged-{turn + 1}").read_text() for turn in range(10)]
    assert kept == [f"damaged {turn}" for turn in range(10)]
    assert path.read_text() == "damaged 11"
    assert "10 such files are there; nothing is saved until" in caplog.text


def test_a_first_start_with_an_empty_file_is_no_error(path, caplog):
    path.touch()
    driver = StateDriver().restart(path)
    assert (driver.storage.successful, driver.storage.written_at) == (True, 0.0)
    driver.save()
    assert driver.storage.successful
    assert not caplog.text


# -- tables and versions ---------------------------------------------------------------------


@pytest.fixture
def written(path) -> StateDriver:
    """A process that has ended, with a hot motor of each of three robots."""
    driver = StateDriver(fleet=raw_fleet("r", "s", "t"))
    for name in ("r", "s", "t"):
        driver.receive(f"/{name}/diagnostics", HOT)
    driver.keep(path)
    driver.close()
    return driver


@pytest.mark.parametrize("statement", ["DROP TABLE faults", "ALTER TABLE events ADD COLUMN more"])
def test_a_database_with_other_tables_is_kept_aside(path, written, edit, caplog, statement):
    edit(statement)
    after = written.restart(path)
    after.save()

    what = "its tables are not those of its version"
    assert f"{path} is damaged ({what}), 0 robots of it are restored" in caplog.text
    assert path.with_name("state.damaged-1").exists()
    assert after.storage.successful


def test_the_database_of_another_program_stays_and_stops_the_start(path, written, edit):
    edit("PRAGMA journal_mode = DELETE", "PRAGMA application_id = 1")
    whole = path.read_bytes()

    with pytest.raises(ForeignError, match=re.escape(f"{path} is the database of another program")):
        written.restart(path)
    assert path.read_bytes() == whole
    assert not path.with_name("state.damaged-1").exists()


@pytest.mark.parametrize("version", [0, 9])
def test_a_database_of_an_unknown_version_is_kept_aside_and_the_exporter_starts(
    path, written, edit, caplog, version
):
    edit(f"PRAGMA user_version = {version}")
    after = written.restart(path)
    after.save()

    what = f"it is of version {version}, and this exporter reads 2 to 4"
    assert f"{path} cannot be used ({what}), 0 robots of it are restored" in caplog.text
    assert f"it is kept as {path}.version-{version}-1" in caplog.text
    assert after.storage.successful
    with closing(sqlite3.connect(f"{path}.version-{version}-1")) as connection:
        assert connection.execute("SELECT count(*) FROM robots").fetchone() == (3,)


@pytest.mark.parametrize(
    "statements",
    [
        ("ANALYZE",),
        ("CREATE INDEX mine ON events (time)",),
        ("DROP INDEX events_of_robot", "DROP INDEX events_of_faults"),
    ],
)
def test_an_index_more_or_less_is_no_damage(path, written, edit, caplog, statements):
    edit(*statements)
    after = written.restart(path)
    after.save()

    assert after.component("Motor").before_stale == ERROR
    assert not caplog.text
    assert path.read_bytes()[68:72] == b"ROSD"  # by which `file` and later versions know it


def error_of(cause: str, path) -> sqlite3.Error:
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
    "cause", ["damaged", "no database", "locked", "too many pages", "our own mistake"]
)
def test_only_what_sqlite_calls_corrupt_is_damage(path, edit, cause):
    edit("CREATE TABLE events (data)")
    error = error_of(cause, path)
    damaged = cause in ("damaged", "no database")

    assert is_damage(error) is damaged
    if hasattr(error, "sqlite_errorcode"):
        del error.sqlite_errorcode  # as Python 3.10 raises it
        assert is_damage(error) is damaged
    assert not is_damage(sqlite3.OperationalError("locking protocol"))


# -- rows that are not valid -----------------------------------------------------------------

WRONG = {"level": 7, "since": "yesterday", "identity": ["Motor"], "message": "x" * 5000}


@pytest.mark.parametrize("field", WRONG)
def test_a_robot_that_is_not_valid_is_dropped_and_the_others_restored(
    path, written, edit, caplog, field
):
    place = f"'$.components[0].{field}', json('{json.dumps(WRONG[field])}')"
    edit(f"UPDATE robots SET data = json_set(data, {place}) WHERE name = 's'")
    after = written.restart(path)
    after.save()

    assert after.component("Motor").before_stale == ERROR
    assert not after.state.robots["s"].components
    assert f"the others restored: robot 's': components.0.{field}" in caplog.text
    assert [each.name for each in path.parent.glob("*damaged*")] == []
    assert "fleet" in fleet_snapshot(after.state, after.now)
    assert len(list(after.log.find(Wanted(kind="level")))) == 3
    assert after.restart(path).component("Motor").before_stale == ERROR


@pytest.mark.parametrize("name", ["''", "'two' || char(10) || 'lines'", "zeroblob(9)", "'LONG'"])
def test_a_robot_whose_name_is_none_is_named_and_left_out(path, written, edit, caplog, name):
    long = "x" * 1024
    name = name.replace("LONG", f"x{long}")
    edit(f"UPDATE robots SET name = {name} WHERE name = 's'")
    edit(f"UPDATE robots SET name = '{long}' WHERE name = 't'")
    after = written.restart(path, fleet=raw_fleet("r", long))
    after.save()

    assert caplog.text.count("its name is not one of a robot") == 1
    assert after.state.robots[long].components


def test_of_many_rows_that_are_not_valid_the_first_are_named(path, written, edit, caplog):
    edit("UPDATE robots SET data = '{}' WHERE name <> 'r'", "UPDATE faults SET fields = '7'")
    after = written.restart(path)
    after.save()

    assert after.component("Motor").before_stale == ERROR
    assert "robot 's': " in caplog.text
    assert re.search(r"; and \d+ more$", caplog.text.strip())
    assert len(caplog.text) < 1000


# -- what is restored of a damaged file ------------------------------------------------------


def test_damage_while_it_runs_is_kept_aside_and_everything_written_again(path, caplog):
    driver = StateDriver().raw(HOT, *(Status(OK, f"c{number}", "x" * 4000) for number in range(50)))
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


def test_of_a_damaged_file_the_newest_events_are_taken_over(path, written, caplog, monkeypatch):
    assert earlier.MAX_SALVAGED == 10_000
    monkeypatch.setattr(earlier, "MAX_SALVAGED", 2)
    of_file = list(written.log.find(Wanted()))
    assert len(of_file) > 2
    with path.open("r+b") as file:
        file.seek(36)
        file.write(b"\0\0\0\5")  # pages that are free: there is none
    after = written.restart(path)
    after.save()
    assert f"it is kept as {path}.damaged-1" in caplog.text

    with closing(sqlite3.connect(path)) as connection:
        ids = [number for (number,) in connection.execute("SELECT id FROM events ORDER BY id DESC")]
    assert ids[-2:] == [each["id"] for each in of_file[:2]]
    assert ids[0] > of_file[0]["id"]
    last = of_file[1]["id"]  # what came later is still in memory
    assert earlier.salvage(path.with_name(f"{path.name}.damaged-1"), last)[-1][0] == last
