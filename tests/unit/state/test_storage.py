"""What is known survives the process, and no disk can take the exporter down."""

from __future__ import annotations

import errno
import json
import logging
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Discovery,
    Fleet,
    Robot,
    Shared,
    Source,
)
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from ros_diagnostics_exporter.state.robot import Robot as ExporterRobot
from ros_diagnostics_exporter.state.snapshot import fleet_snapshot, targets
from ros_diagnostics_exporter.state.storage import MAX_BYTES, Storage
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver, tree

HOT, COOL = Status(ERROR, "Motor", "Hot", "mc-1"), Status(OK, "Motor", "OK", "mc-1")
LASER = Status(OK, "Laser")


def restarted(
    before: StateDriver, path, *, after: float = 5.0, fleet: Fleet | None = None
) -> StateDriver:
    """The state that a new process has which starts ``after`` seconds later."""
    driver = StateDriver(Source.RAW, fleet=fleet or before.state.fleet)
    # The monotonic clock of the new process is another one.
    driver.now = Instant(0.0, before.now.wall + after)
    Storage(path).load(driver.state, driver.now)
    return driver


def saved(driver: StateDriver, path) -> Storage:
    storage = Storage(path)
    storage.save(driver.state, driver.now)
    return storage


def test_what_is_restored_is_stale_until_it_is_heard(tmp_path):
    before = StateDriver()
    before.at(1)
    before.raw(HOT, LASER)
    saved(before, tmp_path / "state")

    after = restarted(before, tmp_path / "state")

    motor = after.component("Motor")
    assert (motor.level, motor.before_stale, motor.problem_since) == (STALE, ERROR, WALL + 1)
    assert after.sample("component_level_before_stale", component="Motor") == ERROR
    assert after.sample("robot_up") == 0
    assert after.sample("robot_last_message_timestamp_seconds") == WALL + 1


def test_a_fault_that_goes_on_began_when_it_began(tmp_path):
    before = StateDriver()
    before.at(1)
    before.raw(HOT)
    before.at(2)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")
    after.raw(HOT)

    motor = after.component("Motor")
    assert (motor.level, motor.since, motor.problem_since) == (ERROR, WALL + 1, WALL + 1)
    assert (motor.changes, motor.before_stale) == (0, None)


def test_a_fault_that_ended_meanwhile_ends_at_the_first_status(tmp_path):
    before = StateDriver()
    before.raw(HOT)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")
    after.raw(COOL)

    motor = after.component("Motor")
    assert (motor.level, motor.since, motor.problem_since) == (OK, WALL + 5, None)
    assert motor.changes == 1


def test_what_was_ok_is_no_problem_once_it_is_heard_again(tmp_path):
    before = StateDriver()
    before.raw(COOL)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")
    after.raw(COOL)

    motor = after.component("Motor")
    assert (motor.level, motor.problem_since, motor.since, motor.changes) == (OK, None, WALL, 0)


def stale_is_ok() -> StateDriver:
    return StateDriver(
        components=(ComponentRule(re.compile(""), levels={STALE: OK}),), stale_after=5.0
    )


def test_a_restart_is_no_problem_where_stale_counts_as_ok(tmp_path):
    before = stale_is_ok()
    before.raw(COOL)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")

    motor = after.component("Motor")
    assert (motor.level, motor.before_stale, motor.problem_since) == (OK, None, None)
    after.at(100)
    after.now = Instant(100.0, WALL + 105)
    after.raw(HOT)
    assert (motor.level, motor.problem_since) == (ERROR, WALL + 105)


def test_a_restart_ends_no_problem_where_stale_counts_as_ok(tmp_path):
    before = stale_is_ok()
    before.raw(HOT)
    saved(before, tmp_path / "state")
    again = restarted(before, tmp_path / "state")
    assert again.component("Motor").problem_since is None  # it is OK, as the config has it
    saved(again, tmp_path / "state")

    for level in (ERROR, WARN):
        after = restarted(again, tmp_path / "state")
        after.raw(HOT._replace(level=level))
        assert (after.level("Motor"), after.component("Motor").problem_since) == (level, WALL)


