"""Silent faults of real nodes: gone, there twice, or without a match, found from outside."""

from __future__ import annotations

import signal
import sys
from dataclasses import replace

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
from rclpy.qos import QoSProfile, ReliabilityPolicy
from std_msgs.msg import String

name, *wants = sys.argv[1:]
rclpy.init()
node = rclpy.create_node(name, namespace="/r")
made = []
if "publish" in wants:
    made.append(node.create_publisher(String, "chat", QoSProfile(depth=1)))
if "best_effort" in wants:
    profile = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)
    made.append(node.create_publisher(String, "unsafe", profile))
if "subscribe" in wants:
    for topic in ("chat", "unsafe"):
        made.append(node.create_subscription(String, topic, print, QoSProfile(depth=1)))
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
    """A function (name, wants...): a process with a node of the robot."""

    def start(name: str, *wants: str):
        process = start_process(name, [sys.executable, "-c", NODE, name, *wants], dds_environment)
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


def learn(running, count: int) -> None:
    """Wait until so many nodes were there for long enough."""
    until(
        lambda: running.sample("robot_expected_nodes", robot="r") == count,
        f"{count} nodes are expected",
        SEEN,
    )


def faults(running) -> dict[str, str]:
    return {
        each.identity.component: each.evidence.partition("\n")[0].rstrip(";")
        for each in running.service.state.faults()
    }


def test_a_killed_a_stopped_and_a_doubled_node_are_faults_until_all_is_as_usual(
    running, start_node
):
    driver, amcl = start_node("driver", "publish"), start_node("amcl")
    other = start_node("other", "subscribe")
    learn(running, 3)
    assert faults(running) == {}

    driver.kill()
    amcl.stop()
    twin = start_node("other", "subscribe")
    gone = "the node is gone"
    expected = {"node driver": gone, "node amcl": gone, "node other": "2 nodes have this name"}
    until(lambda: faults(running) == expected, lambda: f"{faults(running)}", SEEN)

    start_node("driver", "publish")
    start_node("amcl")
    twin.stop()
    until(lambda: faults(running) == {}, lambda: f"{faults(running)}", SEEN)
    assert other.alive


def test_a_node_that_was_not_received_for_a_lease_is_well_once_it_is_again(running, start_node):
    driver = start_node("driver", "publish")
    start_node("other", "subscribe")
    learn(running, 2)
    driver.signal(signal.SIGSTOP)
    gone = {"node driver": "the node is gone"}
    until(lambda: faults(running) == gone, lambda: f"{faults(running)}", SEEN)
    driver.signal(signal.SIGCONT)  # its process, and so its endpoints, have the ids of before
    until(lambda: faults(running) == {}, lambda: f"{faults(running)}", SEEN)
    driver.kill()
    until(lambda: faults(running) == gone, lambda: f"{faults(running)}", SEEN)


def test_a_publisher_that_cannot_match_its_subscriber_is_a_fault_until_it_does(running, start_node):
    start_node("other", "subscribe")
    wrong = start_node("driver", "best_effort")
    text = "Best effort publisher and reliable subscription"
    expected = {"topic unsafe": f"/r/other receives nothing from /r/driver: {text}"}
    until(lambda: faults(running) == expected, lambda: f"{faults(running)}", SEEN)
    wrong.stop()
    start_node("driver", "publish")
    until(lambda: faults(running) == {}, lambda: f"{faults(running)}", SEEN)


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


def test_how_messages_arrive_is_measured(running):
    until(
        lambda: running.sample("robot_link_lost_ratio", robot="r") == 0,
        "the link is measured",
        SEEN,
    )
    assert 0 < running.sample("robot_link_delay_seconds", robot="r") < SEEN
    assert 0 < running.sample("robot_link_jitter_seconds", robot="r") < SEEN
