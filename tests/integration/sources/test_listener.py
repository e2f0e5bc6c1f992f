"""What is received, and what is logged where nothing can be, on real DDS."""

from __future__ import annotations

import re

import pytest
from std_msgs.msg import String

from ros_diagnostics_exporter.config.fleet import Discovery, Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.model import Status
from support.ros_publisher import publisher
from testbed import domains
from testbed.polling import until

pytestmark = pytest.mark.integration

MOTOR, HOT = Status(0, "Motor", "OK"), Status(2, "Motor", "Hot")
QUICK = Profile(stale_after=1.0)


def raw_robot(name: str, domain_id: int, **more) -> Robot:
    topic = f"/{name}/diagnostics"
    return Robot(name, domain_id, topic_raw=topic, source=Source.RAW, **more)


@pytest.mark.parametrize(("reliable", "latched"), [(True, False), (False, False), (True, True)])
def test_publishers_of_every_quality_are_heard(ros_domain, robots, run_exporter, reliable, latched):
    running = run_exporter(Fleet("f", (raw_robot("r", ros_domain),)))
    robots.offer("/r/diagnostics", reliable=reliable, latched=latched)
    robots.wait_for_listeners()

    def received() -> bool:
        robots.send("/r/diagnostics", HOT)
        return running.sample("component_level", component="Motor") == 2

    until(received, "the motor is received")


def test_bytes_that_are_no_message_are_counted_and_the_rest_goes_on(
    ros_domain, robots, run_exporter, caplog
):
    fleet = Fleet("f", (raw_robot("bad", ros_domain), raw_robot("good", ros_domain)))
    running = run_exporter(fleet)
    for name in ("bad", "good"):
        robots.offer(f"/{name}/diagnostics")
    robots.wait_for_listeners()

    for _ in range(3):
        robots.send_bytes("/bad/diagnostics", b"\x00\x01\x00\x00" + b"\xff" * 24)
    robots.send("/good/diagnostics", HOT)

    running.wait_for("robot_rejected_total", 3, robot="bad", reason="undecodable")
    running.wait_for("component_level", 2, robot="good")
    assert running.sample("robot_silent_reason", robot="bad", reason="undecodable") == 1
    assert caplog.text.count("undecodable message dropped") == 1

    robots.send("/bad/diagnostics", MOTOR)
    running.wait_for("robot_up", 1, robot="bad")


def test_the_reasons_of_silence_are_told_apart(ros_domain, robots, run_exporter):
    names = ("never", "mute", "gone", "typed")
    fleet = Fleet("f", tuple(raw_robot(name, ros_domain, profile=QUICK) for name in names))
    running = run_exporter(fleet)
    robots.offer("/mute/diagnostics")
    robots.offer("/gone/diagnostics")
    robots.wait_for_listeners()
    robots.offer("/typed/diagnostics", kind=String)
    robots.send("/gone/diagnostics", MOTOR)
    running.wait_for("robot_up", 1, robot="gone")
    robots.withdraw("/gone/diagnostics")

    for name, reason in (
        ("never", "never_seen"),
        ("mute", "mute"),
        ("gone", "publisher_gone"),
        ("typed", "wrong_type"),
    ):
        running.wait_for("robot_silent_reason", 1, robot=name, reason=reason)
        assert running.sample("robot_up", robot=name) == 0


def test_a_topic_of_another_type_that_discovery_wants_is_reported(
    ros_domain, robots, run_exporter, caplog
):
    wanted = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "{robot}", (ros_domain,), source=Source.RAW
    )
    running = run_exporter(Fleet("f", discoveries=(wanted,)))
    robots.offer("/typed/diagnostics", kind=String)
    robots.offer("/typed/other", kind=String)

    running.wait_for("exporter_rejected_total", 1, reason="wrong_type")
    [text] = [each for each in caplog.messages if "/diagnostics" in each]
    assert "'typed' on topic /typed/diagnostics" in text
    assert "the topic has another type, std_msgs/msg/String" in text


def test_robots_in_two_domains_one_raw_one_aggregated_and_one_found(
    ros_domain, robots, run_exporter
):
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    with domains.lease() as other_domain, publisher(other_domain) as others:
        fleet = Fleet(
            "f",
            (raw_robot("raw", ros_domain), raw_robot("never", ros_domain)),
            (Discovery(pattern, "/{robot}/diagnostics_agg", (other_domain,)),),
        )
        running = run_exporter(fleet)
        robots.offer("/raw/diagnostics")
        others.offer("/found/diagnostics_agg")
        robots.wait_for_listeners()
        others.wait_for_listeners()
        robots.send("/raw/diagnostics", MOTOR)
        tree = (
            Status(2, "/Motor", "Error", "", (("Motor", "Hot"),)),
            HOT._replace(name="/Motor/Motor"),
        )
        others.send("/found/diagnostics_agg", *tree)

        running.wait_for("component_level", 0, robot="raw", component="Motor", group="")
        running.wait_for("component_level", 2, robot="found", component="Motor", group="/Motor")
        assert running.sample("robot_up", robot="never") == 0
        assert running.sample("robot_info", robot="found", domain_id=str(other_domain)) == 1
        for domain_id in (ros_domain, other_domain):
            assert running.sample("exporter_domain_up", domain_id=str(domain_id)) == 1


def test_a_burst_of_a_whole_fleet_in_one_moment_is_received_without_loss(
    ros_domain, robots, run_exporter
):
    fleet = Fleet("f", tuple(raw_robot(f"r{n}", ros_domain) for n in range(50)))
    running = run_exporter(fleet)
    for robot in fleet.robots:
        robots.offer(robot.topic_raw)
    robots.wait_for_listeners()

    for _ in range(20):
        for robot in fleet.robots:
            robots.send(robot.topic_raw, MOTOR)

    until(
        lambda: set(running.samples("robot_messages_total").values()) == {20.0},
        "every robot's 20 messages",
    )


@pytest.mark.slow
def test_sixty_domains_in_one_process(run_exporter):
    from contextlib import ExitStack

    with ExitStack() as stack:
        ids = [stack.enter_context(domains.lease()) for _ in range(60)]
        # The publishers first: on this machine's loopback alone, only the first 32 participants of
        # a process are found by others of the same process.
        made = {d: stack.enter_context(publisher(d)) for d in (ids[0], ids[-1])}
        for domain_id, each in made.items():
            each.offer(f"/r{domain_id}/diagnostics")
        running = run_exporter(Fleet("f", tuple(raw_robot(f"r{d}", d) for d in ids)))
        for domain_id, each in made.items():
            each.wait_for_listeners()
            each.send(f"/r{domain_id}/diagnostics", HOT)
            running.wait_for("component_level", 2, robot=f"r{domain_id}")
        assert len(running.samples("exporter_domain_up")) == 60


def test_the_exporter_is_a_quiet_guest(ros_domain, robots, run_exporter):
    """No services, and no topics: not even the one that every other rclpy node has."""
    running = run_exporter(Fleet("f", (raw_robot("r", ros_domain),)))
    robots.offer("/r/diagnostics")
    robots.wait_for_listeners()

    node = robots._node
    until(lambda: "ros_diagnostics_exporter" in node.get_node_names(), "the node is known")
    assert node.get_service_names_and_types_by_node("ros_diagnostics_exporter", "/") == []
    published = node.get_publisher_names_and_types_by_node("ros_diagnostics_exporter", "/")
    assert published == []
    assert running.service.state.robots
