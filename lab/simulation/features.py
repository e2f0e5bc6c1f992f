"""A small fleet that uses every feature at once, and what holds of it whatever happens.

The features meet at random: capabilities, dependencies, planned STALE, uplinks, sites, common
causes, many components, downtimes of robots and of components, hours of warnings, silence, boots,
flapping, values with thresholds, what queries measure, domains that cannot be joined, the
exporter's own parts, a wall clock that is set, restarts at any moment and other settings. What was
delivered is noted in `Truth` and `Charge` of `small_fleet`, which the checks of `verdicts` know
instead of the engine's state. Messages and clocks of robots are in `network`.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from math import inf, isinf
from random import Random
from typing import Any

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    ComponentReport,
    ComponentSettings,
    Identity,
    Scope,
    State,
    ValueReport,
    Verdict,
)
from ros_diagnostics_exporter.model import Level
from simulation.scenes import Step, random_scene
from simulation.small_fleet import (
    BATTERIES,
    BOOT_GRACE,
    CHARGE,
    COMPONENTS,
    CONFIRM,
    FALLS,
    FLEETS,
    HOSTS,
    LEAST_FALL,
    LEVELS,
    LONG,
    LONGEST_STEP,
    MOVED,
    NUMBERS,
    RECENT,
    REPAIRED,
    ROBOTS,
    SETTINGS,
    STEPS,
    THRESHOLDS,
    UPLINK,
    Truth,
    able,
    configured,
    report,
)
from simulation.story import OWN_PARTS
from simulation.verdicts import Delivered
from support.fault_histories import ERROR, OK, STALE, WARN, back, silent


class World(Delivered):
    """What may happen to the fleet."""

    def array(self, robot: str, reported: Mapping[str, Level]) -> None:
        """An array of a robot, if it is received."""
        if robot not in self.up:
            return
        self.engine()  # what was due before it
        for name, level in reported.items():
            known = self.truth.setdefault((robot, name), Truth())
            if level != known.level or not known.fresh:
                known.since, known.before = self.second, 0.0
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
            report(
                *(name, self.truth[robot, name], level),
                is_first=(robot, name) not in self.received,
            )
            for name, level in reported.items()
        ]
        # One that is STALE is not received yet, as in `RobotReports`.
        self.received.update((robot, name) for name in reported if reported[name] is not STALE)
        total = len(COMPONENTS)
        self.engine(lambda faults, now: faults.components_changed(robot, reports, total, now))
        if self.taken_out.get(robot) in reported:
            del self.taken_out[robot]
            self.engine(able(robot))  # with what is a part again

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
        known.brief.append(self.second)
        if self._is_fault(robot, name):
            known.brief.clear()  # people know of what is wrong
        if STALE not in (level, known.told):
            known.sure.append(self.second)
            known.dated.append(self.second)
        known.told = level

    def _is_fault(self, robot: str, name: str) -> bool:
        """Whether its level or its flapping is one, and it is not intermittent as well."""
        scopes = (Scope.COMPONENT, Scope.FLAPPING)
        states = {
            each.state
            for each in self.lasting
            if each.scope in scopes and (each.robot, each.component) == (robot, name)
        }
        return bool(states) and State.INTERMITTENT not in states

    def move(self, robot: str, times: int) -> None:
        """An aggregator has a component in another group: its faults end there and begin here.

        Before it, the component changes so many times, and once after it.
        """
        if robot not in self.up:
            return
        self.flaps(robot, MOVED, times, 1, ERROR)
        self.engine()  # what was due before it
        known = self.truth[robot, MOVED]
        old, known.group = ComponentName(known.group, MOVED), "" if known.group else "moved"
        new = ComponentName(known.group, MOVED)
        changes = self.player.go(
            self.second, lambda faults, now: faults.component_moved(robot, old, new, now)
        )
        moved = {
            each: each._replace(group=known.group)
            for each in self.lasting
            if (each.robot, each.component) == (robot, MOVED)
        }
        found = {(what, fault.identity) for what, fault, _at in changes}
        ended, begun = (
            {(what, each) for each in identities}
            for what, identities in (("removed", moved), ("began", moved.values()))
        )
        assert found == ended | begun, f"{found} of {moved}"
        self.lasting = self.lasting - moved.keys() | set(moved.values())
        self.began_at.update({to: self.began_at[each] for each, to in moved.items()})
        known.since = self.second
        self.array(robot, {MOVED: ERROR if known.level is OK else OK})

    def measure(self, chosen: Iterable[str], measured: Mapping[str, Level]) -> None:
        """What queries measure of robots, if these are received."""
        for robot in sorted(chosen):
            self.array(robot, measured)

    def cut_off(self, chosen: Iterable[str], is_so: bool) -> None:
        """The domain of robots cannot be joined, or can again."""
        self.engine()  # what was due before it
        self.cut = self.cut | set(chosen) if is_so else self.cut - set(chosen)
        self.cut_at = self.second
        for (robot, name), known in self.truth.items():
            if robot in chosen and name in HOSTS:
                known.since = self.second
        self._report_cut(chosen)

    def _report_cut(self, chosen: Iterable[str]) -> None:
        changed = {robot: robot in self.cut for robot in sorted(chosen)}
        self.engine(lambda faults, now: faults.cut_off(changed, now))

    def charge(self, robot: str, number: float | None) -> None:
        """The charge of a robot's battery, if it is received."""
        if robot not in self.up:
            return
        self.engine()  # what was due before it
        self._report_charge(robot, number)

    def thresholds(self, robot: str, number: int) -> None:
        """So many thresholds of the charge are in fleet.yml: with 2 none is low and critical."""
        if robot not in self.up:
            return
        self.engine()  # what was due before it
        charge = self.charges[robot]
        charge.thresholds = THRESHOLDS[:number]
        if not charge.may_fall:
            charge.below.pop("critical", None)
        self._report_charge(robot, charge.number)
        gone = (State.CRITICAL, State.FALLING)
        left = [
            each
            for each in self.lasting
            if (each.scope, each.robot) == (Scope.VALUE, robot) and each.state in gone
        ]
        assert charge.may_fall or not left, f"has no threshold, and lasts: {left}"

    def counts(self, robot: str, is_so: bool) -> None:
        """A condition of fleet.yml lets the charge of a robot be a fault, or keeps it from that."""
        if robot not in self.up:
            return
        self.engine()  # what was due before it
        self.charges[robot].counts = is_so
        self._report_charge(robot, self.charges[robot].number)

    def falls(self, robot: str, how: tuple[float, float], last: float, counts: bool) -> None:
        """A charge is level for as long as its trend is, falls, and is level again."""
        high, low = how
        charge, step = self.charges[robot], self.step
        if robot not in self.up or step == LONGEST_STEP:
            return
        self.counts(robot, counts)
        self.charge(robot, high)
        self.second += LONGEST_STEP + (STEPS + 2) * step  # the next sample may be by others
        self.engine()
        self.check()
        self.charge(robot, low)
        self.second += 7 * step
        self.engine()
        self.check()
        if charge.counts and charge.may_fall and high - low > LEAST_FALL:
            falling = Identity(Scope.VALUE, State.FALLING, robot=robot, component=CHARGE[0])
            self._assert_seen(falling._replace(key=CHARGE[1], bound="low"))
        self.charge(robot, last)
        self.second += (STEPS + 2) * step
        self.engine()
        self.check()

    def _assert_seen(self, identity: Identity) -> None:
        views = self.player.faults.problems(self.player.at(self.second))
        assert any(each.identity == identity for each in views), f"is not seen: {identity}"

    def _report_charge(self, robot: str, number: float | None, *, is_first: bool = False) -> None:
        charge = self.charges[robot]
        charge.take(number, self.second)
        charge.follow(self.second, self.step)
        if charge.known and is_first and robot in self.booted:
            charge.boots = self.booted[robot]
        if not charge.below:
            charge.boots = 0.0
        most = Verdict.FAILING if charge.counts else Verdict.NO_DATA
        value = ValueReport(CHARGE[1], number, charge.thresholds, most, is_first=is_first)
        name = ComponentName("", CHARGE[0])
        self.engine(lambda faults, now: faults.values_changed(robot, name, BATTERIES, [value], now))

    def flaps(self, robot: str, name: str, times: int, period: int, to: Level) -> None:
        """A component changes so many times, each so many seconds after the other."""
        for number in range(times):
            self.array(robot, {name: OK if number % 2 else to})
            self.second += period
            self.engine()
            self.check()

    def comes_and_goes(self, robot: str, name: str) -> None:
        """A component fails twice for a moment, and later its robot is silent for a minute."""
        self.flaps(robot, name, 4, 3, ERROR)
        self.second += RECENT
        self.engine()
        self.check()
        self.silent({robot})
        self.second += RECENT
        self.engine()
        self.back(robot)

    def wait(self, seconds: int) -> None:
        """Nothing happens for some seconds."""
        self.second += seconds
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
                self.charges[robot].drop(self.second)
            self.up.discard(robot)
            for (owner, _name), known in self.truth.items():
                known.fresh = known.fresh and owner != robot
            self.engine(silent(robot))

    def back(self, robot: str, *, boots: bool = True) -> None:
        """A robot is received again, as it was."""
        if robot in self.up:
            return
        self.up.add(robot)
        self.back_at[robot] = self.second
        self.received = {each for each in self.received if each[0] != robot}
        self.booted.pop(robot, None)
        if boots and robot in BOOT_GRACE:
            self.booted[robot] = self.second + BOOT_GRACE[robot]
        silence = self.second - self.silent_since.pop(robot, self.second)
        intermittent = {
            (each.robot, each.component)
            for each in self.lasting
            if each.state is State.INTERMITTENT
        }
        for (owner, name), part in self.truth.items():
            if owner == robot:  # in which nothing comes to rest
                part.changes = [each + silence for each in part.changes]
                part.sure = [each + silence for each in part.sure]
            if (owner, name) in intermittent and owner == robot:
                begin = self.second - silence - self.player.settings.intermittent.within
                part.dated = [self.second for each in part.dated if each > begin]
        self.engine(back(robot))
        known = {name: Truth().level for name in COMPONENTS}
        known |= {name: each.level for (owner, name), each in self.truth.items() if owner == robot}
        self.array(robot, known)
        self._report_charge(robot, self.charges[robot].number, is_first=boots)

    def uplink(self, level: Level) -> None:
        """What a query measures of the uplink of all robots."""
        how = ComponentSettings(CONFIRM, measured=True, uplink=True)
        known = self.truth.setdefault((UPLINK, "ping"), Truth())
        self._note_change(UPLINK, "ping", level)
        known.level, known.fresh = level, True
        known.since = self.second
        ping = ComponentReport(ComponentName("", "ping"), level, how)
        self.engine(lambda faults, now: faults.components_changed(UPLINK, [ping], 1, now))

    def downtime(self, robot: str, planned: bool) -> None:
        """The planned downtime of a robot begins or ends."""
        self.engine()  # what was due before it
        self._begin_anew(robot)
        (self.planned.add if planned else self.planned.discard)(robot)
        self.engine(lambda faults, now: faults.maintenance({robot: planned}, now))

    def downtime_of(self, robot: str, chosen: Iterable[str]) -> None:
        """Just these components of a robot are in a planned downtime."""
        self.engine()  # what was due before it
        self._begin_anew(robot)
        self.planned_parts[robot] = frozenset(chosen)
        self.engine(
            lambda faults, now: faults.components_in_maintenance(robot, frozenset(chosen), now)
        )

    def _begin_anew(self, robot: str) -> None:
        self.charges[robot].since = self.planned_at[robot] = self.second
        for (owner, _name), known in self.truth.items():
            if owner == robot:
                if robot not in self.planned:
                    known.before = self.second - known.since
                known.since = self.second

    def restart(self) -> None:
        """The exporter is started again, and receives all robots at once."""
        up = sorted(self.up)
        self.grace = self.second + self.player.settings.restart_grace
        # Before time passes, as of what was restored nothing is known yet.
        self._changed(self.player.faults.started(self.player.at(self.second), 0.0))
        self._report_own()
        self._report_cut(self.cut)
        for each in up:
            self.charges[each].drop(self.second)
        self.up.clear()
        for (_robot, name), known in self.truth.items():
            known.fresh = False
            if known.level is STALE and name in SETTINGS and SETTINGS[name].planned_stale:
                known.boots = 0.0  # it is at rest: of such a one nothing is written
        self.engine(back(UPLINK))
        for robot in up:
            self.back(robot, boots=False)

    def reborn(self) -> None:
        """Another process goes on from the rows, with the same fleet.yml."""
        self.player.reborn(self.second)
        self._forget_times()
        for charge in self.charges.values():
            charge.first, charge.timer = -inf, -inf
        # With the clock set, restart_grace of the rows is another; a start begins it anew.
        if self.own.is_in_trouble or self.cut or self.clock_set_at > -inf:
            self.restart()
        self.configure()

    def _forget_times(self) -> None:
        """What was written before the wall clock was set may count as earlier, or from now on."""
        if self.clock_set_at == -inf:
            return
        for known in self.truth.values():
            known.since, known.boots, known.sure, known.dated = self.second, 0.0, [], []
            if known.wrong <= self.clock_set_at:
                known.wrong = -inf
            known.changes = [self.second for _ in known.changes]
            known.brief = [self.second for _ in known.brief]
        for charge in self.charges.values():
            charge.forget_times(self.second, self.clock_set_at)

    def clock(self, seconds: float) -> None:
        """The exporter's wall clock is set."""
        self.engine()  # what was due before it
        self.player.clock_set += seconds
        self.clock_set_at = self.second

    def forget(self, robot: str, name: str) -> None:
        """A person takes out a component, which is new if its robot reports it again."""
        self.engine()  # what was due before it
        self.forgotten, self.taken_at[robot] = (robot, name), self.second
        former = self.truth.pop((robot, name), Truth())
        component = ComponentName(former.group, name)
        self.engine(lambda faults, now: faults.forget_component(robot, component, now))
        left = {each for each in self.lasting if (each.robot, each.component) == self.forgotten}
        assert not left, f"was taken out, and lasts: {left}"
        self.forgotten = None
        self.received.discard((robot, name))
        self.taken_out[robot] = name
        if name in COMPONENTS:
            self.array(robot, {name: former.level})
        elif robot in self.up:
            charge = self.charges[robot]
            charge.below, charge.boots = {}, 0.0
            charge.drop(self.second)
            self._report_charge(robot, charge.number)

    def own_part(self, part: str, level: Level | None) -> None:
        """A part of the exporter is so from now on; None: there is none any more."""
        self.engine()  # what was due before it
        self.own.set(part, level)
        self._report_own()
        assert level is not None or all(each.component != part for each in self.lasting), part

    def restart_without(self, part: str) -> None:
        """The exporter is started again, and has a part no more."""
        self.engine()  # what was due before it
        self.own.set(part, None)
        self.reborn()
        self.own_part(part, None)

    def _report_own(self) -> None:
        reports = self.own.reports(self.second)
        self.engine(lambda faults, now: faults.own(reports, now))

    def configure(self) -> None:
        """The robots and what they can do, by fleet.yml."""
        self.engine(*map(configured, (*ROBOTS, UPLINK)), *map(able, (*ROBOTS, None)))

    def fleet(self, how: FaultSettings) -> None:
        """Other settings of the whole fleet."""
        before, self.player.settings = self.step, how
        self.engine(lambda faults, now: faults.configure(how, now))
        if self.step == before:
            return
        is_back = self.step_before == (self.second, self.step)  # no sample was taken by another
        self.step_before = self.second, before
        for charge in self.charges.values():
            if not isinf(charge.first):
                first = charge.first_before if is_back else self.second
                charge.first, charge.first_before = first, charge.first

    def repair(self) -> None:
        """All is OK, received, and in no downtime."""
        self.uplink(OK)
        for part in OWN_PARTS:
            self.own_part(part, OK)
        self.cut_off(ROBOTS, is_so=False)
        for robot in ROBOTS:
            self.downtime(robot, planned=False)
            self.downtime_of(robot, ())
            self.back(robot)
            self.all_of(robot, OK)
            self.measure((robot,), dict.fromkeys(HOSTS, OK))
            self.thresholds(robot, len(THRESHOLDS))
            self.counts(robot, is_so=True)
            self.charge(robot, 80.0)


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


