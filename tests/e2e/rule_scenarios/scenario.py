"""A rule scenario: steps, each with the alerts that fire once it has settled.

The next step begins when the one before has settled, not at a fixed time, so that a scenario works
on a busy machine too. Alerts that fired in between are read from the series ALERTS of the whole
run. Alerts are written as `NAME ROBOT WHAT`, without the prefix RosDiagnostics.
"""

from dataclasses import dataclass, field

Alerts = frozenset[str]


@dataclass(frozen=True)
class Step:
    """What happens, and what fires once it has settled.

    ``actions`` are orders to robots and components (`worsens/Motor 1: error`, `mute: hang`) or to
    the site (`site: kill exporter`). ``until`` is a PromQL expression that must also return
    something; BEGAN in it is when the step began (Unix time). ``descriptions`` are words that the
    texts of an alert must contain.
    """

    actions: tuple[str, ...]
    alerts: Alerts
    until: str = ""
    descriptions: dict[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Scenario:
    """A title, its robots (or fleets, uplinks), and steps that list all alerts about those.

    ``ranks`` are the states that are recorded of a robot, in order, from the first step on.
    """

    title: str
    robots: tuple[str, ...]
    steps: tuple[Step, ...]
    ranks: dict[str, tuple[int, ...]] = field(default_factory=dict)


def step(
    actions: str | tuple[str, ...],
    *alerts: str,
    until: str = "",
    descriptions: dict[str, str] | None = None,
) -> Step:
    """A step; without an action where ``actions`` is empty."""
    given = (actions,) if isinstance(actions, str) else actions
    return Step(tuple(filter(None, given)), frozenset(alerts), until, descriptions or {})


def critical(robot: str, component: str) -> str:
    return f"ComponentCritical {robot} {component}"


def warning(robot: str, component: str) -> str:
    return f"ComponentWarning {robot} {component}"


def silent(robot: str) -> str:
    return f"RobotSilent {robot}"


def rank(robot: str, state: float) -> str:
    """The robot's recorded state has this rank."""
    return f'robot:ros_diagnostics_state:rank{{robot="{robot}"}} == {state}'


def in_trouble(robot: str, components: int, seconds: int = 12) -> str:
    """So many components of the robot have been in trouble for twice their confirm_after."""
    started = f'ros_diagnostics_component_problem_since_timestamp_seconds{{robot="{robot}"}}'
    return f"count(time() - {started} > {seconds}) == {components}"


BEGIN = ""  # the first step: nothing happens, all are well
