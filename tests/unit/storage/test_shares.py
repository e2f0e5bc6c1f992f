"""Where the database has no room, the robot with the most events loses its own, and no fault."""

import pytest

from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.storage import pruning
from ros_diagnostics_exporter.storage.database import Changes, Database
from ros_diagnostics_exporter.storage.pruning import Bounds
from ros_diagnostics_exporter.storage.retention import Retention
from ros_diagnostics_exporter.storage.storage import Storage
from support.state_driver import WALL, StateDriver

KINDS = ("level", "robot", "fault_began", "fault_ended", "notified", "action", "acknowledged")


@pytest.fixture
def driver(path, monkeypatch) -> StateDriver:
    monkeypatch.setattr(pruning, "LEAST", 50)
    driver = StateDriver()
    driver.storage = Storage(path, Retention(size=400_000))
    for number, kind in enumerate(KINDS * 20):
        driver.log.record(Event(WALL, kind, f"r{number % 5}", component="Motor"))
    driver.save(at_once=True)
    return driver


def flood(driver: StateDriver, robot: str, seconds: int, kind: str = "level") -> None:
    for second in range(1, seconds + 1):
        driver.now = Instant(float(second), WALL + second)
        for _ in range(500):
            driver.log.record(Event(driver.now.wall, kind, robot, message="x" * 150))
        driver.save()


def counts(content, robot: str) -> int:
    return sum(row[3] == robot for row in content()["events"])


def test_a_robot_that_changes_all_the_time_erases_nothing_of_others(driver, content, path):
    before = [row for row in content()["events"] if row[3] != "loud"]
    flood(driver, "loud", 60)
    assert [row for row in content()["events"] if row[3] != "loud"] == before
    assert 0 < counts(content, "loud") < 5_000
    assert path.stat().st_size < 2_000_000

    deleted = driver.storage.early.counts
    assert deleted.keys() == {"loud"}
    assert deleted["loud"] + counts(content, "loud") == 30_000
    reason = driver.storage.early.reason(driver.now)
    assert f"(loud: {deleted['loud']:,})" in reason
    assert driver.storage.early.reason(Instant(driver.now.mono + 601, 0.0)) == ""


def test_faults_go_only_where_there_is_nothing_else(driver, content):
    flood(driver, "loud", 60, "fault_began")
    kinds = {row[2] for row in content()["events"]}
    assert "level" not in kinds
    before = [kind for number, kind in enumerate(KINDS * 20) if kind not in {"level", "robot"}]
    assert [row[2] for row in content()["events"] if row[3] != "loud"] == before


def test_two_that_are_loud_lose_alike(driver, content):
    for name in ("loud", "louder", "loud"):
        flood(driver, name, 20)
    assert abs(counts(content, "loud") - counts(content, "louder")) <= 1500


def test_after_a_restart_the_same_robot_pays(driver, content, path):
    flood(driver, "loud", 20)
    again = driver.again(path)
    again.storage._retention = Retention(size=400_000)
    flood(again, "other", 1)
    assert again.storage.early.counts.keys() == {"loud"}


def test_the_search_for_events_of_a_robot_that_has_fewer_than_counted_ends(path, monkeypatch):
    monkeypatch.setattr(pruning, "LEAST", 15)
    database = Database(path)
    events = [*enumerate([Event(0.0, "level", each) for each in ("loud",) * 10 + ("r",) * 5], 1)]
    for early in ({}, {"loud": 10, "r": 5}):  # the second time they replace those of the first
        changes = Changes(False, [], [], [], {}, events)
        assert database.write(changes, Bounds(0.0, 1e9, 1)).early == early
    database.close()
