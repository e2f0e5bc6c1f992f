"""A small fleet that uses every feature at once, and what holds of it whatever happens.

The features meet at random: capabilities, dependencies, planned STALE, uplinks, sites, common
causes, many components, downtimes of robots and of components, hours of warnings, silence, boots,
flapping, values with thresholds, the exporter's own parts, a wall clock that is set, restarts at
any moment and other settings. What was delivered is noted in `Truth` and `Charge`, which the checks
know instead of the engine's state. Messages and clocks of robots are in `network`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import inf, isnan, nan
from random import Random
from typing import Any

from ros_diagnostics_exporter.config.faults import Falling
from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings, WarningHours
from ros_diagnostics_exporter.events import Event as Observed
from ros_diagnostics_exporter.faults.model import (
    Change,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    Fault,
    Identity,
    PartName,
    ProblemView,
    Reason,
    RobotSettings,
    Scope,
    State,
    ValueReport,
    as_texts,
    severity_of,
)
from ros_diagnostics_exporter.faults.needs import AtLeast, WantedCapability
from ros_diagnostics_exporter.model import Level
from simulation.own import OwnParts
from simulation.story import OWN_PARTS
from support.fault_histories import (
    BATTERY,
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    Event,
    Player,
    back,
    silent,
)

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
VIEW = WantedCapability(
    "view", AtLeast(1, (PartName(component="lidar upper"), PartName(component="lidar lower")))
)
SAY_SILENCE = (State.SILENT, State.CRITICAL)  # of a site, and of an uplink
PARTS = {"view": {"lidar upper", "lidar lower"}, "driving": {"motor"}}
CHARGE = ("battery", "charge")
CHARGED = PartName(component=CHARGE[0], key=CHARGE[1])
DRIVING = WantedCapability("driving", AtLeast(None, (PartName(component="motor"), CHARGED)))
LOW = {each.severity: each.value for each in BATTERY}
NUMBERS = (50.0, 20.2, 15.0, 10.1, 9.0, nan, None)  # of which None is no number, or no key
BACK = 1.02  # times the threshold: from there on a value that was below it is no longer
BATTERIES = ComponentSettings(CONFIRM, depends_on=frozenset({("", "board")}))
FLAP_INTERVAL = 15.0  # seconds without a change that count as one state of 21
FLAP_TIME = 20 * FLAP_INTERVAL  # seconds after which a change no longer counts
FEWEST, ENOUGH = 7, 12  # changes of 20 that may be flapping, and that are
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
# The last level of a component whose fault begins: what does not report any more is still a WARNING
# or an ERROR.
CAUSES = {
    State.WARNING: (WARN, STALE),
    State.STALE: (STALE,),
    State.CRITICAL: (ERROR, STALE),
}
BY_A_PERSON = {Reason.MAINTENANCE, Reason.HOURS, Reason.CONDITION}


# Seconds before it, what happens with its arguments, whether a new process goes on from the rows.
Step = tuple[int, tuple[Any, ...], bool]


@dataclass
class Truth:
    """What was last received of one component."""

    level: Level = OK
    since: float = 0.0  # of this level, the robot received, and no downtime began or ended
    wrong: float = 0.0  # since then it was never OK; silence and restarts say nothing of it
    fresh: bool = False
    boots: float = 0.0  # until then it begins no fault: its robot boots, and it was never OK since
    told: Level = OK  # out of downtimes
    changes: list[float] = field(default_factory=list)  # when `told` changed, at most
    sure: list[float] = field(default_factory=list)  # ... for certain


@dataclass
class Charge:
    """What was last received of a robot's charge."""

    number: float | None = 50.0
    since: float = 0.0  # of this number, the robot received, and no downtime began or ended
    # severity -> since when it was below its threshold, and never beyond its hysteresis
    below: dict[str, float] = field(default_factory=dict)
    boots: float = 0.0
    highest: float = 50.0  # number since the last restart of the trend

    @property
    def known(self) -> bool:
        """Whether it is a number."""
        return self.number is not None and not isnan(self.number)

    def take(self, number: float | None, at: float) -> None:
        """Note what is received."""
        self.number, self.since = number, at
        if number is None or isnan(number):
            return
        self.highest = max(self.highest, number)
        for severity, low in LOW.items():
            if number >= low * (BACK if severity in self.below else 1.0):
                self.below.pop(severity, None)
            else:
                self.below.setdefault(severity, at)


