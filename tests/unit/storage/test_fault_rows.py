"""Faults in the database: they outlive the process, and a damaged row harms no other."""

import json
import logging
import sqlite3
from collections.abc import Callable
from contextlib import closing
from typing import Any

import pytest

from ros_diagnostics_exporter.events import Wanted
from ros_diagnostics_exporter.faults.model import Fault
from ros_diagnostics_exporter.model import Status
from support.state_driver import ERROR, OK, StateDriver, raw_fleet

HOT, COOL = Status(ERROR, "Motor", "Hot"), Status(OK, "Motor")
LASER = Status(ERROR, "Laser", "Dirty")


def saved(path, *statuses: Status) -> StateDriver:
    """A state with the faults of these, in the database."""
    driver = StateDriver().raw_every(1, 20, *statuses)
    driver.keep(path)
    return driver


def edited(driver: StateDriver, path, change: Callable[[list[Any]], Any]) -> None:
    """Let the process end, and change its rows, each [kind, key, fields]."""
    driver.close()
    with closing(sqlite3.connect(path)) as connection, connection:
        rows = [
            [kind, json.loads(key), json.loads(fields)]
            for kind, key, fields in connection.execute("SELECT * FROM faults")
        ]
        change(rows)
        connection.execute("DELETE FROM faults")
        for kind, *others in rows:
            texts = map(json.dumps, others)
            connection.execute("INSERT INTO faults VALUES (?, ?, ?)", (kind, *texts))


def names(faults: list[Fault]) -> set[str]:
    return {each.identity.component for each in faults}


def test_a_fault_outlives_the_process_with_its_times_and_evidence(path):
    before = saved(path, HOT)
    after = before.restart(path)
    assert after.state.faults() == before.state.faults()
    assert names(after.state.faults()) == {"Motor"}
    assert not list(path.parent.glob("*.damaged*"))
    after.save()
    again = after.restart(path)
    assert again.state.faults() == before.state.faults()
    assert again.raw(COOL).state.faults() == []


def test_a_fault_that_ended_is_written_without_it(path):
    before = saved(path, HOT).raw(COOL)
    before.at(22)
    before.save()
    assert before.restart(path).state.faults() == []


@pytest.mark.parametrize(
    "damage",
    [
        lambda row: row.__setitem__(2, None),
        lambda row: row.__setitem__(0, "rocket"),
        lambda row: row[2].update(clock=1e300),
        lambda row: row[2]["fault"]["details"].update(value=float("nan")),  # no JSON for the API
    ],
    ids=["empty", "kind", "beyond", "no number"],
)
def test_a_damaged_row_is_named_and_harms_no_other(path, caplog, damage):
    before = saved(path, HOT, LASER)

    def change(rows: list[Any]) -> None:
        [row] = [
            row
            for row in rows
            if row[0] == "problem" and row[1][:2] == ["component", "critical"] and "Motor" in row[1]
        ]
        damage(row)

    edited(before, path, change)
    with caplog.at_level(logging.ERROR):
        after = before.restart(path)
        after.save()
    assert "1 rows are not valid and dropped, the others restored: " in caplog.text
    assert [each.name for each in path.parent.glob("*damaged*")] == []
    assert names(after.state.faults()) == {"Laser"}
    assert names(after.raw_every(1, 15, HOT, LASER).state.faults()) == {"Laser", "Motor"}


@pytest.mark.parametrize(
    "damage",
    [
        lambda rows: rows.remove(next(row for row in rows if row[0] == "robot")),
        lambda rows: rows.append(["robot", [], rows[0][2]]),
        lambda rows: rows.append(["problem", "key", 7]),
    ],
    ids=["no robot", "no key", "text"],
)
def test_rows_that_do_not_belong_together_stop_nothing(path, caplog, damage):
    before = saved(path, HOT)
    edited(before, path, damage)
    with caplog.at_level(logging.ERROR):
        after = before.restart(path)
        after.save()
    assert "rows are not valid and dropped, the others restored: " in caplog.text
    assert [each.name for each in path.parent.glob("*damaged*")] == []
    assert [each.name for each in after.robot.components] == ["Motor"]
    assert names(after.raw_every(1, 15, HOT).state.faults()) == {"Motor"}


def test_what_refers_to_a_dropped_row_is_dropped_and_the_rest_restored(path, caplog):
    before = StateDriver(fleet=raw_fleet("r", "s"))
    for second in range(1, 20):
        before.at(second)
        for name in ("r", "s"):
            before.receive(f"/{name}/diagnostics", HOT)
    before.keep(path)
    assert len(before.state.faults()) == 2

    def change(rows: list[Any]) -> None:
        [robot] = [row for row in rows if row[:2] == ["robot", ["r"]]]
        robot[2]["presence"] = "flying"

    edited(before, path, change)
    events = len(list(before.log.find(Wanted(limit=1000))))
    after = before.restart(path)
    after.save()
    assert [fault.identity.robot for fault in after.state.faults()] == ["s"]
    what = "3 rows are not valid and dropped, the others restored: robot 'r': presence"
    assert what in caplog.text
    assert "component 'r Motor': what it refers to is not there" in caplog.text
    assert [each.name for each in path.parent.glob("*damaged*")] == []
    assert len(list(after.log.find(Wanted(limit=1000)))) >= events
    after.close()
    caplog.clear()
    after.restart(path)
    assert "dropped" not in caplog.text


def test_only_rows_that_changed_are_written(path):
    driver = saved(path, LASER, COOL)
    with closing(sqlite3.connect(path)) as connection, connection:
        connection.execute("UPDATE faults SET fields = 'as it was'")
    for second in range(22, 50, 2):
        driver.at(second)
        driver.raw(LASER, HOT)
        driver.save()
    with closing(sqlite3.connect(path)) as connection:
        rows = list(connection.execute("SELECT kind, key, fields FROM faults"))
    problems = [(json.loads(key), fields) for kind, key, fields in rows if kind == "problem"]
    assert all(fields == "as it was" for key, fields in problems if "Laser" in key)
    assert any(fields != "as it was" for key, fields in problems if "Motor" in key)
