"""What virtual robots have beside diagnostics, on real topics: messages of any type, and goals."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from action_msgs.msg import GoalStatus, GoalStatusArray
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import JointState

from ros_diagnostics_exporter.sources.dds_types import borrowed_type
from testbed.processes import Process

KEPT = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
SAFETY = "/robot_1/io_and_status_controller/safety_mode"


class Received:
    """All messages of some topics."""

    def __init__(self, listener: Any) -> None:
        self._listener, self._found = listener, dict[str, list[Any]]()

    def subscribe(self, topic: str, kind: Any, qos: QoSProfile | int = 10, **options: Any) -> None:
        found = self._found[topic] = []
        self._listener.node.create_subscription(kind, topic, found.append, qos, **options)

    def until(self, topic: str, condition: Callable[[list[Any]], Any]) -> None:
        found = self._found[topic]
        self._listener.until(lambda: condition(found), f"{topic}: {found}", 40)

    def states(self, action: str) -> list[list[int]]:
        """What each list of an action says of its goals, the first goal first."""
        return [[each.status for each in one.status_list] for one in self._found[topic_of(action)]]


def topic_of(action: str) -> str:
    return f"/robot_1/{action}/_action/status"


@pytest.fixture
def received(listener: Any) -> Received:
    return Received(listener)


def test_messages_of_types_that_are_installed_and_of_others(
    virtual_robots: Callable[..., Process], received: Received, command: Any
):
    virtual_robots("--robots", "1", "--kind", "arm")
    received.subscribe("/robot_1/joint_states", JointState)
    received.subscribe(SAFETY, borrowed_type("ur_dashboard_msgs/msg/SafetyMode"), KEPT, raw=True)

    received.until("/robot_1/joint_states", lambda found: found and found[-1].effort[1] > 29)
    received.until(SAFETY, lambda found: [each[4] for each in found] == [1])
    command("fault", "robot_1", "Safety mode", "protective_stop")
    received.until(SAFETY, lambda found: [each[4] for each in found] == [1, 3])


WORKER = """\
components: []
actions:
- {name: fine, takes: [1, 1], pause: 1}
- {name: aborts, takes: [1, 1], pause: 1}
- {name: cancels, takes: [2, 2], pause: 1}
- {name: is_preempted, takes: [2, 2], pause: 1}
- {name: hangs, takes: [1, 1], pause: 1}
- {name: is_killed, takes: [3, 3], pause: 1}
"""
SCENARIO = """\
robots: [{kind: ./worker.yaml}]
events:
- {at: 0, robot: robot_1, component: aborts, what: abort}
- {at: 0, robot: robot_1, component: cancels, what: cancel}
- {at: 0, robot: robot_1, component: is_preempted, what: preempt}
- {at: 0, robot: robot_1, component: hangs, what: hang}
- {at: 4, robot: robot_1, component: is_killed, what: killed, for: 3}
"""


def test_goals_of_real_action_servers_end_as_their_faults_say(
    virtual_robots: Callable[..., Process], received: Received, tmp_path: Path
):
    (tmp_path / "worker.yaml").write_text(WORKER)
    scenario = tmp_path / "scenario.yaml"
    scenario.write_text(SCENARIO)
    results = {
        "fine": GoalStatus.STATUS_SUCCEEDED,
        "aborts": GoalStatus.STATUS_ABORTED,
        "cancels": GoalStatus.STATUS_CANCELED,
        "is_preempted": GoalStatus.STATUS_ABORTED,
    }
    for action in (*results, "hangs", "is_killed"):
        received.subscribe(topic_of(action), GoalStatusArray, KEPT)
    virtual_robots("--scenario", str(scenario))

    def goals(arrays: list[GoalStatusArray], status: int) -> set[bytes]:
        found = (each for array in arrays for each in array.status_list)
        return {bytes(each.goal_info.goal_id.uuid) for each in found if each.status == status}

    for action, status in results.items():
        received.until(topic_of(action), lambda found, it=status: len(goals(found, it)) > 1)
    assert [6, 2] in received.states("is_preempted")  # the next was accepted before
    assert received.states("hangs")[-1] == [2]
    received.until(topic_of("is_killed"), lambda found: len(goals(found, 4)) == 1)
    assert [2, 1] not in received.states("is_killed")  # of a new server, without the first goal
