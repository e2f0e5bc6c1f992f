"""The goals of robots that zenoh alone reaches: by the real bridge, and as rmw_zenoh has them."""

from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Zenoh
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.config.missions import ActionRule, TooMany
from ros_diagnostics_exporter.config.patterns import wildcard
from ros_diagnostics_exporter.decode.goals import ABORTED, ACCEPTED, Goal
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from support.action_robot import ActionRobot
from support.goal_lists import encode_goals
from support.zenoh_robots import session
from testbed import programs, zenoh
from testbed.polling import until

DOCK = "dock_robot"
PROFILE = Profile(actions=(ActionRule((wildcard(DOCK),), aborted=TooMany(None, 1)),))


def fleet(router, prefix: str, namespace: str) -> Fleet:
    made = {"name": "r", "zenoh": prefix, "namespace": namespace, "source": "agg"}
    robot = validated(Robot, made, {"default": PROFILE})
    return Fleet("f", (replace(robot, profile=PROFILE),), zenoh=Zenoh((router.locator,)))


def results(running) -> dict[str, float]:
    found = running.samples("goals_total").items()
    return {dict(labels)["result"]: value for labels, value in found if value}


def has_running(running, number: int) -> bool:
    return [*running.samples("goals_running").values()] == [number]


@pytest.fixture
def bridged(router, dds_environment, start_process, tmp_path, monkeypatch):
    """Have the real bridge bring diagnostics and the action."""
    monkeypatch.setattr(zenoh, "ALLOWED", {**zenoh.ALLOWED, "action_servers": [f".*/{DOCK}"]})
    domain_id = int(dds_environment["ROS_DOMAIN_ID"])
    config = tmp_path / "bridge.json5"
    try:
        command = zenoh.bridge(config, router.locator, domain_id, "/site/r")
    except programs.MissingProgram as error:
        pytest.skip(str(error))
    start_process("bridge", command, zenoh.on_loopback(dds_environment))


@pytest.mark.slow
@pytest.mark.usefixtures("bridged")
def test_goals_of_a_robot_behind_a_bridge_are_counted(
    router, robots, run_exporter, dds_environment
):
    running = run_exporter(fleet(router, "site/r", "/"))
    robots.offer("/diagnostics_agg")

    def are_running(number: int) -> bool:
        robots.send("/diagnostics_agg", Status(0, "Motor", "OK"))
        return has_running(running, number)

    with ActionRobot("/", DOCK, environment=dds_environment) as robot:
        until(lambda: are_running(0), lambda: f"{running.samples('goals_running')}", 60, every=0.3)
        for how in ("abort", "succeed"):
            robot.tell("begin", DOCK)
            until(lambda: are_running(1), "its begin is seen", 30, every=0.3)
            robot.tell(how, DOCK)
            until(lambda: are_running(0), "its end is seen", 30, every=0.3)

    assert results(running) == {"aborted": 1, "succeeded": 1}


def test_goals_of_a_robot_whose_middleware_is_zenoh_are_counted(router, run_exporter):
    """With tokens and keys as rmw_zenoh's design has them."""
    running = run_exporter(fleet(router, "0", "/r"))
    robot = session("client", connect=[router.locator])
    topic, kind = f"r/{DOCK}{STATUS}", "action_msgs::msg::dds_::GoalStatusArray_"
    tokens = robot.liveliness()
    start = f"@ros2_lv/0/{robot.zid()}/0"
    node = tokens.declare_token(f"{start}/0/NN/%/%r/docking")
    name = topic.replace("/", "%")
    server = tokens.declare_token(f"{start}/7/MP/%/%r/docking/%{name}/{kind}/RIHS01_0/::,10:,:,:,,")
    publisher = robot.declare_publisher(f"0/{topic}/{kind}/RIHS01_0")

    until(lambda: publisher.matching_status.matching, f"{GOALS_TYPE} is subscribed", 30)
    publisher.put(encode_goals([]))
    for status in (ACCEPTED, ABORTED):
        publisher.put(encode_goals([Goal(bytes(16), 1.0, status)]))

    until(lambda: results(running) == {"aborted": 1}, lambda: f"{results(running)}", 30)
    for each in (node, server):
        each.undeclare()
    robot.close()