@pytest.mark.parametrize(
    ("status", "stays"), [(HOT, True), (COOL, False), (COOL._replace(level=STALE), True)]
)
def test_what_was_not_ok_is_not_forgotten_after_a_restart_either(tmp_path, status, stays):
    before = StateDriver(forget_after=100.0)
    before.raw(COOL)
    before.raw(status)
    saved(before, tmp_path / "state")
    again = restarted(before, tmp_path / "state")
    saved(again, tmp_path / "state")
    after = restarted(again, tmp_path / "state")
    after.at(200)
    assert bool(after.robot.components) == stays


def test_a_file_of_a_version_before_is_read(tmp_path):
    before = StateDriver(forget_after=100.0)
    before.raw(HOT, LASER)
    saved(before, tmp_path / "state")
    text = (tmp_path / "state").read_text()
    (tmp_path / "state").write_text(re.sub(r', "was_ok": (true|false)', "", text))
    after = restarted(before, tmp_path / "state")
    after.at(200)
    assert [each.name for each in after.robot.components] == ["Motor"]


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
    saved(before, tmp_path / "state")

    after = restarted(before, tmp_path / "state")
    assert set(after.state.robots) == {"r"}


def test_two_restarts_in_a_row_lose_nothing(tmp_path):
    before = StateDriver()
    before.raw(HOT)
    saved(before, tmp_path / "state")
    between = restarted(before, tmp_path / "state")
    saved(between, tmp_path / "state")
    after = restarted(between, tmp_path / "state")
    after.raw(HOT)

    motor = after.component("Motor")
    assert (motor.level, motor.since, motor.problem_since) == (ERROR, WALL, WALL)


def test_a_restless_component_stays_restless(tmp_path):
    before = StateDriver()
    for second in range(8):
        before.at(second)
        before.raw(HOT if second % 2 else COOL)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")

    assert after.component("Motor").flaps.ratio == before.component("Motor").flaps.ratio > 0.3


def test_a_discovered_robot_that_is_away_is_known_again_if_discovery_still_wants_it(tmp_path):
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    before = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    before.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(1)}, before.now)
    before.agg(*tree(Motor=[HOT]))
    saved(before, tmp_path / "state")

    again = restarted(before, tmp_path / "state")
    assert again.component("Motor").before_stale == ERROR
    assert again.robot.source is Source.AGG

    elsewhere = restarted(before, tmp_path / "state", fleet=Fleet("f"))
    assert not elsewhere.state.robots


HOUR = 3600.0


def healthy(driver: StateDriver, path, topic: Topic, array: Array, *, hours: int) -> None:
    """An array every half minute, the same ones all the time, saved as the exporter does."""
    storage = Storage(path)
    begin = driver.now
    for turn in range(hours * 120 + 1):
        driver.now = Instant(begin.mono + turn * 30.0, begin.wall + turn * 30.0)
        driver.state.receive(topic, array, driver.now)
        storage.save(driver.state, driver.now)
    assert storage.successful


def test_what_was_fine_for_days_is_not_forgotten_by_a_restart(tmp_path):
    before = StateDriver()
    array = Array(0.0, (COOL, LASER), 100)
    healthy(before, tmp_path / "state", Topic(0, "/r/diagnostics"), array, hours=55)
    after = restarted(before, tmp_path / "state")
    after.at(5)

    assert {each.name for each in after.robot.components} == {"Motor", "Laser"}
    seen = after.sample("robot_last_message_timestamp_seconds")
    assert before.now.wall - 60 <= seen <= before.now.wall


def test_a_discovered_robot_that_falls_silent_in_a_restart_stays_known(tmp_path):
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    before = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    before.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(1)}, before.now)
    array = Array(0.0, tree(Motor=[COOL]), 100)
    healthy(before, tmp_path / "state", Topic(0, "/r/diagnostics_agg"), array, hours=55)
    after = restarted(before, tmp_path / "state")
    after.at(5)

    assert after.sample("robot_up") == 0
    assert after.component("Motor").level == STALE


