"""What is kept: robots, their components in trouble, problems, larger causes.

A component has a record only while something about it is not as usual, so that a healthy fleet
costs one record for each robot. How often it changed of late is kept as Nagios' flap detection has
it, of 21 states.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import KW_ONLY, dataclass, field
from enum import Enum
from functools import lru_cache
from itertools import compress
from math import ceil, inf
from operator import ne
from typing import Any

from ros_diagnostics_exporter.config.fleet import Flapping, Threshold
from ros_diagnostics_exporter.faults.model import (
    EFFECTS,
    CapabilityState,
    CapabilityView,
    ComponentName,
    ComponentSettings,
    Effect,
    EffectiveVerdict,
    End,
    Fault,
    Identity,
    PartName,
    RobotSettings,
    Scope,
    State,
    Verdict,
    severity_of,
)
from ros_diagnostics_exporter.faults.needs import Bad, WantedCapability
from ros_diagnostics_exporter.model import Instant, Level

# Before Python 3.12 a member of an Enum is looked up by a call: a fifth of a change of a level.
_OK, _STALE = Level.OK, Level.STALE
_HEALTHY = Verdict.HEALTHY
_FLAPPING, _INTERMITTENT = State.FLAPPING, State.INTERMITTENT
_VALUE, _ROBOT = Scope.VALUE, Scope.ROBOT
SLOTS = 21
DOWN = 0  # in the history of a robot that comes and goes: nothing is received of it
_LOW_CURVE = 0.75
_HIGH_CURVE = 1.25
# Of each possible change, the oldest first.
_WEIGHTS = tuple(
    place * (_HIGH_CURVE - _LOW_CURVE) / (SLOTS - 2) + _LOW_CURVE for place in range(SLOTS - 1)
)


@lru_cache(maxsize=1024)  # a fleet's components have few histories, most a change or two
def flap_ratio(slots: bytes) -> float:
    """Weighted share (0..1) of changes between neighbouring states, the oldest first.

    The newest of the 20 possible changes weighs 1.25, the oldest 0.75: the formula of Nagios'
    check_for_service_flapping (base/flapping.c). ``slots`` are 21 states.
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
        self.slots = self.slots[1:] + bytes((state,))
        self.ratio = flap_ratio(self.slots)
        self.changed = (*self.changed, mono)[1 - SLOTS :]


TREND_STEPS = 15  # intervals between samples in which a value may be seen to fall
ValueKey = tuple[str, str, str]  # key, bound, severity
RowKey = tuple[str, tuple[str, ...]]  # kind, key: the row that a record is written to


class Presence(str, Enum):
    """Whether a robot is received."""

    NEVER = "never"
    SILENT = "silent"
    UP = "up"


_UP = Presence.UP


@dataclass(slots=True, eq=False, repr=False, kw_only=True)
class Subject:
    """What another fault may explain.

    ``explained_until`` (monotonic): from then on confirm_after is counted, because what explained
    it is over for long enough. ``returns_until``: until then it counts towards no larger fault,
    because that was what it is reached or fed through.
    """

    explained_until: float = -inf
    returns_until: float = -inf
    row: RowKey = field(init=False)


