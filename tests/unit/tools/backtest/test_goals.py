"""The goals of actions in a recording are judged as the running exporter judges them."""

import numpy as np
import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from ros_diagnostics_exporter.decode.goals import ABORTED, EXECUTING, SUCCEEDED
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.topic_entries import asked_names
from support.bags import judged, texts, write_messages
from support.configs import load_text

STORE = get_typestore(Stores.ROS2_JAZZY)
ARRAY = "diagnostic_msgs/msg/DiagnosticArray"
FLEET = """\
fleet: hall
robots: [{name: robot_3, namespace: /robot_3, source: raw}]
profiles:
  default: {actions: [{match: dock_robot, aborted: {critical: 1}}]}
"""


def of(kind: str):
    return STORE.types[kind]


def list_of(number: int, status: int):
    """A list of one goal as rosbags has it."""
    goal_id = of("unique_identifier_msgs/msg/UUID")(np.full(16, number, dtype=np.uint8))
    stamp = of("builtin_interfaces/msg/Time")(number, 0)
    info = of("action_msgs/msg/GoalInfo")(goal_id, stamp)
    return of(GOALS_TYPE)([of("action_msgs/msg/GoalStatus")(info, status)])


def array_of_motor():
    stamp = of("builtin_interfaces/msg/Time")(0, 0)
    header = of("std_msgs/msg/Header")(stamp, "")
    motor = of("diagnostic_msgs/msg/DiagnosticStatus")(0, "Motor", "OK", "", [])
    return of(ARRAY)(header, [motor])


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_goal_that_was_aborted_is_a_fault_until_one_succeeds(tmp_path, storage):
    rows = [(at, "/robot_3/diagnostics", ARRAY, array_of_motor()) for at in range(200)]
    told = [(50, 1, EXECUTING), (60, 1, ABORTED), (100, 2, EXECUTING), (120, 2, SUCCEEDED)]
    topic = f"/robot_3/dock_robot{STATUS}"
    rows += [(at + 0.5, topic, GOALS_TYPE, list_of(number, how)) for at, number, how in told]
    bag = write_messages(tmp_path / "bag", sorted(rows, key=lambda row: row[0]), storage, STORE)
    fleet = load_text(tmp_path, FLEET)

    result = judged(fleet, bag, asked=asked_names(fleet.profiles.values()))

    assert texts(result) == ["60.5 70.5 120.5 dock_robot critical"]