def test_the_last_write_has_what_was_seen_last(tmp_path):
    before = StateDriver()
    before.raw(COOL)
    storage = saved(before, tmp_path / "state")
    before.at(7)
    before.raw(COOL)
    storage.save(before.state, before.now, at_once=True)

    after = restarted(before, tmp_path / "state")
    assert after.sample("robot_last_message_timestamp_seconds") == WALL + 7


def test_the_file_is_written_at_most_once_a_second_and_only_for_a_change(tmp_path):
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw(COOL)
    storage = saved(driver, path)
    first = path.read_text()

    driver.at(0.5)
    driver.raw(HOT)
    storage.save(driver.state, driver.now)
    assert path.read_text() == first

    driver.at(1.5)
    storage.save(driver.state, driver.now)
    second = path.read_text()
    assert second != first

    driver.at(4)
    driver.raw(HOT)
    storage.save(driver.state, driver.now)
    assert path.read_text() == second


# What stands in a state file that is not one, and what the log says of it.
DAMAGED = {
    b"": "it is not JSON",
    b"{": "it is not JSON",
    b"[" * 100_000: "it is not JSON",
    b"\xff\xfe": "it is not JSON",
    b'{"version": NaN, "robots": {}}': "it is not JSON",
    b'{"version": 1, "robots": {"\\ud800": {}}}': "it is not JSON",
    b"[]": "its version is None",
    b'{"version": 99, "robots": {}}': "its version is 99, not 1",
    b'{"version": 1}': "it has no robots by name",
    b'{"version": 1, "robots": []}': "it has no robots by name",
    b'{"version": 1, "robots": {"r": 7}}': "robot 'r': ",
    b'{"version": 1, "robots": {"r": {}, "s": {}, "": 7}}': ", and 2 more robots",
}


@pytest.mark.parametrize(("content", "what"), DAMAGED.items(), ids=DAMAGED.values())
def test_a_damaged_file_is_named_kept_aside_and_survived(tmp_path, caplog, content, what):
    path = tmp_path / "state"
    path.write_bytes(content)
    driver = StateDriver()
    with caplog.at_level(logging.ERROR):
        storage = Storage(path)
        storage.load(driver.state, driver.now)

    assert len(caplog.records) == 1
    assert f"{path} is damaged (" in caplog.text
    assert what in caplog.text
    assert len(caplog.text) < 1000
    assert (tmp_path / "state.damaged-1").read_bytes() == content
    storage.save(driver.state, driver.now)
    assert storage.successful
    assert restarted(driver, path).state.robots.keys() == {"r"}


def edited(path, change) -> None:
    """Apply ``change`` to the content of a state file."""
    content = json.loads(path.read_text())
    change(content["robots"])
    path.write_text(json.dumps(content))


WRONG = {
    "level": 7,
    "before_stale": "ERROR",
    "since": 1e300,
    "problem_since": "yesterday",
    "slots": [0] * 20,
    "identity": ["Motor"],
    "message": "x" * 5000,
    "hardware_id": None,
    "listed": [],
}


@pytest.mark.parametrize("field", WRONG)
def test_robots_that_are_whole_are_restored_from_a_damaged_file(tmp_path, caplog, field):
    robots = tuple(
        Robot(name, topic_raw=f"/{name}/diagnostics", source=Source.RAW) for name in ("r", "s")
    )
    before = StateDriver(fleet=Fleet("f", robots))
    before.raw(HOT)
    before.state.receive(Topic(0, "/s/diagnostics"), Array(0.0, (HOT,), 100), before.now)
    path = tmp_path / "state"
    saved(before, path)
    edited(path, lambda robots: robots["s"]["components"][0].update({field: WRONG[field]}))
    after = restarted(before, path)

    assert after.component("Motor").before_stale == ERROR
    assert not after.state.robots["s"].components
    assert f"robot 's': components.0.{field}" in caplog.text
    assert "1 robots of it are restored; it is kept as" in caplog.text
    assert "fleet" in fleet_snapshot(after.state, after.now)


