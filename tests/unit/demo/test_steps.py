"""The steps wait for their mails, and exactly these must arrive."""

import pytest

from demo.__main__ import ROBOTS, WHOLE
from demo.steps import (
    LASER,
    MOTOR,
    Fault,
    Pace,
    Step,
    announcement,
    finished,
    mail_errors,
    next_step,
    out_of_time,
    problems,
    recoveries,
)
from testbed.configuration import KINDS
from testbed.mail import Mail
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.scenario import load_scenario

FAULT = Fault("robot_7", "Motor 1", "error", {"Motor 1": "CRITICAL"}, "hot")
PACE = Pace(healthy=10, notified=5)
(PROBLEM,), (RECOVERY,) = problems([FAULT]), recoveries([FAULT])
BOTH = (FAULT, LASER)


def mails(*subjects: str) -> list[Mail]:
    return [Mail(0.0, "a@b", ("c@d",), subject, "text", "") for subject in subjects]


@pytest.mark.parametrize(
    ("at", "since", "arrived", "then"),
    [
        (Step.HEALTHY, 9.9, [], Step.HEALTHY),
        (Step.HEALTHY, 10.0, [], Step.BROKEN),
        (Step.BROKEN, 99.0, [], Step.BROKEN),
        (Step.BROKEN, 0.0, [PROBLEM], Step.NOTIFIED),
        (Step.NOTIFIED, 4.9, [PROBLEM], Step.NOTIFIED),
        (Step.NOTIFIED, 5.0, [PROBLEM], Step.REPAIRED),
        (Step.REPAIRED, 99.0, [PROBLEM], Step.REPAIRED),
        (Step.REPAIRED, 0.0, [PROBLEM, RECOVERY], Step.FINISHED),
        (Step.FINISHED, 99.0, [PROBLEM, RECOVERY], Step.FINISHED),
    ],
)
def test_a_step_follows_when_its_time_or_its_mail_has_come(at, since, arrived, then):
    assert next_step(at, since, mails(*arrived), [FAULT], PACE) is then


@pytest.mark.parametrize(
    ("arrived", "wrong"),
    [
        ([], ["never arrived", "never arrived"]),
        ([PROBLEM], [f"never arrived: {RECOVERY}"]),
        ([PROBLEM, PROBLEM, RECOVERY], [f"not expected: {PROBLEM}"]),
        ([PROBLEM, RECOVERY, "lunch"], ["not expected: lunch"]),
    ],
)
def test_every_missing_or_unexpected_mail_is_an_error(arrived, wrong):
    errors = mail_errors(mails(*arrived), [FAULT])

    assert len(errors) == len(wrong)
    for error, part in zip(errors, wrong, strict=True):
        assert part in error


def test_running_out_of_time_names_the_step_and_the_option():
    assert "while waiting for the recovery emails" in out_of_time(Step.REPAIRED)
    assert "--seconds 150" in out_of_time(Step.REPAIRED)


def test_with_two_faults_all_their_mails_are_waited_for():
    first, *others = sorted(problems(BOTH))
    assert len(others) == 2
    assert next_step(Step.BROKEN, 99.0, mails(first, others[0]), BOTH, PACE) is Step.BROKEN
    assert next_step(Step.BROKEN, 99.0, mails(first, *others), BOTH, PACE) is Step.NOTIFIED
    assert finished([FAULT]) == "demo finished: 1 problem, 1 recovery"
    assert finished(BOTH) == "demo finished: 3 problems, 3 recoveries"


def test_what_will_happen_is_announced_with_its_mails():
    scan = "turtlebot4_diagnostics: /scan topic status of turtlebot_1"
    mailed = "/scan topic status (turtlebot4_diagnostics) of turtlebot_1"
    assert announcement((MOTOR, LASER)) == (
        f"soon these break, and are repaired later: Motor 2 of robot_3 and {scan}; each of these"
        " gets a PROBLEM mail and later a RECOVERY mail:"
        f" Motor 2 of robot_3, {mailed}, navigate_to_pose of turtlebot_1"
    )


def test_what_breaks_is_there():
    fleet = Fleet(load_scenario(ROBOTS).specs)
    assert len(fleet.robots) == WHOLE.robots
    for fault in (MOTOR, LASER):
        part = fleet.robot(fault.robot).driver.part(fault.component)
        assert fault.what in part.known_faults()
    kinds = {robot.spec.kind.parent for robot in fleet.robots.values()}
    assert kinds == {KINDS}
