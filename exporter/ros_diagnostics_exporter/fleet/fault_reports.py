"""What the state reports to the judgement of faults: what changed since it last did.

The state calls `update` after each array and tick of a robot,
which compares the robot with what was reported of it; every call is made under the state's lock.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from math import inf

from ros_diagnostics_exporter.config.capabilities import FleetCapability
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.fleet import Robot as Settings
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.clocks import LIMIT
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import (
    NO_OTHERS,
    Change,
    ComponentName,
    Counts,
    Fault,
    Identity,
    Others,
    OwnReport,
    ProblemView,
    Reason,
    Row,
    Scope,
    State,
    as_texts,
)
from ros_diagnostics_exporter.fleet.capabilities import (
    capabilities_text,
    fleet_evidence,
    wanted_of_fleet,
)
from ros_diagnostics_exporter.fleet.fault_evidence import (
    Evidence,
    evidence,
    last_received,
    of_capability,
    of_exporter,
)
from ros_diagnostics_exporter.fleet.newcomers import STARTING
from ros_diagnostics_exporter.fleet.robot_reports import RobotReports
from ros_diagnostics_exporter.model import Instant, Level, Status
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.robot import RobotState

_LEVELS = {  # of what begins a fault
    (Scope.COMPONENT, State.WARNING): Level.WARN,
    (Scope.COMPONENT, State.CRITICAL): Level.ERROR,
}


class FaultReports:
    """The faults of the fleet, and of each robot what was reported of it.

    ``engine`` judges, and is asked what it found; another one takes its place in `restore`.
    Faults that begin and end are appended to ``events``.
    Called only under the lock of the State that holds it. ``now`` of a call may be earlier than
    that of the one before, as arrays and ticks come from several threads: time does not go back.
    """

    def __init__(self, fleet: Fleet, now: Instant, events: deque[Event]) -> None:
        self._fleet = fleet
        self._now = now
        self.due_at = inf  # when something is due by itself, monotonic
        self._events = events
        self._robots: dict[str, RobotReports] = {}
        self._fleet_source: tuple[Mapping[str, FleetCapability], list[Settings]] | None = None
        self._own: dict[str, str] = {}  # part of the exporter -> what is wrong with it
        self._others = NO_OTHERS
        if fleet.shard is not None:
            self._others = Others(known=1 / fleet.shard.count, twice=fleet.shard.twice)
        self.engine = Faults(fleet.faults, self._others)
        self._start(now)

    def _start(self, now: Instant) -> None:
        found_after = STARTING if self._fleet.discoveries or self._fleet.shared else 0.0
        self.engine.started(now, self._fleet.longest_confirm_after, found_after)

    # -- reported ----------------------------------------------------------------------------

    def add(self, robot: RobotState, now: Instant) -> None:
        """Judge a new robot from now on."""
        reports = self._robots[robot.settings.name] = RobotReports(robot, self._events)
        self._record(reports.configure(self.engine, self._time(now)))

    def remove(self, robot: RobotState, now: Instant) -> None:
        """End all that is wrong with a robot that is no longer wanted."""
        del self._robots[robot.settings.name]
        self._remove(robot.settings.name, self._time(now))

    def _remove(self, robot: str, now: Instant) -> None:
        moved = not self._fleet.has(robot)
        self._record(self.engine.forget_robot(robot, now, moved=moved))

    def update(self, robot: RobotState, now: Instant) -> None:
        """Report what changed of a robot; cheap where nothing did."""
        reports, at = self._robots[robot.settings.name], robot.marks.at
        has_news = max(at[Mark.NAMES], at[Mark.LEVEL], at[Mark.VALUE]) > reports.read
        if has_news or (not (robot.up and reports.is_up) and reports.is_due(now)):
            self._record(reports.update(self.engine, self._time(now)))

    def configure(self, fleet: Fleet, now: Instant, *, is_over: bool) -> None:
        """Follow another config in what is not of a robot, before all robots do and after it."""
        now, self._fleet = self._time(now), fleet
        if is_over:
            self.report_fleet(now)
        self._record(self.engine.configure(fleet.faults, now, is_over=is_over))

    def configure_robot(self, robot: RobotState, now: Instant) -> None:
        """Follow a robot's config, after the robot did."""
        now, reports, changes = self._time(now), self._robots[robot.settings.name], list[Change]()
        if reports.has_other_settings:
            changes = reports.configure(self.engine, now)
        self._record(changes + reports.update(self.engine, now))

    def _report_maintenance(self, now: Instant) -> None:
        """Report which robots' planned downtimes began or ended, all of them at one time."""
        planned = {
            name: reports.robot.maintenance
            for name, reports in self._robots.items()
            if reports.robot.maintenance != reports.maintenance
        }
        for name, is_planned in planned.items():
            self._robots[name].maintenance = is_planned
        if planned:
            self._record(self.engine.maintenance(planned, now))
        for name, reports in self._robots.items():
            if reports.robot.maintained != reports.maintained:
                reports.maintained = reports.robot.maintained
                self._record(self.engine.components_in_maintenance(name, reports.maintained, now))

    def _report_domains(self, now: Instant) -> None:
        """Report of which robots the DDS domain cannot be joined, or can again."""
        changed = {
            name: not reports.robot.network.domain_up
            for name, reports in self._robots.items()
            if reports.robot.network.domain_up == reports.cut_off
        }
        for name, is_so in changed.items():
            self._robots[name].cut_off = is_so
        if changed:
            self._record(self.engine.cut_off(changed, now))

    def _clocks(self) -> dict[str, float]:
        """How far the clocks of robots differ that are received, and have one."""
        robots = ((name, reports.robot) for name, reports in self._robots.items())
        return {
            name: robot.clock_behind
            for name, robot in robots
            if robot.up and robot.clock_behind is not None
        }

    def report_fleet(self, now: Instant) -> None:
        """Report what the fleet can do, where it has other robots, or other settings of them."""
        every = self._robots.values() if self._fleet.capabilities else ()
        source = self._fleet.capabilities, [each.robot.settings for each in every]
        if source != self._fleet_source:
            self._fleet_source = source
            found = wanted_of_fleet(self._fleet, source[1])
            self._record(self.engine.configure_capabilities(None, found, now))

    def take_others(self, counts: Counts, known: float, now: Instant) -> None:
        """Take what the other exporters that share the fleet count; see `Others`."""
        twice = frozenset() if self._fleet.shard is None else self._fleet.shard.twice
        self._others = Others(counts, known, twice)
        self._record(self.engine.take_others(self._others, self._time(now)))

    def own(self, reports: Iterable[OwnReport], now: Instant) -> None:
        """Report all parts of the exporter itself."""
        reports = list(reports)
        self._own = {each.part: each.message for each in reports}
        self._record(self.engine.own(reports, self._time(now)))

    def advance(self, now: Instant) -> None:
        """Let time pass, before a robot is changed: what was due begins by what was known then."""
        self._record(self.engine.advance(self._time(now)))

    def tick(self, now: Instant, *, slow: bool) -> None:
        """Let time pass; to be called a few times a second, once a second with ``slow``."""
        now = self._time(now)
        if slow:
            self._report_maintenance(now)
            self._report_domains(now)
            self._record(self.engine.clocks(self._clocks(), now))
            self.report_fleet(now)
            for reports in self._robots.values():
                if reports.may_end:
                    self._record(reports.end_unrepeated(self.engine, now))
        self.advance(now)

    def restore(self, rows: Iterable[Row], now: Instant) -> list[Row]:
        """Go on from the rows of an earlier process; returns those that cannot be restored.

        Nothing is received yet.
        """
        now, rows = self._time(now), list(rows)
        faults = Faults(self._fleet.faults, self._others)
        dropped = faults.restore(rows, now)
        self.engine, self._fleet_source = faults, None
        self._start(now)
        for kind, key, fields in rows:
            if kind == "robot" and fields is not None and key and key[0] not in self._robots:
                self._remove(key[0], now)
        for reports in self._robots.values():
            self._record(reports.start_over(faults, now))
            reports.robot.marks.note(Mark.DETAILS)  # what the former engine followed is gone
        planned = {name: each.maintenance for name, each in self._robots.items()}
        self._record(faults.maintenance(planned, now))
        return dropped

    def take_rows(self, now: Instant) -> list[Row]:
        """The rows that changed since they were last taken, of all what `restore` needs."""
        return self.engine.take_rows(self._time(now))

    def _time(self, now: Instant) -> Instant:
        if now.mono >= self._now.mono:
            self._now = now
        return self._now

    def _record(self, changes: Iterable[Change]) -> None:
        """Write the evidence of the faults that began, and append all changes to the events."""
        for what, fault, at in changes:
            if fault.identity.robot in self._robots:
                self._robots[fault.identity.robot].robot.marks.note(Mark.DETAILS)
            described, end = fault, ""
            if what == "began":
                identity = fault.identity
                known = Evidence(fault.evidence, {})
                text, fields = known if fault.evidence else self._evidence(identity)
                can = fault.capabilities or self._capabilities_text(identity)
                described = self.engine.describe(fault, text, can, fields)
            elif what == "recovered":
                end = last_received(fault.identity, self._find)
                self.engine.describe_end(fault, end)
            self._events.append(_event(what, described, at, end))
        for name in self.engine.take_followed():
            if name in self._robots:
                self._robots[name].robot.marks.note(Mark.DETAILS)
        self.due_at = self.engine.due_at

    def _evidence(self, identity: Identity) -> Evidence:
        if identity.scope is Scope.EXPORTER and identity.component in self._own:
            return of_exporter(self._own[identity.component])
        reports = self._robots.get(identity.robot)
        if identity.scope is Scope.CAPABILITY and not identity.robot:
            view = self.engine.needs(None).get(identity.check)
            return Evidence("" if view is None else fleet_evidence(view), {})
        flapping = self._flapping(identity.robot)
        if identity.scope is not Scope.CAPABILITY or reports is None:
            troubled, messages = self._troubled(identity), self._messages(identity)
            counted = self._others.counts.get((identity.scope, identity.site or identity.component))
            elsewhere = 0 if counted is None else counted.counted
            return evidence(
                identity,
                self._find,
                troubled,
                messages,
                flapping=flapping,
                elsewhere=elsewhere,
            )
        of = self.engine.capabilities(identity.robot).get(identity.check)
        return Evidence("", {}) if of is None else of_capability(of, reports.by_name, flapping)

    def _capabilities_text(self, identity: Identity) -> str:
        """What else the robot can no longer do; nothing of one that is silent, or an uplink."""
        reports, found = self._robots.get(identity.robot), self._find(identity)
        component = None if found is None else found[1]
        is_uplink = component is not None and component.is_uplink
        if reports is None or not reports.robot.up or is_uplink:
            return ""
        capabilities = self.engine.capabilities(identity.robot)
        if identity.scope is Scope.CAPABILITY:
            capabilities.pop(identity.check, None)
        return capabilities_text(capabilities)

    def _find(self, identity: Identity) -> tuple[RobotState, Component | None] | None:
        """The robot, and the component if it is of one, that a fault is about."""
        reports = self._robots.get(identity.robot)
        if reports is None:
            return None
        return reports.robot, reports.find(ComponentName(identity.group, identity.component))

    def _troubled(self, identity: Identity) -> Iterator[str]:
        """The robots that a fault of no robot counts, or that are behind an uplink."""
        counted = {robot for robot, _component in self.engine.members(identity)}
        for name, reports in self._robots.items():
            if name in counted or _is_part(reports.robot, identity):
                yield name

    def _flapping(self, robot: str) -> Iterator[Component]:
        """The components of a robot that change too often."""
        for identity in self.engine.identities(robot) if robot in self._robots else ():
            found = self._find(identity) if identity.state is State.FLAPPING else None
            if found is not None and found[1] is not None:
                yield found[1]

    def _messages(self, identity: Identity) -> Iterator[str]:
        """What the components say that a fault of many robots counts."""
        for robot, name in self.engine.members(identity) if identity.scope is Scope.COMMON else ():
            component = self._robots[robot].find(name) if robot in self._robots else None
            if component is not None:
                yield component.message

    # -- asked -------------------------------------------------------------------------------

    def problems(self, now: Instant, robot: str | None = None) -> list[ProblemView]:
        """All problems, confirmed or not, of the fleet or of one robot.

        Raises:
            LookupError: there is no such robot.
        """
        by_condition = {
            view.identity: view
            for name, reports in self._robots.items()
            if robot in (None, name)
            for view in reports.by_condition.views()
        }
        found = []
        for view in self.engine.problems(now, robot):
            if view.fault is not None:  # it goes on under its condition, and is shown as it is
                by_condition.pop(view.identity, None)
            if view.identity not in by_condition:
                found.append(self._with_text(view))
        return [*found, *by_condition.values()]

    def _with_text(self, view: ProblemView) -> ProblemView:
        """It, and of a part of the exporter that has no evidence yet what is wrong."""
        if view.identity.scope is not Scope.EXPORTER or view.fault is not None:
            return view
        return view._replace(text=self._own.get(view.identity.component, ""))

    def mode(self, robot: RobotState) -> tuple[bool | None, bool | None]:
        """Whether a robot works by itself, and what is an intervention holds; None: not known."""
        return self._robots[robot.settings.name].mode

    def suppressed_components(self, robot: str) -> dict[ComponentName, Reason]:
        """The components of a robot whose trouble is due and that another fault explains."""
        return self.engine.suppressed_components(robot, self._now)

    def adopt(self, faults: Iterable[Fault], now: Instant) -> None:
        """Go on with faults whose alerts fire and which this process does not know."""
        now = self._time(now)
        for fault in faults:
            self._take_over(fault, now)
            self._record(self.engine.adopt(fault, now))
            reports = self._robots.get(fault.identity.robot)
            if reports is not None:
                reports.has_adopted = True
                changes = reports.configure(self.engine, now)
                self._record(changes + reports.update(self.engine, now))

    def _take_over(self, fault: Fault, now: Instant) -> None:
        """Go on with what a component said to another process, if it reports only changes.

        What it said here is no evidence of the end of a fault that began later.
        """
        known = self._find(fault.identity)
        component = None if known is None else known[1]
        if known is None or component is None or not component.is_on_change:
            return
        wanted = _LEVELS.get((fault.identity.scope, fault.identity.state), component.level)
        said = [each for each in Level if component.effective_level(each) == wanted]
        if component.since > fault.since or not said:
            return
        if component.is_stale:
            component.reported_before = said[0]  # it goes on with that when the robot is back
        else:
            status = Status(said[0], component.identity[0], fault.message)
            known[0].components.update(component, status, now)

    def forget(self, robot: str, component: str | None, now: Instant) -> int:
        """Note that nothing of a robot, or of its components of one name, is to be held any more.

        Also of one that is not known here. Returns how many of its components were never received:
        their faults were adopted, and end here.
        """
        now, reports = self._time(now), self._robots.get(robot)
        if component is None:
            self.engine.forget(robot, now)
        adopted = [] if reports is None else reports.adopted(self.engine)
        wanted = [name for name in adopted if component in (None, name.component)]
        for name in wanted:
            self._record(self.engine.forget_component(robot, name, now))
            self._robots[robot].robot.marks.note(Mark.NAMES)  # checks count them no more
        return len(wanted)

    def keeps(self, robot: RobotState, component: Component | None = None) -> bool:
        """Whether a component, or a robot without any, has a problem and is not to be forgotten.

        One that was ever received is silent: only a person knows that it does not come back.
        """
        name = robot.settings.name
        if component is None:
            was_received = robot.last_wall or self._robots[name].has_adopted
            return bool(was_received) and self.engine.in_trouble(name)
        known = self._robots[name].name_of(component)
        return known is not None and self.engine.in_trouble(name, known)

    def has_any(self, robot: RobotState) -> bool:
        """Whether there is a fault of a robot, or of a part of it."""
        name = robot.settings.name
        return any(each.identity.robot == name for each in self.engine.faults())

    def has_fault(self, robot: RobotState, component: Component) -> bool:
        """Whether people know a component by a fault of it, or of a value of it."""
        name = self._robots[robot.settings.name].name_of(component)
        return name is not None and any(
            each.identity.robot == robot.settings.name
            and (each.identity.group, each.identity.component) == name
            for each in self.engine.faults()
        )


def _is_part(robot: RobotState, identity: Identity) -> bool:
    """Whether it is behind the robot of the fault, or its clock is beside the exporter's."""
    if identity.scope is Scope.COMPONENT:
        return robot.settings.labels.get("uplink") == identity.robot
    is_exporter = identity.scope is Scope.EXPORTER
    return is_exporter and robot.up and abs(robot.clock_behind or 0.0) > LIMIT


def _event(what: str, fault: Fault, at: float, end: str) -> Event:
    return Event(
        time=at,
        kind="fault_began" if what == "began" else "fault_ended",
        **as_texts(fault.identity, fault.labels),
        message=fault.evidence if what == "began" else end,
        since=fault.since,
        reason="" if what == "began" else what,
        details=fault.details if what == "began" and fault.details else None,
    )
