"""The goals of real action servers over real DDS: counted, judged, recorded, restarted."""

from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.missions import ActionRule, TooMany
from ros_diagnostics_exporter.config.patterns import wildcard
from ros_diagnostics_exporter.model import Status
from support.action_robot import ActionRobot
from support.ros_publisher import repeating
from testbed.polling import until

DOCK, GOTO = "dock_robot", "navigate_to_pose"
RULES = (
    ActionRule((wildcard(GOTO),), aborted=TooMany(None, 3)),
    ActionRule((wildcard(DOCK),), aborted=TooMany(None, 1)),
)
MOTOR = Status(0, "Motor", "OK")


@pytest.fixture
def start_exporter(robots, run_exporter, dds_environment):
    """A function: starts an exporter; the robot reports all the time."""
    domain_id = int(dds_environment["ROS_DOMAIN_ID"])
    profile = Profile(confirm_after=2.0, actions=RULES)
    robot = Robot("r", domain_id, profile=profile, namespace="/r", source=Source.RAW)
    fleet = Fleet("f", (replace(robot, topic_raw="/r/diagnostics"),))
    started = []

    def start():
        exporter = run_exporter(fleet)
        robots.offer("/r/diagnostics")
        started.append(exporter)  # from now on the robot reports
        return exporter

    def report(_turn: int) -> None:
        if started:
            robots.send("/r/diagnostics", MOTOR)

    with repeating(report, 0.2):
        yield start


@pytest.fixture
def running(start_exporter):
    return start_exporter()


def results(running) -> dict[tuple[str, str], float]:
    """How many goals ended in which way, by action and result."""
    found = running.samples("goals_total")
    return {
        (dict(labels)["action"], dict(labels)["result"]): value
        for labels, value in found.items()
        if value
    }


def goals_running(running) -> dict[str, float]:
    return {dict(each)["action"]: value for each, value in running.samples("goals_running").items()}


def wait_for(running, expected: dict[tuple[str, str], float], seconds: float = 30) -> None:
    until(lambda: results(running) == expected, lambda: f"{results(running)}", seconds)


def begun(running, robot: ActionRobot, action: str) -> None:
    """Begin a goal, and wait until the exporter has seen it."""
    robot.tell("begin", action)
    until(lambda: goals_running(running).get(action) == 1, lambda: f"{goals_running(running)}", 30)


def found(running) -> None:
    """Wait until the exporter has joined the topics of both actions."""
    until(lambda: goals_running(running).keys() >= {DOCK, GOTO}, lambda: "no action", 60)


def test_how_goals_end_is_counted_and_aborted_ones_are_a_fault(running, dds_environment):
    def faults() -> dict[str, str]:
        return {each.identity.component: each.evidence for each in running.service.state.faults()}

    with ActionRobot("/r", GOTO, DOCK, environment=dds_environment) as robot:
        found(running)
        for how in ("succeed", "abort", "cancel"):
            begun(running, robot, GOTO)
            robot.tell(how, GOTO)
        wait_for(running, {(GOTO, "succeeded"): 1, (GOTO, "aborted"): 1, (GOTO, "cancelled"): 1})
        begun(running, robot, DOCK)
        robot.tell("abort", DOCK)
        until(lambda: DOCK in faults(), lambda: f"{faults()}", 60)
        assert "aborted 1 of the last 1 goals" in faults()[DOCK]

        begun(running, robot, DOCK)
        robot.tell("succeed", DOCK)
        until(lambda: not faults(), lambda: f"{faults()}", 60)
    sums = running.samples("goal_duration_seconds_sum")
    assert all(0 < value < 60 for value in sums.values())


def test_a_goal_that_another_replaces_is_preempted(running, dds_environment):
    with ActionRobot("/r", GOTO, DOCK, environment=dds_environment) as robot:
        found(running)
        begun(running, robot, GOTO)
        robot.tell("replace", GOTO)
        wait_for(running, {(GOTO, "preempted"): 1})
        assert goals_running(running)[GOTO] == 1


def test_a_server_that_is_killed_and_starts_again_leaves_its_goal_unknown(running, dds_environment):
    with ActionRobot("/r", GOTO, DOCK, environment=dds_environment) as robot:
        found(running)
        begun(running, robot, GOTO)
        robot.kill()
    with ActionRobot("/r", GOTO, DOCK, environment=dds_environment) as again:
        again.tell("begin", GOTO)
        again.tell("succeed", GOTO)
        wait_for(running, {(GOTO, "unknown"): 1, (GOTO, "succeeded"): 1}, 60)


def test_who_joins_late_is_sent_the_list_of_what_runs(start_exporter, dds_environment):
    with ActionRobot("/r", GOTO, DOCK, environment=dds_environment) as robot:
        robot.tell("begin", GOTO)
        robot.tell("succeed", GOTO)
        robot.tell("begin", GOTO)
        running = start_exporter()
        until(lambda: goals_running(running).get(GOTO) == 1, lambda: "not seen", 60)
        robot.tell("abort", GOTO)
        wait_for(running, {(GOTO, "aborted"): 1})
    assert running.samples("goal_duration_seconds_count").popitem()[1] == 0
