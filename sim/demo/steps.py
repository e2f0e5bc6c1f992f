"""The steps of the demo, which fault it injects, and which emails must arrive, no others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

from testbed.configuration import FLEET
from testbed.mail import Mail


@dataclass(frozen=True)
class Fault:
    """What breaks, and which components of the robot are then mailed, each with its state.

    ``mailed`` has them as subjects do: the node that publishes a component stands last.
    """

    robot: str
    component: str
    what: str  # as virtual robots name it
    mailed: Mapping[str, str]
    message: str = ""


MOTOR = Fault(
    robot="robot_3",
    component="Motor 2",
    what="error",
    message="no encoder pulses, drive switched off",
    mailed={"Motor 2": "CRITICAL"},
)
# The laser is STALE, and while it is two goals of the robot are aborted.
LASER = Fault(
    robot="turtlebot_1",
    component="turtlebot4_diagnostics: /scan topic status",
    what="silent",
    mailed={
        "/scan topic status (turtlebot4_diagnostics)": "STALE",
        "navigate_to_pose": "WARNING",
    },
)


class Step(Enum):
    """The steps in their order; the value says what happens meanwhile."""

    HEALTHY = "all robots were OK"
    BROKEN = "waiting for the emails about what is broken"
    NOTIFIED = "leaving time to read the emails"
    REPAIRED = "waiting for the recovery emails"
    FINISHED = "showing the fleet after the recoveries"


@dataclass(frozen=True)
class Pace:
    """Seconds before the fault, and between its email and the repair."""

    healthy: float = 12.0
    notified: float = 12.0


PROBLEM = "** PROBLEM **"
RECOVERY = "** RECOVERY **"


def problems(faults: Sequence[Fault]) -> set[str]:
    """Return the subjects of the emails that must arrive when these are broken."""
    return _subjects(f"{PROBLEM} {FLEET}/{{}} {{}} is {{}}", faults)


def recoveries(faults: Sequence[Fault]) -> set[str]:
    """Return the subjects of the emails that must arrive when they are repaired."""
    return _subjects(f"{RECOVERY} {FLEET}/{{}} {{}} is no longer {{}}", faults)


def _subjects(form: str, faults: Sequence[Fault]) -> set[str]:
    """Return the form for each part that is mailed, filled in with robot, name and state."""
    return {
        form.format(fault.robot, name, state)
        for fault in faults
        for name, state in fault.mailed.items()
    }


def next_step(
    step: Step, since: float, mails: Sequence[Mail], faults: Sequence[Fault], pace: Pace
) -> Step:
    """Return the step that follows now, or ``step`` itself.

    Args:
        step: The current step.
        since: Seconds since it began.
        mails: All that have arrived.
        faults: Those that are injected.
        pace: How long to let the reader look.
    """
    subjects = {mail.subject for mail in mails}
    if step is Step.HEALTHY and since >= pace.healthy:
        return Step.BROKEN
    if step is Step.BROKEN and subjects >= problems(faults):
        return Step.NOTIFIED
    if step is Step.NOTIFIED and since >= pace.notified:
        return Step.REPAIRED
    if step is Step.REPAIRED and subjects >= recoveries(faults):
        return Step.FINISHED
    return step


def mail_errors(mails: Sequence[Mail], faults: Sequence[Fault]) -> list[str]:
    """Return what is wrong with the mails that arrived; empty: exactly the expected ones."""
    subjects = [mail.subject for mail in mails]
    missing = [*sorted(problems(faults)), *sorted(recoveries(faults))]
    errors = [f"this email never arrived: {each}" for each in missing if each not in subjects]
    for each in subjects:
        if each in missing:
            missing.remove(each)
        else:
            errors.append(f"this email was not expected: {each}")
    return errors


def announcement(faults: Sequence[Fault]) -> str:
    """Return what will happen, and which emails that brings."""
    broken = " and ".join(f"{fault.component} of {fault.robot}" for fault in faults)
    mailed = [f"{name} of {fault.robot}" for fault in faults for name in fault.mailed]
    two = "each of these gets a PROBLEM mail and later a RECOVERY mail"
    return f"soon these break, and are repaired later: {broken}; {two}: {', '.join(mailed)}"


def finished(faults: Sequence[Fault]) -> str:
    """Return what is said when all emails have arrived."""
    problem, recovery = len(problems(faults)), len(recoveries(faults))
    if problem == 1:
        return "demo finished: 1 problem, 1 recovery"
    return f"demo finished: {problem} problems, {recovery} recoveries"


def out_of_time(step: Step) -> str:
    """Return an error that names the current step, and the way out."""
    return (
        f"the time ran out while {step.value}; the demo takes about 90 seconds on an idle machine:"
        " use --seconds 150, or see above what it was waiting for"
    )
