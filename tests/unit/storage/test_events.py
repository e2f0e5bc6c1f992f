"""Events in the database: found as in memory, by ids that go on, and deleted by age and size."""

import sqlite3
from contextlib import closing
from dataclasses import replace

import pytest

from ros_diagnostics_exporter import events
from ros_diagnostics_exporter.events import Event, Wanted
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.storage import pruning
from ros_diagnostics_exporter.storage.database import Changes, Database
from ros_diagnostics_exporter.storage.pruning import Bounds
from ros_diagnostics_exporter.storage.retention import AgeClock, Retention
from ros_diagnostics_exporter.storage.storage import Storage
from support.state_driver import ERROR, OK, WALL, StateDriver

HOT, COOL = Status(ERROR, "Motor", "Hot"), Status(OK, "Motor")
DAY = 86_400.0


def test_events_are_there_after_a_restart_and_ids_go_on(path):
    before = StateDriver().raw(HOT)
    before.at(1)
    after = before.raw(COOL).again(path).raw(HOT)
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


def test_old_events_go_by_age_and_size(path, content, monkeypatch):
    monkeypatch.setattr(pruning, "LEAST", 100)
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


def test_robots_that_need_all_of_the_size_leave_the_newest_events_and_say_so(
    path, content, monkeypatch, caplog
):
    """They had none left, and said nothing."""
    assert pruning.LEAST == 10_000
    monkeypatch.setattr(pruning, "LEAST", 50)
    driver = StateDriver().raw(*(Status(0, f"c{number}", "x" * 1000) for number in range(400)))
    driver.storage = Storage(path, Retention(size=300_000))
    for second in range(0, 100, 2):
        record(driver, second, 10)
        assert driver.storage.is_crowded

    kept = [number for number, *_texts in content()["events"]]
    robots = [number for number, _time, _kind, robot, *_texts in content()["events"] if robot]
    assert len(kept) == 50
    assert [*robots, *range(kept[-1] - 49 + len(robots), kept[-1] + 1)] == kept
    limit = "--storage.retention.size (300,000 bytes)"
    what = f"database {path}: what is kept of robots needs {limit}: only 10,000 events"
    assert caplog.text.count(what) == 1

    driver.state.forget("r", None, driver.now)
    for second in range(100, 110, 2):
        record(driver, second, 1)
    assert not driver.storage.is_crowded


def test_only_events_that_are_too_old_or_too_many_go(path, content, monkeypatch):
    monkeypatch.setattr(pruning, "LEAST", 0)
    database = Database(path)
    # The wall clock was set back once.
    old = [Event(0.0 if n == 700 else float(n), "config", message="x" * 200) for n in range(3000)]

    def left_by(new: list[Event] = (), **limits: float) -> range:
        changes = Changes(False, [], [], [], {}, enumerate(new, 1 + database.last_event()))
        database.write(changes, Bounds(**{"oldest": 0.0, "newest": 1e9, "size": 1 << 30, **limits}))
        ids = [number for number, *_ in content()["events"]]
        assert ids == list(range(ids[0], ids[-1] + 1))
        return range(ids[0], ids[-1] + 1)

    def used() -> int:
        with closing(sqlite3.connect(path)) as other:
            names = "page_count", "freelist_count", "page_size"
            [[pages], [free], [size]] = (other.execute(f"PRAGMA {n}").fetchone() for n in names)
        assert free > 0
        return (pages - free) * size

    assert left_by(old) == range(1, 3001)
    assert left_by(oldest=500.0) == range(501, 3001)
    assert left_by(size=used()) == range(501, 3001)
    left = left_by(old[:100], size=used() - 1)  # as many go as have to
    assert 2500 - 200 <= len(left) <= 2500
    assert left[-1] == 3100
    assert 200 <= len(left) - len(left_by(size=1)) <= 1000  # not all at once
    database.close()


def test_the_clock_of_ages_follows_one_that_was_set_ahead_four_times_as_fast():
    clock = AgeClock()
    clock.set(1000.0, Instant(0.0, 5000.0))
    assert [clock.time(Instant(second, 5000.0)) for second in (0.0, 0.0, 10.0)] == [1e3, 1e3, 1040]
    assert clock.time(Instant(10.0, 500.0)) == 500.0  # and is set back
    assert clock.wall(Instant(10.0, 500.0)) == 1040.0


def test_by_default_events_are_kept_for_ninety_days():
    assert Retention() == Retention(seconds=90 * DAY, size=256 << 20)


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
    record(driver, 2, 1)
    assert not caplog.text
    record(driver, 4, 51)
    assert "1 events are lost" in caplog.text
    assert not caplog.records[-1].exc_info
    assert '"message": "50 "' in content()["events"][-1][-2]
