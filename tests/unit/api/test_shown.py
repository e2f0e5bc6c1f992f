"""One line for what is wrong with a component: the worst of it."""

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.severity import shown_problems
from support.state_driver import ERROR, OK, SETTLED, STALE, StateDriver


@pytest.mark.parametrize("labels", [{}, {"site": "hall"}])
def test_a_component_that_is_critical_and_then_stale_is_one_line(labels):
    robot = Robot(
        "r", topic_raw="/r/diagnostics", source=Source.RAW, profile=Profile(), labels=labels
    )
    driver = StateDriver(fleet=Fleet("f", (robot,))).raw_every(1, SETTLED, Status(OK, "Motor"))
    driver.raw_every(1, SETTLED + 3, Status(STALE, "Motor"))
    driver.raw_every(1, SETTLED + 30, Status(ERROR, "Motor"))
    snapshot = fleet_snapshot(driver.state, driver.now)
    shown, _ = shown_problems(snapshot["robots"][0], driver.now.wall, 9)
    assert [each.state for each in shown] == ["CRITICAL"]
