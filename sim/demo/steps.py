"""The steps of the demo, which fault it injects, and which emails must arrive, no others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from testbed.configuration import FLEET
from testbed.mail import Mail


@dataclass(frozen=True)
class Fault:
    """The component that breaks, and its driver's message."""

    robot: str = "robot_3"
    component: str = "Motor 2"
    message: str = "no encoder pulses, drive switched off"


class Step(Enum):
    """The steps in their order; the value says what happens meanwhile."""

    HEALTHY = "all robots were OK"
    BROKEN = "waiting for the email about the broken motor"
    NOTIFIED = "leaving time to read the email"
    REPAIRED = "waiting for the recovery email"
    FINISHED = "showing the fleet after the recovery"


@dataclass(frozen=True)
class Pace:
    """Seconds before the fault, and between its email and the repair."""

    healthy: float = 12.0
    notified: float = 12.0


PROBLEM = "** PROBLEM **"
RECOVERY = "** RECOVERY **"


def expected_subjects(fault: Fault) -> tuple[str, str]:
    """Return the subjects of the emails that must arrive, in their order."""
    name = f"{FLEET}/{fault.robot} {fault.component}"
    return (f"{PROBLEM} {name} is CRITICAL", f"{RECOVERY} {name} is no longer CRITICAL")


def next_step(step: Step, since: float, mails: Sequence[Mail], fault: Fault, pace: Pace) -> Step:
    """Return the step that follows now, or ``step`` itself.

    Args:
        step: The current step.
        since: Seconds since it began.
        mails: All that have arrived.
        fault: The injected fault.
        pace: How long to let the reader look.
    """
    subjects = {mail.subject for mail in mails}
    problem, recovery = (subject in subjects for subject in expected_subjects(fault))
    if step is Step.HEALTHY and since >= pace.healthy:
        return Step.BROKEN
    if step is Step.BROKEN and problem:
        return Step.NOTIFIED
    if step is Step.NOTIFIED and since >= pace.notified:
        return Step.REPAIRED
    if step is Step.REPAIRED and recovery:
        return Step.FINISHED
    return step


def mail_errors(mails: Sequence[Mail], fault: Fault) -> list[str]:
    """Return what is wrong with the mails that arrived; empty: exactly the expected ones."""
    subjects = [mail.subject for mail in mails]
    missing = list(expected_subjects(fault))
    errors = [f"this email never arrived: {each}" for each in missing if each not in subjects]
    for each in subjects:
        if each in missing:
            missing.remove(each)
        else:
            errors.append(f"this email was not expected: {each}")
    return errors


def out_of_time(step: Step) -> str:
    """Return an error that names the current step, and the way out."""
    return (
        f"the time ran out while {step.value}; the demo takes about 70 seconds on an idle machine:"
        " use --seconds 150, or see above what it was waiting for"
    )
