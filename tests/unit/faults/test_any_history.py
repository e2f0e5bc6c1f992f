"""Whatever happens to a fleet: the engine gives what brute force gives, and keeps the rules."""

from copy import copy
from dataclasses import replace

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Falling,
    FaultSettings,
    Flapping,
    Intermittent,
    WarningHours,
)
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    ComponentReport,
    ComponentSettings,
    OwnReport,
    RobotSettings,
    State,
    ValueReport,
)
from support.fault_histories import (
    BATTERY,
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    FleetChange,
    Player,
    back,
    check,
    forget,
    maintenance,
    never,
    restart,
    silent,
)
from support.fault_model import OWN_CONFIRM, Model

ROBOTS = ("r1", "r2", "r3", "r4")
COMPONENTS = ("a", "b", "planned", "strict")
PARTS = ("database", "domain 7")  # of the exporter
JUDGED = {
    "a": ComponentSettings(3),
    "b": ComponentSettings(5),
    "planned": ComponentSettings(3, planned_stale=True),
    "strict": ComponentSettings(3, stale_is_critical=True),
}
FLEETS = (
    FaultSettings(
        confirm_after=4,
        restart_grace=7,
        pending_after=15,
        flapping=Flapping(0.2, 0.1),
        intermittent=Intermittent(3, 150.0),
        falling=Falling(15.0, 20.0),  # sampled once a second, as the model does
        many=CauseSettings(3, 0.5),
        site=CauseSettings(2, 0.5),
        common=CauseSettings(3, 0.5),
    ),
    FaultSettings(
        confirm_after=2,
        restart_grace=3,
        pending_after=5,
        flapping=Flapping(0.3, 0.15),
        intermittent=Intermittent(2, 40.0),
        falling=Falling(15.0, 40.0),
        many=CauseSettings(2, 0.3),
        site=CauseSettings(3, 0.7),
        common=CauseSettings(4, 0.9, absolute=2),
    ),
)
# No larger faults, which the model does not know.
_NEVER = CauseSettings(1000, 1.0)
SMALL = tuple(replace(each, many=_NEVER, site=_NEVER, common=_NEVER) for each in FLEETS)
# Monday 13:46:40, when a history begins: the hours are every second minute of the next ones.
EVERY_SECOND_MINUTE = tuple((0, 827 + 2 * each, 828 + 2 * each) for each in range(8))
HOURS = WarningHours(EVERY_SECOND_MINUTE, "UTC")
FLEETS, SMALL = ((*each, replace(each[0], warning_hours=HOURS)) for each in (FLEETS, SMALL))
ROBOT_SETTINGS = (
    RobotSettings({"site": "hall"}, 3, 4, 6),
    RobotSettings({"site": "yard", "team": "red"}, 5, 4, 6),
)

robots = st.sampled_from(ROBOTS)
components = st.sampled_from(COMPONENTS)
any_level = st.sampled_from([OK, OK, WARN, ERROR, ERROR, STALE])
arrays = st.dictionaries(components, any_level, min_size=1)
whole_arrays = st.fixed_dictionaries(dict.fromkeys(COMPONENTS, any_level))
numbers = st.sampled_from([5.0, 10.0, 10.2, 20.0, 20.3, 50.0, None])
events = st.one_of(
    st.tuples(st.just("array"), robots, arrays),
    st.tuples(st.just("array"), robots, arrays),
    st.tuples(st.just("array"), robots, whole_arrays),
    st.tuples(st.just("flicks"), robots, components, st.integers(1, 3), st.sampled_from([1, 25])),
    st.tuples(st.just("everywhere"), components, any_level),
    st.tuples(st.just("silent"), robots),
    st.tuples(st.just("outage")),
    st.tuples(st.just("back"), robots, whole_arrays, numbers, st.integers(0, 2)),
    st.tuples(st.just("back"), robots, whole_arrays, numbers, st.integers(0, 2)),
    st.tuples(st.just("never"), robots),
    st.tuples(st.just("value"), robots, numbers, st.integers(0, 2)),
    st.tuples(st.just("drain"), robots, st.integers(16, 40)),
    st.tuples(st.just("check"), robots, st.sampled_from([(1, 2), (2, 2), (1, 2), (0, None)])),
    st.tuples(st.just("maintenance"), st.sets(robots, min_size=1), st.booleans()),
    st.tuples(st.just("restart")),
    st.tuples(st.just("own"), st.dictionaries(st.sampled_from(PARTS), any_level)),
    st.tuples(st.just("configure"), robots, st.sampled_from(ROBOT_SETTINGS), st.booleans()),
    st.tuples(st.just("fleet"), st.sampled_from(range(len(FLEETS)))),
    st.tuples(st.just("forget"), robots, components | st.none()),
)
histories = st.lists(st.tuples(st.integers(0, 8), events, st.booleans()), max_size=40)


