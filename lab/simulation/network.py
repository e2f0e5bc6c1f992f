"""Robots behind a bad network, clocks that are set, a process that pauses; what holds whatever.

Messages are lost, delayed, doubled and reordered; a robot is switched off, its components are mute;
the clocks of robots and of the exporter are set, its process stands still or is started again, and
its disk is full: then a later process knows what was written before that. Some robots and
components are received for the first time only later, and what the fleet can do rests on them.
What arrived at the exporter's machine, and what its process took of it, is noted here.
"""

from __future__ import annotations

import heapq
import sqlite3
import tempfile
from collections.abc import Iterator
from copy import deepcopy
from dataclasses import dataclass, field
from itertools import count
from math import inf
from pathlib import Path
from random import Random
from statistics import median
from typing import Any

from ros_diagnostics_exporter.config.capabilities import (
    Capability,
    ComponentsOf,
    Expression,
    FleetCapability,
    RobotsOf,
)
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source, ValueRule
from ros_diagnostics_exporter.events import Event, EventLog
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.loops import Clocks
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.storage.database import Database
from ros_diagnostics_exporter.storage.storage import Storage
from simulation.small_fleet import CONFIRM, FEWEST, Charge
from support.fault_histories import BATTERY
from support.state_driver import ERROR, OK, STALE, WALL, WARN, tree

ROBOTS = ("r1", "r2", "r3", "r4")  # the even ones with an aggregator
COMPONENTS = ("battery", "motor", "imu")
DRIVES = "imu"  # the component that a robot needs to drive
DRIVING = 2  # robots that have to
STALE_AFTER = 10.0
LATE = 2.5  # seconds by which turns may be late
LIMIT = 5.0  # seconds by which a clock may differ
ENOUGH_CLOCKS = 3  # robots that tell the exporter's clock from one of theirs
RIGHT = 4.0  # seconds by which a clock that was wrong may differ and is no longer
CLOCK_TIME = 60.0  # seconds for which a clock has to be wrong
KEPT = 10  # messages of a robot that wait for a process that pauses
TEXTS = {"50": 50.0, "20.2": 20.2, "15,5": 15.5, "9.5": 9.5, "nan": None, "n/a": None, "": None}
# What no longer reports is still an ERROR or a WARNING.
STATES = {"critical": (ERROR, STALE), "stale": (STALE,), "warning": (WARN, STALE)}
WORSE = {"critical": (ERROR,), "stale": (ERROR, STALE), "warning": (ERROR, WARN, STALE)}
QUIET = 150  # seconds after which whatever is wrong is a fault
REPAIRED = 1500  # ... and after which nothing is, since all was repaired
_REPAIRED = ("levels", "mute", "text", "clock", "off", "lost", "delay", "double")


@dataclass
class Part:
    """What the process took of a component last; times are those in which it ran."""

    level: int = OK
    ok_at: float = 0.0  # when it was last OK
    at: float = 0.0  # when anything was taken
    changes: int = 0  # at most: each gap may be STALE and back
    is_new: bool = True  # it was never taken


@dataclass
class Clock:
    """When a clock was last right: ``perhaps``, and for long enough that it is surely seen.

    Clocks are looked at once a second, so that one turn may be missed.
    """

    perhaps: float = 0.0
    surely: float = 0.0
    _was_right: bool = False

    def note(self, at: float, *, is_right: bool, may_be_right: bool) -> None:
        """Note whether it is right in this turn."""
        if may_be_right:
            self.perhaps = at
        if is_right and self._was_right:
            self.surely = at
        self._was_right = is_right


