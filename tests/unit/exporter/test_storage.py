"""What is known survives the process, and no disk can take the exporter down."""

from __future__ import annotations

import json
import logging
import os
import re
import subprocess
import sys
import time
from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.fleet import ComponentRule, Discovery, Fleet, Source
from ros_diagnostics_exporter.diagnostics import Instant, Status
from ros_diagnostics_exporter.state.network import Endpoint
from ros_diagnostics_exporter.storage import Storage
from stories import ERROR, OK, STALE, WALL, WARN, Story, tree

HOT, COOL = Status(ERROR, "Motor", "Hot", "mc-1"), Status(OK, "Motor", "OK", "mc-1")
LASER = Status(OK, "Laser")


def restarted(before: Story, path, *, after: float = 5.0, fleet: Fleet | None = None) -> Story:
    """The state that a new process has which starts ``after`` seconds later."""
    story = Story(Source.RAW, fleet=fleet or before.state.fleet)
    # The monotonic clock of the new process is another one.
    story.now = Instant(0.0, before.now.wall + after)
    Storage(path).load(story.state, story.now)
    return story


def saved(story: Story, path) -> Storage:
    storage = Storage(path)
    storage.save(story.state, story.now)
    return storage


def test_what_is_restored_is_stale_until_it_is_heard(tmp_path):
    before = Story()
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
    before = Story()
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
    before = Story()
    before.raw(HOT)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")
    after.raw(COOL)

    motor = after.component("Motor")
    assert (motor.level, motor.since, motor.problem_since) == (OK, WALL + 5, None)
    assert motor.changes == 1


def test_what_was_ok_is_no_problem_once_it_is_heard_again(tmp_path):
    before = Story()
    before.raw(COOL)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")
    after.raw(COOL)

    motor = after.component("Motor")
    assert (motor.level, motor.problem_since, motor.since, motor.changes) == (OK, None, WALL, 0)


def stale_is_ok() -> Story:
    return Story(components=(ComponentRule(re.compile(""), levels={STALE: OK}),), stale_after=5.0)


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
    before = Story(forget_after=100.0)
    before.raw(COOL)
    before.raw(status)
    saved(before, tmp_path / "state")
    again = restarted(before, tmp_path / "state")
    saved(again, tmp_path / "state")
    after = restarted(again, tmp_path / "state")
    after.at(200)
    assert bool(after.robot.components) == stays


def test_a_file_of_a_version_before_is_read(tmp_path):
    before = Story(forget_after=100.0)
    before.raw(HOT, LASER)
    saved(before, tmp_path / "state")
    text = (tmp_path / "state").read_text()
    (tmp_path / "state").write_text(re.sub(r', "was_ok": (true|false)', "", text))
    after = restarted(before, tmp_path / "state")
    after.at(200)
    assert [each.name for each in after.robot.components.values()] == ["Motor"]


