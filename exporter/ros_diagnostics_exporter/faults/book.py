"""The records of the whole fleet, and notes of what has to be judged or written again."""

from __future__ import annotations

from collections.abc import Iterable
from math import inf
from typing import Any, Literal

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.model import (
    NO_OTHERS,
    ComponentName,
    Identity,
    Others,
    RobotSettings,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.records import (
    TREND_STEPS,
    CapabilityRecord,
    Cause,
    ComponentRecord,
    Ended,
    Presence,
    Problem,
    RobotRecord,
    RowKey,
    Subject,
)
from ros_diagnostics_exporter.loops import Timers
from ros_diagnostics_exporter.model import Instant

TimerKind = Literal[
    "confirm",
    "fleet",
    "returned",
    "waits",
    "presence",
    "flaps",
    "trends",
    "settled",
    "hours",
    "ends",
]
_Timed = Problem | RobotRecord | ComponentRecord | None
Timer = tuple[TimerKind, _Timed]
_FAILING, _HEALTHY, _NEVER = Verdict.FAILING, Verdict.HEALTHY, Presence.NEVER
_VALUE, _EXPORTER, _CAPABILITY = Scope.VALUE, Scope.EXPORTER, Scope.CAPABILITY
_CHECK, _ROBOT, _SITE = Scope.CHECK, Scope.ROBOT, Scope.SITE
_FLAPPING, _PENDING, _CLOCK, _FALLING = State.FLAPPING, State.PENDING, State.CLOCK, State.FALLING
_MANY, _INTERMITTENT = State.MANY, State.INTERMITTENT
_MAY_BE_UNREACHABLE = (State.SILENT, State.FLAPPING)
CLOCK_TIME = 60.0  # seconds for which a clock has to be wrong: longer than arrays are buffered
FLEET_ROW: RowKey = ("fleet", ())
TIME_TO_RETURN = 60.0  # seconds at most for what a fault explained to be healthy after it
UPLINK_TIME = 15.0  # seconds in which a query has noticed that an uplink does not answer


class Book:
    """All records; when (monotonic) a start is over, see `Faults.started`.

    ``grace_until``: restart_grace; ``fleet_known_at``: robots that nobody declared are found, too;
    ``settled_at``: what was wrong before is a fault again.
    """

    def __init__(self, settings: FaultSettings, others: Others = NO_OTHERS) -> None:
        self.settings = settings
        self.others = others
        self.grace_until = -inf
        self.settled_at = -inf
        self.fleet_known_at = -inf
        self.restored_at = -inf  # when rows were read, monotonic
        self.is_reloading = False  # robots follow another config, one by one
        self.clock_offset = 0.0  # of the wall clock to the monotonic, when hours were computed
        self.robots: dict[str, RobotRecord] = {}
        self.causes: dict[tuple[Scope, str], Cause] = {}  # of sites and components
        self.problems: dict[Identity, Problem] = {}
        self.own: dict[str, float] = {}  # part of the exporter -> seconds until it is a fault
        self.ended: dict[Identity, Ended] = {}
        self.forgotten: dict[str, Ended] = {}  # robots of which nothing is to be held
        self.named: dict[str, dict[ComponentRecord, None]] = {}  # components with a record, by name
        self.present: dict[str, set[str]] = {}  # site -> robots that causes are shares of
        self.timers: Timers[Timer] = Timers()
        self.asked: set[Problem] = set()  # whether they are reported, which is being found out
        self.touched: dict[Problem, None] = {}
        self.touched_causes: dict[Cause, None] = {}
        self.touched_robots: dict[RobotRecord, None] = {}  # whose capabilities are to be judged
        self.written: dict[RowKey, None] = {}  # rows that differ from what was last taken
        self.capabilities: dict[str, CapabilityRecord] = {}  # of the fleet, in order of need
        self.changed: dict[Problem, Verdict] = {}  # whose verdict is another than this before
        self.followed: dict[str, None] = {}  # robots of which `Faults.followed` changed

    # -- notes -------------------------------------------------------------------------------

    def touch(self, problems: Iterable[Problem]) -> None:
        """Have these judged again, and the capabilities that rest on them."""
        for problem in problems:
            self.touched[problem] = None
            self._touch_capabilities(problem)

    def _touch_capabilities(self, problem: Problem) -> None:
        robot = problem.robot
        if robot is not None and robot.capabilities and not problem.capability:
            self.touched_robots[robot] = None

    def give_verdict(self, problem: Problem, verdict: Verdict) -> None:
        """Note what is known of a problem now, and have it judged with what it explains."""
        if verdict is _FAILING:
            problem.restored = False
        if verdict is not problem.verdict:
            self.changed.setdefault(problem, problem.verdict)
            problem.verdict = verdict
            self.written[problem.row] = None
        self.touched[problem] = None
        self._touch_capabilities(problem)

    def forget_changes(self, component: ComponentRecord) -> None:
        """Count no change so far towards its being intermittent, unless that is a fault."""
        if component.flaps is None or component.is_intermittent:
            return
        component.flaps.changed = ()
        self.written[component.row] = None
        if _INTERMITTENT in component.problems:
            self.give_verdict(component.problems[_INTERMITTENT], _HEALTHY)

    def touch_causes(self) -> None:
        """Have every site and common cause judged again, because the whole has changed."""
        self.touched_causes.update(dict.fromkeys(self.causes.values()))

    def write(
        self, record: Problem | Cause | CapabilityRecord | RobotRecord | ComponentRecord
    ) -> None:
        """Have the row of this record written again."""
        self.written[record.row] = None
        if isinstance(record, ComponentRecord):
            follows = record.since, None if record.flaps is None else record.flaps.ratio
            if follows != record.noted:
                record.noted = follows
                self.followed[record.robot.name] = None

    def explain_until(self, subject: Subject, until: float) -> None:
        """Count confirm_after from ``until`` (monotonic) on, or from later as before."""
        if until > subject.explained_until:
            subject.explained_until = until
            self.written[subject.row] = None

    def await_return(self, subject: Subject, robot: RobotRecord, until: float) -> None:
        """Explain it until then, and count it, or its robot, towards nothing larger before."""
        self.explain_until(subject, until)
        subject.returns_until = max(subject.returns_until, until)
        self.timers.set_at_latest(("waits", robot), until)

    # -- records -----------------------------------------------------------------------------

    def add_robot(self, name: str, settings: RobotSettings) -> RobotRecord:
        """A new robot, never received."""
        robot = self.robots[name] = RobotRecord(name, settings)
        self.write(robot)
        return robot

    def add_component(self, component: ComponentRecord) -> ComponentRecord:
        """Keep the record of a component."""
        name = component.name
        component.robot.components[name] = component
        if component.settings.depends_on:  # else set with its next level
            component.robot.has_dependencies = True
        self.named.setdefault(name.component, {})[component] = None
        self.write(component)
        return component

    def drop_component(self, component: ComponentRecord) -> None:
        """Take out the record of a component."""
        name = component.name
        del component.robot.components[name]
        del self.named[name.component][component]
        if not self.named[name.component]:
            del self.named[name.component]
        self.timers.clear(("flaps", component))
        self.write(component)

    def new_problem(self, identity: Identity, since: Instant) -> Problem:
        """A new problem, which what it is about has from now on."""
        problem, scope = Problem(identity, since), identity.scope
        robot = problem.robot = self.robots[identity.robot] if identity.robot else None
        owner: dict[Any, Problem] = self.problems
        key: Any = identity.state
        if scope is _CAPABILITY:
            problem.capability = self.capability(robot, identity.check)
            owner = problem.capability.problems
        elif scope is _EXPORTER:
            self.own.setdefault(identity.component, CLOCK_TIME)
            key = identity
        elif robot is None or identity.state is _MANY:
            name = identity.site if scope is _SITE else identity.component
            problem.cause = self.cause(scope, name) if robot is None else robot.many
            owner, key = problem.cause.problems, identity.severity
        elif scope is _CHECK:
            owner, key = robot.checks, identity.check
        elif scope is _ROBOT:
            owner = robot.problems
        else:
            component = robot.components[ComponentName(identity.group, identity.component)]
            problem.component = component
            owner = component.problems
            if scope is _VALUE:
                owner, key = component.values, (identity.key, identity.bound, identity.state.value)
        problem.place = owner, key
        owner[key] = self.problems[identity] = problem
        self.write(problem)
        return problem

    def judge(self, identity: Identity, verdict: Verdict, now: Instant) -> None:
        """Give a verdict on a problem, which is a new one if it fails and there was none."""
        problem = self.problems.get(identity)
        if problem is None and verdict is _FAILING:
            problem = self.new_problem(identity, now)
        if problem is not None:
            self.give_verdict(problem, verdict)

    def drop_problem(self, problem: Problem) -> None:
        """Take out a problem, here and at its owner."""
        del self.problems[problem.identity]
        self.touched.pop(problem, None)
        self._touch_capabilities(problem)
        self.changed.pop(problem, None)
        self.timers.clear(("confirm", problem))
        self.write(problem)
        owner, key = problem.place
        owner.pop(key, None)

    def capability(self, robot: RobotRecord | None, name: str) -> CapabilityRecord:
        """The capability of a robot or (None) the fleet; a new one if it is not configured yet."""
        records = self.capabilities if robot is None else robot.capabilities
        return records.setdefault(name, CapabilityRecord(robot, name))

    def cause(self, scope: Scope, name: str) -> Cause:
        """The cause of a site or a component name, made if it is new."""
        cause = self.causes.get((scope, name))
        if cause is None:
            cause = self.causes[scope, name] = Cause(scope, name)
        return cause

    # -- what causes are counted of ----------------------------------------------------------

    def note_presence(self, robot: RobotRecord) -> None:
        """Count the robot, or not, among those that a share of robots is a share of."""
        site = self.present.setdefault(robot.settings.site, set())
        wanted = robot.presence is not _NEVER and not robot.maintenance
        if wanted != (robot.name in site):
            (site.add if wanted else site.discard)(robot.name)
            self.touch_causes()
        if not site:
            del self.present[robot.settings.site]

    def due(self, problem: Problem, *, as_part: bool = False) -> float:
        """When (monotonic) the problem may be a fault at the earliest.

        ``as_part``: whatever capability explained it, of which it is a part.
        """
        component, confirm_after = problem.component, self.confirm_after(problem)
        clock = max(problem.clock, problem.subject.explained_until)
        if not as_part and problem.explained_until > clock:
            clock = problem.explained_until
        if component is not None:
            boots = problem if problem.identity.scope is _VALUE else component
            if boots.boots_until > clock + confirm_after:
                return boots.boots_until
            if component.settings.measured:
                clock = max(clock, component.robot.returned_until)  # it was not reached before
            return clock + confirm_after
        late = UPLINK_TIME if self._may_be_unreachable(problem) else 0.0
        return max(problem.boots_until, clock + confirm_after + late)

    def confirm_after(self, problem: Problem) -> float:
        """Seconds for which a problem has to last until it is a fault."""
        state, component, robot = problem.identity.state, problem.component, problem.robot
        of_component = state is _FLAPPING and component is not None
        if of_component or problem.capability is not None:
            return 0.0
        if state is _PENDING:
            return self.settings.pending_after
        if state is _CLOCK or problem.identity.scope is _EXPORTER:
            return self.own.get(problem.identity.component, CLOCK_TIME)
        if state is _FALLING:
            return 2 * self.settings.falling.over / TREND_STEPS
        if component is not None:
            return component.settings.confirm_after
        return self.settings.confirm_after if robot is None else robot.settings.confirm_after

    def _may_be_unreachable(self, problem: Problem) -> bool:
        """Whether it may turn out that an uplink explains what is common to robots, or silence.

        Or what is measured of a robot, that many of its components failed.
        """
        state, robot = problem.identity.state, problem.robot
        if state is _MANY and robot is not None:
            components = robot.components.values()
            return robot.has_dependencies and any(each.settings.depends_on for each in components)
        robots = [robot] if robot and state in _MAY_BE_UNREACHABLE else []
        if problem.cause is not None and problem.robot is None:
            robots = [self.robots[name] for name in problem.cause.counted if name in self.robots]
        return any(robot.settings.uplink in self.robots for robot in robots)