@dataclass
class Sender:
    """A robot as it is, what its network does, and what came of it.

    ``lost`` and ``double`` are shares of its messages, ``delay`` the most seconds of each.
    """

    name: str
    levels: dict[str, int] = field(default_factory=lambda: dict.fromkeys(COMPONENTS, OK))
    mute: set[str] = field(default_factory=set)
    text: str = "50"  # of the charge; "" where the key is missing
    clock: float = 0.0
    off: bool = False
    lost: float = 0.0
    delay: float = 0.0
    double: float = 0.0
    arrived: float = 0.0  # when the last message did, by a clock that nobody sets
    gaps: int = 0  # between two arrivals, each as long as a silence
    away: float = 0.0  # the longest time between two arrivals since the process last took any
    parts: dict[str, Part] = field(default_factory=lambda: {each: Part() for each in COMPONENTS})
    charge: Charge = field(default_factory=Charge)
    taken: float = 0.0  # when the process took the last message
    offset: float = 0.0  # of that message
    clock_right: Clock = field(default_factory=Clock)  # by that
    wrong_at: float = 0.0  # when its clock was last wrong, while it was received

    @property
    def is_raw(self) -> bool:
        """Whether its drivers are received, and no aggregator."""
        return int(self.name[1:]) % 2 == 1

    @property
    def is_new(self) -> bool:
        """Whether nothing of it was ever taken."""
        return all(each.is_new for each in self.parts.values())

    def arrays(self) -> Iterator[tuple[Status, ...]]:
        """What it publishes in a second."""
        pairs = {"battery": (("charge", self.text),) if self.text else ()}
        rows = [
            Status(level, name, "m", "", pairs.get(name, ()))
            for name, level in self.levels.items()
            if name not in self.mute
        ]
        if self.is_raw:
            yield from ((each,) for each in rows)
        else:
            yield tree(g=rows)


class Disk(Storage):
    """The database of one process, on a disk that may be full."""

    is_full = False

    def _open(self) -> Database:
        if self.is_full:
            raise sqlite3.OperationalError("database or disk is full")
        return super()._open()

    def _log_dropped(self, dropped: list[str]) -> None:
        assert not dropped, dropped