def test_no_damaged_file_overwrites_an_earlier_one_and_ten_are_kept(tmp_path, caplog):
    path = tmp_path / "state"
    for turn in range(12):
        path.write_text(f"damaged {turn}")
        storage, driver = Storage(path), StateDriver()
        storage.load(driver.state, driver.now)
        storage.save(driver.state, driver.now)
        assert storage.successful == (turn < 10)

    kept = [(tmp_path / f"state.damaged-{turn + 1}").read_text() for turn in range(10)]
    assert kept == [f"damaged {turn}" for turn in range(10)]
    assert path.read_text() == "damaged 11"
    assert "10 such files are there; nothing is saved until" in caplog.text


def planted(kind: str, path) -> None:
    """Put something there that cannot be read as a state file."""
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
    driver, storage = StateDriver(), Storage(path)
    storage.load(driver.state, driver.now)
    driver.raw(HOT)
    for second in range(1, 4):
        driver.at(second)
        storage.save(driver.state, driver.now, at_once=second == 3)
    assert not storage.successful
    assert path.lstat().st_mode == mode
    assert (tmp_path / "target").read_text() == "precious"
    assert caplog.text.count(f"state file {path} cannot be read") == 1
    assert sorted(each.name for each in tmp_path.iterdir()) == ["state", "target"]

    path.rename(tmp_path / "moved")
    driver.at(5)
    storage.save(driver.state, driver.now)
    assert storage.successful
    assert restarted(driver, path).component("Motor").before_stale == ERROR


def test_a_disk_that_fails_to_read_does_not_stop_the_start(tmp_path, monkeypatch, caplog):
    path = tmp_path / "state"
    path.write_text("precious")

    def fail(*_arguments, **_more):
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    monkeypatch.setattr("ros_diagnostics_exporter.state.storage.read_regular", fail)
    driver, storage = StateDriver(), Storage(path)
    storage.load(driver.state, driver.now)
    storage.save(driver.state, driver.now, at_once=True)

    assert not storage.successful
    assert path.read_text() == "precious"
    assert "cannot be read (Input/output error)" in caplog.text


def test_a_file_that_is_far_too_large_is_not_read_whole(tmp_path, caplog):
    path = tmp_path / "state"
    with path.open("wb") as file:
        file.truncate(1 << 30)
    driver = StateDriver()
    Storage(path).load(driver.state, driver.now)

    assert f"it is larger than {MAX_BYTES} bytes" in caplog.text
    assert (tmp_path / "state.damaged-1").stat().st_size == 1 << 30


def test_no_more_is_written_than_is_read_again(tmp_path, monkeypatch, caplog):
    path = tmp_path / "state"
    driver = StateDriver()
    storage = saved(driver, path)
    monkeypatch.setattr("ros_diagnostics_exporter.state.storage.MAX_BYTES", 200)
    driver.at(2)
    driver.raw(HOT)
    storage.save(driver.state, driver.now)

    assert not storage.successful
    assert "larger than the 200 bytes that are read again" in caplog.text
    assert '"components": []' in path.read_text()


def test_a_planted_link_is_not_written_through(tmp_path):
    target = tmp_path / "target"
    target.write_text("precious")
    (tmp_path / "state.new").symlink_to(target)
    driver = StateDriver()
    driver.raw(HOT)

    assert saved(driver, tmp_path / "state").successful
    assert target.read_text() == "precious"
    assert not (tmp_path / "state").is_symlink()


def test_half_of_a_character_makes_no_damaged_file(tmp_path, caplog):
    driver = StateDriver()
    driver.raw(Status(ERROR, "Motor", "Hot \ud800"))
    saved(driver, tmp_path / "state")

    assert restarted(driver, tmp_path / "state").component("Motor").message == "Hot ?"
    assert not caplog.text


def test_a_fault_of_our_own_is_shown_and_the_next_turn_saves(tmp_path, monkeypatch, caplog):
    driver, storage = StateDriver(), Storage(tmp_path / "state")
    driver.raw(HOT)
    with monkeypatch.context() as patch:
        patch.setattr(ExporterRobot, "persist", lambda *_arguments: 1 / 0)
        for second in range(1, 4):
            driver.at(second)
            storage.save(driver.state, driver.now)
    assert not storage.successful
    assert caplog.text.count("ZeroDivisionError") == 1

    driver.at(5)
    storage.save(driver.state, driver.now)
    assert storage.successful
    assert restarted(driver, tmp_path / "state").component("Motor").before_stale == ERROR


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
def whole(tmp_path_factory) -> bytes:
    path = tmp_path_factory.mktemp("whole") / "state"
    assert saved(EVENTFUL, path).successful
    return path.read_bytes()


