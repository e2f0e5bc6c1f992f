"""A small fleet that has everything that explains or plans a fault, and what was received of it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from math import inf, isinf, isnan, nan

from ros_diagnostics_exporter.config.faults import Falling
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    FaultSettings,
    Threshold,
    WarningHours,
)
from ros_diagnostics_exporter.faults.model import (
    CapabilityState,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    PartName,
    RobotSettings,
    State,
)
from ros_diagnostics_exporter.faults.needs import AtLeast, WantedCapability
from ros_diagnostics_exporter.model import Level
from support.fault_histories import BATTERY, ERROR, OK, STALE, WARN, Event

LEVELS = (OK, OK, WARN, ERROR, ERROR, STALE)
ROBOTS = ("r1", "r2", "r3", "r4")
UPLINK = "ap"
CONFIRM = 10.0
BOOT_GRACE = {"r3": 30.0, "r4": 60.0}  # of two robots; the others have none
# A problem that nothing explains is a fault this long after it is due: see `suppression.latest`,
# and once more for what an explanation that was never a fault leaves behind it.
PATIENCE = 2 * 60.0 + CONFIRM
LONG = 40  # seconds after which what many have in common is a fault
WAITS = 60.0  # seconds for which what is no fault yet may suppress what is due
REPAIRED = 3600.0  # seconds after all was repaired in which each fault ends
COMPONENTS = {
    "board": ComponentSettings(CONFIRM, planned_stale=True),
    "lidar upper": ComponentSettings(CONFIRM, depends_on=frozenset({("", "board")})),
    "lidar lower": ComponentSettings(CONFIRM),
    "motor": ComponentSettings(CONFIRM),
    "camera": ComponentSettings(CONFIRM, depends_on=frozenset({("", "motor"), ("", "board")})),
    "strict": ComponentSettings(CONFIRM, stale_is_critical=True),
}
MOVED = "camera"  # that may be in another group: nothing rests on it
# What queries measure of a robot, once it was measured for the first time.
HOSTS = dict.fromkeys(("disk", "memory", "cpu"), ComponentSettings(CONFIRM, measured=True))
SETTINGS = {**COMPONENTS, **HOSTS}
CHARGE = ("battery", "charge")
CHARGED = PartName(component=CHARGE[0], key=CHARGE[1])
# Of a charge: the first is never exceeded, the last may fall away.
THRESHOLDS = (Threshold("high", "critical", 1000.0), *BATTERY)
NUMBERS = (50.0, 20.2, 15.0, 10.1, 9.0, nan, None)  # of which None is no number, or no key
BACK = 1.02  # times the threshold: from there on a value that was below it is no longer
BATTERIES = ComponentSettings(CONFIRM, depends_on=frozenset({("", "board")}))
# From which number to which a charge falls: of the last it is not known that it gets too low.
FALLS = ((50.0, 20.2), (50.0, 15.0), (20.2, 10.1), (25.0, 23.0))
LEAST_FALL = 4.0  # of a charge after which it is sure to be too low soon
STEPS = 15  # between the samples of a trend
LONGEST_STEP = 60.0  # seconds between two samples
STEEPEST = 6  # times a fall: by no line through the samples is a value lower within ``ahead``
# Two capabilities rest on one part, and of one what is degraded is as good as what is OK.
CAPABILITIES = (
    WantedCapability(
        "view",
        AtLeast(1, (PartName(component="lidar upper"), PartName(component="lidar lower"))),
    ),
    WantedCapability("driving", AtLeast(None, (PartName(component="motor"), CHARGED))),
    WantedCapability("docking", AtLeast(None, (PartName(component="motor"),))),
    WantedCapability(
        "signal", AtLeast(None, (PartName(component="strict"),), degraded=CapabilityState.OK)
    ),
)
PARTS = {
    "view": {"lidar upper", "lidar lower"},
    "driving": {"motor"},
    "docking": {"motor"},
    "signal": {"strict"},
}
DRIVING = 2  # of the robots have to be able to drive
OF_FLEET = WantedCapability(
    "transport", AtLeast(DRIVING, tuple(PartName(robot=each, check="driving") for each in ROBOTS))
)
FLAP_INTERVAL = 15.0  # seconds without a change that count as one state of 21
FLAP_TIME = 20 * FLAP_INTERVAL  # seconds after which a change no longer counts
FEWEST, ENOUGH = 7, 12  # changes of 20 that may be flapping, and that are
FEWEST_TO_GO_ON = 4  # changes of 20 with which what flaps may go on
MAY_FLAP = 4  # changes in two intervals: too many for one that is at rest
RECENT = 60.0  # seconds in which so many are flapping, whatever was before
MINUTES = tuple((0, 827 + 4 * each, 829 + 4 * each) for each in range(20))
FLEETS = (
    FaultSettings(
        site=CauseSettings(2, 0.5), common=CauseSettings(3, 0.5), many=CauseSettings(4, 0.5)
    ),
    FaultSettings(
        site=CauseSettings(3, 0.7),
        common=CauseSettings(2, 0.5),
        many=CauseSettings(3, 0.3),
        falling=Falling(60.0, 120.0),
        warning_hours=WarningHours(MINUTES, "UTC"),
    ),
)
COMMON_NEEDS = SITE_NEEDS = 3  # robots at most, by any of these settings
# The last level of a component whose fault begins: what does not report any more is still a WARNING
# or an ERROR.
CAUSES = {
    State.WARNING: (WARN, STALE),
    State.STALE: (STALE,),
    State.CRITICAL: (ERROR, STALE),
}


@dataclass
class Truth:
    """What was last received of one component."""

    level: Level = OK
    since: float = 0.0  # of this level, the robot received, and no downtime began or ended
    before: float = 0.0  # for how long it had been so when a downtime of its robot began
    wrong: float = 0.0  # since then it was never OK; silence and restarts say nothing of it
    fresh: bool = False
    boots: float = 0.0  # until then it begins no fault: its robot boots, and it was never OK since
    group: str = ""
    told: Level = OK  # out of downtimes
    changes: list[float] = field(default_factory=list)  # when `told` changed, at most
    sure: list[float] = field(default_factory=list)  # ... for certain
    # The same, as old as they are; those of what is intermittent are of its robot's last return.
    dated: list[float] = field(default_factory=list)
    brief: list[float] = field(default_factory=list)  # ... at most, without a fault that says it


@dataclass
class Charge:
    """What was last received of a robot's charge."""

    number: float | None = 50.0
    since: float = 0.0  # of this number, the robot received, and no downtime began or ended
    thresholds: tuple[Threshold, ...] = THRESHOLDS
    counts: bool = True  # no condition of fleet.yml keeps it from being a fault
    # severity -> since when it was below its threshold, and never beyond its hysteresis
    below: dict[str, float] = field(default_factory=dict)
    boots: float = 0.0
    highest: float = 50.0
    taken: list[tuple[float, float]] = field(default_factory=lambda: [(-inf, 50.0)])  # when what
    # When its trend has its first sample, at the earliest; -inf: another process judged it last.
    first: float = inf
    first_before: float = -inf  # ... by the settings before
    timer: float = -inf  # until when a trend that there is no more may take a sample

    @property
    def known(self) -> bool:
        """Whether it is a number."""
        return self.number is not None and not isnan(self.number)

    @property
    def may_fall(self) -> bool:
        """Whether it has a threshold to fall to."""
        return len(self.thresholds) == len(THRESHOLDS)

    def low(self) -> Iterator[tuple[str, float]]:
        """Its low thresholds, each with its severity."""
        return ((each.severity, each.value) for each in self.thresholds if each.bound == "low")

    def take(self, number: float | None, at: float) -> None:
        """Note what is received."""
        self.number, self.since = number, at
        if number is None or isnan(number):
            return
        self.highest = max(self.highest, number)
        self.taken.append((at, number))
        for severity, low in self.low():
            if number >= low * (BACK if severity in self.below else 1.0):
                self.below.pop(severity, None)
            elif self.counts:  # else nothing is known of it, and what was below it still is
                self.below.setdefault(severity, at)

    def since_then(self, at: float) -> list[float]:
        """The numbers that it had from then on."""
        before = [number for when, number in self.taken if when <= at]
        return [before[-1], *(number for when, number in self.taken if when > at)]

    def follow(self, at: float, step: float) -> None:
        """Note that its trend goes on, or begins: it is sampled at each ``step``."""
        if self.number is None or not self.may_fall:
            self.drop(at)
        elif isinf(self.first):
            self.first = at if at <= self.timer else at + step

    def drop(self, at: float) -> None:
        """Note that its samples are no more."""
        if self.first < inf:
            self.first, self.timer = inf, at + LONGEST_STEP

    def forget_times(self, at: float, set_at: float) -> None:
        """What was noted before the clock was set may count as earlier, or from now on."""
        self.since, self.boots = at, 0.0
        for severity, since in self.below.items():
            if since <= set_at:
                self.below[severity] = -inf


def configured(robot: str) -> Event:
    """A robot, or the uplink of all, by fleet.yml."""
    labels = {"site": "hall"} if robot == UPLINK else {"site": "hall", "uplink": UPLINK}
    how = RobotSettings(labels, CONFIRM, boot_grace=BOOT_GRACE.get(robot, 0.0))
    return lambda faults, now: faults.configure_robot(robot, how, now, declared=True)


def able(robot: str | None) -> Event:
    """What a robot, or (None) the fleet, can do."""
    wanted = [OF_FLEET] if robot is None else CAPABILITIES
    return lambda faults, now: faults.configure_capabilities(robot, wanted, now)


def report(name: str, known: Truth, level: Level, *, is_first: bool = False) -> ComponentReport:
    """One component of an array, or of a query."""
    return ComponentReport(ComponentName(known.group, name), level, SETTINGS[name], is_first)
