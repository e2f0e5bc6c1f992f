"""Events in the database: found as in memory, by ids that go on, and deleted by age and size."""

from __future__ import annotations

from dataclasses import replace

import pytest

from ros_diagnostics_exporter import events
from ros_diagnostics_exporter.events import Event, Wanted
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.storage.database import Retention
from ros_diagnostics_exporter.storage.storage import Storage
from support.state_driver import ERROR, OK, WALL, StateDriver

HOT, COOL = Status(ERROR, "Motor", "Hot"), Status(OK, "Motor")
DAY = 86_400.0


def test_events_are_there_after_a_restart_and_ids_go_on(path):
    before = StateDriver()
    before.raw(HOT)
    before.at(1)
    before.raw(COOL)
    after = before.again(path)
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
def test_the_database_finds_what_the_memory_finds(path, wanted):
    driver = StateDriver()
    for second in range(10):
        driver.at(second)
        driver.raw(*(Status((second + n) % 2 * ERROR, f"c{n}") for n in range(10)))
    driver.keep(path)
    in_memory = list(driver.log.find(wanted))
    after = driver.restart(path)
    after.save()
    before_it = replace(wanted, before=wanted.before or len(driver.events) + 1)
    assert list(after.log.find(before_it)) == in_memory


def record(driver: StateDriver, second: float, number: int, text: str = "") -> None:
    """So many events that many seconds after the start, saved."""
    driver.now = Instant(second, WALL + second)
    for each in range(number):
        driver.log.record(Event(driver.now.wall, "config", message=f"{each} {text}"))
    driver.save()


def test_old_events_go_by_age_and_size(path, content):
    driver = StateDriver()
    driver.storage = Storage(path, Retention(seconds=100.0, size=200_000))
    for second in range(0, 1000, 20):
        record(driver, second, 20, "x" * 50)
    events = content()["events"]
    assert min(time for _id, time, *_texts in events) >= driver.now.wall - 100 - 20
    assert len(events) >= 100

    size = path.stat().st_size
    for second in range(1000, 1100, 2):
        record(driver, second, 100, "x" * 200)
    driver.close()
    assert size < path.stat().st_size < 400_000
    assert content()["events"][-1][1] == driver.now.wall


def with_events(path, *days: float) -> StateDriver:
    """Written, with one event as many days before now as given, in this order; kept for 90."""
    driver = StateDriver()
    driver.storage = Storage(path, Retention(seconds=90 * DAY))
    for day in days:
        driver.log.record(Event(WALL - day * DAY, "config"))
    driver.save(at_once=True)
    return driver


@pytest.fixture
def kept(content):
    """A function: of how many days ago those of the above and later ones are."""
    return lambda: [
        (WALL - time) / DAY for _id, time, kind, *_ in content()["events"] if kind == "config"
    ]


@pytest.mark.parametrize("restarted_first", [False, True])
@pytest.mark.parametrize("days", [-2, 100, 200])
def test_a_wall_clock_that_was_set_deletes_no_events(path, kept, days, restarted_first):
    driver = with_events(path, 80, 40, 1)
    if restarted_first:
        driver = driver.restart(path, after=days * DAY)
    for second in range(1, 600, 20):
        driver.now = Instant(float(second), WALL + second + days * DAY)
        driver.log.record(Event(driver.now.wall, "config"))
        driver.save()
    assert len(kept()) == 3 + 30
    for second in range(600, 700, 20):  # and is set right
        driver.now = Instant(float(second), WALL + second)
        driver.save(at_once=True)
    assert len(kept()) == 3 + 30
    driver.close()


def test_an_event_of_the_future_keeps_none_of_those_after_it(path, kept):
    with_events(path, -200, 95, 92, 80).close()
    assert kept() == [80]


def test_events_grow_old_after_a_long_time_off(path, kept):
    driver = with_events(path, 80, 1)
    for hour in range(1, 24 * 8):
        driver.now = Instant(3600.0 * hour, WALL + 20 * DAY + 3600.0 * hour)
        driver.save(at_once=True)
    assert kept() == [1]
    driver.close()


def test_events_that_come_faster_than_the_disk_are_counted_and_the_newest_kept(
    path, content, monkeypatch, caplog
):
    monkeypatch.setattr(events, "MAX_EVENTS", 50)
    driver = StateDriver()
    driver.keep(path)
    record(driver, 2, 80)
    assert "30 events are lost" in caplog.text
    assert '"message": "79 "' in content()["events"][-1][-1]
