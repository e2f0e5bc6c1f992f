"""What goes in and out: identities, faults, reports of what changed, reasons of suppression."""

from __future__ import annotations

import json
from collections.abc import Mapping
from collections.abc import Set as AbstractSet
from dataclasses import dataclass, field
from enum import Enum, IntEnum
from functools import cached_property
from hashlib import sha256
from types import MappingProxyType
from typing import Any, Literal, NamedTuple

from ros_diagnostics_exporter.config.fleet import Fleet, Threshold
from ros_diagnostics_exporter.model import Instant, Level


class Scope(str, Enum):
    """What a fault is about."""

    COMPONENT = "component"
    VALUE = "value"
    CHECK = "check"
    ROBOT = "robot"
    FLAPPING = "flapping"  # of a component, or intermittent
    SITE = "site"
    COMMON = "common"
    CAPABILITY = "capability"  # of a robot or of the fleet; its name is the identity's ``check``
    EXPORTER = "exporter"  # the exporter itself; ``component`` is which part of it


class State(str, Enum):
    """What is wrong with it."""

    WARNING = "warning"
    STALE = "stale"
    CRITICAL = "critical"
    FALLING = "falling"
    SILENT = "silent"
    PENDING = "pending"
    FLAPPING = "flapping"
    INTERMITTENT = "intermittent"
    MANY = "many"
    CLOCK = "clock"
    NO_RESERVE = "no_reserve"
    DEGRADED = "degraded"
    LOST = "lost"


class Identity(NamedTuple):
    """Which fault it is, the same for every exporter that judges it; what does not apply is "".

    ``severity`` is that of many components, whose state does not say it.
    """

    scope: Scope
    state: State
    site: str = ""
    robot: str = ""
    group: str = ""
    component: str = ""
    check: str = ""
    key: str = ""
    bound: str = ""
    severity: str = ""


_CRITICAL = {State.CRITICAL, State.SILENT, State.LOST}


def severity_of(identity: Identity) -> Literal["critical", "warning"]:
    """The severity of a fault, which follows from its identity."""
    if identity.state is State.MANY:
        return "critical" if identity.severity == "critical" else "warning"
    return "critical" if identity.state in _CRITICAL else "warning"


def exporter_of(fleet: Fleet, identity: Identity) -> str:
    """Whose fault it is, by the name of exporters: one's own, or what all shards judge alike."""
    is_own = bool(identity.robot) or identity.scope is Scope.EXPORTER
    return fleet.exporter if is_own else fleet.together


def fault_id(fleet: Fleet, identity: Identity) -> str:
    """What names a fault in series, alerts and links: 12 hexadecimal digits.

    The same from all exporters that judge a robot, from both halves of a pair, and each time it
    begins. A site or a common cause counts the robots of one exporter, or of all shards, whose name
    is part of it.
    """
    named = (fleet.name, "" if identity.robot else exporter_of(fleet, identity), *identity)
    return sha256(json.dumps(named).encode()).hexdigest()[:12]


def as_texts(identity: Identity, labels: Mapping[str, str]) -> dict[str, str]:
    """An identity with its severity as metrics, events and the API have it, by name.

    ``labels`` are the robot's own labels: a fault of a robot is of the site that they name, if any.
    """
    return {
        **identity._asdict(),
        "scope": identity.scope.value,
        "state": identity.state.value,
        "severity": severity_of(identity),
        "site": identity.site or labels.get("site", ""),
    }


def fault_of(fleet: Fleet, texts: Mapping[str, Any]) -> str:
    """The id of the fault of which these are the texts, see `as_texts`; "" may be left out.

    Raises:
        LookupError, ValueError: They are of no fault, or of one of another version.
    """
    scope, state = Scope(texts["scope"]), State(texts["state"])
    names = ("robot", "group", "component", "check", "key", "bound")
    parts = {name: texts.get(name, "") for name in names}
    site = texts.get("site", "") if scope is Scope.SITE else ""
    severity = texts["severity"] if state is State.MANY else ""
    return fault_id(fleet, Identity(scope, state, **parts, site=site, severity=severity))


class Count(NamedTuple):
    """Of how many robots a larger fault is a share, how many it counts, and how many of them fresh.

    ``fresh``: in trouble now.
    """

    present: int = 0
    counted: int = 0
    fresh: int = 0


Counts = Mapping[tuple[Scope, str], Count]  # by site or component; COMMON and "": all robots


class Others(NamedTuple):
    """What the other exporters of a fleet count.

    ``known`` is the share of all exporters of which it is known, this one among them. Below 1 no
    larger fault ends. ``twice`` are the robots that this exporter has, too, and another counts.
    """

    counts: Counts = MappingProxyType({})
    known: float = 1.0
    twice: AbstractSet[str] = frozenset()


NO_OTHERS = Others()


