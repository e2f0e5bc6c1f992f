"""Plays a story: robots that publish, and an exporter that is stopped, started and configured.

What was delivered is noted in `Delivered`, which the checks know instead of the exporter's state.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from random import Random

from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Fleet,
    Maintenance,
    Profile,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.config.fleet import FaultSettings as Settings
from ros_diagnostics_exporter.faults.model import Fault
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_tools.backtest.replay import Restarts
from simulation.can import capabilities, of_fleet
from simulation.own import OwnParts
from simulation.story import (
    COMPONENTS,
    ERROR,
    OK,
    PERIOD,
    STALE,
    TICK,
    WARN,
    Event,
    Story,
    robot_name,
    site_of,
)

LATE = (PERIOD + 2) * TICK  # seconds by which messages and ticks may delay what is due
WALL = 1_700_000_000.0
STALE_AFTER = 1500.0
CONFIRM_AFTER = 1200.0
FLAP_INTERVAL = 1800.0
# Seconds without anything else after which it is clear what is to be: longer than the 21 intervals
# in which changes count as flapping.
CALM = 24 * FLAP_INTERVAL
HYSTERESIS = 0.02
GRACE = 1800.0
LOW = {"warning": 20.0, "critical": 10.0}
BATTERY = COMPONENTS[0]
PENDING_AFTER = 7200.0
SETTINGS = Settings(
    confirm_after=600.0,
    restart_grace=GRACE,
    pending_after=PENDING_AFTER,
    site=CauseSettings(2, 0.5),  # a fleet of ten robots has sites of two
)
OVER = SETTINGS.falling.over  # seconds in which a value is seen to fall
_THRESHOLDS = tuple(Threshold("low", severity, number) for severity, number in LOW.items())
_PROFILE = Profile(
    stale_after=STALE_AFTER,
    confirm_after=CONFIRM_AFTER,
    flap_interval=FLAP_INTERVAL,
    forget_after=1e9,
    values=(ValueRule(key=Pattern("charge"), thresholds=_THRESHOLDS),),
)


@dataclass
class Part:
    """What was delivered of one component. Times are monotonic."""

    level: int = OK  # the last that was published and was not STALE
    received: float = 0.0  # the last array that had it, STALE or not
    stale: bool = False  # it was STALE or missing in the last array of an aggregator
    trouble_since: float | None = None  # at the earliest
    trouble_known: float = 0.0  # when it was received, which is at the latest
    changes: list[float] = field(default_factory=list)
    charge: float = 80.0
    charges: list[tuple[float, float]] = field(default_factory=list)  # when it became another
    touched: float = -1.0  # when it was last delivered, or missing
    before: list[Part] = field(default_factory=list)  # what was known before, in that tick


@dataclass
class Delivered:
    """What was delivered of one robot. Times are monotonic."""

    name: str
    raw: bool
    parts: dict[str, Part] = field(default_factory=dict)
    last: float | None = None
    gap: float = 0.0  # when it last was not received for longer than a period
    quiet: float = 0.0  # when it last was in maintenance, not configured, or otherwise configured


class World:
    """The fleet and its exporter; ``state`` is None while the exporter is stopped."""

    def __init__(self, story: Story) -> None:
        self.story = story
        self.tick = 0
        self.offset = self._offset_before = WALL  # now, and when this tick began
        self.confirm_after = CONFIRM_AFTER
        self.shortest_confirm = CONFIRM_AFTER  # that held since the last tick
        self.robots = [robot_name(number) for number in range(story.robots)]
        self.delivered = {
            name: Delivered(name, raw=n % 2 == 0) for n, name in enumerate(self.robots)
        }
        self._levels = {name: dict.fromkeys(COMPONENTS, OK) for name in self.robots}
        self._charge = dict.fromkeys(self.robots, 80.0)
        self._muted: dict[str, set[str]] = {name: set() for name in self.robots}
        self._off: set[str] = set()
        self._undeclared: set[str] = set()
        self.resized: dict[str, float] = {}  # site -> when the config last had other robots of it
        self._cut: set[str] = set()
        self._network: dict[str, set[str]] = {"lose": set(), "repeat": set(), "swap": set()}
        self._late: dict[str, tuple[Status, ...]] = {}
        self._maintenance: list[Maintenance] = []
        self.own = OwnParts()
        self.fleet = self._fleet()
        self.state: FleetState | None = FleetState(self.fleet, self.now)
        self.restarts = Restarts()
        self.started = 0.0
        self._stopped: tuple[FleetState, Instant] | None = None
        self._starts_at = 0
        self._loses = False
        self.lost = False  # the database, at this tick
        self._lost_at = -1.0  # when it last was, monotonic
        self.firing: Callable[[], list[Fault]] = list  # what Alertmanager has
        self.removed: set[tuple[str, str]] = set()  # by a person or the config, at this tick
        # What was delivered of their robots before: a fault may begin in the tick that ends it.
        self.before_removal: dict[str, Delivered] = {}

    @property
    def now(self) -> Instant:
        """The two clocks."""
        return Instant(float(self.tick * TICK), self.tick * TICK + self.offset)

    def mono(self, wall: float) -> float:
        """Return the monotonic time of an event's wall time in this tick.

        Where the clock was set in it, the event may be from before that.
        """
        found = (wall - self.offset, wall - self._offset_before)
        return min(found, key=lambda at: abs(self.now.mono - at))

    def declared(self) -> list[Delivered]:
        """What was delivered of the robots that the config has."""
        return [each for name, each in self.delivered.items() if name not in self._undeclared]

    def in_trouble(self, part: str) -> int:
        """How many robots have a component in trouble, or had it not long ago."""
        return sum(
            known.parts[part].level == ERROR or self._changed(known.parts[part])
            for known in self.delivered.values()
            if part in known.parts
        )

    def _changed(self, part: Part) -> bool:
        return bool(part.changes) and self.now.mono - part.changes[-1] < CALM

    # -- config ------------------------------------------------------------------------------

    def _fleet(self) -> Fleet:
        can = capabilities() if self.story.able else {}
        profile = replace(_PROFILE, confirm_after=self.confirm_after, capabilities=can)
        robots = tuple(
            Robot(
                name,
                topic_raw=f"/{name}/d" if self.delivered[name].raw else None,
                topic_agg=None if self.delivered[name].raw else f"/{name}/d",
                source=Source.RAW if self.delivered[name].raw else Source.AGG,
                profile=profile,
                labels={"site": site_of(name)},
            )
            for name in self.robots
            if name not in self._undeclared
        )
        return Fleet(
            "f",
            robots,
            maintenance=tuple(self._maintenance),
            faults=SETTINGS,
            capabilities=of_fleet() if self.story.able else {},
        )

    def _configure(self) -> None:
        self.fleet = self._fleet()
        if self.state is not None:
            self.state.configure(self.fleet, self.now)

    # -- time --------------------------------------------------------------------------------

    def advance(self, events: list[Event]) -> None:
        """One tick: what happens, then what is published, then the exporter's own tick."""
        self.tick += 1
        self._offset_before = self.offset
        self.lost = False
        self.removed.clear()
        self.before_removal.clear()
        self.shortest_confirm = self.confirm_after
        if self.state is None and self.tick >= self._starts_at:
            self._start()
        for event in events:
            getattr(self, f"_do_{event.what}")(event.who, *event.how)
        for number, name in enumerate(self.robots):
            if (self.tick + number) % self.story.period == 0:
                self._publish(name)
        if self.state is not None:
            reports, now = self.own.reports(self.now.mono), self.now
            self.state.judge(lambda of: of.own(reports, now))
            self.state.tick(self.now)
        self._note_quiet()

    def _note_quiet(self) -> None:
        if self.tick % PERIOD:
            return
        now = self.now.mono
        for name, known in self.delivered.items():
            robot = None if self.state is None else self.state.robots.get(name)
            if robot is None or robot.maintenance:
                known.quiet = now
            if known.last is None or now - known.last > 1.5 * PERIOD * TICK:
                known.gap = now

    def _start(self) -> None:
        if self._stopped is not None:
            state, then = self._stopped
            if self._loses:
                self.lost = True
                self._adopt()
            else:
                self.state = self.restarts.restart(state, self.fleet, then, self.now)
            self.started = self.now.mono
            self._stopped = None
            self._forget_undeclared()

    # -- what happens ------------------------------------------------------------------------

    def _do_level(self, robot: str, part: str, level: int) -> None:
        self._levels[robot][part] = level

    def _do_charge(self, robot: str, charge: float) -> None:
        self._charge[robot] = charge

    def _do_mute(self, robot: str, part: str, muted: bool) -> None:
        (self._muted[robot].add if muted else self._muted[robot].discard)(part)

    def _do_off(self, robot: str, off: bool) -> None:
        (self._off.add if off else self._off.discard)(robot)

    def _do_partition(self, site: str, cut: bool) -> None:
        (self._cut.add if cut else self._cut.discard)(site)

    def _do_lose(self, robot: str, on: bool) -> None:
        (self._network["lose"].add if on else self._network["lose"].discard)(robot)

    def _do_repeat(self, robot: str, on: bool) -> None:
        (self._network["repeat"].add if on else self._network["repeat"].discard)(robot)

    def _do_swap(self, robot: str, on: bool) -> None:
        (self._network["swap"].add if on else self._network["swap"].discard)(robot)
        self._late.pop(robot, None)

    def _do_forget(self, robot: str, part: str) -> None:
        if self.state is None or robot in self._undeclared:
            return
        if any(each.name == part for each in self.state.robots[robot].components):
            self.state.forget(robot, part, self.now)
            self._note_removal(robot, part)
            self.delivered[robot].parts.pop(part, None)

    def _do_own(self, part: str, level: int | None) -> None:
        self.own.set(part, level)

    def _do_declared(self, robot: str, declared: bool) -> None:
        (self._undeclared.discard if declared else self._undeclared.add)(robot)
        self.delivered[robot].quiet = self.resized[site_of(robot)] = self.now.mono
        if self.state is not None:
            self._forget_undeclared()
        self._configure()

    def _forget_undeclared(self) -> None:
        for robot in self._undeclared:
            self._note_removal(robot, "")
            known = self.delivered[robot]
            known.parts, known.last = {}, None

    def _note_removal(self, robot: str, part: str) -> None:
        known = self.delivered[robot]
        self.before_removal.setdefault(robot, replace(known, parts=dict(known.parts)))
        self.removed.add((robot, part))

    def _do_maintenance(self, site: str, ticks: int) -> None:
        now = self.now.wall
        window = Maintenance(
            f"m{self.tick}", {"site": (Pattern(site),)}, "", now, now + ticks * TICK
        )
        self._maintenance = [each for each in self._maintenance if (each.end or 0) > now]
        self._maintenance.append(window)
        self._configure()

    def _do_confirm_after(self, _who: str, seconds: float) -> None:
        self.confirm_after = seconds
        self.shortest_confirm = min(self.shortest_confirm, seconds)
        for known in self.delivered.values():
            known.quiet = self.now.mono
        self._configure()

    def _do_clock(self, _who: str, seconds: float) -> None:
        self.offset += seconds

    def _adopt(self) -> None:
        """Start without the database, with what fires; a person forgets robots that are no more."""
        self.restarts = Restarts()
        self._lost_at = self.now.mono
        self.state = FleetState(self.fleet, self.now)
        self.state.adopt(self.firing(), self.now)
        for robot in self._undeclared:
            self.state.forget(robot, None, self.now)

    def is_known(self, known: Delivered) -> bool:
        """Whether the exporter has received the robot, or its database says so."""
        return known.last is not None and known.last >= self._lost_at

    @property
    def holds_adopted(self) -> bool:
        """Whether what was adopted may last unseen: of a start without the database, in grace."""
        return self.started == self._lost_at and self.now.mono <= self.started + GRACE

    def is_declared(self, robot: str) -> bool:
        """Whether fleet.yml has the robot now."""
        return robot not in self._undeclared

    def _do_restart(self, _who: str, ticks: int, lose: bool = False) -> None:
        if self.state is None:
            return
        self._loses = lose
        self._stopped, self.state = (self.state, self.now), None
        self._starts_at = self.tick + ticks
        if not ticks:
            self._start()

    # -- messages ----------------------------------------------------------------------------

    def _publish(self, robot: str) -> None:
        if robot in self._off or site_of(robot) in self._cut:
            self._late.pop(robot, None)
            return
        array = self._array(robot)
        if robot in self._network["lose"] and self._is_lost(robot):
            return
        if robot in self._network["swap"]:
            late = self._late.pop(robot, None)
            if late is None:
                self._late[robot] = array
                return
            self._deliver(robot, array)
            array = late
        self._deliver(robot, array)
        if robot in self._network["repeat"]:
            self._deliver(robot, array)

    def _is_lost(self, robot: str) -> bool:
        """By chance, but whatever else the story has."""
        return Random(f"{self.story.seed} {robot} {self.tick}").random() < 0.3

    def _array(self, robot: str) -> tuple[Status, ...]:
        charge = (("charge", f"{self._charge[robot]}"),)
        rows = tuple(
            Status(level, part, "m", "", charge if part == BATTERY else ())
            for part, level in self._levels[robot].items()
            if part not in self._muted[robot]
        )
        if self.delivered[robot].raw:
            return rows
        header = Status(0, "/g", "", "", tuple((each.name, "m") for each in rows))
        return (header, *(each._replace(name=f"/g/{each.name}") for each in rows))

    def _deliver(self, robot: str, array: tuple[Status, ...]) -> None:
        if self.state is None or robot in self._undeclared:
            return
        now = self.now
        self.state.receive(Topic(0, f"/{robot}/d"), Array(0.0, array, 100), now)
        known = self.delivered[robot]
        found = {each.name.rpartition("/")[2]: each for each in array if each.name != "/g"}
        for name, status in found.items():
            _note(known.parts.setdefault(name, Part()), status, now.mono)
        if not known.raw:
            for name in known.parts.keys() - found.keys():
                _keep_before(known.parts[name], now.mono)
                known.parts[name].stale = True
        known.last = now.mono


def _keep_before(part: Part, now: float) -> None:
    former = replace(part, before=[])
    part.before = [former] if part.touched < now else [*part.before, former]
    part.touched = now


def _note(part: Part, status: Status, now: float) -> None:
    charge = float(status.values[0][1]) if status.values else part.charge
    if (status.level, charge) == (part.level, part.charge) and not part.stale and part.received:
        late = now - part.received > STALE_AFTER / 2
        if late or part.touched == now:
            _keep_before(part, now)
        part.received = now
        return
    _keep_before(part, now)
    if status.level != (STALE if part.stale else part.level):
        part.changes = [*part.changes[-30:], now]
    if status.level == OK:
        part.trouble_since = None
    elif part.trouble_since is None:
        # Not received for long is trouble, too.
        late = part.stale or now - part.received > STALE_AFTER / 2
        part.trouble_since = part.received if late else now
        part.trouble_known = now
    part.stale = status.level == STALE
    if not part.stale:
        part.level = status.level
    if charge != part.charge or not part.charges:
        part.charges = [*part.charges[-30:], (now, charge)]
    part.charge, part.received = charge, now


LEVEL_OF = {"warning": WARN, "critical": ERROR, "stale": STALE}