class Site:
    """The robots, the network, and the process; times are seconds since the begin.

    ``time`` is that of a clock that nobody sets, ``ran`` for how long the process ran: of a pause
    as much counts as `Clocks` says.
    """

    def __init__(self, random: Random, folder: Path, *, drives: bool) -> None:
        self._random, self._drives = random, drives
        self.time = self.ran = 0.0
        self.robots = {name: Sender(name) for name in ROBOTS}
        self._wall = 0.0  # seconds by which the exporter's clock was set
        # Until rows are restored by a clock that was set, or that are not the last ones.
        self._is_exact = True
        self._under_way: list[tuple[float, int, str, float, tuple[Status, ...]]] = []
        self._numbers = count()
        self._waiting: dict[str, list[tuple[float, tuple[Status, ...]]]] = {}
        self._stands_until = self._last_turn = 0.0
        self._stood = 0.0  # seconds of its pauses that do not count, since it was started
        self.doubts = False  # its own clock is known to be wrong
        self._own_clock = Clock()  # by most robots
        self._enough_at = 0.0  # when enough robots to tell were received
        self._began = 0.0  # the process
        self._disk = Disk(folder / "state.db")
        # As written: by robot its charge, and the components that were never taken.
        self._written: dict[str, tuple[Charge, set[str]]] = {}
        self._start()

    def _start(self) -> None:
        self._clocks = Clocks(lambda: self.time)
        self._clocks.keep_watch()
        self._state = FleetState(_fleet(drives=self._drives), self._now())
        self._waiting, self._last_turn = {}, self.time

    def _now(self) -> Instant:
        return Instant(self._clocks.read().mono, WALL + self.time + self._wall)

    # -- what happens ------------------------------------------------------------------------

    def go(self, seconds: float, step: float = 1.0) -> None:
        """Let time pass."""
        end = self.time + seconds
        while self.time < end:
            self.time += step
            for robot in self.robots.values():
                self._publish(robot)
            self._arrive()
            if self.time >= self._stands_until:
                self._turn()

    def begin(self) -> None:
        """Some robots are switched on later, and some drivers start later."""
        for robot in self.robots.values():
            robot.off = self._random.random() < 0.3
            robot.mute = {each for each in COMPONENTS if self._random.random() < 0.3}

    def change(self, robot: str, how: dict[str, Any]) -> None:
        """Something about a robot, or about its network, is another from now on."""
        for name, value in how.items():
            setattr(self.robots[robot], name, value)

    def level(self, robot: str, component: str, level: int) -> None:
        """A component has another level."""
        self.robots[robot].levels[component] = level

    def mute(self, robot: str, component: str) -> None:
        """A component reports no more, or reports again."""
        self.robots[robot].mute ^= {component}

    def flaps(self, robot: str, component: str, times: int, period: int) -> None:
        """A component changes so many times, each so many seconds after the other."""
        for number in range(times):
            self.level(robot, component, OK if number % 2 else ERROR)
            self.go(period)

    def pause(self, seconds: float) -> None:
        """The process stands still."""
        self._stands_until = self.time + seconds
        self.go(seconds)

    def restart(self, seconds: float) -> None:
        """The process ends, and another goes on with what it has written."""
        is_full = self._disk.is_full
        self._write()
        self._disk.close()
        self._stands_until = inf
        self.go(seconds)
        self._stands_until = 0.0
        self._start()
        self._is_exact = self._is_exact and self._wall == 0.0 and not is_full
        self._disk = Disk(self._disk.path)
        self._disk.load(self._state, self._now())
        self._disk.is_full = is_full
        for name, (charge, new) in self._written.items():
            self.robots[name].charge = deepcopy(charge)
            for component, part in self.robots[name].parts.items():
                part.is_new = component in new
        self.doubts = self._doubts_itself
        self.ran += seconds + self._stood  # what was written has the time of day alone
        self._began, self._stood = self.ran, 0.0

    def full_disk(self, is_so: bool) -> None:
        """Nothing can be written from now on, or it can again."""
        self._write()
        self._disk.is_full = is_so

    def _write(self) -> None:
        self._disk.save(self._state, EventLog(), self._now(), at_once=True)
        assert self._disk.successful is not self._disk.is_full
        if not self._disk.is_full:
            self._written = {
                name: (
                    deepcopy(each.charge),
                    {component for component, part in each.parts.items() if part.is_new},
                )
                for name, each in self.robots.items()
            }

    def clock(self, seconds: float) -> None:
        """The exporter's wall clock is set."""
        self._wall += seconds

    def repair(self) -> None:
        """All is well again."""
        self._wall = 0.0
        for name in ROBOTS:
            well = vars(Sender(name))
            self.change(name, {each: well[each] for each in _REPAIRED})

    # -- the network and the process ---------------------------------------------------------

    def _publish(self, robot: Sender) -> None:
        random, stamp = self._random, WALL + self.time + robot.clock
        for statuses in () if robot.off else robot.arrays():
            if random.random() < robot.lost:
                continue
            for _ in range(1 + (random.random() < robot.double)):
                at = self.time + random.uniform(0.0, robot.delay)
                message = at, next(self._numbers), robot.name, stamp, statuses
                heapq.heappush(self._under_way, message)

    def _arrive(self) -> None:
        while self._under_way and self._under_way[0][0] <= self.time:
            at, _number, name, stamp, statuses = heapq.heappop(self._under_way)
            robot = self.robots[name]
            robot.gaps += at - robot.arrived > STALE_AFTER
            robot.away = max(robot.away, at - robot.arrived)
            robot.arrived = at
            kept = self._waiting.setdefault(name, [])[-KEPT:]
            self._waiting[name] = [*kept, (stamp, statuses)]

    def _turn(self) -> None:
        """The process lets time pass and takes what waits for it, in any order."""
        passed = self.time - self._last_turn
        self.ran += min(passed, Clocks.LONGEST)
        self._stood += max(passed - Clocks.LONGEST, 0.0)
        self._last_turn, now = self.time, self._now()
        if self._random.random() < 0.5:
            if any(self._may_be_right()):  # by those that did not just fall silent
                self._own_clock.perhaps = self.ran
            self._state.tick(now)
            self._check()
        waiting, self._waiting = self._waiting, {}
        for name, messages in waiting.items():
            for stamp, statuses in messages:
                self._take(self.robots[name], Array(stamp, statuses, 100), now)
        self._note_clocks()
        self._state.tick(now)
        self._check()
        if self._disk.is_full:
            self._write()
        for robot in self.robots.values():
            robot.away = 0.0

    def _take(self, robot: Sender, array: Array, now: Instant) -> None:
        # As `receive` does first: what was due begins by what was taken before.
        self._state._faults.advance(now)
        self._check()
        robot.taken, robot.offset = self.ran, now.wall - array.stamp
        found = {each.name.rpartition("/")[2]: each for each in array.statuses}
        for name in found.keys() & robot.parts if robot.is_raw else COMPONENTS:
            _note(robot, name, found.get(name), self.ran)
        topic = "diagnostics" if robot.is_raw else "diagnostics_agg"
        self._state.receive(Topic(0, f"/{robot.name}/{topic}"), array, now)
        self._check()

    def _note_clocks(self) -> None:
        """Note which clocks may be right, by what was taken last of each robot."""
        right = self._may_be_right()
        self._own_clock.note(self.ran, is_right=all(right), may_be_right=any(right))
        received = [each for each in self.robots.values() if self._is_received(each)]
        if len(received) >= ENOUGH_CLOCKS:
            self._enough_at = self.ran
        for robot in self.robots.values():
            is_right = abs(robot.offset) <= RIGHT
            if robot.taken >= self._began:  # of another process, nothing is known
                robot.clock_right.note(self.ran, is_right=is_right, may_be_right=is_right)
            if robot in received and not is_right:
                robot.wrong_at = self.ran

    def _is_received(self, robot: Sender) -> bool:
        return self.ran - robot.taken <= STALE_AFTER + LATE

    def _may_be_right(self) -> list[bool]:
        """Whether its own clock is, by each set of robots that it may go by."""
        return [self._is_right(late, begin) for late in (0.0, LATE) for begin in (0.0, self._began)]

    def _is_right(self, late: float, since: float) -> bool:
        """Whether its own clock is, by the robots that are received or fell silent so lately.

        And that were received after ``since``: another process knows of no others.
        """
        first = max(self.ran - STALE_AFTER - late, since)
        offsets = [each.offset for each in self.robots.values() if each.taken >= first]
        return len(offsets) >= ENOUGH_CLOCKS and abs(median(offsets)) <= RIGHT

    # -- what holds --------------------------------------------------------------------------

    def _check(self) -> None:
        for event in self._state.take_events():
            if event.kind not in ("fault_began", "fault_ended"):
                continue
            robot = self.robots.get(event.robot)
            if event.scope == "capability" and event.kind == "fault_began":
                self._check_driving(robot, event)
            elif robot is None and event.scope != "capability":
                self._check_own_clock(event)
            elif event.kind == "fault_began":
                wrong = robot and _wrong_begin(self, robot, event)
                assert not wrong, (wrong, self.time, event)
            else:
                assert event.reason == "recovered", event
                wrong = robot and _wrong_end(self, robot, event)
                assert not wrong, (wrong, self.time, event)

    def _check_own_clock(self, event: Event) -> None:
        assert (event.scope, event.component) == ("exporter", "clock"), event
        self.doubts = event.kind == "fault_began"
        if self.doubts:
            assert self.is_due(self._own_clock.surely, CLOCK_TIME), (self.time, event)
            assert self._enough_at >= self.ran - LATE, (self.time, event)
        else:
            assert self._own_clock.perhaps >= self.ran - LATE, (self.time, event)

    def _check_driving(self, robot: Sender | None, event: Event) -> None:
        """What a robot, or (None) the fleet, cannot do; what was never received is not lost."""
        robots = [robot] if robot else [*self.robots.values()]
        needed = 1 if robot else len(robots) - DRIVING + (event.state != "no_reserve")
        lacking = [each.name for each in robots if self.may_not_drive(each)]
        assert len(lacking) >= needed, (lacking, self.time, event)

    def may_not_drive(self, robot: Sender) -> bool:
        """Whether a robot cannot drive, or nobody knows any more whether it can."""
        part = robot.parts[DRIVES]
        is_silent = robot.arrived > 0.0 and self.is_away(robot)  # with whatever it sent
        is_bad = part.level != OK or self.is_late(part)
        may_flap = self.most_changes(part) >= FEWEST  # whatever it says at the moment
        is_failing = may_flap or (is_bad and self.is_due(part.ok_at, CONFIRM))
        return is_silent or (not part.is_new and is_failing)

    def most_changes(self, part: Part) -> int:
        """How often it may have changed by now."""
        return part.changes + self.is_late(part)

    def is_late(self, part: Part) -> bool:
        """Whether nothing was taken of it for so long that it may be STALE."""
        return self.ran - part.at > STALE_AFTER / 4

    def is_away(self, robot: Sender) -> bool:
        """Whether nothing arrived of it for so long that it may be silent."""
        away = max(self.time - robot.arrived, robot.away)
        return away >= STALE_AFTER + CONFIRM - LATE

    def is_due(self, since: float, confirm_after: float) -> bool:
        """Whether a problem may be a fault that was not there at that time."""
        return not self._is_exact or self.ran >= since + confirm_after - LATE

    def check_end(self) -> None:
        """Whatever is wrong is a fault in time, and once it is repaired nothing is."""
        for robot in self.robots.values():
            self.change(robot.name, {"lost": 0.0, "delay": 0.0, "double": 0.0})
        self.go(QUIET)
        found = {each[1:] for each in self._state_faults()}
        wanted = set(self._wanted())
        assert wanted <= found, wanted - found
        self.repair()
        end = self.time + REPAIRED
        while self.time < end and self._state_faults():
            self.go(20, Clocks.LONGEST)
        assert not self._state_faults(), self._state_faults()

    @property
    def _doubts_itself(self) -> bool:
        """Whether there is a fault of the exporter's own clock."""
        return any(each[2:] == ("", "clock") for each in self._state_faults())

    def _state_faults(self) -> set[tuple[str, str, str, str]]:
        found = (each.identity for each in self._state.faults())
        return {(each.scope, each.state, each.robot, each.component) for each in found}

    def _wanted(self) -> Iterator[tuple[str, str, str]]:
        """State, robot and component of the faults that there have to be."""
        found = {each[1:] for each in self._state_faults()}
        own = self._doubts_itself
        for name, robot in self.robots.items():
            if robot.off or (robot.is_raw and len(robot.mute) == len(COMPONENTS)):
                flaps = ("flapping", name, "") in found
                if not robot.is_new:
                    yield ("flapping" if flaps else "silent"), name, ""
                continue
            if abs(robot.offset) > LIMIT and not own:
                yield "clock", name, ""
            for component in COMPONENTS:
                level = STALE if component in robot.mute else robot.levels[component]
                flaps = ("flapping", name, component) in found
                is_said = component == DRIVES and ("lost", name, "") in found
                if level == ERROR and not is_said:
                    yield ("flapping" if flaps else "critical"), name, component
            is_judged = robot.charge.known and "battery" not in robot.mute
            below = robot.charge.below if is_judged else ()
            if "critical" in below:
                yield "critical", name, "battery"