@dataclass
class World:
    """An engine, and what was delivered to it."""

    player: Player = field(default_factory=lambda: Player(FLEETS[0]))
    truth: dict[tuple[str, str], Truth] = field(default_factory=dict)
    up: set[str] = field(default_factory=set)
    second: float = 0.0
    began: list[Identity] = field(default_factory=list)
    lasting: set[Identity] = field(default_factory=set)  # began and not ended
    planned: set[str] = field(default_factory=set)  # robots in a downtime
    planned_parts: dict[str, frozenset[str]] = field(default_factory=dict)  # their components
    grace: float = 0.0  # until then what is absent begins no fault
    booted: dict[str, float] = field(default_factory=dict)  # until when a robot boots
    received: set[tuple[str, str]] = field(default_factory=set)  # since its robot came back
    charges: dict[str, Charge] = field(default_factory=lambda: {each: Charge() for each in ROBOTS})
    silent_since: dict[str, float] = field(default_factory=dict)
    own: OwnParts = field(default_factory=OwnParts)
    clock_set_at: float = -inf  # when the wall clock was last set
    over_at: dict[Identity, float] = field(default_factory=dict)  # when a fault last ended
    planned_at: dict[str, float] = field(default_factory=dict)  # when a downtime began or ended
    forgotten: tuple[str, str] | None = None  # a component that a person takes out now

    def engine(self, *happened: Event) -> None:
        """Let time pass, then these; nothing begins or ends that may not."""
        self._changed(self.player.go(self.second, *happened))

    def _changed(self, changes: Iterable[Change]) -> None:
        changes = list(changes)
        over = {fault.identity for what, fault, _at in changes if what != "began"}
        for what, fault, wall in changes:
            at = wall - WALL - self.player.clock_set
            if fault.identity.scope is Scope.EXPORTER:
                self._own_changed(what, fault, at)
            elif what == "began":
                self._began(fault.identity, at)
                self._assert_unexplained(fault.identity, at, over)
            else:
                self._ended(fault.identity, recovered=what == "recovered")
                self.over_at[fault.identity] = at

    def _began(self, identity: Identity, at: float) -> None:
        """A fault of something that was due and that no downtime covers; and of that just one."""
        self.began.append(identity)
        assert identity not in self.lasting, f"began twice: {identity}"
        self.lasting.add(identity)
        assert not self._boots(identity, at), f"began while its robot boots: {identity}"
        assert not self._is_planned(identity), f"began in a downtime: {identity}"
        is_absent = identity.state in (State.SILENT, State.STALE) and self.clock_set_at == -inf
        assert not is_absent or at >= self.grace - 0.01, f"began after a restart: {identity}"
        if identity.scope is Scope.COMPONENT:
            known = self.truth[identity.robot, identity.component]
            assert known.fresh, f"began while its robot is silent: {identity}"
            assert known.level in CAUSES[identity.state], f"began of {known.level}: {identity}"
            is_due = at >= known.wrong + CONFIRM - 0.01
            assert is_due, f"began before it was due: {identity}"
        if identity.scope is Scope.ROBOT and identity.state is State.SILENT:
            assert identity.robot not in self.up, f"began of a robot that is up: {identity}"
        if identity.scope is Scope.VALUE:
            self._value_began(identity, at)
        if identity.scope is Scope.FLAPPING:
            known = self.truth[identity.robot, identity.component]
            fewest, within = FEWEST, FLAP_TIME
            if identity.state is State.INTERMITTENT:
                intermittent = self.player.settings.intermittent
                fewest, within = intermittent.changes, intermittent.within
            lately = [each for each in known.changes if each > at - within - FLAP_INTERVAL]
            assert len(lately) >= fewest, f"began with {len(lately)} changes: {identity}"

    def _assert_unexplained(self, identity: Identity, at: float, over: set[Identity]) -> None:
        """No larger fault says it already, or did until just now."""
        larger = {each for each in self.lasting if each is not identity and _says(each, identity)}
        assert larger <= over, f"began although {larger - over} says it: {identity}"
        if self.clock_set_at > -inf or identity.robot in self.planned:
            return
        for each, ended in self.over_at.items():
            planned_at = self.planned_at.get(identity.robot, -inf)
            is_just_over = ended <= at < ended + CONFIRM - 0.01 and planned_at < ended
            if identity.scope is Scope.FLAPPING:  # what changed since then, nothing explains
                changes = self.truth[identity.robot, identity.component].changes
                is_just_over &= sum(change >= ended for change in changes) < FEWEST
            is_cause = each.scope in (Scope.SITE, Scope.COMMON)
            assert not (is_cause and is_just_over and _says(each, identity)), (each, identity)

    def _value_began(self, identity: Identity, at: float) -> None:
        charge = self.charges[identity.robot]
        assert identity.robot in self.up, f"began while its robot is silent: {identity}"
        assert charge.known, f"began of what is no number: {identity}"
        if identity.state is State.FALLING:
            assert charge.number != charge.highest, f"began of what did not fall: {identity}"
            assert "critical" not in charge.below, f"began of what is too low: {identity}"
            return
        since = charge.below.get(identity.state.value, inf)
        assert at >= since + CONFIRM - 0.01, f"began before it was due: {identity}"

    def _own_changed(self, what: str, fault: Fault, at: float) -> None:
        """A fault of a part of the exporter, of which it knows itself how it is."""
        kind = "fault_began" if what == "began" else "fault_ended"
        texts: dict[str, Any] = as_texts(fault.identity, {})
        event = Observed(at, kind, **texts, reason=what)
        assert (fault.identity in self.lasting) is (what != "began"), f"{what} twice: {event}"
        (self.lasting.add if what == "began" else self.lasting.remove)(fault.identity)
        # One that was restored counts by a wall clock that was set meanwhile.
        found = self.own.ended(event) if what != "began" else self.own.began(event, at)
        wrong = [] if what == "began" and self.clock_set_at > -inf else [*found]
        assert not wrong, wrong

    def _ended(self, identity: Identity, *, recovered: bool) -> None:
        """A fault that lasted; nothing that is broken, silent or in a downtime recovers."""
        assert identity in self.lasting, f"ended twice: {identity}"
        self.lasting.remove(identity)
        if not recovered:
            robot, component = self.forgotten or ("", "")
            # With it what counts it, of which too little is left.
            of_robot, of_all = identity.state is State.MANY, identity.scope is Scope.COMMON
            about = "" if of_all else robot, "" if of_robot else component
            is_taken_out = (identity.robot, identity.component) == about and bool(self.forgotten)
            assert is_taken_out, f"removed by nobody: {identity}"
            return
        assert not self._is_planned(identity), f"recovered in a downtime: {identity}"
        if identity.scope is Scope.COMPONENT:
            known = self.truth[identity.robot, identity.component]
            assert known.fresh, f"recovered while its robot is silent: {identity}"
            worse = {State.CRITICAL: (ERROR,), State.STALE: (ERROR, STALE)}
            broken = worse.get(identity.state, (ERROR, WARN, STALE))
            assert known.level not in broken, f"recovered with {known.level}: {identity}"
        if identity.scope is Scope.ROBOT and identity.state is State.SILENT:
            assert identity.robot in self.up, f"recovered of a silent robot: {identity}"
        if identity.scope is Scope.VALUE:
            charge = self.charges[identity.robot]
            assert identity.robot in self.up, f"recovered while its robot is silent: {identity}"
            assert charge.known, f"recovered with what is no number: {identity}"
            severity = "critical" if identity.state is State.FALLING else identity.state.value
            assert severity not in charge.below, f"recovered below its threshold: {identity}"
        if identity.scope is Scope.FLAPPING:
            self._came_to_rest(identity)

    def _came_to_rest(self, identity: Identity) -> None:
        known = self.truth[identity.robot, identity.component]
        if identity.state is State.INTERMITTENT:
            assert known.fresh, f"recovered while its robot is silent: {identity}"
            assert known.level is OK, f"recovered with {known.level}: {identity}"
            return
        lately = self._recent(known, self.silent_since.get(identity.robot, self.second))
        assert lately < FEWEST, f"recovered with {lately} changes in {RECENT} s: {identity}"

    def _recent(self, known: Truth, at: float) -> int:
        return sum(each > at - RECENT for each in known.sure)

    def _is_planned(self, identity: Identity) -> bool:
        """Whether what a fault is about is in a downtime."""
        parts = self.planned_parts.get(identity.robot, frozenset())
        return identity.robot in self.planned or identity.component in parts

    def _boots(self, identity: Identity, at: float) -> bool:
        """Whether what a fault is about has time, because its robot boots."""
        if identity.scope is Scope.VALUE:
            return self.charges[identity.robot].boots > at + 0.01
        if identity.scope is Scope.COMPONENT:
            parts = [self.truth[identity.robot, identity.component]]
        elif identity.state is State.MANY:
            parts = [each for (robot, _), each in self.truth.items() if robot == identity.robot]
        else:
            return False
        wrong = [each for each in parts if each.level is not OK]
        return bool(wrong) and all(each.boots > at + 0.01 for each in wrong)

    def array(self, robot: str, reported: Mapping[str, Level]) -> None:
        """An array of a robot, if it is received."""
        if robot not in self.up:
            return
        self.engine()  # what was due before it
        for name, level in reported.items():
            known = self.truth.setdefault((robot, name), Truth())
            if level != known.level or not known.fresh:
                known.since = self.second
            if known.level is OK:
                known.wrong = self.second
            is_first = (robot, name) not in self.received
            if level is OK:
                known.boots = 0.0
            elif is_first and robot in self.booted:
                known.boots = self.booted[robot]
            self._note_change(robot, name, level)
            known.level, known.fresh = level, True
        reports = [
            ComponentReport(
                ComponentName("", name), level, COMPONENTS[name], (robot, name) not in self.received
            )
            for name, level in reported.items()
        ]
        # One that is STALE is not received yet, as in `RobotReports`.
        self.received.update((robot, name) for name in reported if reported[name] is not STALE)
        total = len(COMPONENTS)
        self.engine(lambda faults, now: faults.components_changed(robot, reports, total, now))

    def _note_change(self, robot: str, name: str, level: Level) -> None:
        """Note a change of a component's level, which does not count in a downtime."""
        known = self.truth[robot, name]
        if (
            robot in self.planned
            or name in self.planned_parts.get(robot, ())
            or level == known.told
        ):
            return
        known.changes.append(self.second)
        if STALE not in (level, known.told):
            known.sure.append(self.second)
        known.told = level

    def charge(self, robot: str, number: float | None) -> None:
        """The charge of a robot's battery, if it is received."""
        if robot not in self.up:
            return
        self.engine()  # what was due before it
        self._report_charge(robot, number)

    def _report_charge(self, robot: str, number: float | None, *, is_first: bool = False) -> None:
        charge = self.charges[robot]
        charge.take(number, self.second)
        if charge.known and is_first and robot in self.booted:
            charge.boots = self.booted[robot]
        if not charge.below:
            charge.boots = 0.0
        report = ValueReport(CHARGE[1], number, BATTERY, is_first=is_first)
        name = ComponentName("", CHARGE[0])
        self.engine(
            lambda faults, now: faults.values_changed(robot, name, BATTERIES, [report], now)
        )

    def flaps(self, robot: str, name: str, times: int, period: int, to: Level) -> None:
        """A component changes so many times, each so many seconds after the other."""
        for number in range(times):
            self.array(robot, {name: OK if number % 2 else to})
            self.second += period
            self.engine()
            self.check()

    def flash(self, robot: str, name: str, seconds: int, then: Level) -> None:
        """A component is ERROR for some seconds."""
        self.array(robot, {name: ERROR})
        self.second += seconds
        self.array(robot, {name: then})

    def everywhere(self, name: str, level: Level) -> None:
        """The same component of all robots."""
        for robot in ROBOTS:
            self.array(robot, {name: level})

    def everywhere_but(self, robot: str, name: str) -> None:
        """The same component of all robots fails, and is repaired but for that of one."""
        self.everywhere(name, ERROR)
        self.second += LONG
        self.engine()
        for each in ROBOTS:
            if each != robot:
                self.array(each, {name: OK})

    def outage(self, robot: str) -> None:
        """All robots fall silent, and are back but for one."""
        self.silent(ROBOTS)
        self.second += LONG
        self.engine()
        for each in ROBOTS:
            if each != robot:
                self.back(each)

    def all_of(self, robot: str, level: Level) -> None:
        """All components of a robot."""
        self.array(robot, dict.fromkeys(COMPONENTS, level))

    def silent(self, chosen: Iterable[str]) -> None:
        """Robots fall silent."""
        for robot in sorted(chosen):
            if robot in self.up:
                self.silent_since[robot] = self.second
            self.up.discard(robot)
            for (owner, _name), known in self.truth.items():
                known.fresh = known.fresh and owner != robot
            self.engine(silent(robot))

    def back(self, robot: str, *, boots: bool = True) -> None:
        """A robot is received again, as it was."""
        if robot in self.up:
            return
        self.up.add(robot)
        self.received = {each for each in self.received if each[0] != robot}
        self.booted.pop(robot, None)
        if boots and robot in BOOT_GRACE:
            self.booted[robot] = self.second + BOOT_GRACE[robot]
        silence = self.second - self.silent_since.pop(robot, self.second)
        for (owner, _name), part in self.truth.items():
            if owner == robot:  # in which nothing comes to rest
                part.changes = [each + silence for each in part.changes]
                part.sure = [each + silence for each in part.sure]
        self.engine(back(robot))
        known = {name: self.truth.get((robot, name), Truth()).level for name in COMPONENTS}
        self.array(robot, known)
        self._report_charge(robot, self.charges[robot].number, is_first=boots)

    def uplink(self, level: Level) -> None:
        """What a query measures of the uplink of all robots."""
        how = ComponentSettings(CONFIRM, measured=True, uplink=True)
        known = self.truth.setdefault((UPLINK, "ping"), Truth())
        self._note_change(UPLINK, "ping", level)
        known.level, known.fresh = level, True
        known.since = self.second
        report = ComponentReport(ComponentName("", "ping"), level, how)
        self.engine(lambda faults, now: faults.components_changed(UPLINK, [report], 1, now))

    def downtime(self, robot: str, planned: bool) -> None:
        """The planned downtime of a robot begins or ends."""
        self.engine()  # what was due before it
        self._begin_anew(robot, COMPONENTS)
        (self.planned.add if planned else self.planned.discard)(robot)
        self.engine(lambda faults, now: faults.maintenance({robot: planned}, now))

    def downtime_of(self, robot: str, chosen: Iterable[str]) -> None:
        """Just these components of a robot are in a planned downtime."""
        self.engine()  # what was due before it
        self._begin_anew(robot, COMPONENTS)
        self.planned_parts[robot] = frozenset(chosen)
        self.engine(
            lambda faults, now: faults.components_in_maintenance(robot, frozenset(chosen), now)
        )

    def _begin_anew(self, robot: str, chosen: Iterable[str]) -> None:
        self.charges[robot].since = self.planned_at[robot] = self.second
        for name in chosen:
            known = self.truth.setdefault((robot, name), Truth())
            known.since = self.second

    def restart(self) -> None:
        """The exporter is started again, and receives all robots at once."""
        up = sorted(self.up)
        self.grace = self.second + self.player.settings.restart_grace
        # Before time passes, as of what was restored nothing is known yet.
        self._changed(self.player.faults.started(self.player.at(self.second), 0.0))
        self._report_own()
        self.up.clear()
        for (_robot, name), known in self.truth.items():
            known.fresh = False
            if known.level is STALE and name in COMPONENTS and COMPONENTS[name].planned_stale:
                known.boots = 0.0  # it is at rest: of such a one nothing is written
        self.engine(back(UPLINK))
        for robot in up:
            self.back(robot, boots=False)

    def reborn(self) -> None:
        """Another process goes on from the rows, with the same fleet.yml."""
        self.player.reborn(self.second)
        self._forget_times()
        # With the clock set, restart_grace of the rows is another; a start begins it anew.
        if self.own.is_in_trouble or self.clock_set_at > -inf:
            self.restart()
        self.configure()

    def _forget_times(self) -> None:
        """What was written before the wall clock was set may count as earlier, or from now on."""
        if self.clock_set_at == -inf:
            return
        for known in self.truth.values():
            known.since, known.boots, known.sure = self.second, 0.0, []
            if known.wrong <= self.clock_set_at:
                known.wrong = -inf
            known.changes = [self.second for _ in known.changes]
        for charge in self.charges.values():
            charge.since, charge.boots = self.second, 0.0
            for severity, since in charge.below.items():
                if since <= self.clock_set_at:
                    charge.below[severity] = -inf

    def clock(self, seconds: float) -> None:
        """The exporter's wall clock is set."""
        self.engine()  # what was due before it
        self.player.clock_set += seconds
        self.clock_set_at = self.second

    def forget(self, robot: str, name: str) -> None:
        """A person takes out a component, which is new if its robot reports it again."""
        self.engine()  # what was due before it
        self.forgotten = robot, name
        component = ComponentName("", name)
        self.engine(lambda faults, now: faults.forget_component(robot, component, now))
        left = {each for each in self.lasting if (each.robot, each.component) == self.forgotten}
        assert not left, f"was taken out, and lasts: {left}"
        self.forgotten = None
        self.received.discard((robot, name))
        former = self.truth.pop((robot, name), Truth())
        self.array(robot, {name: former.level})

    def own_part(self, part: str, level: Level | None) -> None:
        """A part of the exporter is so from now on; None: there is none any more."""
        self.engine()  # what was due before it
        self.own.set(part, level)
        self._report_own()

    def _report_own(self) -> None:
        reports = self.own.reports(self.second)
        self.engine(lambda faults, now: faults.own(reports, now))

    def configure(self) -> None:
        """The robots and what they can do, by fleet.yml."""
        self.engine(*map(_configured, (*ROBOTS, UPLINK)), *map(_able, ROBOTS))

    def fleet(self, how: FaultSettings) -> None:
        """Other settings of the whole fleet."""
        self.player.settings = how
        self.engine(lambda faults, now: faults.configure(how, now))

    def repair(self) -> None:
        """All is OK, received, and in no downtime."""
        self.uplink(OK)
        for part in OWN_PARTS:
            self.own_part(part, OK)
        for robot in ROBOTS:
            self.downtime(robot, planned=False)
            self.downtime_of(robot, ())
            self.back(robot)
            self.all_of(robot, OK)
            self.charge(robot, 80.0)

    # -- what holds --------------------------------------------------------------------------

    def check(self) -> None:
        """What is freshly bad, due and no fault has a lasting fault that explains it."""
        faults = self.player.faults
        lasting = {fault.identity for fault in faults.faults()}
        views = {view.identity: view for view in faults.problems(self.player.at(self.second))}
        for identity in self._bad():
            if identity in lasting:
                continue
            assert identity in views, identity
            view = views[identity]
            now = self.player.at(self.second)
            waits_since = faults._book.problems[identity].waits_since
            waits = waits_since is not None and now.mono <= waits_since + WAITS
            if view.suppressed in BY_A_PERSON or view.due > now.wall or waits:
                continue
            assert self._is_reported(view.by, views, lasting), view

    def _bad(self) -> Iterator[Identity]:
        """What is certainly wrong, and was for so long that it is a fault or explained."""
        latest = self.second - CONFIRM - PATIENCE
        for (robot, name), known in self.truth.items():
            if known.fresh and known.level == ERROR and known.since < latest:
                yield Identity(Scope.COMPONENT, State.CRITICAL, "", robot, "", name)
            if known.fresh and self._recent(known, self.second) >= ENOUGH:
                yield Identity(Scope.FLAPPING, State.FLAPPING, "", robot, "", name)
        gone = [max(self.silent_since[each], self.grace) for each in ROBOTS if each not in self.up]
        is_reached = self.truth.get((UPLINK, "ping"), Truth()).level is OK
        if len(gone) == len(ROBOTS) and is_reached and not self.planned and max(gone) < latest:
            yield Identity(Scope.SITE, State.SILENT, site="hall")
        for robot, charge in self.charges.items():
            for severity in charge.below if robot in self.up and charge.known else ():
                if charge.since < latest:
                    yield Identity(
                        *(Scope.VALUE, State(severity), "", robot, "", CHARGE[0]),
                        key=CHARGE[1],
                        bound="low",
                    )

    def _is_reported(
        self, by: Identity | None, views: Mapping[Identity, ProblemView], lasting: set[Identity]
    ) -> bool:
        """Whether what explains it is a fault, or is explained by one, or waits for hours."""
        if by is None:
            return False
        if by in lasting:
            return True
        view = views[by]
        # What is named need not be the only one that explains: where a fault explained it until
        # now, one that is not due yet may be named first.
        if view.suppressed in BY_A_PERSON or view.due > self.player.at(self.second).wall:
            return True
        return self._is_reported(view.by, views, lasting)


