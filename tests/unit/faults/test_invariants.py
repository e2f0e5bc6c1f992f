"""What holds whatever happens, in a fleet that uses every feature at once.

The features meet at random: capabilities, dependencies, planned STALE, uplinks, sites, common
causes, many components, downtimes of robots and of components, boot_grace, hours of warnings,
silence, flapping and restarts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings, WarningHours
from ros_diagnostics_exporter.faults.model import (
    EFFECTS,
    ComponentName,
    ComponentReport,
    ComponentSettings,
    EffectiveVerdict,
    Identity,
    PartName,
    Reason,
    RobotSettings,
    Scope,
    State,
)
from ros_diagnostics_exporter.faults.needs import AtLeast, WantedCapability
from support.fault_histories import ERROR, OK, STALE, WARN, Player, back, restart, silent

LEVELS = (OK, OK, WARN, ERROR, ERROR, STALE)
ROBOTS = ("r1", "r2", "r3", "r4")
UPLINK = "ap"
CONFIRM = 10.0
# A problem that nothing explains is a fault this long after it is due: see `suppression.latest`,
# and once more for what an explanation that was never a fault leaves behind it.
PATIENCE = 2 * 60.0 + CONFIRM
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
DRIVING = WantedCapability("driving", AtLeast(None, (PartName(component="motor"),)))
MINUTES = tuple((0, 827 + 4 * each, 829 + 4 * each) for each in range(20))
FLEETS = (
    FaultSettings(
        site=CauseSettings(2, 0.5), common=CauseSettings(3, 0.5), many=CauseSettings(4, 0.5)
    ),
    FaultSettings(
        site=CauseSettings(3, 0.7),
        common=CauseSettings(2, 0.5),
        many=CauseSettings(3, 0.3),
        warning_hours=WarningHours(MINUTES, "UTC"),
    ),
)
BY_A_PERSON = {Reason.MAINTENANCE, Reason.HOURS, Reason.CONDITION}

robots = st.sampled_from(ROBOTS)
names = st.sampled_from(tuple(COMPONENTS))
levels = st.sampled_from(LEVELS)
events = st.one_of(
    st.tuples(st.just("array"), robots, st.dictionaries(names, levels, min_size=1)),
    st.tuples(st.just("array"), robots, st.dictionaries(names, levels, min_size=1)),
    st.tuples(st.just("flash"), robots, names, st.integers(1, 15), levels),
    st.tuples(st.just("everywhere"), names, levels),
    st.tuples(st.just("all_of"), robots, levels),
    st.tuples(st.just("silent"), st.sets(robots, min_size=1)),
    st.tuples(st.just("back"), robots),
    st.tuples(st.just("uplink"), levels),
    st.tuples(st.just("downtime"), robots, st.booleans()),
    st.tuples(st.just("downtime_of"), robots, st.sets(names, max_size=2)),
    st.tuples(st.just("restart")),
    st.tuples(st.just("fleet"), st.sampled_from(FLEETS)),
)
histories = st.lists(st.tuples(st.integers(0, 90), events, st.booleans()), max_size=25)


@dataclass
class Truth:
    """What was last received of one component."""

    level: int = OK
    since: float = 0.0  # of this level, the robot received and out of downtime
    fresh: bool = False


@dataclass
class World:
    """An engine, and what was delivered to it."""

    player: Player = field(default_factory=lambda: Player(FLEETS[0]))
    truth: dict[tuple[str, str], Truth] = field(default_factory=dict)
    up: set[str] = field(default_factory=set)
    second: float = 0.0
    began: list[Identity] = field(default_factory=list)
    grace: float = 0.0

    def engine(self, *happened) -> None:
        for what, fault, _at in self.player.go(self.second, *happened):
            identity = fault.identity
            of = self.truth.get((identity.robot, identity.component))
            if what == "began":
                self.began.append(identity)
            elif what == "recovered" and identity.scope is Scope.COMPONENT:
                assert of is not None
                assert of.fresh, identity
                worse = {State.CRITICAL: (ERROR,), State.STALE: (ERROR, STALE)}
                assert of.level not in worse.get(identity.state, (ERROR, WARN, STALE)), identity

    def array(self, robot: str, reported: dict[str, int]) -> None:
        if robot not in self.up:
            return
        for name, level in reported.items():
            known = self.truth.setdefault((robot, name), Truth())
            if level != known.level or not known.fresh:
                known.since = self.second
            known.level, known.fresh = level, True
        reports = [
            ComponentReport(ComponentName("", name), level, COMPONENTS[name])
            for name, level in reported.items()
        ]
        total = len(COMPONENTS)
        self.engine(lambda faults, now: faults.components_changed(robot, reports, total, now))

    def flash(self, robot: str, name: str, seconds: int, then: int) -> None:
        self.array(robot, {name: ERROR})
        self.second += seconds
        self.array(robot, {name: then})

    def everywhere(self, name: str, level: int) -> None:
        for robot in ROBOTS:
            self.array(robot, {name: level})

    def all_of(self, robot: str, level: int) -> None:
        self.array(robot, dict.fromkeys(COMPONENTS, level))

    def silent(self, chosen: set[str]) -> None:
        for robot in sorted(chosen):
            self.up.discard(robot)
            for (owner, _name), known in self.truth.items():
                known.fresh = known.fresh and owner != robot
            self.engine(silent(robot))

    def back(self, robot: str) -> None:
        if robot in self.up:
            return
        self.up.add(robot)
        self.engine(back(robot))
        known = {name: self.truth.get((robot, name), Truth()).level for name in COMPONENTS}
        self.array(robot, known)

    def uplink(self, level: int) -> None:
        how = ComponentSettings(CONFIRM, measured=True, uplink=True)
        known = self.truth.setdefault((UPLINK, "ping"), Truth())
        known.level, known.fresh, known.since = level, True, self.second
        report = ComponentReport(ComponentName("", "ping"), level, how)
        self.engine(lambda faults, now: faults.components_changed(UPLINK, [report], 1, now))

    def downtime(self, robot: str, planned: bool) -> None:
        self._begin_anew(robot, COMPONENTS)
        self.engine(lambda faults, now: faults.maintenance({robot: planned}, now))

    def downtime_of(self, robot: str, chosen: set[str]) -> None:
        self._begin_anew(robot, COMPONENTS)
        self.engine(
            lambda faults, now: faults.components_in_maintenance(robot, frozenset(chosen), now)
        )

    def _begin_anew(self, robot: str, chosen) -> None:
        for name in chosen:
            known = self.truth.setdefault((robot, name), Truth())
            known.since = self.second

    def restart(self) -> None:
        up = sorted(self.up)
        self.engine(restart())
        self.up.clear()
        for known in self.truth.values():
            known.fresh = False
        self.engine(back(UPLINK))
        for robot in up:
            self.back(robot)

    def fleet(self, how: FaultSettings) -> None:
        self.player.settings = how
        self.engine(lambda faults, now: faults.configure(how, now))

    # -- what holds --------------------------------------------------------------------------

    def check(self) -> None:
        """What is freshly ERROR, due and no fault has a lasting fault that explains it."""
        faults = self.player.faults
        lasting = {fault.identity for fault in faults.faults()}
        views = {view.identity: view for view in faults.problems(self.player.at(self.second))}
        for (robot, name), known in self.truth.items():
            late = self.second > known.since + CONFIRM + PATIENCE
            if not (known.fresh and known.level == ERROR and late):
                continue
            identity = Identity(Scope.COMPONENT, State.CRITICAL, "", robot, "", name)
            if identity in lasting:
                continue
            assert identity in views, identity
            view = views[identity]
            if view.suppressed in BY_A_PERSON or view.due > self.player.at(self.second).wall:
                continue
            assert self._is_reported(view.by, views, lasting), view

    def _is_reported(self, by: Identity | None, views, lasting) -> bool:
        """Whether what explains it is a fault, or is explained by one, or waits for hours."""
        if by is None:
            return False
        if by in lasting:
            return True
        view = views[by]
        return view.suppressed in BY_A_PERSON or self._is_reported(view.by, views, lasting)


def started() -> World:
    world = World()
    for robot in (*ROBOTS, UPLINK):
        labels = {"site": "hall"} if robot == UPLINK else {"site": "hall", "uplink": UPLINK}
        how = RobotSettings(labels, CONFIRM)
        world.engine(
            lambda faults, now, robot=robot, how=how: faults.configure_robot(
                robot, how, now, declared=True
            )
        )
    world.engine(back(UPLINK))
    for robot in ROBOTS:
        world.back(robot)
        world.engine(
            lambda faults, now, robot=robot: faults.configure_capabilities(
                robot, [VIEW, DRIVING], now
            )
        )
    return world


# Each is a mistake that was made once.
UPPER_THEN_LOWER = [
    (10, ("array", "r1", {"lidar upper": ERROR}), False),
    (2, ("array", "r1", {"lidar lower": STALE}), False),
]
NO_RESERVE_FOR_A_MINUTE = [
    (10, ("array", "r1", {"lidar upper": ERROR}), False),
    (60, ("array", "r1", {"lidar lower": STALE}), False),
]
ERROR_BEFORE_PLANNED_STALE = [
    (10, ("flash", "r1", "board", 3, STALE), False),
    (10, ("array", "r1", {"lidar upper": ERROR, "lidar lower": OK}), False),
]


@settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(histories)
@example(UPPER_THEN_LOWER)
@example(NO_RESERVE_FOR_A_MINUTE)
@example(ERROR_BEFORE_PLANNED_STALE)
def test_whatever_is_freshly_error_is_a_fault_or_a_lasting_fault_explains_it(history):
    world = started()
    for seconds, (what, *how), reborn in history:
        world.second += seconds
        world.engine()
        world.check()
        if reborn:
            world.player.reborn(world.second)
        getattr(world, what)(*how)
    world.second += 600
    world.engine()
    world.check()
    world.player.write(world.second)
    assert world.player.faults.restore([], world.player.at(world.second)) == []


@pytest.mark.parametrize("standing", EffectiveVerdict)
def test_every_standing_has_its_effects(standing):
    effect = EFFECTS[standing]
    is_failing, is_healthy = (
        standing is EffectiveVerdict.FAILING,
        standing is EffectiveVerdict.HEALTHY,
    )
    assert effect.counts is effect.begins is is_failing
    assert effect.ends is is_healthy
    assert effect.explains == {
        EffectiveVerdict.FAILING: "as a problem",
        EffectiveVerdict.NO_DATA: "as a fault",
    }.get(standing, "never")