@dataclass(slots=True, eq=False, repr=False)
class Problem(Subject):
    """One thing that is wrong, confirmed (``fault``) or not yet.

    ``since`` is when this state began, ``clock`` (monotonic) when the trouble did from which
    confirm_after is counted. ``robot``, ``component``, ``cause`` and ``capability`` are what it
    belongs to; ``clock`` of a capability is when its parts have been so for their confirm_after.
    ``restored``: the fault is of an earlier process, and nothing has confirmed it since.
    ``waits_since`` (monotonic): it is due, and nothing suppresses it but what is no fault yet.
    ``by_setting``: it is CRITICAL because fleet.yml says so of STALE, and was never ERROR.
    """

    identity: Identity
    since: Instant
    _: KW_ONLY
    robot: RobotRecord | None = None
    component: ComponentRecord | None = None
    cause: Cause | None = None
    capability: CapabilityRecord | None = None
    verdict: Verdict = Verdict.NO_DATA
    fault: Fault | None = None
    restored: bool = False
    waits_since: float | None = None
    by_setting: bool = False
    boots_until: float = -inf  # of a value, or check, that was so from the first message
    place: tuple[dict[Any, Problem], Any] = field(init=False)  # where what it is about has it
    clock: float = field(init=False)
    row: RowKey = field(init=False)

    def __post_init__(self) -> None:
        self.clock = self.since.mono
        self.row = ("problem", self.identity)

    @property
    def lasts(self) -> bool:
        """Whether it was not healthy when last known: in trouble, or without data since."""
        return self.verdict is not _HEALTHY

    @property
    def is_critical(self) -> bool:
        """Whether it is of severity critical; else of warning."""
        return severity_of(self.identity) == "critical"

    def is_thinned(self, now: Instant) -> bool:
        """Whether a person has just taken out some of what it is about."""
        if self.cause is not None:
            return self.cause.thinned
        robot = None if self.capability is None else self.robot
        return robot is not None and robot.thinned == now.mono

    @property
    def in_downtime(self) -> bool:
        """Whether what it is about is in a planned downtime."""
        if self.component is not None:
            return self.component.in_downtime
        return self.robot is not None and self.robot.maintenance

    @property
    def effective_verdict(self) -> EffectiveVerdict:
        """The verdict together with what people planned."""
        if self.verdict is Verdict.HEALTHY:
            return EffectiveVerdict.HEALTHY
        if self.in_downtime:
            return EffectiveVerdict.IN_DOWNTIME
        if self.verdict is not Verdict.NO_DATA:
            return EffectiveVerdict.FAILING
        planned = self.component is not None and self.component.is_planned_stale
        return EffectiveVerdict.PLANNED_STALE if planned else EffectiveVerdict.NO_DATA

    @property
    def effect(self) -> Effect:
        """What it does to each mechanism."""
        return EFFECTS[self.effective_verdict]

    @property
    def may_explain(self) -> bool:
        """Whether there can be anything that it explains: most components have nothing."""
        component, state = self.component, self.identity.state
        if component is None:
            of_robot = self.capability is not None and self.robot is not None
            return self.cause is not None or of_robot or state is _FLAPPING
        if component.settings.uplink or component.robot.has_dependencies:
            return True
        if self.identity.scope is _VALUE:
            return any(severity == "falling" for _key, _bound, severity in component.values)
        return state is _FLAPPING or _INTERMITTENT in component.problems

    @property
    def subject(self) -> Subject:
        """What it is about, all problems of which were explained together."""
        if self.component is not None:
            return self.component
        if self.capability is not None:
            return self.capability
        is_presence = self.identity.scope is _ROBOT and self.cause is None
        return self.robot if is_presence and self.robot is not None else self