def random_history(seed: int, *, rounds: int = 3) -> Iterator[Step]:
    """Up to a hundred steps: the same for the same arguments.

    With fewer ``rounds``: those of the features of the first ones, which are the same in all.
    """
    random, more, scenes = Random(seed), Random(f"extra {seed}"), Random(f"scenes {seed}")
    for _ in range(random.randrange(4, 30)):
        yield _random_seconds(random), _random_event(random), random.random() < 0.3
        while rounds > 1 and more.random() < 0.4:
            yield _random_seconds(more), _extra_event(more), more.random() < 0.2
        if rounds > 2 and scenes.random() < 0.15:
            yield from random_scene(scenes)


def _random_seconds(random: Random) -> int:
    return random.choice((0, 1, 5, 12, 30, 60, 90))


def _extra_event(random: Random) -> tuple[Any, ...]:
    robot, name = random.choice(ROBOTS), random.choice(list(COMPONENTS))
    times, period = random.randrange(2, 20), random.choice((1, 1, 3, 8, 16))
    charge = ("charge", robot, random.choice(NUMBERS))
    some = random.sample(ROBOTS, random.choice((1, 1, 3, 4)))
    measured = dict.fromkeys(random.sample(list(HOSTS), random.randrange(1, 4)))
    part, often = random.choice(list(OWN_PARTS)), random.random() < 0.7
    return random.choice(
        (
            *(charge, charge, charge),
            ("flaps", robot, name, times, period, random.choice((WARN, ERROR))),
            ("flaps", robot, random.choice(list(HOSTS)), random.randrange(2, 7), period, ERROR),
            ("forget", robot, random.choice((name, CHARGE[0]))),
            ("everywhere_but", robot, name),
            ("outage", robot),
            ("clock", random.choice((-3600.0, -30.0, 30.0, 3600.0, 5 * 86_400.0))),
            ("own_part", part, random.choice((OK, WARN, ERROR, STALE, None))),
            ("restart_without", part),
            *(("measure", some, dict.fromkeys(measured, random.choice(LEVELS))),) * 2,
            ("cut_off", some, random.random() < 0.5),
            ("wait", random.choice((300, 700))),
            ("move", robot, random.choice((0, 14))),
            ("comes_and_goes", robot, random.choice(list(SETTINGS))),
            ("thresholds", robot, random.choice((2, 3, 3))),
            ("counts", robot, random.random() < 0.6),
            *(("falls", robot, random.choice(FALLS), random.choice((9.0, 50.0)), often),) * 2,
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