def _says(larger: Identity, identity: Identity) -> bool:
    """Whether a fault says that another one is there, while both last."""
    if larger.scope is Scope.SITE or larger.robot == UPLINK:
        is_presence = identity.state in (State.SILENT, State.FLAPPING)
        return identity.scope is Scope.ROBOT and is_presence and larger.state in SAY_SILENCE
    is_component = identity.scope in (Scope.COMPONENT, Scope.FLAPPING)
    if larger.scope is Scope.COMMON:
        return is_component and identity.component == larger.component
    if larger.robot != identity.robot or not is_component:
        return False
    if larger.state is State.MANY:
        return larger.severity == "critical" or severity_of(identity) == "warning"
    if larger.state is State.LOST:
        is_part = identity.component in PARTS[larger.check]
        return is_part and (identity.scope, identity.state) == (Scope.COMPONENT, State.CRITICAL)
    flaps = (larger.scope, larger.state) == (Scope.FLAPPING, State.FLAPPING)
    same = identity.component == larger.component
    return flaps and same and identity.scope is Scope.COMPONENT


def _configured(robot: str) -> Event:
    labels = {"site": "hall"} if robot == UPLINK else {"site": "hall", "uplink": UPLINK}
    how = RobotSettings(labels, CONFIRM, boot_grace=BOOT_GRACE.get(robot, 0.0))
    return lambda faults, now: faults.configure_robot(robot, how, now, declared=True)


