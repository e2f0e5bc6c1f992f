"""What is received, and what is logged where nothing can be, on real DDS."""

import re

import pytest
from std_msgs.msg import String

from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Discovery,
    Fleet,
    Profile,
    Robot,
    Source,
)
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.regex import Pattern
from support.ros_publisher import publisher
from testbed import domains
from testbed.polling import until

MOTOR, HOT = Status(0, "Motor", "OK"), Status(2, "Motor", "Hot")


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


def test_a_topic_that_no_entry_takes_is_named_as_soon_as_it_is_published(
    ros_domain, robots, run_exporter
):
    wanted = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "{robot}", (ros_domain,), source=Source.RAW
    )
    running = run_exporter(Fleet("f", discoveries=(wanted,)))
    robots.offer("/diagnostics")
    robots.offer("/r/diagnostics")
    until(lambda: running.service.state.unclaimed, "the topic is named")
    (found,) = running.service.state.unclaimed
    assert (found.domain_id, found.topics) == (ros_domain, ("/diagnostics",))
    assert found.entry == f"{{name: robot_{ros_domain}, domain_id: {ros_domain}}}"


def test_the_worst_of_two_publishers_counts_until_it_is_gone(ros_domain, robots, run_exporter):
    """Each says it once; only the middleware tells them apart."""
    rule = ComponentRule(Pattern("Motor"), reports="on_change")
    profile = Profile(components=(rule,), stale_after=600.0)
    running = run_exporter(Fleet("f", (raw_robot("r", ros_domain, profile=profile),)))
    with publisher(ros_domain) as broken:
        for each, status in ((broken, HOT), (robots, MOTOR)):
            each.offer("/r/diagnostics")
            each.wait_for_listeners()
            each.send("/r/diagnostics", status)
            running.wait_for("robot_messages_total", 1 + (each is robots))
        robots.send("/r/diagnostics", MOTOR)
        running.wait_for("robot_messages_total", 3)
        assert running.sample("component_level", component="Motor") == 2
    running.wait_for("component_level", 0, component="Motor")