def test_a_robot_that_never_published_does_not_survive_a_restart(tmp_path):
    discovery = Discovery(re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    before = Story(fleet=Fleet("f", discoveries=(discovery,)))
    before.state.graph(0, {f"/{n}/diagnostics": Endpoint(1) for n in ("r", "mute")}, before.now)
    before.at(10)
    before.raw(COOL)
    before.at(20)
    before.raw(COOL)
    saved(before, tmp_path / "state")

    after = restarted(before, tmp_path / "state")
    assert set(after.state.robots) == {"r"}


def test_two_restarts_in_a_row_lose_nothing(tmp_path):
    before = Story()
    before.raw(HOT)
    saved(before, tmp_path / "state")
    between = restarted(before, tmp_path / "state")
    saved(between, tmp_path / "state")
    after = restarted(between, tmp_path / "state")
    after.raw(HOT)

    motor = after.component("Motor")
    assert (motor.level, motor.since, motor.problem_since) == (ERROR, WALL, WALL)


def test_a_restless_component_stays_restless(tmp_path):
    before = Story()
    for second in range(8):
        before.at(second)
        before.raw(HOT if second % 2 else COOL)
    saved(before, tmp_path / "state")
    after = restarted(before, tmp_path / "state")

    assert after.component("Motor").flaps.ratio == before.component("Motor").flaps.ratio > 0.3


def test_a_discovered_robot_that_is_away_is_known_again_if_discovery_still_wants_it(tmp_path):
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    before = Story(fleet=Fleet("f", discoveries=(discovery,)))
    before.state.graph(0, {"/r/diagnostics_agg": Endpoint(1)}, before.now)
    before.agg(*tree(Motor=[HOT]))
    saved(before, tmp_path / "state")

    again = restarted(before, tmp_path / "state")
    assert again.component("Motor").before_stale == ERROR
    assert again.robot.source is Source.AGG

    elsewhere = restarted(before, tmp_path / "state", fleet=Fleet("f"))
    assert not elsewhere.state.robots


def test_the_file_is_written_at_most_once_a_second_and_only_for_a_change(tmp_path):
    path = tmp_path / "state"
    story = Story()
    story.raw(COOL)
    storage = saved(story, path)
    first = path.read_text()

    story.at(0.5)
    story.raw(HOT)
    storage.save(story.state, story.now)
    assert path.read_text() == first

    story.at(1.5)
    storage.save(story.state, story.now)
    second = path.read_text()
    assert second != first

    story.at(4)
    story.raw(HOT)
    storage.save(story.state, story.now)
    assert path.read_text() == second


@pytest.mark.parametrize("content", ["", "{", '{"version": 99, "robots": {}}', '{"version": 1}'])
def test_a_damaged_file_is_said_kept_aside_and_survived(tmp_path, caplog, content):
    path = tmp_path / "state"
    path.write_text(content)
    story = Story()
    with caplog.at_level(logging.ERROR):
        Storage(path).load(story.state, story.now)

    assert "is damaged" in caplog.text
    assert str(path) in caplog.text
    assert (tmp_path / "state.unreadable").read_text() == content


def test_a_missing_file_is_the_first_start_and_no_error(tmp_path, caplog):
    story = Story()
    Storage(tmp_path / "state").load(story.state, story.now)

    assert not caplog.text


def test_a_folder_that_is_gone_is_said_once_a_minute_and_tried_again(tmp_path, caplog):
    folder = tmp_path / "folder"
    storage = Storage(folder / "state")
    story = Story()
    story.raw(HOT)
    for second in range(1, 11):
        story.at(second)
        storage.save(story.state, story.now)
    assert not storage.successful
    assert caplog.text.count("cannot be written") == 1

    folder.mkdir()
    story.at(12)
    storage.save(story.state, story.now)
    assert storage.successful
    assert restarted(story, folder / "state").component("Motor").before_stale == ERROR


def test_every_prefix_of_the_file_is_refused_and_the_whole_is_read(tmp_path):
    """A copy cut off anywhere must not be mistaken for a whole state."""
    path = tmp_path / "state"
    story = Story()
    story.raw(HOT, LASER)
    saved(story, path)
    whole = path.read_text()

    for length in range(0, len(whole.rstrip()) - 1, 7):
        (tmp_path / "cut").write_text(whole[:length])
        fresh = Story()
        Storage(tmp_path / "cut").load(fresh.state, fresh.now)
        assert not fresh.robot.components
    assert json.loads(whole)["version"] == 1


def test_a_full_disk_is_said_and_leaves_the_last_file_whole(tmp_path, caplog):
    path = tmp_path / "state"
    story = Story()
    story.raw(HOT)
    storage = saved(story, path)
    whole = path.read_text()
    (tmp_path / "state.new").symlink_to("/dev/full")

    story.at(2)
    story.raw(COOL)
    storage.save(story.state, story.now)

    assert not storage.successful
    assert "No space left on device" in caplog.text
    assert path.read_text() == whole


WRITER = """
import sys
from pathlib import Path
from stories import ERROR, OK, Story
from ros_diagnostics_exporter.diagnostics import Status
from ros_diagnostics_exporter.storage import Storage

story, storage = Story(), Storage(Path(sys.argv[1]))
for turn in range(1_000_000):
    story.raw(*(Status((ERROR, OK)[turn % 2], f"c{n}", "x" * (turn % 50)) for n in range(50)))
    storage.save(story.state, story.now, at_once=True)
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
        fresh = Story()
        Storage(path).load(fresh.state, fresh.now)
        assert len(fresh.robot.components) == 50