def _note(robot: Sender, name: str, status: Status | None, at: float) -> None:
    """Note what the process takes of a component; None: it is missing where all are listed."""
    part = robot.parts[name]
    level = STALE if status is None else status.level
    part.changes += (level != part.level) + 2 * (at - part.at > STALE_AFTER / 4)
    part.level, part.at, part.is_new = level, at, part.is_new and status is None
    if level == OK:
        part.ok_at = at
    if name == "battery":
        text = "" if status is None or level == STALE else dict(status.values).get("charge", "")
        robot.charge.take(TEXTS[text], at)


def _wrong_begin(site: Site, robot: Sender, event: Event) -> str:
    """What is wrong with a fault that began, by what was taken."""
    part = robot.parts.get(event.component)
    if part is None:
        return _wrong_begin_of_robot(site, robot, event)
    if event.scope == "flapping":
        fewest = 4 if event.state == "intermittent" else FEWEST
        changes = site.most_changes(part)
        return "" if changes >= fewest else f"{changes} changes"
    if event.scope == "value" and event.state == "falling":
        return "" if robot.charge.number != robot.charge.highest else "it did not fall"
    if event.scope == "value":
        below = robot.charge.below.get(event.state, inf)
        is_due = robot.charge.known and site.is_due(below, CONFIRM)
        return "" if is_due else f"not below for long enough: {robot.charge}"
    is_late = event.state == "stale" and site.is_late(part)
    if part.level not in STATES[event.state] and not is_late:
        return f"it is {part.level}"
    return "" if site.is_due(part.ok_at, CONFIRM) else "not for long enough"


