"""What has to hold after each event, by what was delivered and not by the exporter's own state."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_tools.backtest.history import identity
from simulation.can import leaves_of_all
from simulation.capabilities import Capabilities
from simulation.larger import LargerCauses
from simulation.mails import Mails
from simulation.story import COMPONENTS, DAY, ERROR, OK, PERIOD, TICK, WARN, Story
from simulation.world import (
    BATTERY,
    CALM,
    GRACE,
    HYSTERESIS,
    LATE,
    LEVEL_OF,
    LOW,
    OVER,
    STALE_AFTER,
    Delivered,
    Part,
    World,
)

CHECK_EVERY = PERIOD  # ticks between two looks at what should have happened
TWIN_EVERY = DAY // 4  # ticks between two restarts that are only tried; and at each fault's event


class BrokenError(AssertionError):
    """An invariant does not hold at a tick; the text says which, when and for what."""

    def __init__(self, what: str, tick: int, about: object) -> None:
        day, rest = divmod(tick, DAY)
        when = f"day {day}, {rest * TICK // 3600:02d}:{rest * TICK % 3600 // 60:02d}"
        super().__init__(f"{what} at tick {tick} ({when}): {about}")
        self.what, self.tick = what, tick


class Judge:
    """Plays a story and raises BrokenError at the first thing that is wrong."""

    def __init__(self, story: Story) -> None:
        self.story = story
        self.world = World(story)
        self.mails = Mails()
        self.world.firing = self.mails.faults
        self._larger = LargerCauses(self.world)
        self._capabilities = Capabilities(self.world)
        self.notified = 0
        self._faults: dict[tuple[str, ...], Event] = {}
        self._maintained: set[str] = set()
        self._scraped: dict[tuple[str, ...], bool] = {}
        self._spans: dict[tuple[str, ...], int] = {}

    def run(self) -> None:
        """Play all of it."""
        events = iter(self.story.events)
        coming = next(events, None)
        while self.world.tick < self.story.ticks:
            due = []
            while coming is not None and coming.at <= self.world.tick + 1:
                due.append(coming)
                coming = next(events, None)
            self.world.advance(due)
            self._check()

    def _check(self) -> None:
        world = self.world
        now = world.now
        if world.lost and world.state is not None:
            gone = [key for key, each in self._faults.items() if not self._is_adopted(each)]
            for key in gone:
                del self._faults[key]
            self._follow_adopted()
        if world.state is not None:
            begun, ended = [], False
            for event in world.state.take_events():
                if event.kind == "fault_began" and world.lost and identity(event) in self._faults:
                    continue  # it goes on with what fires
                if event.kind == "fault_began":
                    self._began(event)
                    begun.append(event)
                elif event.kind == "fault_ended":
                    self._ended(event)
                    self._fail_first(self._capabilities.ended(event))
                    ended = True
            self._fail_first(self._larger.began(begun, self._faults))
            self._fail_first(self._capabilities.began(begun, self._faults))
            self._limits()
            self._same_faults()
            self._maintained = {
                name for name, robot in world.state.robots.items() if robot.maintenance
            }
            if begun or ended or world.tick % TWIN_EVERY == 0:
                self._restart_changes_nothing(now)
        self._scrape(now)
        if world.state is not None and world.tick % CHECK_EVERY == 0:
            self._check_liveness(now)
            self._fail_first(self._larger.missing())
            own = self.world.own.missing(self._faults.values(), now.mono, world.started)
            self._fail_first(own)
            self._fail_first(self._capabilities.missing(self._faults))

    def _fail_first(self, found: Iterator[tuple[str, object]]) -> None:
        for what, about in found:
            self._fail(what, about)

    def _fail(self, what: str, about: object) -> None:
        raise BrokenError(what, self.world.tick, about)

    # -- what began and ended ----------------------------------------------------------------

    def _began(self, event: Event) -> None:
        key = identity(event)
        if key in self._faults:
            self._fail("a fault that lasts began again", event)
        self._faults[key] = event
        self._scraped[key] = False
        self.notified += 1
        if event.robot and self._in_maintenance(event.robot):
            self._fail("a fault began in maintenance", event)
        if event.scope in {"component", "value"}:
            self._part_began(event)
        if event.scope == "robot" and event.state == "silent":
            self._silence_began(event)
        if event.scope == "exporter":
            self._fail_first(self.world.own.began(event, self._at(event)))

    def _part_began(self, event: Event) -> None:
        known, part = self._known(event)
        if known.last is None or self._at(event) - known.last > STALE_AFTER + TICK:
            self._fail("a fault of a component began while its robot was silent", event)
        if part is None:
            self._fail("a fault of a component that was never delivered began", event)
            return
        self._any(self._wrong_begin, event, part)

    def _any(self, wrong: Callable[[Event, Part], str], event: Event, part: Part) -> None:
        """Fail if an event is wrong by all that was known of its component in this tick."""
        known = [part, *(part.before if part.touched == self.world.now.mono else ())]
        texts = [wrong(event, each) for each in known]
        if all(texts):
            self._fail(texts[0], event)

    def _wrong_begin(self, event: Event, part: Part) -> str:
        """What is wrong with the begin of a fault, by what was delivered of its component."""
        at, since = self._at(event), part.trouble_since
        if event.scope == "value":
            if event.state == "falling":
                return self._wrong_fall(event, part)
            beyond = part.charge < LOW[event.state] * (1 + HYSTERESIS)  # once it was below
            return "" if beyond else "a fault of a value within its threshold began"
        if event.state == "stale":
            stale = part.stale or at - part.received >= STALE_AFTER / 2
            return "" if stale else "a component that is received is STALE"
        if part.level != LEVEL_OF[event.state]:
            return "a fault of another level than was delivered began"
        if since is None or at - since < self.world.shortest_confirm - 1:
            return "a fault began before its confirm_after"
        return ""

    def _wrong_fall(self, event: Event, part: Part) -> str:
        """What is wrong with the forecast that a value will be too low."""
        same = (event.robot, event.component)
        if any(each.scope == "value" and each.state in LOW and (each.robot, each.component) == same
               for each in self._faults.values()):  # fmt: skip
            return "a value falls that is known to be too low"
        if part.charge < LOW["critical"]:
            return "a value falls that is too low already"
        lately = _charges_since(part, self._at(event) - OVER - TICK)
        if max(lately, default=part.charge) <= part.charge:
            return "a value falls that did not fall lately"
        return ""

    def _at(self, event: Event) -> float:
        return self.world.mono(event.time)

    def _silence_began(self, event: Event) -> None:
        known = self.world.delivered[event.robot]
        at = self.world.mono(event.time)
        least = STALE_AFTER + self.world.shortest_confirm
        if known.last is None or self.world.started > known.last:
            least = max(0.0, min(self.world.shortest_confirm, GRACE))
        if known.last is not None and at - known.last < least - 1:
            self._fail("a robot that was just received is silent", event)
        if at < self.world.started + GRACE - 1 and self.world.started > 0:
            self._fail("a silence began within restart_grace", event)

    def _ended(self, event: Event) -> None:
        key = identity(event)
        if key not in self._faults:
            self._fail("a fault ended that had not begun", event)
        if self._faults[key].since != event.since:
            self._fail("a fault ended with another since than it had", event)
        del self._faults[key]
        if self._scraped.pop(key, False):
            self._spans[key] = self._spans.get(key, 0) + 1
        if event.scope == "exporter":
            self._fail_first(self.world.own.ended(event))
            return
        if event.reason == "removed":
            self._removed(event)
            return
        if event.robot and self._in_maintenance(event.robot):
            self._fail("a fault recovered in maintenance", event)
        if event.scope in {"component", "value"}:
            self._part_recovered(event)
        if event.scope == "robot" and event.state == "silent":
            known = self.world.delivered[event.robot]
            if known.last is None or self.world.now.mono - known.last > STALE_AFTER + TICK:
                self._fail("a silence ended although nothing was received", event)

    def _removed(self, event: Event) -> None:
        if not self._is_removed(event):
            self._fail("a fault was removed by nobody", event)

    def _is_removed(self, event: Event) -> bool:
        """Whether its robot, its component or a part of it was taken out in this tick."""
        is_of_many = event.scope in ("site", "common")
        removed = {part for robot, part in self.world.removed if is_of_many or robot == event.robot}
        is_of_parts = event.scope == "capability" or event.state == "many"
        return bool(removed if is_of_parts else removed & {"", event.component})

    def _part_recovered(self, event: Event) -> None:
        known, part = self._known(event)
        now = self.world.now.mono
        if known.last is None or now - known.last > STALE_AFTER + TICK or part is None:
            self._fail("a fault recovered by absence", event)
            return
        self._any(self._wrong_recovery, event, part)

    def _wrong_recovery(self, event: Event, part: Part) -> str:
        if event.state == "falling":
            return _wrong_end_of_fall(part, self._at(event))
        if event.scope == "value":
            well = not part.stale and part.charge >= LOW[event.state] * (1 + HYSTERESIS)
            return "" if well else "a value recovered within its hysteresis"
        better = (OK,) if event.state == "warning" else (OK, WARN)
        well = not part.stale and part.level in better
        return "" if well else "a fault recovered without a fresh lower level"

    def _known(self, event: Event) -> tuple[Delivered, Part | None]:
        known = self.world.delivered[event.robot]
        if self._is_removed(event):
            known = self.world.before_removal[event.robot]
        return known, known.parts.get(event.component)

    def _in_maintenance(self, robot: str) -> bool:
        """Whether it was before this tick and still is."""
        state = self.world.state
        known = None if state is None else state.robots.get(robot)
        return robot in self._maintained and known is not None and known.maintenance

    # -- at every tick -----------------------------------------------------------------------

    def _is_adopted(self, event: Event) -> bool:
        """Whether an exporter without its database knows the fault again."""
        return not event.robot or self.world.is_declared(event.robot)

    def _follow_adopted(self) -> None:
        """Take the begin of what fires: that of an earlier fault, which ended and began unseen."""
        for fault in self.mails.faults():
            for key, event in self._faults.items():
                if _same(event, tuple(fault.identity)):
                    self._faults[key] = replace(event, since=fault.since)

    def _limits(self) -> None:
        state = self.world.state
        if state is None:
            return
        if len(state.robots) > self.story.robots:
            self._fail("more robots than the fleet has", len(state.robots))

    def _same_faults(self) -> None:
        state = self.world.state
        if state is None:
            return
        lasting = {(fault.identity.robot, fault.identity.component, fault.identity.state.value,
                    fault.identity.scope.value) for fault in state.faults()}  # fmt: skip
        events = {(each.robot, each.component, each.state, each.scope)
                  for each in self._faults.values()}  # fmt: skip
        if lasting != events:
            self._fail("the faults are not what the events say", lasting ^ events)

    def _restart_changes_nothing(self, now: Instant) -> None:
        state = self.world.state
        if state is None:
            return
        twin = self.world.restarts.restart(state, self.world.fleet, now, now)
        before = {fault.identity: fault for fault in state.faults()}
        after = {fault.identity: fault for fault in twin.faults()}
        if before.keys() != after.keys():
            self._fail("a restart changes the faults", before.keys() ^ after.keys())
        for key, fault in before.items():
            other = after[key]
            same = (other.labels == fault.labels, other.evidence == fault.evidence,
                    abs(other.since - fault.since) < 0.01,
                    abs(other.confirmed - fault.confirmed) < 0.01)  # fmt: skip
            if not all(same):
                self._fail("a restart changes a fault", (fault, other))
        if any(event.kind.startswith("fault") for event in twin.take_events()):
            self._fail("a restart is an event of a fault", twin)

    # -- mails -------------------------------------------------------------------------------

    def _scrape(self, now: Instant) -> None:
        before = self.mails.notified
        sent = len(self.mails.sent)
        self.mails.scrape(self.world.state, now)
        for what, key, _at in self.mails.sent[sent:]:
            if (what == "PROBLEM") is (key in before):
                self._fail("a mail was sent twice", (what, key))
            if what != "PROBLEM" and any(_same(each, key) for each in self._faults.values()):
                self._fail("a recovery was sent of a fault that lasts", key)
        if self.world.state is not None:
            for key in self._scraped:
                self._scraped[key] = True
            firing = len(self.mails.firing)
            if firing != len(self._faults):
                self._fail("alerts fire that are no faults", firing)

    # -- what should have happened -----------------------------------------------------------

    def _check_liveness(self, now: Instant) -> None:
        lasting: dict[tuple[str, str], set[str]] = {}
        for event in self._faults.values():
            if event.scope in {"component", "value"}:
                lasting.setdefault((event.robot, event.component), set()).add(
                    f"{event.scope} {event.state}"
                )
        bad = {part: self.world.in_trouble(part) for part in COMPONENTS}
        for known in self.world.delivered.values():
            self._check_silence(known, now.mono)
            if not self._is_clear(known, now.mono):
                continue
            for name, part in known.parts.items():
                found = lasting.get((known.name, name), set())
                self._check_part(known, name, found, now.mono, bad)
                if name == BATTERY:
                    self._check_value(known, part, found)

    def _recently(self, times: list[float]) -> bool:
        return bool(times) and self.world.now.mono - times[-1] < CALM

    def _is_clear(self, known: Delivered, now: float) -> bool:
        """Whether nothing but levels has happened to the robot for long."""
        return min(now - known.gap, now - known.quiet, now - self.world.started) > CALM

    def _check_part(
        self, known: Delivered, name: str, found: set[str], now: float, bad: dict[str, int]
    ) -> None:
        part = known.parts[name]
        recent = [each for each in part.changes if now - each < CALM]
        if part.stale or now - part.received > LATE or len(recent) > 3:
            return
        since = part.trouble_since
        if since is None:
            settled = not recent or now - recent[-1] > LATE
            if settled and any(each.startswith("component") for each in found):
                self._fail("a component that is OK has a fault", (known.name, name, found))
            return
        fresh = recent and now - recent[-1] > LATE
        if part.level == WARN and fresh and "component critical" in found:
            self._fail("a fault goes on after a fresh lower level", (known.name, name, found))
        in_trouble = sum(
            each.trouble_since is not None or self._recently(each.changes)
            for each in known.parts.values()
        )
        explained = in_trouble > 3 or bad.get(name, 0) > 2
        explained = explained or (self.story.able and name in leaves_of_all())  # see `capabilities`
        wanted = {WARN: "component warning", ERROR: "component critical"}[part.level]
        late = now - max(since, recent[-1] if recent else 0.0) > self.world.confirm_after + LATE
        if late and not explained and wanted not in found:
            self._fail("a confirmed problem is not notified", (known.name, name, wanted, found))

    def _check_value(self, known: Delivered, part: Part, found: set[str]) -> None:
        if part.stale or part.charge < LOW["warning"] * (1 + HYSTERESIS):
            return
        wrong = {each for each in found if each.startswith("value")}
        if self.world.now.mono - part.touched < OVER + LATE:
            wrong.discard("value falling")
        if wrong:
            self._fail("a value that is well has a fault", (known.name, part.charge, found))

    def _check_silence(self, known: Delivered, now: float) -> None:
        key = ("robot", "silent")
        lasts = any(
            (each.scope, each.state) == key and each.robot == known.name
            for each in self._faults.values()
        )
        received = known.last is not None and now - known.last < LATE
        robot = None if self.world.state is None else self.world.state.robots.get(known.name)
        if lasts and received and robot is not None and not robot.maintenance:
            self._fail("a robot that is received has a fault of silence", known.name)


def _wrong_end_of_fall(part: Part, at: float) -> str:
    if part.stale or part.charge < LOW["critical"]:
        return "a value recovered from falling that is not known, or too low"
    lately = _charges_since(part, at - OVER + 2 * TICK)
    # A single step: the line through it goes on to below the threshold.
    if len(lately) == 2 and part.charge - max(0.0, lately[0] - part.charge) < LOW["critical"]:
        return "a value recovered that still falls"
    return ""


def _charges_since(part: Part, at: float) -> list[float]:
    """What was delivered of the charge from then on, and the last before."""
    before = [charge for time, charge in part.charges if time < at]
    return [*before[-1:], *(charge for time, charge in part.charges if time >= at)]


def _same(event: Event, key: tuple[Any, ...]) -> bool:
    mine = (event.robot, event.group, event.component, event.check, event.key, event.bound)
    return (event.scope, event.state) == (key[0].value, key[1].value) and mine == key[3:9] and (
        event.scope != "site" or event.site == key[2]
    ) and (event.state != "many" or event.severity == key[9])  # fmt: skip
