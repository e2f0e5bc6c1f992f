"""Faults in the state file: they outlive the process, and a damaged row harms no other."""

from __future__ import annotations

import json
import logging

import pytest

from ros_diagnostics_exporter.faults.model import Fault
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.state.storage import Storage
from support.state_driver import ERROR, OK, StateDriver

HOT, COOL = Status(ERROR, "Motor", "Hot"), Status(OK, "Motor")
LASER = Status(ERROR, "Laser", "Dirty")


def saved(path, *statuses: Status) -> StateDriver:
    """A state with the faults of these, written to the file."""
    driver = StateDriver()
    driver.raw_every(1, 20, *statuses)
    Storage(path).save(driver.state, driver.now)
    return driver


def restarted(before: StateDriver, path) -> StateDriver:
    driver = StateDriver(fleet=before.state.fleet)
    driver.now = Instant(0.0, before.now.wall + 5)
    Storage(path).load(driver.state, driver.now)
    return driver


def names(faults: list[Fault]) -> set[str]:
    return {each.identity.component for each in faults}


def test_a_fault_outlives_the_process_with_its_times_and_evidence(tmp_path):
    before = saved(tmp_path / "state", HOT)
    after = restarted(before, tmp_path / "state")
    assert after.state.faults() == before.state.faults()
    assert names(after.state.faults()) == {"Motor"}
    assert not list(tmp_path.glob("*.damaged*"))
    Storage(tmp_path / "state").save(after.state, after.now)
    again = restarted(after, tmp_path / "state")
    assert again.state.faults() == before.state.faults()
    again.raw(COOL)
    assert again.state.faults() == []


def test_a_fault_that_ended_is_written_without_it(tmp_path):
    before = saved(tmp_path / "state", HOT)
    before.raw(COOL)
    Storage(tmp_path / "state").save(before.state, before.now)
    assert restarted(before, tmp_path / "state").state.faults() == []


def test_a_file_without_faults_is_read(tmp_path):
    before = saved(tmp_path / "state", HOT)
    content = json.loads((tmp_path / "state").read_text())
    del content["faults"]
    (tmp_path / "state").write_text(json.dumps(content))
    after = restarted(before, tmp_path / "state")
    assert [each.name for each in after.robot.components] == ["Motor"]
    assert after.state.faults() == []
    assert not list(tmp_path.glob("*.damaged*"))


@pytest.mark.parametrize(
    "damage",
    [
        lambda row: row.clear(),
        lambda row: row.__setitem__(0, "rocket"),
        lambda row: row[2].pop("verdict"),
        lambda row: row[2].update(since="yesterday"),
        lambda row: row[2].update(clock=1e300),
        lambda row: row[2]["fault"].update(labels=["a"]),
    ],
    ids=["empty", "kind", "missing", "no time", "beyond", "labels"],
)
def test_a_damaged_row_is_named_and_harms_no_other(tmp_path, caplog, damage):
    before = saved(tmp_path / "state", HOT, LASER)
    content = json.loads((tmp_path / "state").read_text())
    [row] = [
        row
        for row in content["faults"]
        if row[0] == "problem" and row[1][:2] == ["component", "critical"] and "Motor" in row[1]
    ]
    damage(row)
    (tmp_path / "state").write_text(json.dumps(content))
    with caplog.at_level(logging.ERROR):
        after = restarted(before, tmp_path / "state")
    assert "of its faults" in caplog.text
    assert (tmp_path / "state.damaged-1").exists()
    assert names(after.state.faults()) == {"Laser"}
    after.raw_every(1, 15, HOT, LASER)
    assert names(after.state.faults()) == {"Laser", "Motor"}


@pytest.mark.parametrize(
    "damage",
    [
        lambda rows: rows.__setitem__(slice(None), [row for row in rows if row[0] != "robot"]),
        lambda rows: rows.append(["robot", [], rows[0][2]]),
        lambda rows: rows.append("row"),
    ],
    ids=["no robot", "no key", "text"],
)
def test_rows_that_do_not_belong_together_stop_nothing(tmp_path, caplog, damage):
    before = saved(tmp_path / "state", HOT)
    content = json.loads((tmp_path / "state").read_text())
    damage(content["faults"])
    (tmp_path / "state").write_text(json.dumps(content))
    with caplog.at_level(logging.ERROR):
        after = restarted(before, tmp_path / "state")
    assert "faults" in caplog.text
    assert [each.name for each in after.robot.components] == ["Motor"]
    after.raw_every(1, 15, HOT)
    assert names(after.state.faults()) == {"Motor"}


def test_what_did_not_change_is_not_written_again(tmp_path):
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw_every(1, 41, COOL)
    storage = Storage(path)
    storage.save(driver.state, driver.now)
    path.unlink()
    for _ in range(5):
        driver.raw_every(1, driver.now.mono + 2, COOL)
        storage.save(driver.state, driver.now)
    assert not path.exists()
    driver.raw_every(1, driver.now.mono + 2, HOT)
    storage.save(driver.state, driver.now)
    assert path.exists()