def _wrong_begin_of_robot(site: Site, robot: Sender, event: Event) -> str:
    if event.state == "pending":
        return "" if robot.is_new else "it was received"
    if event.state == "silent":
        return "" if site.is_away(robot) else "it was just received"
    if event.state == "flapping":
        is_away = site.time - robot.arrived > STALE_AFTER
        enough = 2 * robot.gaps + is_away >= FEWEST
        return "" if enough else f"it was away {robot.gaps} times"
    if event.state == "clock":
        is_due = site.is_due(robot.clock_right.surely, CLOCK_TIME) and not site.doubts
        if not is_due:
            return "its clock was just right, or the exporter's is wrong"
        return "" if robot.wrong_at >= site.ran - LATE else "it is not known to be wrong"
    return "nothing of the kind happened"


def _wrong_end(site: Site, robot: Sender, event: Event) -> str:
    """What is wrong with a fault that recovered, by what was taken."""
    part = robot.parts.get(event.component)
    if site.ran - robot.taken > STALE_AFTER + LATE:
        return "its robot is silent"
    if event.state == "clock":
        return "" if robot.clock_right.perhaps >= site.ran - LATE else "its clock is wrong"
    if part is None or event.scope == "flapping":
        return ""
    if event.scope == "value":
        severity = "critical" if event.state == "falling" else event.state
        is_well = robot.charge.known and severity not in robot.charge.below
        return "" if is_well else f"it is too low: {robot.charge}"
    if site.ran - part.at > STALE_AFTER + LATE:
        return "it is not received"
    return "" if part.level not in WORSE[event.state] else f"it is {part.level}"


