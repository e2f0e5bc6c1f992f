"""What is kept: robots, their components in trouble, problems, larger causes.

A component has a record only while something about it is not as usual, so that a healthy fleet
costs one record for each robot.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from enum import Enum
from math import inf
from typing import Literal

from ros_diagnostics_exporter.config.fleet import Threshold
from ros_diagnostics_exporter.faults.flapping import FlapHistory
from ros_diagnostics_exporter.faults.model import (
    Ability,
    ComponentName,
    End,
    Fault,
    Identity,
    PartName,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.needs import Bad, WantedCapability
from ros_diagnostics_exporter.faults.settings import ComponentSettings, RobotSettings
from ros_diagnostics_exporter.model import Instant, Level

TREND_STEPS = 15  # intervals between samples in which a value may be seen to fall
ValueKey = tuple[str, str, str]  # key, bound, severity
Fails = Literal["stale", "error"] | None
RowKey = tuple[str, tuple[str, ...]]  # kind, key: the row that a record is written to


class Presence(str, Enum):
    """Whether a robot is received."""

    NEVER = "never"
    SILENT = "silent"
    UP = "up"


class Problem:
    """One thing that is wrong, confirmed (``fault``) or not yet.

    ``since`` is when this state began, ``clock`` (monotonic) when the trouble did from which
    confirm_after is counted. ``robot``, ``component``, ``cause`` and ``capability`` are what it
    belongs to; ``clock`` of a capability is when its parts have been so for their confirm_after.
    ``restored``: the fault is of an earlier process, and nothing has confirmed it since.
    """

    __slots__ = (
        "capability",
        "cause",
        "clock",
        "component",
        "fault",
        "identity",
        "restored",
        "robot",
        "row",
        "since",
        "verdict",
    )

    def __init__(
        self,
        identity: Identity,
        since: Instant,
        *,
        robot: RobotRecord | None = None,
        component: ComponentRecord | None = None,
        cause: Cause | None = None,
        capability: CapabilityRecord | FleetCapabilityRecord | None = None,
    ) -> None:
        self.identity = identity
        self.row: RowKey = ("problem", (identity[0].value, identity[1].value, *identity[2:]))
        self.since = since
        self.clock = since.mono
        self.robot = robot
        self.component = component
        self.cause = cause
        self.capability = capability
        self.verdict = Verdict.HELD
        self.fault: Fault | None = None
        self.restored = False

    @property
    def in_trouble(self) -> bool:
        """Whether it was not well when last known."""
        return self.verdict is not Verdict.WELL


class ComponentRecord:
    """A component that is or was in trouble.

    ``level`` is the latest, STALE while its robot is silent; ``since`` when it left OK;
    ``counted`` whether it counts towards a common cause until it is received better;
    ``explained_until`` (monotonic) when what it is behind has been well for long enough.
    """

    __slots__ = (
        "counted",
        "explained_until",
        "flaps",
        "level",
        "name",
        "noted",
        "problems",
        "robot",
        "row",
        "settings",
        "since",
        "values",
    )

    def __init__(
        self, robot: RobotRecord, name: ComponentName, settings: ComponentSettings
    ) -> None:
        self.robot = robot
        self.name = name
        self.row: RowKey = ("component", (robot.name, *name))
        self.settings = settings
        self.level = Level.OK
        self.since: Instant | None = None
        self.problems: dict[State, Problem] = {}  # FLAPPING and INTERMITTENT among them
        self.values: dict[ValueKey, Problem] = {}
        self.flaps: FlapHistory | None = None
        self.counted = False
        self.explained_until = -inf
        # (since, flap ratio) when a change of them was last noted
        self.noted: tuple[Instant | None, float | None] | None = None

    @property
    def flapping(self) -> bool:
        """Whether it changes too often for anything else to be reported of it."""
        problem = self.problems.get(State.FLAPPING)
        return problem is not None and problem.in_trouble

    @property
    def fails(self) -> Fails:
        """Whether it explains that what is behind it is STALE, or any trouble of that."""
        bad = {state for state, problem in self.problems.items() if problem.in_trouble}
        if bad & {State.CRITICAL, State.FLAPPING}:
            return "error"
        return "stale" if State.STALE in bad else None

    def is_behind(self, *, stale: bool) -> bool:
        """Whether what it is behind explains its trouble; ``stale``: that it is absent."""
        found = (self.robot.components.get(ComponentName(*each)) for each in self.settings.behind)
        explained = ("stale", "error") if stale else ("error",)
        return any(each is not None and each.fails in explained for each in found)

    @property
    def is_intermittent(self) -> bool:
        """Whether it is confirmed that it changes again and again."""
        problem = self.problems.get(State.INTERMITTENT)
        return problem is not None and problem.fault is not None

    @property
    def has_fault(self) -> bool:
        """Whether its level, or how often that changes, is confirmed to be wrong."""
        return any(
            problem.fault is not None
            for state, problem in self.problems.items()
            if state is not State.INTERMITTENT
        )

    @property
    def maintenance(self) -> bool:
        """Whether it, or its robot, is in a planned downtime."""
        return self.robot.maintenance or self.name.component in self.robot.maintained

    @property
    def is_usual(self) -> bool:
        """Whether there is nothing to keep."""
        return not (self.problems or self.values or self.counted) and (
            self.since is None and self.flaps is None
        )


class Trend:
    """A value that is not to fall to its ``threshold``: its latest number, and samples of it.

    ``most`` is the worst verdict that it may have now, ``settings`` those of its component.
    """

    __slots__ = ("most", "number", "samples", "settings", "threshold")

    def __init__(self) -> None:
        self.number = 0.0
        self.threshold = Threshold("low", "critical", 0.0)
        self.most = Verdict.BAD
        self.settings = ComponentSettings()
        self.samples: deque[float] = deque(maxlen=TREND_STEPS + 1)


class RobotRecord:
    """One robot, with what is wrong with it and its components.

    ``total`` is how many components it has; ``maintained`` the names of those in a downtime of
    their own; ``returned_until`` (monotonic) when what rests on absence may begin after its return;
    ``unreachable_since`` (monotonic) since when an uplink or a DDS domain explains its absence;
    ``chained``: a component of it is, or was, behind another; ``history`` counts its coming and
    going; ``trends`` are of values that may fall, by key.
    """

    __slots__ = (
        "capabilities",
        "chained",
        "checks",
        "components",
        "counted",
        "declared",
        "history",
        "maintained",
        "maintenance",
        "many",
        "name",
        "presence",
        "problems",
        "returned_until",
        "row",
        "settings",
        "total",
        "trends",
        "unreachable_since",
    )

    def __init__(self, name: str, settings: RobotSettings) -> None:
        self.name = name
        self.row: RowKey = ("robot", (name,))
        self.settings = settings
        self.declared = False
        self.presence = Presence.NEVER
        self.maintenance = False
        self.maintained: frozenset[str] = frozenset()  # not written: planned anew after a start
        self.returned_until = -inf
        self.unreachable_since: float | None = None  # not written: reported anew after a start
        self.chained = False
        self.total = 0
        self.counted = False  # towards its site's silence
        self.history: FlapHistory | None = None
        self.problems: dict[State, Problem] = {}  # SILENT, PENDING, FLAPPING
        self.checks: dict[str, Problem] = {}
        self.capabilities: dict[str, CapabilityRecord] = {}  # each after those that it needs
        self.components: dict[ComponentName, ComponentRecord] = {}
        self.trends: dict[tuple[ComponentName, str], Trend] = {}  # not written: followed anew
        self.many = Cause(Scope.ROBOT, name, self)

    @property
    def up(self) -> bool:
        """Whether it is received."""
        return self.presence is Presence.UP

    @property
    def unreachable(self) -> bool:
        """Whether something else explains that nothing is received of it."""
        return self.unreachable_since is not None

    @property
    def flapping(self) -> bool:
        """Whether it comes and goes."""
        problem = self.problems.get(State.FLAPPING)
        return problem is not None and problem.in_trouble

    def all_problems(self) -> Iterator[Problem]:
        """Everything that is wrong with the robot and its parts."""
        yield from self.problems.values()
        yield from self.checks.values()
        yield from self.many.problems.values()
        for capability in self.capabilities.values():
            yield from capability.problems.values()
        for component in self.components.values():
            yield from component.problems.values()
            yield from component.values.values()


class Cause:
    """Many problems that are one: of a site, of one component on many robots, of one robot.

    ``scope`` is SITE, COMMON or ROBOT and ``name`` the site, the component or the robot. While
    ``active``, and until ``covers_until`` (monotonic) after it, what it explains does not begin.
    ``counted`` (robot -> what of it) stay until they are received better; ``fresh`` are those of
    them whose trouble is known now. A robot's own cause counts its components instead.
    ``adopted``: it was a fault before the start, and what it counted then is not known.
    """

    __slots__ = (
        "active",
        "adopted",
        "counted",
        "covers_until",
        "fresh",
        "name",
        "problems",
        "robot",
        "row",
        "scope",
    )

    def __init__(self, scope: Scope, name: str, robot: RobotRecord | None = None) -> None:
        self.scope = scope
        self.name = name
        self.row: RowKey = ("cause", (scope.value, name))
        self.robot = robot
        self.active: Instant | None = None
        self.adopted = False
        self.covers_until = -inf
        self.counted: dict[str, set[str]] = {}
        self.fresh: dict[str, set[str]] = {}
        self.problems: dict[str, Problem] = {}  # by severity; "" where there is one

    def covers(self, now: Instant) -> bool:
        """Whether what it explains is quiet."""
        return self.active is not None or now.mono < self.covers_until

    @property
    def is_fault(self) -> bool:
        """Whether it is confirmed, so that only what is received ends it."""
        return any(each.fault is not None for each in self.problems.values())

    def count(self, robot: str, part: str, *, counts: bool, fresh: bool) -> None:
        """Note whether a part of a robot belongs to it."""
        for sets, wanted in ((self.counted, counts), (self.fresh, fresh)):
            if wanted:
                sets.setdefault(robot, set()).add(part)
            elif robot in sets:
                sets[robot].discard(part)
                if not sets[robot]:
                    del sets[robot]

    @property
    def is_usual(self) -> bool:
        """Whether there is nothing to keep."""
        return not (self.counted or self.problems or self.active) and self.covers_until == -inf


class CapabilityRecord:
    """Something that a robot can do; ``wanted`` is None until it is configured.

    ``ability`` is how good it is, and ``due`` (monotonic) when its parts have been so for their
    confirm_after. While ``active``, and until ``covers_until`` (monotonic) after it, the ``parts``
    that keep it from being OK are quiet; ``worst`` is how bad it was when last known. ``adopted``:
    it was a fault before the start, and its parts then are not known.
    """

    __slots__ = (
        "ability",
        "active",
        "adopted",
        "covers_until",
        "due",
        "name",
        "parts",
        "problems",
        "robot",
        "row",
        "wanted",
        "worst",
    )

    def __init__(self, robot: RobotRecord, name: str) -> None:
        self.robot = robot
        self.name = name
        self.row: RowKey = ("capability", (robot.name, name))
        self.wanted: WantedCapability | None = None
        self.ability = self.worst = Ability.UNKNOWN
        self.due = -inf
        self.active: Instant | None = None
        self.adopted = False
        self.covers_until = -inf
        self.parts: dict[PartName, Bad] = {}
        self.problems: dict[State, Problem] = {}

    def covers(self, now: Instant) -> bool:
        """Whether its parts are quiet."""
        return self.active is not None or now.mono < self.covers_until

    @property
    def is_fault(self) -> bool:
        """Whether it is confirmed that it is in trouble."""
        return any(each.fault is not None and each.in_trouble for each in self.problems.values())


class FleetCapabilityRecord:
    """Something that the fleet can do; ``wanted`` is None until it is configured.

    ``parts`` are the robots that kept it from being OK when that was last known. ``adopted``: it
    was a fault before the start, and what its robots can do is not known yet.
    """

    __slots__ = ("ability", "adopted", "name", "parts", "problems", "wanted")

    def __init__(self, name: str) -> None:
        self.name = name
        self.wanted: WantedCapability | None = None
        self.ability = Ability.UNKNOWN
        self.adopted = False
        self.parts: dict[PartName, Bad] = {}
        self.problems: dict[State, Problem] = {}


class Ended:
    """What ended a fault, kept until ``until`` (monotonic): for ever while nobody has read it."""

    __slots__ = ("end", "until")

    def __init__(self, end: End) -> None:
        self.end = end
        self.until = inf