@dataclass(frozen=True)
class Fault:
    """A confirmed problem.

    ``since`` is when the trouble began, ``confirmed`` when the fault did (both Unix time). The
    trouble of a component that is WARNING began when it left OK, the same time as in
    `component_problem_since_timestamp_seconds`; that of one that is STALE or CRITICAL when it
    turned so; of a silent robot with its last message; of many, a site or a common cause when there
    were enough, and of many that are CRITICAL when they were.
    ``labels`` are the robot's own at that moment, ``evidence`` lines that the caller wrote about
    it, ``capabilities`` what the robot can no longer do, and what it still can; ``details`` is the
    evidence as fields, JSON.
    """

    identity: Identity
    since: float
    confirmed: float
    labels: Mapping[str, str]
    evidence: str = ""
    capabilities: str = ""
    details: Mapping[str, Any] = field(default_factory=dict)

    @property
    def message(self) -> str:
        """The first line of its evidence: of a component's level what that says."""
        return self.evidence.split(";\n")[0]


class Change(NamedTuple):
    """A fault began or ended, ``at`` Unix time; "removed" by a person, "recovered" by itself."""

    what: Literal["began", "recovered", "removed"]
    fault: Fault
    at: float


class End(NamedTuple):
    """What ended a fault, or (``fault`` None) all that anybody may still hold of a robot.

    ``at`` is Unix time, and never before the fault began, whatever the wall clock was set to.
    ``message`` is what was received last, "" where a person ended it.
    """

    fault: Fault | None
    robot: str
    reason: Literal["recovered", "removed"]
    at: float
    message: str = ""


class ComponentName(NamedTuple):
    """Which component of which robot."""

    group: str
    component: str


class Followed(NamedTuple):
    """What is kept of a component in time: when its trouble began (Unix time), how it flaps."""

    since: float | None
    flap_ratio: float  # 0..1


class ComponentReport(NamedTuple):
    """One component's level that counts, and how it is judged.

    ``is_first``: it was not received since its robot came back.
    """

    name: ComponentName
    level: Level
    settings: ComponentSettings
    is_first: bool = False


class OwnReport(NamedTuple):
    """One part of the exporter: WARN or ERROR where it is wrong, STALE where nothing is known.

    It is a fault after ``confirm_after`` seconds; ``message`` says what is wrong.
    """

    part: str
    level: Level
    message: str = ""
    confirm_after: float = 60.0


class Verdict(IntEnum):
    """What is known of a problem now."""

    HEALTHY = 0  # a fresh lower level
    NO_DATA = 1  # nothing fresh: neither begins nor ends
    ABSENT = 2  # in trouble, for want of data
    FAILING = 3  # in trouble, freshly reported


class Effect(NamedTuple):
    """What a problem does to each mechanism; see `EffectiveVerdict`.

    ``counts`` towards a larger fault; ``explains`` others: never, only once it is a fault, or as
    soon as it can become one; ``begins`` and ``ends``: whether it may, by itself.
    """

    counts: bool
    explains: Literal["never", "as a fault", "as a problem"]
    begins: bool
    ends: bool


class EffectiveVerdict(str, Enum):
    """The verdict on a problem together with what people planned."""

    FAILING = "failing"  # fresh, and nobody planned it
    IN_DOWNTIME = "in_downtime"
    PLANNED_STALE = "planned_stale"
    NO_DATA = "no_data"  # a silent robot, a lost link, just restarted
    HEALTHY = "healthy"


# Every mechanism asks this table, so that no verdict means one thing here and another there. What a
# condition of fleet.yml suppresses is reported as HEALTHY, or as planned STALE if it is not known.
EFFECTS: Mapping[EffectiveVerdict, Effect] = MappingProxyType(
    {
        EffectiveVerdict.FAILING: Effect(
            counts=True, explains="as a problem", begins=True, ends=False
        ),
        EffectiveVerdict.IN_DOWNTIME: Effect(
            counts=False, explains="never", begins=False, ends=False
        ),
        EffectiveVerdict.PLANNED_STALE: Effect(
            counts=False, explains="never", begins=False, ends=False
        ),
        EffectiveVerdict.NO_DATA: Effect(
            counts=False, explains="as a fault", begins=False, ends=False
        ),
        EffectiveVerdict.HEALTHY: Effect(counts=False, explains="never", begins=False, ends=True),
    }
)


class CapabilityState(IntEnum):
    """Whether a robot can do something, the better first."""

    OK = 0
    NO_RESERVE = 1  # it can, and no further part may fail
    DEGRADED = 2  # it can, by a part that is in WARNING
    UNKNOWN = 3  # that rests on what is not received
    LOST = 4


CAPABILITY_STATES = (  # as they are shown: what is not known last
    *(CapabilityState.OK, CapabilityState.NO_RESERVE, CapabilityState.DEGRADED),
    *(CapabilityState.LOST, CapabilityState.UNKNOWN),
)


