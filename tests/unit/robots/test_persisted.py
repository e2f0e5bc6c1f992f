"""What is known of a robot outlives a restart, with the times at which it was."""

from __future__ import annotations

from pathlib import Path

from ros_diagnostics_exporter.model import Status
from support.state_driver import ERROR, OK, STALE, WALL, StateDriver

MOTOR, ARM = Status(OK, "Motor", "fine", "m-1"), Status(ERROR, "Arm", "stuck")


def test_what_is_not_received_yet_is_as_it_was_before_the_restart(tmp_path: Path):
    driver = StateDriver()
    driver.at(5)
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
    assert [each._replace(before_stale=None) for each in after.components] == before.components
    assert after._replace(components=before.components) == before
    found = [later.component(name) for name in ("Motor", "Arm")]
    assert [each.level for each in found] == [STALE, STALE]
    assert [each.before_stale for each in found] == [OK, ERROR]
    assert [each.level_before_silence for each in found] == [OK, ERROR]

    later.raw(MOTOR, ARM)
    motor, arm = later.robot.persist(later.now).components
    assert (motor.level, motor.since, motor.before_stale) == (OK, WALL + 5, None)
    assert (arm.level, arm.since, arm.listed) == (ERROR, WALL + 5, later.now.wall)
    later.raw(MOTOR, ARM._replace(level=OK))
    assert [each.level for each in later.robot.persist(later.now).components] == [OK, OK]