def _fleet(*, drives: bool) -> Fleet:
    rule = ValueRule(key=Pattern("charge"), thresholds=BATTERY)
    drive = Capability("drive", Expression(None, (ComponentsOf((Pattern(DRIVES),)),)))
    driving = FleetCapability("driving", Expression(DRIVING, (RobotsOf("drive", {}),)))
    profile = Profile(
        stale_after=STALE_AFTER,
        confirm_after=CONFIRM,
        values=(rule,),
        capabilities={"drive": drive} if drives else {},
    )
    robots = (
        Robot(
            name,
            topic_agg=f"/{name}/diagnostics_agg",
            topic_raw=f"/{name}/diagnostics",
            source=Source.RAW if Sender(name).is_raw else Source.AGG,
            profile=profile,
        )
        for name in ROBOTS
    )
    return Fleet("f", tuple(robots), capabilities={"driving": driving} if drives else {})


def play(seed: int, *, extra: bool = True) -> None:
    """Play what happens, the same for the same arguments.

    Raises:
        AssertionError: something does not hold.
    """
    random = Random(f"network {seed}")
    with tempfile.TemporaryDirectory(prefix="network-") as folder:
        site = Site(random, Path(folder), drives=extra)
        if extra:
            site.begin()
        site.go(40)  # restart_grace
        for what, *how in random_steps(seed, extra=extra):
            getattr(site, what)(*how)
            site.go(random.choice((0, 1, 5, 12, 40)))
        site.check_end()


def random_steps(seed: int, *, extra: bool = True) -> Iterator[tuple[Any, ...]]:
    """Up to twenty steps, and ``extra`` ones, as of a disk that is full."""
    random, more = Random(seed), Random(f"disk {seed}")
    for _ in range(random.randrange(3, 20)):
        while extra and more.random() < 0.2:
            yield more.choice((("full_disk", True), ("full_disk", False), ("restart", 5)))
        robot, component = random.choice(ROBOTS), random.choice(COMPONENTS)
        level = random.choice((OK, WARN, ERROR, ERROR, STALE))
        network = {"lost": random.choice((0.0, 0.2, 0.7)), "double": random.choice((0.0, 0.5))}
        clock = random.choice((0.0, -30.0, 4.5, 6.0, 3600.0))
        yield random.choice(
            (
                *(("level", robot, component, level), ("level", robot, component, level)),
                ("change", robot, {"text": random.choice(list(TEXTS))}),
                ("change", robot, {"off": random.random() < 0.5}),
                ("change", robot, {"clock": clock}),
                ("change", robot, {**network, "delay": random.choice((0.0, 3.0))}),
                ("mute", robot, component),
                ("flaps", robot, component, random.randrange(2, 16), random.choice((1, 4, 12))),
                ("clock", clock),
                *(("pause", random.choice((3, 9, 25, 120))),) * 2,
                ("restart", random.choice((1, 5, 60))),
            )
        )
    # Nothing is known any more of a clock that is wrong, a moment before it is a fault.
    robot = more.choice(ROBOTS)
    if extra and more.random() < 0.5:
        yield "change", robot, {"clock": 3600.0}
        yield "go", 45
        yield "change", robot, {"off": True}
        yield "go", 90
