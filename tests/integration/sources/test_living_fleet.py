"""Robots that appear, leave, move and share a topic, on real DDS; domains that cannot be joined."""

from __future__ import annotations

import re

import pytest

from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Fleet,
    Limits,
    Profile,
    Robot,
    Shared,
    Source,
)
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Status
from support.state_driver import tree
from testbed.polling import until

pytestmark = pytest.mark.integration

HOT, COOL = Status(2, "Motor", "Hot"), Status(0, "Motor", "OK")
PATTERN = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")


def discovering(domain_id: int, **more) -> Fleet:
    profile = Profile(stale_after=2.0, forget_after=3.0)
    found = Discovery(PATTERN, "/{robot}/diagnostics_agg", (domain_id,), profile=profile)
    return Fleet("f", discoveries=(found,), **more)


def test_a_robot_that_leaves_is_silent_until_a_person_forgets_it(ros_domain, robots, run_exporter):
    running = run_exporter(discovering(ros_domain))
    for name in ("well", "faulty"):
        robots.offer(f"/{name}/diagnostics_agg")
    robots.wait_for_listeners()
    robots.send("/well/diagnostics_agg", *tree(Motor=[COOL]))
    robots.send("/faulty/diagnostics_agg", *tree(Motor=[HOT]))
    running.wait_for("component_level", 0, robot="well")
    running.wait_for("component_level", 2, robot="faulty")

    for name in ("well", "faulty"):
        robots.withdraw(f"/{name}/diagnostics_agg")

    running.wait_for("robot_silent_reason", 1, robot="faulty", reason="publisher_gone")
    running.wait_for("component_level", None, robot="well")
    assert running.sample("robot_up", robot="well") == 0
    assert running.sample("component_problem_since_timestamp_seconds", robot="faulty")

    running.service.state.forget("well", None, read_clocks())
    running.wait_for("robot_up", None, robot="well")


def test_a_robot_that_returns_under_another_topic_goes_on_with_its_fault(
    ros_domain, robots, run_exporter
):
    def fleet(topic: str) -> Fleet:
        return Fleet("f", (Robot("r", ros_domain, topic_raw=topic, source=Source.RAW),))

    running = run_exporter(fleet("/old/diagnostics"))
    for topic in ("/old/diagnostics", "/new/diagnostics"):
        robots.offer(topic)
    until(lambda: robots.listeners("/old/diagnostics"), "the old topic is subscribed")
    robots.send("/old/diagnostics", HOT)
    running.wait_for("component_level", 2, robot="r")
    began = running.sample("component_problem_since_timestamp_seconds", robot="r")

    running.service.state.configure(fleet("/new/diagnostics"), read_clocks())
    until(lambda: robots.listeners("/new/diagnostics"), "the new topic is subscribed")
    robots.send("/new/diagnostics", HOT._replace(message="Hot, still"))
    running.wait_for("robot_messages_total", 2, robot="r")

    assert running.sample("component_problem_since_timestamp_seconds", robot="r") == began
    until(lambda: not robots.listeners("/old/diagnostics"), "the old topic is left")


def test_two_robots_on_one_topic_are_two(ros_domain, robots, run_exporter):
    running = run_exporter(Fleet("f", shared=(Shared("/diagnostics", True, ros_domain),)))
    robots.offer("/diagnostics")
    robots.wait_for_listeners()
    robots.send("/diagnostics", HOT._replace(hardware_id="r1"), COOL._replace(hardware_id="r2"))

    running.wait_for("component_level", 2, robot="r1", component="Motor")
    running.wait_for("component_level", 0, robot="r2", component="Motor")


def test_a_robot_that_the_limits_keep_out_is_told(ros_domain, robots, run_exporter):
    running = run_exporter(discovering(ros_domain, limits=Limits(robots=1)))
    for name in ("one", "two"):
        robots.offer(f"/{name}/diagnostics_agg")
    until(
        lambda: sum(running.samples("robot_silent_reason").values()) == 2,
        lambda: f"one mute, one kept out: {running.samples('robot_silent_reason')}",
    )

    reasons = {dict(labels)["reason"] for labels in running.samples("robot_silent_reason")}
    assert reasons == {"mute", "limit"}
    assert running.sample("exporter_rejected_total", reason="robot_limit") == 1


def test_a_domain_that_cannot_be_joined_is_told_and_joined_later(
    ros_domain, robots, run_exporter, monkeypatch
):
    """SROS 2 that enforces security without a keystore lets nobody in."""
    fleet = Fleet("f", (Robot("r", ros_domain, topic_raw="/r/diagnostics", source=Source.RAW),))
    robots.offer("/r/diagnostics")
    monkeypatch.setenv("ROS_SECURITY_ENABLE", "true")
    monkeypatch.setenv("ROS_SECURITY_STRATEGY", "Enforce")
    monkeypatch.setenv("ROS_SECURITY_KEYSTORE", "/nonexistent")
    running = run_exporter(fleet)

    running.wait_for("robot_silent_reason", 1, robot="r", reason="domain_unreachable")
    assert running.sample("exporter_domain_up", domain_id=str(ros_domain)) == 0

    monkeypatch.setenv("ROS_SECURITY_ENABLE", "false")
    running.service.join()
    robots.wait_for_listeners()
    robots.send("/r/diagnostics", COOL)
    running.wait_for("robot_up", 1, robot="r")
    assert running.sample("exporter_domain_up", domain_id=str(ros_domain)) == 1
