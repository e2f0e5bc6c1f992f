"""Silent faults of real nodes, found from outside; `./run experiment silent` has more."""

from __future__ import annotations

import signal
import sys
from dataclasses import replace
from functools import partial

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.model import Status
from support.ros_publisher import repeating
from testbed.polling import until

pytestmark = [pytest.mark.integration, pytest.mark.slow]

MOTOR = Status(0, "Motor", "OK")
LEARN = 5.0  # seconds in place of a day
SEEN = 100.0  # seconds in which all of this is found: a lease of 20 s, three rounds of 20 s
NODE = """
import sys
import rclpy

rclpy.init()
node = rclpy.create_node(sys.argv[1], namespace="/r")
print("ready", flush=True)
rclpy.spin(node)
"""
# Of a robot whose owner has set what ROS has no setting for.
EXCLUSIVE = """\
<profiles xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles">
  <data_writer profile_name="/r/diagnostics">
    <qos><ownership><kind>EXCLUSIVE</kind></ownership></qos>
  </data_writer>
</profiles>
"""
DRIVER = """
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

rclpy.init()
node = rclpy.create_node("driver", namespace="/r")
sender = node.create_publisher(DiagnosticArray, "diagnostics", 10)
array = DiagnosticArray(status=[DiagnosticStatus(name="Motor", level=bytes(1))])
node.create_timer(0.1, lambda: sender.publish(array))
print("ready", flush=True)
rclpy.spin(node)
"""


@pytest.fixture
def start_node(start_process, dds_environment):
    """A function (name): a process with a node of the robot."""

    def start(name: str):
        process = start_process(name, [sys.executable, "-c", NODE, name], dds_environment)
        process.wait_for_output("ready", 60)
        return process

    return start


@pytest.fixture
def running(ros_domain, robots, run_exporter):
    """An exporter that receives the robot r once a second."""
    profile = Profile(graph=Graph(mode="on", learn_after=LEARN))
    robot = Robot("r", ros_domain, profile=replace(profile, confirm_after=1.0), namespace="/r")
    fleet = Fleet("f", (replace(robot, topic_raw="/r/diagnostics", source=Source.RAW),))
    made = run_exporter(fleet)
    robots.offer("/r/diagnostics")
    with repeating(lambda _turn: robots.send("/r/diagnostics", MOTOR), 0.2):
        yield made


def faults(running) -> dict[str, str]:
    return {
        each.identity.component: each.evidence.partition("\n")[0].rstrip(";")
        for each in running.service.state.faults()
    }


def test_a_node_that_was_not_received_for_a_lease_is_well_once_it_is_again(running, start_node):
    driver = start_node("driver")
    start_node("other")
    expected = partial(running.sample, "robot_expected_nodes", robot="r")
    until(lambda: expected() == 2, lambda: f"2 nodes are expected, not {expected()}", SEEN)
    driver.signal(signal.SIGSTOP)
    gone = {"node driver": "the node is gone"}
    until(lambda: faults(running) == gone, lambda: f"{faults(running)}", SEEN)
    driver.signal(signal.SIGCONT)  # its process, and so its endpoints, have the ids of before
    until(lambda: faults(running) == {}, lambda: f"{faults(running)}", SEEN)
    driver.kill()
    until(lambda: faults(running) == gone, lambda: f"{faults(running)}", SEEN)


def test_a_publisher_that_the_exporter_itself_cannot_match_is_named(
    ros_domain, run_exporter, start_process, dds_environment, tmp_path
):
    (tmp_path / "profiles.xml").write_text(EXCLUSIVE)
    own = {"FASTRTPS_DEFAULT_PROFILES_FILE": str(tmp_path / "profiles.xml")}
    own["RMW_FASTRTPS_USE_QOS_FROM_XML"] = "1"
    start_process("driver", [sys.executable, "-c", DRIVER], dds_environment | own)
    robot = Robot("r", ros_domain, profile=Profile(graph=Graph(mode="on")), namespace="/r")
    running = run_exporter(
        Fleet("f", (replace(robot, topic_raw="/r/diagnostics", source=Source.RAW),))
    )
    running.wait_for("robot_silent_reason", 1, reason="incompatible_qos")

    def shown() -> dict[str, str]:
        found = running.service.state.robots["r"].components
        return {each.label: each.message for each in found}

    why = "a policy that ROS has no name for, as ownership or data representation"
    text = f"this exporter receives nothing from /r/driver: by {why}"
    until(lambda: shown() == {"topic diagnostics": text}, lambda: f"{shown()}", SEEN)