def _able(robot: str) -> Event:
    return lambda faults, now: faults.configure_capabilities(robot, [VIEW, DRIVING], now)


def started() -> World:
    """The fleet, received and healthy."""
    world = World()
    world.configure()
    world.engine(back(UPLINK))
    for robot in ROBOTS:
        world.back(robot)
    return world


def play(history: Iterable[Step]) -> World:
    """Play a history and ten quiet minutes after it.

    Raises:
        AssertionError: something does not hold; it names the problem.
    """
    world = started()
    for seconds, (what, *how), reborn in history:
        world.second += seconds
        world.engine()
        world.check()
        if reborn:
            world.reborn()
        getattr(world, what)(*how)
    world.second += 600
    world.engine()
    world.check()
    world.reborn()  # every row that was written can be read
    world.engine()
    world.check()
    world.repair()
    world.second += REPAIRED
    world.engine()
    assert not world.lasting, f"never ends: {world.lasting}"
    return world


def random_history(seed: int, *, extra: bool = True) -> Iterator[Step]:
    """Up to sixty steps: the same for the same arguments.

    Without ``extra``: those of the features of the first round, which are the same in both.
    """
    random, more = Random(seed), Random(f"extra {seed}")
    for _ in range(random.randrange(4, 30)):
        yield _random_seconds(random), _random_event(random), random.random() < 0.3
        while extra and more.random() < 0.4:
            yield _random_seconds(more), _extra_event(more), more.random() < 0.2


