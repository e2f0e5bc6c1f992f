"""Whatever stands in the database: the exporter starts, and what it shows is whole."""

import json
import re
import shutil
import sqlite3
import tempfile
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot, targets
from ros_diagnostics_exporter.config.fleet import Discovery, Fleet, Robot, Shared
from ros_diagnostics_exporter.events import Wanted
from ros_diagnostics_exporter.model import Endpoint, Status
from ros_diagnostics_exporter.storage.earlier import decoded
from support.state_driver import ERROR, OK, STALE, StateDriver, tree

HOT, COOL = Status(ERROR, "Motor", "Hot", "mc-1"), Status(OK, "Motor", "OK", "mc-1")
LASER = Status(OK, "Laser")


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
        driver.receive(topic, *statuses)
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
    after = EVENTFUL.restart(folder / "state").at(1)
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


# Of SQLite's header the version and the program: a database of another is refused, not repaired.
WHOSE = {*range(60, 64), *range(68, 72)}


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
            place = data.draw(st.integers(0, len(raw) - 1))
            if place not in WHOSE:
                raw[place] = data.draw(st.integers(0, 255))
        path.write_bytes(bytes(raw))
        use(Path(folder))


def test_a_schema_that_is_no_text_does_not_stop_the_start(whole, tmp_path):
    raw = (whole / "live").read_bytes()
    schema = b"CREATE TABLE robots "
    assert raw.count(schema + b"(") == 1
    (tmp_path / "state").write_bytes(raw.replace(schema + b"(", schema + b"\x80"))
    use(tmp_path)


def test_a_file_cut_off_anywhere_is_survived(whole, tmp_path):
    raw = (whole / "live").read_bytes()
    for length in range(0, len(raw), 4093):
        folder = tmp_path / str(length)
        folder.mkdir()
        (folder / "state").write_bytes(raw[:length])
        use(folder)


@pytest.mark.parametrize("text", [None, 7, b"\xff", "", "{", "NaN", '{"level": Infinity}'])
def test_what_is_no_json_is_no_content(text):
    assert decoded(text) is None