@dataclass(slots=True, eq=False, repr=False)
class ComponentRecord(Subject):
    """A component that is or was in trouble.

    ``level`` is the latest, STALE while its robot is silent; ``since`` when its trouble began;
    ``counted`` whether it counts towards a common cause until it is received better.
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
    boots_until: float = -inf  # its level was so from the first message: it begins no sooner
    # (since, flap ratio) when a change of them was last noted
    noted: tuple[Instant | None, float | None] | None = None
    row: RowKey = field(init=False)

    def __post_init__(self) -> None:
        self.row = ("component", (self.robot.name, *self.name))

    @property
    def flapping(self) -> bool:
        """Whether it changes too often for anything else to be reported of it."""
        problem = self.problems.get(_FLAPPING)
        return problem is not None and problem.lasts

    @property
    def is_planned_stale(self) -> bool:
        """Whether it is STALE as fleet.yml expects it, so that nothing begins, ends or counts."""
        return self.level is _STALE and self.settings.planned_stale

    @property
    def is_failing(self) -> bool:
        """Whether it is in trouble now, freshly known, and nobody planned that."""
        planned = self.is_planned_stale or self.in_downtime
        return self.level is not _OK and self.since is not None and not planned

    def has_time(self, now: Instant) -> bool:
        """Whether its trouble is to be over by itself: it boots, or what feeds it is just back."""
        return now.mono < self.boots_until or now.mono < self.returns_until

    @property
    def is_intermittent(self) -> bool:
        """Whether it is confirmed that it changes again and again."""
        problem = self.problems.get(_INTERMITTENT)
        return problem is not None and problem.fault is not None

    @property
    def has_fault(self) -> bool:
        """Whether its level, or how often that changes, is confirmed to be wrong."""
        for state, problem in self.problems.items():
            if problem.fault is not None and state is not _INTERMITTENT:
                return True
        return False

    @property
    def in_downtime(self) -> bool:
        """Whether it, or its robot, is in a planned downtime."""
        return self.robot.maintenance or self.name.component in self.robot.maintained

    def all_problems(self) -> Iterator[Problem]:
        """What is wrong with its level and how that changes, and with its values."""
        yield from self.problems.values()
        yield from self.values.values()

    @property
    def is_usual(self) -> bool:
        """Whether there is nothing to keep."""
        return not (self.problems or self.values or self.counted) and (
            self.since is None and self.flaps is None
        )


@dataclass(slots=True, eq=False, repr=False)
class Trend:
    """A value that is not to fall to its ``threshold``: its latest number, and samples of it.

    ``most`` is the worst verdict that it may have now, ``settings`` are those of its component,
    ``step`` the seconds between two samples.
    """

    number: float = 0.0
    step: float = 0.0
    threshold: Threshold = field(default_factory=lambda: Threshold("low", "critical", 0.0))
    most: Verdict = Verdict.FAILING
    settings: ComponentSettings = field(default_factory=ComponentSettings)
    samples: deque[float] = field(default_factory=lambda: deque(maxlen=TREND_STEPS + 1))


@dataclass(slots=True, eq=False, repr=False)
class RobotRecord(Subject):
    """One robot, with what is wrong with it and its components.

    ``total`` is how many components it has; ``maintained`` the names of those in a downtime of
    their own; ``returned_until`` (monotonic) when what rests on absence may begin after its return;
    ``cut_off_since`` (monotonic) since when its DDS domain cannot be joined; ``history`` counts its
    coming and going; ``trends`` are of values that may fall, by key.
    """

    name: str
    settings: RobotSettings
    declared: bool = False
    presence: Presence = Presence.NEVER
    maintenance: bool = False
    maintained: frozenset[str] = frozenset()
    returned_until: float = -inf
    booted_until: float = -inf  # for its boot_grace after it came back
    is_restarted: bool = False  # the exporter has just begun to listen, and not the robot to speak
    history_before: FlapHistory | None = None  # before it fell silent, if that counts
    thinned: float = -inf  # when a person took out anything of it, monotonic
    cut_off_since: float | None = None  # not written: reported anew after a start
    has_dependencies: bool = False  # a component of it depends, or did, on another
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
        return self.presence is _UP

    @property
    def flapping(self) -> bool:
        """Whether it comes and goes."""
        problem = self.problems.get(_FLAPPING)
        return problem is not None and problem.lasts

    def stays_away(self, flapping: Flapping) -> bool:
        """Whether it is away for longer than one that flaps: than 1 / ``stop`` intervals.

        One that changes no more often than that has a smaller ratio than ``stop``.
        """
        if self.history is None:
            return False
        return self.history.slots.endswith(bytes([DOWN]) * min(ceil(1 / flapping.stop) + 1, SLOTS))

    def all_problems(self) -> Iterator[Problem]:
        """Everything that is wrong with the robot and its parts."""
        yield from self.problems.values()
        yield from self.checks.values()
        yield from self.many.problems.values()
        for capability in self.capabilities.values():
            yield from capability.problems.values()
        for component in self.components.values():
            yield from component.all_problems()


@dataclass(slots=True, eq=False, repr=False)
class Cause:
    """Many problems that are one: of a site, of one component on many robots, of one robot.

    ``scope`` is SITE, COMMON or ROBOT and ``name`` the site, the component or the robot. It is
    ``active`` from when there are enough until fewer than half of that are left. ``counted`` (robot
    -> what of it) stay until they are received better; ``fresh`` are those of them whose trouble is
    known now. A robot's own cause counts its components instead. ``adopted``: it was a fault before
    the start, and what it counted then is not known. ``thinned``: a person has just taken out some.
    """

    scope: Scope
    name: str
    robot: RobotRecord | None = None
    active: Instant | None = None
    adopted: bool = False
    thinned: bool = False
    counted: dict[str, set[str]] = field(default_factory=dict)
    fresh: dict[str, set[str]] = field(default_factory=dict)
    problems: dict[str, Problem] = field(default_factory=dict)  # by severity; "" where there is one

    @property
    def row(self) -> RowKey:
        """The row that it is written to."""
        return "cause", (self.scope.value, self.name)

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
        return not (self.counted or self.problems or self.active)


@dataclass(slots=True, eq=False, repr=False)
class CapabilityRecord(Subject):
    """Something that a robot can do, or (``robot`` None) the fleet, whose parts are robots.

    ``wanted`` is None until it is configured. ``state`` is how good it is, ``due`` (monotonic)
    when its parts have been so for their confirm_after. ``parts`` keep it from being OK, and
    ``worst`` is how bad it is, both as when last known. ``adopted``: it was a fault before the
    start, and its parts then are not known.
    """

    robot: RobotRecord | None
    name: str
    wanted: WantedCapability | None = None
    state: CapabilityState = CapabilityState.UNKNOWN
    worst: CapabilityState = CapabilityState.UNKNOWN
    due: float = -inf
    adopted: bool = False
    parts: dict[PartName, Bad] = field(default_factory=dict)
    problems: dict[State, Problem] = field(default_factory=dict)
    row: RowKey = field(init=False)

    def __post_init__(self) -> None:
        self.row = ("capability", ("" if self.robot is None else self.robot.name, self.name))

    @property
    def view(self) -> CapabilityView:
        """What is shown of it."""
        parts = {part: bad.state for part, bad in self.parts.items()} if self.problems else {}
        return CapabilityView(self.state, parts)

    @property
    def is_fault(self) -> bool:
        """Whether it is confirmed that it is in trouble."""
        return any(each.fault is not None and each.lasts for each in self.problems.values())


@dataclass(slots=True, eq=False, repr=False)
class Ended:
    """What ended a fault, kept until ``until`` (monotonic): for ever while nobody has read it."""

    end: End
    until: float = inf
