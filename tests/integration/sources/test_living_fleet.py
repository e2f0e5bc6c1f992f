"""Robots that leave and move, on real DDS."""

from __future__ import annotations

import re

import pytest

from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Fleet,
    Profile,
    Robot,
    Source,
)
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Status
from support.state_driver import tree
from testbed.polling import until

pytestmark = pytest.mark.integration

HOT, COOL = Status(2, "Motor", "Hot"), Status(0, "Motor", "OK")
PATTERN = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")


def discovering(domain_id: int) -> Fleet:
    profile = Profile(stale_after=2.0, forget_after=3.0)
    found = Discovery(PATTERN, "/{robot}/diagnostics_agg", (domain_id,), profile=profile)
    return Fleet("f", discoveries=(found,))


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
