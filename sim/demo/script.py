"""What happens to the robots during the demo, and which emails must come of it, no others."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from testbed.configuration import FLEET
from testbed.mail import Mail


@dataclass(frozen=True)
class Fault:
    """The component that breaks, as its driver will tell it."""

    robot: str = "robot_3"
    component: str = "Motor 2"
    message: str = "no encoder pulses, drive switched off"


class Step(Enum):
    """Where the story stands; each waits for the next one's condition."""

    WELL = "all robots are well"
    BROKEN = "the motor is broken, the email about it is awaited"
    TOLD = "the operator has been told"
    REPAIRED = "the motor is repaired, the email about that is awaited"
    OVER = "the recovery has been told"


@dataclass(frozen=True)
class Pace:
    """Seconds that the reader has to look at something."""

    well: float = 12.0  # a healthy fleet
    told: float = 12.0  # a broken motor, after its email


PROBLEM = "** PROBLEM **"
RECOVERY = "** RECOVERY **"


def expected(fault: Fault) -> tuple[str, str]:
    """Return the subjects of the emails that the story must bring, in their order."""
    who = f"{FLEET}/{fault.robot} {fault.component}"
    return (f"{PROBLEM} {who} is CRITICAL", f"{RECOVERY} {who} is no longer CRITICAL")


def step(at: Step, since: float, mails: Sequence[Mail], fault: Fault, pace: Pace) -> Step:
    """Return where the story stands now.

    Args:
        at: Where it stood.
        since: Seconds since it stands there.
        mails: All that have arrived.
        fault: What breaks.
        pace: How long to let the reader look.
    """
    problem, recovery = (any(mail.subject == each for mail in mails) for each in expected(fault))
    if at is Step.WELL and since >= pace.well:
        return Step.BROKEN
    if at is Step.BROKEN and problem:
        return Step.TOLD
    if at is Step.TOLD and since >= pace.told:
        return Step.REPAIRED
    if at is Step.REPAIRED and recovery:
        return Step.OVER
    return at


def verdict(mails: Sequence[Mail], fault: Fault) -> list[str]:
    """Say what is wrong with the mails that arrived; an empty list: exactly the expected ones."""
    subjects = [mail.subject for mail in mails]
    wanted = list(expected(fault))
    wrong = [f"this email never came: {each}" for each in wanted if each not in subjects]
    for each in subjects:
        if each in wanted:
            wanted.remove(each)
        else:
            wrong.append(f"this email was not expected: {each}")
    return wrong


def cut_short(at: Step) -> str:
    """Say where the story stood when the time was over, and the way out."""
    return (
        f"the time was over while {at.value}; the story takes about 70 seconds on a machine with"
        " nothing else to do: give it more with --seconds 150, or see the lines above for what it"
        " waited for"
    )
