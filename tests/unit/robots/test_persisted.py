"""What is known of a robot outlives a restart, with the times at which it was."""

from dataclasses import replace
from math import inf
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import Profile, Source
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.robots.persisted import ROBOT
from support.state_driver import ERROR, OK, STALE, WALL, StateDriver

MOTOR, ARM = Status(OK, "Motor", "fine", "m-1"), Status(ERROR, "Arm", "stuck")


def test_what_is_not_received_yet_is_as_it_was_before_the_restart(tmp_path: Path):
    driver = StateDriver().at(5)
    driver.raw(MOTOR, ARM)
    driver.at(8)
    driver.raw(ARM)
    before = driver.robot.persist(driver.now)
    assert before.last_seen == WALL + 8
    assert [(each.level, each.since, each.listed) for each in before.components] == [
        (OK, WALL + 5, WALL + 5),
        (ERROR, WALL + 5, WALL + 8),
    ]

    later = driver.again(tmp_path / "state", after=30.0)
    after = later.robot.persist(later.now)
    assert [replace(each, before_stale=None) for each in after.components] == before.components
    assert replace(after, components=before.components) == before
    found = [later.component(name) for name in ("Motor", "Arm")]
    assert [each.level for each in found] == [STALE, STALE]
    assert [each.before_stale for each in found] == [OK, ERROR]
    assert [each.published for each in found] == [OK, ERROR]

    later.raw(MOTOR, ARM)
    motor, arm = later.robot.persist(later.now).components
    assert (motor.level, motor.since, motor.before_stale) == (OK, WALL + 5, None)
    assert (arm.level, arm.since, arm.listed) == (ERROR, WALL + 5, later.now.wall)
    later.raw(MOTOR, ARM._replace(level=OK))
    assert [each.level for each in later.robot.persist(later.now).components] == [OK, OK]


def test_a_reload_before_the_first_array_is_no_change(tmp_path: Path):
    driver = StateDriver()
    later = driver.raw(MOTOR, ARM).again(tmp_path / "state", after=600.0)
    events = list(later.events)
    later.follow_profile(Profile(forget_after=9e4))
    assert later.events == events
    later.raw(MOTOR, ARM)
    motor, arm = later.robot.persist(later.now).components
    assert [(each.level, each.since) for each in (motor, arm)] == [(OK, WALL), (ERROR, WALL)]
    assert "level" not in [each.kind for each in later.events[len(events) :]]
    assert [each.changes for each in later.robot.components] == [0, 0]


@pytest.mark.parametrize(
    ("seen", "latest", "last_seen", "listed"),
    [
        (8.0, inf, 8.0, 5.0),
        (18.0, inf, 18.0, 15.0),
        (8.0, 4.0, 4.0, 4.0),
        (18.0, 16.0, 16.0, 15.0),
        (7.0, inf, 8.0, 5.0),
    ],
)
def test_what_was_received_later_than_written_is_as_old_and_nothing_is_of_the_future(
    seen, latest, last_seen, listed
):
    robot = StateDriver().at(5).raw(MOTOR).at(8).raw(ARM).robot.persist(Instant(8.0, WALL + 8))
    found = robot.seen_at(WALL + seen, WALL + latest)
    assert (found.last_seen, found.components[0].listed) == (WALL + last_seen, WALL + listed)


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ('"level": 2', '"level": -1'),
        ('"level": 2', '"level": 4'),
        ('"reported": 2', '"reported": 256'),
        ('"domain_id": 0', '"domain_id": 233'),
        ('"source": "raw"', '"source": "none of these"'),
    ],
)
def test_a_row_of_which_something_cannot_be_is_not_read(right, wrong):
    text = StateDriver().raw(ARM).robot.persist(Instant(0.0, WALL)).as_json()
    assert ROBOT.validate_json(text)
    assert right in text
    with pytest.raises(ValueError, match="validation error"):
        ROBOT.validate_json(text.replace(right, wrong))


texts = st.text(st.characters(exclude_categories=["Cs"]), max_size=300)
statuses = st.lists(st.builds(Status, st.integers(0, 255), texts, texts, texts), max_size=5)


@given(st.lists(st.tuples(st.sampled_from(["raw", "agg"]), statuses), max_size=4))
def test_whatever_is_written_of_a_robot_can_be_read(arrays: list[tuple[str, list[Status]]]):
    driver = StateDriver(Source.BOTH)
    for topic, sent in arrays:
        getattr(driver, topic)(*sent)
        driver.wait(6)
    written = driver.robot.persist(driver.now)
    assert ROBOT.validate_json(written.as_json()) == written
