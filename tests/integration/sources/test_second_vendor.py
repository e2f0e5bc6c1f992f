"""Robots whose middleware is Eclipse Cyclone DDS: received, seen in the graph, and judged."""

from collections.abc import Iterator
from dataclasses import replace

import pytest
from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication
from cyclonedds.core import Policy

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.model import Status
from support.cyclone_robot import (
    CONFIG,
    CONFIG_VARIABLE,
    CycloneRobot,
    DiagnosticArray,
    Text,
    cyclone_robot,
)
from support.ros_publisher import repeating
from testbed.polling import until

TOPIC = "/r/diagnostics"
HOT = Status(2, "Motor", "Hot", "m1", (("Temperature", "91.5 °C"),))
SEEN = 100.0  # seconds in which the graph is judged: three rounds of 20 s


def fleet(domain_id: int, **graph) -> Fleet:
    profile = Profile(confirm_after=1.0, graph=Graph(**{"mode": "on", **graph}))
    robot = Robot("r", domain_id, profile=profile, namespace="/r")
    return Fleet("f", (replace(robot, topic_raw=TOPIC, source=Source.RAW),))


@pytest.fixture(autouse=True)
def _on_this_machine(monkeypatch) -> None:
    monkeypatch.setenv(CONFIG_VARIABLE, CONFIG)


@pytest.fixture
def robot(ros_domain) -> Iterator[CycloneRobot]:
    with cyclone_robot(ros_domain, "/r", "driver") as made:
        made.publish(TOPIC, DiagnosticArray)
        yield made


def messages(running) -> dict[str, str]:
    components = running.service.state.robots["r"].components
    return {each.label: each.message for each in components if each.level}


def test_its_diagnostics_are_received_and_its_link_is_measured(ros_domain, robot, run_exporter):
    running = run_exporter(fleet(ros_domain))
    with repeating(lambda _turn: robot.send(TOPIC, HOT), 0.2):
        running.wait_for("component_level", 2, component="Motor")
        assert running.sample("component_value", key="Temperature") == 91.5
        until(lambda: running.sample("robot_link_lost_ratio") == 0, "the link is measured", SEEN)


@pytest.mark.slow
def test_its_node_and_its_qos_are_judged(ros_domain, robot, run_exporter):
    running = run_exporter(fleet(ros_domain, expect=("driver", "amcl")))
    robot.publish("/r/unsafe", Text, reliable=False)
    text = "/r/other receives nothing from /r/driver: Best effort publisher and reliable"
    expected = {
        "node amcl": "the node is gone",
        "topic unsafe": f"{text} subscription",
        "Motor": "Hot",
    }

    def found() -> dict[str, str]:
        return {name: each.rstrip(";") for name, each in messages(running).items()}

    send = repeating(lambda _turn: robot.send(TOPIC, HOT), 0.2)
    with cyclone_robot(ros_domain, "/r", "other") as other, send:
        other.subscribe("/r/unsafe", Text)
        until(lambda: found() == expected, lambda: f"{found()}", SEEN)
        robot.withdraw("/r/unsafe")
        del expected["topic unsafe"]
        until(lambda: found() == expected, lambda: f"{found()}", SEEN)


@pytest.mark.slow
def test_a_policy_that_ros_cannot_set_and_we_cannot_match_is_named(ros_domain, run_exporter):
    running = run_exporter(fleet(ros_domain))
    why = "a policy that ROS has no name for, as ownership or data representation"
    expected = {"topic diagnostics": f"this exporter receives nothing from /r/driver: by {why}"}
    with cyclone_robot(ros_domain, "/r", "driver") as robot:
        robot.publish(TOPIC, DiagnosticArray, Policy.Ownership.Exclusive)
        running.wait_for("robot_silent_reason", 1, reason="incompatible_qos")
        assert robot.matched(TOPIC) == 0
        until(lambda: messages(running) == expected, lambda: f"{messages(running)}", SEEN)


def test_the_exporter_writes_nothing_but_what_names_its_node(ros_domain, robot, run_exporter):
    """By what another vendor's participant is told of all writers in the domain."""
    run_exporter(fleet(ros_domain))
    reader = BuiltinDataReader(robot._participant, BuiltinTopicDcpsPublication)
    own = robot._participant.guid
    seen: dict[str, str] = {}

    def written() -> set[str]:
        for each in reader.take(N=1000):
            if each.participant_key != own:
                seen[str(each.key)] = each.topic_name
        return set(seen.values())

    until(lambda: robot.matched(TOPIC), "the exporter has subscribed")
    until(written, "a writer of the exporter is known")
    assert written() == {"ros_discovery_info"}
