"""What is kept: robots, their components in trouble, problems, larger causes.

A component has a record only while something about it is not as usual, so that a healthy fleet
costs one record for each robot. How often it changed of late is kept as Nagios' flap detection has
it, of 21 states.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import KW_ONLY, dataclass, field
from enum import Enum
from itertools import compress
from math import inf
from operator import ne
from typing import Literal

from ros_diagnostics_exporter.config.fleet import Threshold
from ros_diagnostics_exporter.faults.model import (
    Ability,
    ComponentName,
    ComponentSettings,
    End,
    Fault,
    Identity,
    PartName,
    RobotSettings,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.needs import Bad, WantedCapability
from ros_diagnostics_exporter.model import Instant, Level

SLOTS = 21
_LOW_CURVE = 0.75
_HIGH_CURVE = 1.25
# Of each possible change, the oldest first.
_WEIGHTS = tuple(
    place * (_HIGH_CURVE - _LOW_CURVE) / (SLOTS - 2) + _LOW_CURVE for place in range(SLOTS - 1)
)


def flap_ratio(slots: Sequence[int]) -> float:
    """Weighted share (0..1) of changes between neighbouring states, the oldest first.

    The newest of the 20 possible changes weighs 1.25, the oldest 0.75: the formula of Nagios'
    check_for_service_flapping (base/flapping.c). ``slots`` holds 21 states.
    """
    changed = map(ne, slots, slots[1:])
    return sum(compress(_WEIGHTS, changed)) / (SLOTS - 1)


class FlapHistory:
    """The last 21 states of one thing.

    A state is recorded at every change, so that no change is ever missed, and otherwise once an
    interval, so that what has come to rest no longer flaps after 21 intervals. ``changed`` are the
    times (monotonic) of its last changes, the oldest first, that no fault explains.
    """

    __slots__ = ("changed", "last", "ratio", "slots")

    def __init__(self, slots: Iterable[int], mono: float) -> None:
        """``slots`` are 21 states, the oldest first, each from 0 to 255."""
        self.slots = bytes(slots)  # of each component there is one: a list takes four times as much
        self.ratio = flap_ratio(self.slots)
        self.last = mono  # when the latest state was recorded
        self.changed: tuple[float, ...] = ()

    def decay(self, mono: float, interval: float) -> bool:
        """Record what the time since the last record adds; True if the ratio may have changed."""
        steps = int((mono - self.last) / interval + 1e-9)
        if steps <= 0:
            # Computed as a timer is: after a long uptime the difference may be less than interval.
            if mono < self.last + interval:
                return False
            steps = 1
        self.last = min(mono, self.last + steps * interval)
        if self.ratio == 0.0:
            return False
        steps = min(steps, SLOTS)
        self.slots = self.slots[steps:] + self.slots[-1:] * steps
        self.ratio = flap_ratio(self.slots)
        return True

    def change(self, state: int, mono: float, interval: float) -> None:
        """Record a change to another state."""
        self.decay(mono, interval)
        self.last = mono
        self.slots = bytes((*self.slots[1:], state))
        self.ratio = flap_ratio(self.slots)
        self.changed = (*self.changed, mono)[1 - SLOTS :]


TREND_STEPS = 15  # intervals between samples in which a value may be seen to fall
ValueKey = tuple[str, str, str]  # key, bound, severity
Fails = Literal["stale", "error"] | None
RowKey = tuple[str, tuple[str, ...]]  # kind, key: the row that a record is written to


class Presence(str, Enum):
    """Whether a robot is received."""

    NEVER = "never"
    SILENT = "silent"
    UP = "up"


@dataclass(slots=True, eq=False, repr=False)
class Problem:
    """One thing that is wrong, confirmed (``fault``) or not yet.

    ``since`` is when this state began, ``clock`` (monotonic) when the trouble did from which
    confirm_after is counted. ``robot``, ``component``, ``cause`` and ``capability`` are what it
    belongs to; ``clock`` of a capability is when its parts have been so for their confirm_after.
    ``restored``: the fault is of an earlier process, and nothing has confirmed it since.
    """

    identity: Identity
    since: Instant
    _: KW_ONLY
    robot: RobotRecord | None = None
    component: ComponentRecord | None = None
    cause: Cause | None = None
    capability: CapabilityRecord | FleetCapabilityRecord | None = None
    verdict: Verdict = Verdict.HELD
    fault: Fault | None = None
    restored: bool = False
    clock: float = field(init=False)
    row: RowKey = field(init=False)

    def __post_init__(self) -> None:
        self.clock = self.since.mono
        of = self.identity
        self.row = ("problem", (of[0].value, of[1].value, *of[2:]))

    @property
    def in_trouble(self) -> bool:
        """Whether it was not well when last known."""
        return self.verdict is not Verdict.WELL


@dataclass(slots=True, eq=False, repr=False)
class ComponentRecord:
    """A component that is or was in trouble.

    ``level`` is the latest, STALE while its robot is silent; ``since`` when it left OK;
    ``counted`` whether it counts towards a common cause until it is received better;
    ``explained_until`` (monotonic) when what it is behind has been well for long enough.
    """

    robot: RobotRecord
    name: ComponentName
    settings: ComponentSettings
    level: Level = Level.OK
    since: Instant | None = None
    problems: dict[State, Problem] = field(default_factory=dict)  # FLAPPING, INTERMITTENT, too
    values: dict[ValueKey, Problem] = field(default_factory=dict)
    flaps: FlapHistory | None = None
    counted: bool = False
    explained_until: float = -inf
    # (since, flap ratio) when a change of them was last noted
    noted: tuple[Instant | None, float | None] | None = None
    row: RowKey = field(init=False)

    def __post_init__(self) -> None:
        self.row = ("component", (self.robot.name, *self.name))

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


@dataclass(slots=True, eq=False, repr=False)
class Trend:
    """A value that is not to fall to its ``threshold``: its latest number, and samples of it.

    ``most`` is the worst verdict that it may have now, ``settings`` those of its component.
    """

    number: float = 0.0
    threshold: Threshold = field(default_factory=lambda: Threshold("low", "critical", 0.0))
    most: Verdict = Verdict.BAD
    settings: ComponentSettings = field(default_factory=ComponentSettings)
    samples: deque[float] = field(default_factory=lambda: deque(maxlen=TREND_STEPS + 1))


@dataclass(slots=True, eq=False, repr=False)
class RobotRecord:
    """One robot, with what is wrong with it and its components.

    ``total`` is how many components it has; ``maintained`` the names of those in a downtime of
    their own; ``returned_until`` (monotonic) when what rests on absence may begin after its return;
    ``unreachable_since`` (monotonic) since when an uplink or a DDS domain explains its absence;
    ``chained``: a component of it is, or was, behind another; ``history`` counts its coming and
    going; ``trends`` are of values that may fall, by key.
    """

    name: str
    settings: RobotSettings
    declared: bool = False
    presence: Presence = Presence.NEVER
    maintenance: bool = False
    maintained: frozenset[str] = frozenset()  # not written: planned anew after a start
    returned_until: float = -inf
    unreachable_since: float | None = None  # not written: reported anew after a start
    chained: bool = False
    total: int = 0
    counted: bool = False  # towards its site's silence
    history: FlapHistory | None = None
    problems: dict[State, Problem] = field(default_factory=dict)  # SILENT, PENDING, FLAPPING
    checks: dict[str, Problem] = field(default_factory=dict)
    # each after those that it needs
    capabilities: dict[str, CapabilityRecord] = field(default_factory=dict)
    components: dict[ComponentName, ComponentRecord] = field(default_factory=dict)
    # not written: followed anew
    trends: dict[tuple[ComponentName, str], Trend] = field(default_factory=dict)
    many: Cause = field(init=False)
    row: RowKey = field(init=False)

    def __post_init__(self) -> None:
        self.many = Cause(Scope.ROBOT, self.name, self)
        self.row = ("robot", (self.name,))

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


@dataclass(slots=True, eq=False, repr=False)
class Cause:
    """Many problems that are one: of a site, of one component on many robots, of one robot.

    ``scope`` is SITE, COMMON or ROBOT and ``name`` the site, the component or the robot. While
    ``active``, and until ``covers_until`` (monotonic) after it, what it explains does not begin.
    ``counted`` (robot -> what of it) stay until they are received better; ``fresh`` are those of
    them whose trouble is known now. A robot's own cause counts its components instead.
    ``adopted``: it was a fault before the start, and what it counted then is not known.
    """

    scope: Scope
    name: str
    robot: RobotRecord | None = None
    active: Instant | None = None
    adopted: bool = False
    covers_until: float = -inf
    counted: dict[str, set[str]] = field(default_factory=dict)
    fresh: dict[str, set[str]] = field(default_factory=dict)
    problems: dict[str, Problem] = field(default_factory=dict)  # by severity; "" where there is one

    @property
    def row(self) -> RowKey:
        """The row that it is written to."""
        return "cause", (self.scope.value, self.name)

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


@dataclass(slots=True, eq=False, repr=False)
class CapabilityRecord:
    """Something that a robot can do; ``wanted`` is None until it is configured.

    ``ability`` is how good it is, and ``due`` (monotonic) when its parts have been so for their
    confirm_after. While ``active``, and until ``covers_until`` (monotonic) after it, the ``parts``
    that keep it from being OK are quiet; ``worst`` is how bad it was when last known. ``adopted``:
    it was a fault before the start, and its parts then are not known.
    """

    robot: RobotRecord
    name: str
    wanted: WantedCapability | None = None
    ability: Ability = Ability.UNKNOWN
    worst: Ability = Ability.UNKNOWN
    due: float = -inf
    active: Instant | None = None
    adopted: bool = False
    covers_until: float = -inf
    parts: dict[PartName, Bad] = field(default_factory=dict)
    problems: dict[State, Problem] = field(default_factory=dict)
    row: RowKey = field(init=False)

    def __post_init__(self) -> None:
        self.row = ("capability", (self.robot.name, self.name))

    def covers(self, now: Instant) -> bool:
        """Whether its parts are quiet."""
        return self.active is not None or now.mono < self.covers_until

    @property
    def is_fault(self) -> bool:
        """Whether it is confirmed that it is in trouble."""
        return any(each.fault is not None and each.in_trouble for each in self.problems.values())


@dataclass(slots=True, eq=False, repr=False)
class FleetCapabilityRecord:
    """Something that the fleet can do; ``wanted`` is None until it is configured.

    ``parts`` are the robots that kept it from being OK when that was last known. ``adopted``: it
    was a fault before the start, and what its robots can do is not known yet.
    """

    name: str
    wanted: WantedCapability | None = None
    ability: Ability = Ability.UNKNOWN
    adopted: bool = False
    parts: dict[PartName, Bad] = field(default_factory=dict)
    problems: dict[State, Problem] = field(default_factory=dict)


@dataclass(slots=True, eq=False, repr=False)
class Ended:
    """What ended a fault, kept until ``until`` (monotonic): for ever while nobody has read it."""

    end: End
    until: float = inf
