"""Events of faults are found without reading those of levels, in older databases too."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest

from ros_diagnostics_exporter.events import Event, Wanted
from ros_diagnostics_exporter.storage.database import Changes, Database, find_events, first_event
from ros_diagnostics_exporter.storage.pruning import Bounds

EVENTS = [
    Event(10.0, "level", "r", "/Motor", "Motor 1", "OK", "ERROR"),
    Event(20.0, "fault_began", "r", "/Motor", "Motor 1", since=10.0, fault="0123456789ab"),
    Event(30.0, "notified", "s", since=10.0),
    Event(40.0, "fault_began", "s", since=30.0),
]


def written(path: Path) -> Path:
    found = Database(path)
    changes = Changes(True, [], [], [], {}, enumerate(EVENTS, 1))
    found.write(changes, Bounds(0.0, 100.0, 1 << 30))
    found.close()
    return path


def test_they_are_found_by_kind_robot_and_time(tmp_path):
    path = written(tmp_path / "db")

    def times(**wanted):
        return [event.time for _number, event in find_events(path, Wanted(**wanted))]

    assert times(kind="fault_began") == [40.0, 20.0]
    assert times(kind="fault_began", robot="r") == [20.0]
    assert times(kind="fault_began", until=40.0) == [20.0]
    assert times(kind="fault_ended") == []
    assert times(kind="level") == [10.0]
    assert times(fault="0123456789ab") == [20.0]
    assert times(fault="0123456789ab", kind="fault_ended") == []
    assert times(fault="fedcba987654") == []
    assert first_event(path) == 10.0


def test_those_of_one_fault_are_found_by_its_index(tmp_path):
    """A page of one fault, which every mail links, reads no event of another."""
    with closing(sqlite3.connect(written(tmp_path / "db"))) as connection:
        query = "SELECT id, data FROM events INDEXED BY events_of_fault WHERE id < 9 AND fault = ?"
        plan = connection.execute(f"EXPLAIN QUERY PLAN {query} ORDER BY id DESC", ("x",)).fetchall()
    assert [step[-1] for step in plan] == [
        "SEARCH events USING INDEX events_of_fault (fault=? AND rowid<?)"
    ]


def test_a_database_of_an_earlier_exporter_gets_the_index_and_keeps_its_events(tmp_path):
    path = written(tmp_path / "db")
    with closing(sqlite3.connect(path)) as connection:
        connection.execute("DROP INDEX events_of_faults")
    Database(path).close()
    assert [event.time for _n, event in find_events(path, Wanted(kind="notified"))] == [30.0]


def test_a_damaged_event_is_left_out(tmp_path):
    path = written(tmp_path / "db")
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE events SET data = '{}' WHERE id = 2")
    assert [number for number, _event in find_events(path, Wanted())] == [4, 3, 1]


@pytest.mark.parametrize(
    ("highest", "last"), [(-1, 0), (1, 1), (2**52, 2**52), (2**52 + 1, 0), (2**63 - 1, 0)]
)
def test_ids_go_on_from_the_highest_unless_no_exporter_wrote_it(tmp_path, highest, last):
    database = Database(tmp_path / "db")
    changes = Changes(True, [], [], [], {}, [(highest, EVENTS[0])])
    database.write(changes, Bounds(0.0, 100.0, 1 << 30))
    assert database.last_event() == last
    database.close()


def test_an_empty_database_has_no_first_event(tmp_path):
    Database(tmp_path / "db").close()
    assert first_event(tmp_path / "db") is None
