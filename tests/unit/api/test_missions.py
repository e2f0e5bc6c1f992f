"""The missions as the API shows them: of one robot, or of all that have any."""

import pytest

from ros_diagnostics_exporter.api.missions import missions
from support.missions import DOCK, FLEET, Mission

TWO = FLEET.replace("source: raw}]", "source: raw}, {name: s, namespace: /s, source: raw}]")


@pytest.mark.parametrize(("robot", "shown"), [("r", ["r"]), ("s", []), (None, ["r"])])
def test_they_are_those_of_the_robots_that_are_asked_for(tmp_path, robot, shown):
    driver = Mission.of(tmp_path, TWO).driver
    found = missions(driver.state, robot, driver.now)["robots"]
    assert [each["robot"] for each in found] == shown
    assert DOCK in [action["action"] for each in found for action in each["actions"]] or not shown


def test_of_a_robot_that_there_is_not_nothing_is_shown(tmp_path):
    driver = Mission.of(tmp_path, TWO).driver
    with pytest.raises(LookupError, match="no robot 'nobody'"):
        missions(driver.state, "nobody", driver.now)