# The machine may be: a history takes as long as it takes.
busy = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])


class Both:
    """Does the same to the engine and to the model."""

    def __init__(self, *, reborn: bool, compare: bool) -> None:
        self.fleets = SMALL if compare else FLEETS
        self.player = Player(self.fleets[0])
        self.player.writes = reborn
        self.model = Model(self.fleets[0], int(WALL))
        self.reborn = reborn
        self.compare = compare
        self.second = 0
        self.changes = []
        self.seen = []

    def go(self, seconds: int) -> None:
        for _ in range(seconds):
            self.second += 1
            self.step()

    def step(self) -> None:
        if self.compare:
            self.model.step(self.second)

    def do(self, event: tuple, *, reborn: bool) -> None:
        passed = len(self.changes)
        self.engine()
        self.watch(passed)
        if self.reborn and reborn:
            self.player.reborn(self.second)
        happened = len(self.changes)
        getattr(self, event[0])(*event[1:])
        self.watch(happened)
        self.step()

    def watch(self, first: int) -> None:
        """Keep for each change what the world was like then: (change, robot, component)."""
        for what, fault, _ in self.changes[first:]:
            robot = self.model.robots.get(fault.identity.robot)
            part = None
            if robot is not None:
                part = robot.components.get((fault.identity.group, fault.identity.component))
            self.seen.append((what, fault.identity, copy(robot), copy(part)))

    def engine(self, *events) -> None:
        self.changes += self.player.go(self.second, *events)

    # -- events ------------------------------------------------------------------------------

    def configure(self, robot, how, declared):
        self.engine(lambda faults, now: faults.configure_robot(robot, how, now, declared=declared))
        self.model.configure_robot(robot, how, declared, self.second)

    def array(self, robot, reported):
        if robot not in self.model.robots:
            return
        reports = [
            ComponentReport(ComponentName("", name), to, JUDGED[name])
            for name, to in reported.items()
        ]
        self.engine(lambda faults, now: faults.components_changed(robot, reports, 4, now))
        self.model.robots[robot].total = 4
        for name, to in reported.items():
            self.model.level(robot, ("", name), to, JUDGED[name], self.second)

    def everywhere(self, component, to):
        for robot in ROBOTS:
            self.array(robot, {component: to})
            self.step()

    def flicks(self, robot, component, times, pause):
        """Faults too short to be confirmed."""
        for _ in range(times):
            self.array(robot, {component: ERROR})
            self.step()
            self.go(1)
            self.engine()
            self.array(robot, {component: OK})
            self.step()
            self.go(pause)

    def silent(self, robot):
        if robot in self.model.robots:
            self.engine(silent(robot))
            self.model.silent(robot, self.second)

    def outage(self):
        for robot in ROBOTS:
            self.silent(robot)
            self.step()

    def back(self, robot, reported, number, thresholds):
        if robot in self.model.robots:
            self.engine(back(robot))
            self.model.back(robot, self.second)
            self.step()
            self.array(robot, reported)
            self.step()
            self.value(robot, number, thresholds)

    def value(self, robot, number, thresholds):
        if robot in self.model.robots:
            judged = BATTERY[:thresholds]
            self.engine(_value(robot, number, judged))
            self.model.value(robot, "a", number, judged, JUDGED["a"], now=self.second)

    def drain(self, robot, seconds):
        """A value that falls by 1 a second."""
        for second in range(seconds):
            self.engine()
            self.value(robot, 50.0 - second, 2)
            self.step()
            self.go(1)

    def never(self, robot):
        known = self.model.robots.get(robot)
        if known is not None and not known.received and known.presence == "silent":
            self.engine(never(robot))
            self.model.pending(robot, self.second)

    def check(self, robot, numbers):
        if robot in self.model.robots:
            self.engine(check(*numbers, robot=robot))
            self.model.check(robot, "motors", *numbers, self.second)

    def maintenance(self, planned_robots, planned):
        known = [robot for robot in planned_robots if robot in self.model.robots]
        if known:
            self.engine(maintenance(*known, planned=planned))
        for robot in known:
            self.model.robots[robot].maintenance = planned

    def own(self, levels):
        reports = [OwnReport(part, to, "", OWN_CONFIRM) for part, to in levels.items()]
        self.engine(lambda faults, now: faults.own(reports, now))
        self.model.report_own(levels, self.second)

    def restart(self):
        self.engine(restart())
        self.model.started(self.second)

    def fleet(self, how):
        self.engine(FleetChange(self.fleets[how]))
        self.model.settings = self.fleets[how]

    def forget(self, robot, component):
        if robot in self.model.robots:
            self.engine(forget(robot, component))
            if component is None:
                self.model.forget_robot(robot, self.second)
            else:
                self.model.forget_component(robot, "", component, self.second)