def _random_seconds(random: Random) -> int:
    return random.choice((0, 1, 5, 12, 30, 60, 90))


def _extra_event(random: Random) -> tuple[Any, ...]:
    robot, name = random.choice(ROBOTS), random.choice(list(COMPONENTS))
    times, period = random.randrange(2, 20), random.choice((1, 1, 3, 8, 16))
    charge = ("charge", robot, random.choice(NUMBERS))
    return random.choice(
        (
            *(charge, charge, charge),
            ("flaps", robot, name, times, period, random.choice((WARN, ERROR))),
            ("forget", robot, name),
            ("everywhere_but", robot, name),
            ("outage", robot),
            ("clock", random.choice((-3600.0, -30.0, 30.0, 3600.0, 5 * 86_400.0))),
            ("own_part", random.choice(list(OWN_PARTS)), random.choice((OK, WARN, ERROR, STALE))),
        )
    )


def _random_event(random: Random) -> tuple[Any, ...]:
    robot, name, level = (
        random.choice(ROBOTS),
        random.choice(list(COMPONENTS)),
        random.choice(LEVELS),
    )
    some = random.sample(list(COMPONENTS), random.randrange(1, 4))
    arrays = ("array", robot, {each: random.choice(LEVELS) for each in some})
    return random.choice(
        (
            *(arrays, arrays, arrays),
            ("flash", robot, name, random.randrange(1, 15), level),
            ("everywhere", name, level),
            ("all_of", robot, level),
            ("silent", set(random.sample(ROBOTS, random.randrange(1, 5)))),
            *(("back", robot), ("back", robot)),
            ("uplink", level),
            ("downtime", robot, random.random() < 0.5),
            ("downtime_of", robot, set(some[:2])),
            ("restart",),
            ("fleet", random.choice(FLEETS)),
        )
    )
