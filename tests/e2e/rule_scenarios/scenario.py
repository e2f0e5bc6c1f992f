"""What a story consists of, and the words in which the stories are told.

A step says what happens and which alerts fire when it has settled; the next step begins then, not
at a time. So a story holds on a fast machine and on a busy one, and what was told in between is
read from the series ALERTS of the whole run. Alerts are written as `NAME ROBOT WHAT`, without the
prefix RosDiagnostics.
"""

from __future__ import annotations

from dataclasses import dataclass, field

Alerts = frozenset[str]


@dataclass(frozen=True)
class Step:
    """What happens, and what fires once it has settled.

    ``does`` are orders to robots and parts (`worsens/Motor 1: error`, `mute: hang`), or deeds of
    the stage (`stage: kill exporter`). ``until`` is a PromQL expression that must have an answer
    too: what must have come about where the alerts alone do not say it; BEGAN in it is when the
    step began (Unix time). ``says`` are words that an
    alert's description must have.
    """

    does: tuple[str, ...]
    alerts: Alerts
    until: str = ""
    says: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Story:
    """A title, the robots (or fleets, uplinks) whose alerts it tells completely, and its steps.

    ``ranks`` are the states that a robot is recorded in, one after another, from the first step on.
    ``spends`` are parts of availability and the steps during which the first robot is in them: from
    the beginning of the first to the beginning of the second.
    """

    title: str
    robots: tuple[str, ...]
    steps: tuple[Step, ...]
    ranks: dict[str, tuple[int, ...]] = field(default_factory=dict)
    spends: dict[str, tuple[tuple[int, int], ...]] = field(default_factory=dict)


def step(
    does: str | tuple[str, ...], *alerts: str, until: str = "", **more: dict[str, str]
) -> Step:
    """A step, its alerts one by one."""
    orders = (does,) if isinstance(does, str) else does
    return Step(tuple(filter(None, orders)), frozenset(alerts), until, **more)


def critical(robot: str, component: str) -> str:
    return f"ComponentCritical {robot} {component}"


def warning(robot: str, component: str) -> str:
    return f"ComponentWarning {robot} {component}"


def silent(robot: str) -> str:
    return f"RobotSilent {robot}"


def rank(robot: str, state: int) -> str:
    """The robot's recorded state is this one."""
    return f'robot:ros_diagnostics_state:rank{{robot="{robot}"}} == {state}'


def lasts(robot: str, components: int, seconds: int = 12) -> str:
    """So many parts of the robot have been in trouble for twice their confirm_after."""
    started = f'component:ros_diagnostics_problem:start{{robot="{robot}"}}'
    return f"count(time() - {started} > {seconds}) == {components}"


BEGIN = ""  # the first step: nothing happens, all are well