def _value(robot, number, thresholds):
    report = ValueReport("charge", number, thresholds)
    name = ComponentName("", "a")
    return lambda faults, now: faults.values_changed(robot, name, JUDGED["a"], [report], now)


def run(history, *, reborn: bool = False, compare: bool = False) -> Both:
    both = Both(reborn=reborn, compare=compare)
    for robot in ROBOTS:
        both.do(("configure", robot, ROBOT_SETTINGS[0], True), reborn=False)
        both.do(("back", robot, dict.fromkeys(COMPONENTS, OK), 50.0, 2), reborn=False)
    both.go(20)
    for gap, event, is_reborn in history:
        both.go(gap)
        both.do(event, reborn=is_reborn)
    both.go(120)
    both.do(("go", 0), reborn=False)
    return both


def plain(changes):
    """Changes as the model gives them, those of one second in one order."""
    return sorted(
        (
            round(at - WALL),
            what,
            tuple(getattr(part, "value", part) for part in fault.identity),
            round(fault.since - WALL),
            tuple(sorted(fault.labels.items())),
        )
        for what, fault, at in changes
    )


OWN_BEFORE_A_RESTART = [
    (0, ("own", {"database": WARN}), False),
    (0, ("restart",), False),
    (0, ("go", 0), True),
]


@busy
@given(histories)
@example(OWN_BEFORE_A_RESTART)
def test_the_engine_gives_what_brute_force_gives(history):
    both = run(history, compare=True)

    assert plain(both.changes) == sorted(both.model.changes)


@busy
@given(histories)
@example(OWN_BEFORE_A_RESTART)
def test_a_new_engine_from_the_written_rows_at_any_event_changes_nothing(history):
    # What falls is computed anew after a start.
    reborn, other = (
        [each for each in found.changes if each.fault.identity.state is not State.FALLING]
        for found in (run(history, reborn=True), run(history))
    )
    assert reborn == other


@busy
@given(histories)
def test_none_begins_while_suppressed(history):
    for what, identity, robot, part in run(history).seen:
        if what != "began" or robot is None:
            continue
        assert not robot.maintenance, identity
        if identity.scope in {"component", "value", "check", "flapping"}:
            assert robot.presence == "up", identity
        if identity.scope in {"component", "flapping"}:
            assert part.fresh, identity


@busy
@given(histories)
def test_none_ends_without_a_fresh_lower_level_or_a_person(history):
    better = {"warning": {OK}, "stale": {OK, WARN}, "critical": {OK, WARN}}
    for what, identity, robot, part in run(history).seen:
        if what != "recovered" or robot is None:
            continue
        assert not robot.maintenance, identity
        if identity.scope == "component":
            assert part.fresh, identity
            assert part.level in better[identity.state.value], identity
        elif identity.scope in {"value", "check"} or identity.state in {"silent", "pending"}:
            assert robot.presence == "up", identity


@busy
@given(histories)
def test_timers_and_rows_are_bounded_by_what_is_in_trouble(history):
    both = run(history)
    book = both.player.faults._book
    both.player.write(both.second)

    records = len(book.problems) + sum(2 + len(each.components) for each in book.robots.values())
    assert len(book.timers) <= records + 2 * len(book.causes) + 1
    assert book.timers.entries <= 2 * len(book.timers) + 64
    assert len(both.player.rows) <= records + len(book.causes) + len(book.ended) + 1