class PartName(NamedTuple):
    """What an expression rests on: a component, one value of it, or a check.

    Of a fleet's: a ``robot``, and in ``check`` which of its capabilities.
    """

    group: str = ""
    component: str = ""
    key: str = ""
    check: str = ""
    robot: str = ""


class CapabilityView(NamedTuple):
    """A capability as it is now, and the parts that keep it from being OK."""

    state: CapabilityState
    parts: Mapping[PartName, CapabilityState]


class ValueReport(NamedTuple):
    """One value that has thresholds, or had; ``number`` is None while nothing fresh is known.

    ``most`` is the worst verdict that it may have, by the conditions of fleet.yml; ``is_first``:
    its component was not received since its robot came back.
    """

    key: str
    number: float | None
    thresholds: tuple[Threshold, ...]
    most: Verdict = Verdict.FAILING
    is_first: bool = False


class Reason(str, Enum):
    """Why a problem is suppressed."""

    NO_DATA = "no_data"
    ROBOT_SILENT = "robot_silent"
    UNREACHABLE = "unreachable"  # its uplink or its DDS domain fails
    MAINTENANCE = "maintenance"
    RESTART = "restart"  # within restart_grace
    RETURNED = "returned"  # the robot is back for less than confirm_after
    FLAPPING = "flapping"
    ROBOT_FLAPPING = "robot_flapping"
    SITE = "site"
    COMMON = "common"
    MANY = "many"
    DEPENDS_ON = "depends_on"  # a component that it depends on, by fleet.yml, fails
    CAPABILITY = "capability"  # one that is in trouble because of it
    FAULT = "fault"  # a worse one of the same is confirmed
    CONDITION = "condition"  # fleet.yml's `when` or `unless`
    HOURS = "hours"  # outside of the hours in which warnings begin


class ProblemView(NamedTuple):
    """A problem as pages and the API show it, soft (``fault`` is None) or hard.

    ``since`` is Unix time, ``due`` when it may begin at the earliest; ``suppressed`` says why it
    does not begin then, or why a fault that is ``healthy`` again goes on: ``by`` another problem,
    or ``because`` of a condition. ``text`` is what is wrong with a part of the exporter,
    of a soft problem.
    """

    identity: Identity
    since: float
    due: float
    fault: Fault | None
    suppressed: Reason | None
    healthy: bool
    because: str = ""
    by: Identity | None = None
    text: str = ""


DOWNTIMES = "downtimes"  # the kind of the one row of those that people planned
MISSIONS = "missions"  # the kind of the rows of the goals of robots' actions
LEARNED = "graph"  # the kind of the rows of what was learned of robots' nodes and topics
OTHERS = (DOWNTIMES, MISSIONS, LEARNED)  # that are no state of the engine


class Row(NamedTuple):
    """One row of what outlives the process; ``fields`` is None where the row is to be deleted.

    ``kind`` and ``key`` identify it. Fields are JSON values, their times Unix time.
    """

    kind: str
    key: tuple[str, ...]
    fields: dict[str, object] | None


def at_mono(mono: float, now: Instant) -> Instant:
    """The Instant at a reading of the monotonic clock, by the difference of both clocks ``now``."""
    return Instant(mono, now.wall + (mono - now.mono))


# -- settings ------------------------------------------------------------------------------------


@dataclass(frozen=True)
class RobotSettings:
    """What holds for one robot.

    ``presence_interval`` lies between two of the 21 states in which a robot's coming and going is
    counted, ``flap_interval`` between two of a component. For ``boot_grace`` seconds after it came
    back, what was wrong from its first message on begins no fault.
    """

    labels: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    confirm_after: float = 10.0
    flap_interval: float = 15.0
    presence_interval: float = 60.0
    boot_grace: float = 0.0

    @cached_property  # both are asked many times for each change, and labels stay as they are
    def site(self) -> str:
        """The site whose robots may fall silent together; "" is one too."""
        return self.labels.get("site", "")

    @cached_property
    def uplink(self) -> str:
        """The robot-like entry through which it is reached; "" where there is none."""
        return self.labels.get("uplink", "")


@dataclass(frozen=True)
class ComponentSettings:
    """What holds for one component, the robot's and the fleet's defaults applied.

    ``measured``: by a query rather than by the robot, so also while the robot is not reached.
    ``uplink``: its failure makes the robots unreachable that name its robot as their uplink.
    ``depends_on``: the components of its robot, (group, name) each, whose failure explains its own.
    """

    confirm_after: float = 10.0
    planned_stale: bool = False
    stale_is_critical: bool = False
    measured: bool = False
    uplink: bool = False
    depends_on: frozenset[tuple[str, str]] = frozenset()