def use(content: bytes) -> None:
    """Start from a state file of this content, and ask for all that can be asked."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "state"
        path.write_bytes(content)
        after = restarted(EVENTFUL, path)
        after.at(1)
        after.agg(*tree(Motor=[COOL], Laser=[LASER]))
        after.samples()
        json.dumps(fleet_snapshot(after.state, after.now), allow_nan=False)
        targets(after.state, "node", None)
        again = restarted(after, path) if saved(after, path).successful else None
        assert again is not None
        assert "r" in again.state.robots


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


@given(data=st.data())
@settings(max_examples=150)
def test_any_values_in_the_file_neither_stop_the_start_nor_break_what_is_shown(whole, data):
    content = json.loads(whole)
    for _ in range(data.draw(st.integers(1, 3))):
        content = junk_put_in(content, data.draw)
        if not isinstance(content, dict | list):
            break
    use(json.dumps(content).encode())


@given(data=st.data())
@settings(max_examples=150)
def test_any_bytes_in_the_file_neither_stop_the_start_nor_break_what_is_shown(whole, data):
    content = bytearray(whole)
    for _ in range(data.draw(st.integers(1, 5))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    use(bytes(content))


def test_a_missing_file_is_the_first_start_and_no_error(tmp_path, caplog):
    driver = StateDriver()
    Storage(tmp_path / "state").load(driver.state, driver.now)

    assert not caplog.text


def test_a_folder_that_is_gone_is_said_once_a_minute_and_tried_again(tmp_path, caplog):
    folder = tmp_path / "folder"
    storage = Storage(folder / "state")
    driver = StateDriver()
    driver.raw(HOT)
    for second in range(1, 11):
        driver.at(second)
        storage.save(driver.state, driver.now)
    assert not storage.successful
    assert caplog.text.count("cannot be written") == 1

    folder.mkdir()
    driver.at(12)
    storage.save(driver.state, driver.now)
    assert storage.successful
    assert restarted(driver, folder / "state").component("Motor").before_stale == ERROR


def test_every_prefix_of_the_file_is_refused_and_the_whole_is_read(tmp_path):
    """A copy cut off anywhere must not be mistaken for a whole state."""
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw(HOT, LASER)
    saved(driver, path)
    whole = path.read_text()

    for length in range(0, len(whole.rstrip()) - 1, 7):
        (tmp_path / "cut").write_text(whole[:length])
        fresh = StateDriver()
        Storage(tmp_path / "cut").load(fresh.state, fresh.now)
        assert not fresh.robot.components
    assert json.loads(whole)["version"] == 1


def test_a_disk_that_takes_no_more_leaves_the_last_file_whole(tmp_path, caplog):
    path = tmp_path / "state"
    driver = StateDriver()
    driver.raw(HOT)
    storage = saved(driver, path)
    whole = path.read_text()

    driver.at(2)
    driver.raw(COOL, *(Status(OK, f"c{number}") for number in range(100)))
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4096, before[1]))  # the real error of a real write
    try:
        storage.save(driver.state, driver.now)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)

    assert not storage.successful
    assert "File too large" in caplog.text
    assert path.read_text() == whole


WRITER = """
import sys
from pathlib import Path
from support.state_driver import ERROR, OK, StateDriver
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.state.storage import MAX_BYTES, Storage

driver, storage = StateDriver(), Storage(Path(sys.argv[1]))
for turn in range(1_000_000):
    driver.raw(*(Status((ERROR, OK)[turn % 2], f"c{n}", "x" * (turn % 50)) for n in range(50)))
    storage.save(driver.state, driver.now, at_once=True)
    if turn == 3:
        print("writing", flush=True)
"""


def test_killed_at_any_moment_the_file_is_whole(tmp_path):
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
        fresh = StateDriver()
        Storage(path).load(fresh.state, fresh.now)
        assert len(fresh.robot.components) == 50
