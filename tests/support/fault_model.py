"""A second, simple implementation of the fault rules: everything is computed anew at each second.

Written from the rules and not from the engine, for tests that compare the two. It has no timers,
events or rows, and knows nothing of larger faults: `test_invariants` says what holds of those.
"""

from dataclasses import dataclass, field
from datetime import datetime
from statistics import linear_regression
from typing import Any
from zoneinfo import ZoneInfo

from ros_diagnostics_exporter.config.fleet import FaultSettings, Threshold
from ros_diagnostics_exporter.faults.model import ComponentSettings, RobotSettings
from ros_diagnostics_exporter.model import Level

OK, WARN, ERROR, STALE = Level
STATE_OF = {WARN: "warning", ERROR: "critical", STALE: "stale"}
LOW = ("warning", "critical")
OWN_CONFIRM = 60  # seconds: as before an exporter has first looked at itself
Key = tuple[str, ...]  # scope, state, site, robot, group, component, check, key, bound, severity


def key_of(
    scope: str,
    state: str,
    *,
    site: str = "",
    robot: str = "",
    group: str = "",
    component: str = "",
    check: str = "",
    key: str = "",
    bound: str = "",
    severity: str = "",
) -> Key:
    return scope, state, site, robot, group, component, check, key, bound, severity


def _is_critical(key: Key) -> bool:
    return "critical" in (key[1], key[9]) or key[1] == "silent"


@dataclass
class Slots:
    """The last 21 states, recorded at each change and once an interval."""

    last: int
    states: list[int] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.states = self.states or [OK] * 21

    def record(self, state: int, now: int) -> None:
        self.states = [*self.states[1:], state]
        self.last = now

    def tick(self, now: int, interval: float) -> None:
        while now - self.last >= interval:
            self.states = [*self.states[1:], self.states[-1]]
            self.last += int(interval)

    @property
    def ratio(self) -> float:
        pairs = zip(self.states, self.states[1:], strict=False)
        return sum(0.75 + 0.5 * n / 19 for n, (a, b) in enumerate(pairs) if a != b) / 20


@dataclass
class Monitored:
    """A component, value or check; ``open`` has the states it is in, with the second since when."""

    clock: int | None = None  # in trouble since
    open: dict[str, int] = field(default_factory=dict)
    fresh: bool = False  # reported since its robot was last received
    level: Level = OK
    settings: ComponentSettings = field(default_factory=ComponentSettings)
    slots: Slots | None = None
    flapping: bool = False
    flapping_since: int = 0
    changed: list[int] = field(default_factory=list)  # of its level, that no fault explains
    intermittent_since: int | None = None


@dataclass
class Followed:
    """A value that may fall below a critical low threshold, and its number at each second."""

    number: float | None = None  # None: nothing is known now
    threshold: float = 0.0
    samples: list[float] = field(default_factory=list)
    verdict: str = "well"
    since: int | None = None


@dataclass
class RobotModel:
    settings: RobotSettings
    declared: bool
    presence: str = "never"
    maintenance: bool = False
    silent_at: int = 0
    silent_since: int | None = None
    pending_since: int | None = None
    received: bool = False
    returned_until: float = -(10**9)  # until then absence is no fault
    total: int = 0
    slots: Slots | None = None
    flapping: bool = False
    flapping_since: int = 0
    went: bool = False  # it fell silent, and that counts
    components: dict[tuple[str, str], Monitored] = field(default_factory=dict)
    values: dict[tuple[str, ...], Monitored] = field(default_factory=dict)  # group, name, key, ...
    checks: dict[str, Monitored] = field(default_factory=dict)
    followed: dict[tuple[str, str], Followed] = field(default_factory=dict)
    sampled: int = 0


@dataclass
class OwnModel:
    """One thing that may be wrong with a part of the exporter."""

    since: int | None = None
    fresh: bool = False


class Model:
    """The fleet; `step` appends the faults that began and ended to ``changes``."""

    def __init__(self, settings: FaultSettings, wall: int = 0) -> None:
        self.settings = settings
        self.wall = wall  # Unix time of second 0
        self.robots: dict[str, RobotModel] = {}
        self.faults: dict[Key, dict[str, Any]] = {}
        self.own: dict[tuple[str, Level], OwnModel] = {}  # part of the exporter, what is wrong
        self.settled_at = -(10**9)
        self.changes: list[tuple[int, str, Key, int, tuple[tuple[str, str], ...]]] = []

    # -- events ------------------------------------------------------------------------------

    def started(self, now: int) -> None:
        self.settled_at = now + int(self.settings.restart_grace)
        for known in self.own.values():
            known.fresh = False
        for name, robot in self.robots.items():
            if robot.presence == "up":
                self._fall_silent(name, robot, now)

    def configure_robot(self, name: str, settings: RobotSettings, declared: bool, now: int) -> None:
        robot = self.robots.get(name)
        if robot is None:
            robot = self.robots[name] = RobotModel(settings, declared)
        robot.settings, robot.declared = settings, declared
        if robot.presence == "never":
            if not declared:
                robot.pending_since = None
                self._end(key_of("robot", "pending", robot=name), "removed", now)
            elif robot.pending_since is None:
                robot.pending_since = now

    def forget_robot(self, name: str, now: int) -> None:
        for key in [key for key in self.faults if key[3] == name]:
            self._end(key, "removed", now)
        del self.robots[name]

    def forget_component(self, name: str, group: str, component: str, now: int) -> None:
        robot = self.robots[name]
        for key in [key for key in self.faults if key[3:6] == (name, group, component)]:
            self._end(key, "removed", now)
        robot.components.pop((group, component), None)
        for value in [value for value in robot.values if value[:2] == (group, component)]:
            del robot.values[value]
        robot.followed.pop((group, component), None)

    def silent(self, name: str, now: int) -> None:
        robot = self.robots[name]
        if robot.presence == "silent":
            return
        robot.went = robot.presence == "up" and not robot.maintenance
        if robot.went:
            self._note(robot, 0, now)
        self._fall_silent(name, robot, now)

    def _fall_silent(self, name: str, robot: RobotModel, now: int) -> None:
        robot.presence = "silent"
        robot.silent_at = now
        if robot.silent_since is None:
            robot.silent_since = now
        for where, part in robot.components.items():
            self._keep_open(part, name, where)
        for part in (
            *robot.components.values(),
            *robot.values.values(),
            *robot.checks.values(),
        ):
            part.fresh = False
        for each in robot.followed.values():
            self._lose(each)

    def _lose(self, followed: Followed) -> None:
        """Nothing is known of a value."""
        followed.number, followed.samples = None, []
        if followed.verdict == "bad":
            followed.verdict = "held"

    def pending(self, name: str, now: int) -> None:
        robot = self.robots[name]
        robot.presence = "never"
        if robot.declared and robot.pending_since is None:
            robot.pending_since = now

    def back(self, name: str, now: int) -> None:
        robot = self.robots[name]
        if robot.presence == "up":
            return
        if robot.presence == "silent" and robot.went:
            self._note(robot, 1, now)
        robot.went = False
        robot.presence = "up"
        robot.received = True
        robot.returned_until = now + robot.settings.confirm_after
        robot.pending_since = None
        if key_of("robot", "silent", robot=name) not in self.faults:
            robot.silent_since = None
        for (group, component), part in robot.components.items():
            if part.slots is not None:
                part.slots.last = now
            where = {"robot": name, "group": group, "component": component}
            if key_of("flapping", "intermittent", **where) in self.faults:
                part.changed = [now for _ in part.changed]

    def _note(self, robot: RobotModel, state: int, now: int) -> None:
        if robot.slots is None:
            robot.slots = Slots(now, [1] * 21)
        if robot.slots.states[-1] != state and not robot.maintenance:
            robot.slots.record(state, now)

    def level(
        self, name: str, where: tuple[str, str], to: Level, how: ComponentSettings, now: int
    ) -> None:
        robot = self.robots[name]
        if robot.presence != "up":
            return
        part = robot.components.setdefault(where, Monitored())
        part.settings, part.level, part.fresh = how, to, True
        planned = to == STALE and how.planned_stale
        if not planned:
            self._note_level(name, where, to, now)
        if to == OK:
            part.clock, part.open = None, {}
            return
        if part.clock is None and not planned:
            part.clock = now
        if to == STALE:
            for value in [value for value in robot.values if value[:2] == where]:
                robot.values[value].fresh = False
            if where in robot.followed and robot.followed[where].verdict == "bad":
                robot.followed[where].verdict = "held"
        if to == WARN:
            part.open = {state: at for state, at in part.open.items() if state == "warning"}
        else:
            self._keep_open(part, name, where)
        if not planned:
            self._open(part, to, now)

    def _keep_open(self, part: Monitored, name: str, where: tuple[str, str]) -> None:
        """A fault continues under a worse level, under STALE and in silence."""
        for state in ("warning", "stale", "critical"):
            key = key_of("component", state, robot=name, group=where[0], component=where[1])
            if key in self.faults:
                part.open.setdefault(state, self.faults[key]["since"])

    def _open(self, part: Monitored, to: Level, now: int) -> None:
        assert part.clock is not None
        part.open.setdefault(STATE_OF[to], part.clock if to == WARN else now)
        if to == STALE and part.settings.stale_is_critical:
            part.open.setdefault("critical", now)

    def _has_fault(self, name: str, where: tuple[str, str]) -> bool:
        """Whether a component has a fault that explains its changes."""
        states = ("warning", "stale", "critical")
        of = {"robot": name, "group": where[0], "component": where[1]}
        keys = [key_of("component", state, **of) for state in states]
        return any(key in self.faults for key in (*keys, key_of("flapping", "flapping", **of)))

    def _note_level(self, name: str, where: tuple[str, str], to: Level, now: int) -> None:
        robot = self.robots[name]
        part = robot.components[where]
        last = OK if part.slots is None else part.slots.states[-1]
        returned = to == STALE and now < robot.returned_until
        if to == last or returned or robot.maintenance:
            return
        part.slots = part.slots or Slots(now)
        part.slots.record(to, now)
        intermittent = key_of(
            "flapping", "intermittent", robot=name, group=where[0], component=where[1]
        )
        explained = self._has_fault(name, where) and intermittent not in self.faults
        part.changed = [] if explained else [*part.changed, now][-20:]

    def value(
        self,
        name: str,
        component: str,
        number: float | None,
        thresholds: tuple[Threshold, ...],
        how: ComponentSettings,
        *,
        now: int,
    ) -> None:
        robot = self.robots[name]
        if robot.presence != "up":
            return
        wanted = {("", component, "charge", each.bound, each.severity) for each in thresholds}
        for known in [known for known in robot.values if known not in wanted]:
            self._end(self._value_key(name, known), "removed", now)
            del robot.values[known]
        for each in thresholds:
            known = ("", component, "charge", each.bound, each.severity)
            part = robot.values.setdefault(known, Monitored())
            lasts = self.faults.get(self._value_key(name, known))
            if not part.fresh and lasts is not None:  # not known: not well either
                part.open.setdefault("", lasts["since"])
            part.settings, part.fresh = how, number is not None
            if number is None:
                if lasts is not None:
                    part.open.setdefault("", lasts["since"])
                continue
            low = each.bound == "low"
            beyond = number < each.value if low else number > each.value
            margin = abs(each.value) * self.settings.value_hysteresis
            near = number < each.value + margin if low else number > each.value - margin
            if beyond:
                part.open.setdefault("", now)
            elif not near:
                part.open = {}
        if component and ("", component) in robot.components:
            robot.components["", component].settings = how
        self._follow(name, number, thresholds, now, where=("", component))

    def _follow(
        self,
        name: str,
        number: float | None,
        thresholds: tuple[Threshold, ...],
        now: int,
        *,
        where: tuple[str, str],
    ) -> None:
        """Follow the value ``charge``, if it may fall below a critical threshold."""
        robot = self.robots[name]
        lows = [each for each in thresholds if (each.bound, each.severity) == ("low", "critical")]
        if not lows:
            self._end(self._falling_key(name, where), "removed", now)
            robot.followed.pop(where, None)
            return
        followed = robot.followed.setdefault(where, Followed())
        if number is None:
            self._lose(followed)
            return
        followed.number, followed.threshold = number, lows[0].value

    def _falling_key(self, name: str, where: tuple[str, str]) -> Key:
        return self._value_key(name, (*where, "charge", "low", "falling"))

    def _value_key(self, name: str, known: tuple[str, ...]) -> Key:
        group, component, key, bound, severity = known
        return key_of(
            "value", severity, robot=name, group=group, component=component, key=key, bound=bound
        )

    def check(self, name: str, check: str, found: int, expected: int | None, now: int) -> None:
        robot = self.robots[name]
        if expected is None:
            self._end(key_of("check", "critical", robot=name, check=check), "removed", now)
            robot.checks.pop(check, None)
        elif robot.presence == "up":
            part = robot.checks.setdefault(check, Monitored())
            part.fresh = True
            if found < expected:
                part.open.setdefault("", now)
            else:
                part.open = {}

    # -- computation -------------------------------------------------------------------------

    def report_own(self, levels: dict[str, Level], now: int) -> None:
        for part, bad in [each for each in self.own if each[0] not in levels]:
            self._end(key_of("exporter", STATE_OF[bad], component=part), "removed", now)
            del self.own[part, bad]
        for part, level in levels.items():
            for bad in (WARN, ERROR):
                known = self.own.setdefault((part, bad), OwnModel())
                known.fresh = level != STALE
                if level == bad:
                    known.since = now if known.since is None else known.since
                elif known.fresh:
                    known.since = None

    def step(self, now: int) -> None:
        """Compute all causes and faults at this second."""
        for (part, bad), known in self.own.items():
            key, since = key_of("exporter", STATE_OF[bad], component=part), known.since
            begins = since is not None and known.fresh and now >= since + OWN_CONFIRM
            well = known.fresh and since is None
            self._update(key, since, begins, well=well, labels={}, now=now)
        for robot in self.robots.values():
            self._flap(robot, now)
            self._sample(robot, now)
        for name, robot in self.robots.items():
            self._update_robot(name, robot, now)

    def _flap(self, robot: RobotModel, now: int) -> None:
        if robot.slots is not None:
            robot.slots.tick(now, robot.settings.presence_interval)
            self._weigh(robot, now)
        for part in robot.components.values():
            if part.slots is not None and robot.presence == "up":
                part.slots.tick(now, robot.settings.flap_interval)
                self._weigh(part, now)

    def _sample(self, robot: RobotModel, now: int) -> None:
        """Take the values of this second, and see where each will be."""
        if now == robot.sampled:
            return
        robot.sampled = now
        for followed in robot.followed.values():
            if followed.number is not None:
                followed.samples = [*followed.samples, followed.number][-16:]
                self._foresee(followed, now)

    def _foresee(self, followed: Followed, now: int) -> None:
        samples, number = followed.samples, followed.number
        assert number is not None
        if len(samples) < 16 or number < followed.threshold:
            verdict = "well" if followed.verdict == "well" else "held"
        elif samples[-1] >= samples[0]:
            verdict = "well"
        else:
            slope, start = linear_regression(range(16), samples)
            later = start + slope * (15 + self.settings.falling.ahead)
            margin = abs(followed.threshold) * self.settings.value_hysteresis
            limit = followed.threshold + (0 if followed.verdict == "well" else margin)
            verdict = "bad" if later < limit else "well"
        followed.verdict = verdict
        if verdict == "well":
            followed.since = None
        elif followed.since is None:
            followed.since = now

    def _weigh(self, thing: Monitored | RobotModel, now: int) -> None:
        was, settings = thing.flapping, self.settings
        assert thing.slots is not None
        limit = settings.flapping.stop if was else settings.flapping.start
        thing.flapping = thing.slots.ratio >= limit
        if thing.flapping and not was:
            thing.flapping_since = now

    # -- robots and their parts --------------------------------------------------------------

    def _update_robot(self, name: str, robot: RobotModel, now: int) -> None:
        labels = robot.settings.labels
        confirm = robot.settings.confirm_after
        work = robot.maintenance
        settled = now >= self.settled_at
        comes_and_goes = self._explains(robot, key_of("robot", "flapping", robot=name), now)

        def update(key: Key, since: int | None, begins: bool, *, well: bool) -> None:
            self._update(
                key, since, begins and not work, well=well and not work, labels=labels, now=now
            )

        silent = robot.presence == "silent" and settled and not comes_and_goes
        update(
            key_of("robot", "silent", robot=name),
            robot.silent_since,
            silent and now >= robot.silent_at + confirm,
            well=robot.presence == "up",
        )
        if robot.presence == "up" and key_of("robot", "silent", robot=name) not in self.faults:
            robot.silent_since = None
        pending = robot.pending_since
        due = pending is not None and now >= pending + self.settings.pending_after
        update(
            key_of("robot", "pending", robot=name),
            pending,
            due and robot.presence == "never" and settled and not comes_and_goes,
            well=robot.presence == "up",
        )
        update(
            key_of("robot", "flapping", robot=name),
            robot.flapping_since,
            robot.flapping and now >= robot.flapping_since + confirm,
            well=not robot.flapping,
        )
        returned = settled and now >= robot.returned_until and not comes_and_goes
        for check, part in robot.checks.items():
            since = part.open.get("")
            begins = since is not None and part.fresh and returned and now >= since + confirm
            key = key_of("check", "critical", robot=name, check=check)
            update(key, since, begins, well=part.fresh and since is None)
        for where, followed in robot.followed.items():
            since = followed.since
            due = since is not None and now >= since + 2  # two more samples
            lows = [self._value_key(name, (*where, "charge", "low", each)) for each in LOW]
            begins = followed.verdict == "bad" and due and not any(e in self.faults for e in lows)
            well = followed.verdict == "well" and followed.number is not None
            update(self._falling_key(name, where), since, begins, well=well)
        for known, part in robot.values.items():
            since = part.open.get("")
            wait = part.settings.confirm_after
            begins = since is not None and part.fresh and now >= since + wait
            update(self._value_key(name, known), since, begins, well=part.fresh and since is None)
        for (group, component), part in robot.components.items():
            where = {"robot": name, "group": group, "component": component}
            self._update_component(robot, part, where, update, returned=returned, now=now)

    def _update_component(
        self,
        robot: RobotModel,
        part: Monitored,
        where: dict[str, str],
        update: Any,
        *,
        returned: bool,
        now: int,
    ) -> None:
        suppressed = not part.fresh or self._explains(
            part, key_of("flapping", "flapping", **where), now
        )
        up = robot.presence == "up"
        update(
            key_of("flapping", "flapping", **where),
            part.flapping_since,
            part.flapping and up,
            well=not part.flapping,
        )
        for state in ("warning", "stale", "critical"):
            since = part.open.get(state)
            due = part.clock is not None and now >= part.clock + part.settings.confirm_after
            begins = since is not None and due and not suppressed
            if part.level == STALE:
                begins = begins and returned and not part.settings.planned_stale
                begins = begins and not (state == "warning" and "critical" in part.open)
            elif state != STATE_OF.get(part.level):
                begins = False
            well = part.fresh and state not in part.open and not part.flapping
            update(key_of("component", state, **where), since, begins, well=well)
        if up:
            self._update_intermittent(part, where, update, now=now)

    def _update_intermittent(
        self, part: Monitored, where: dict[str, str], update: Any, *, now: int
    ) -> None:
        """Changes too short to be faults, and too many to be chance."""
        key, settings = key_of("flapping", "intermittent", **where), self.settings
        part.changed = [at for at in part.changed if at + settings.intermittent.within > now]
        place = where["group"], where["component"]
        if self._has_fault(where["robot"], place) and key not in self.faults:
            part.changed = []  # people know
        number, most = len(part.changed), settings.intermittent.changes
        is_ok = part.fresh and part.level == OK
        well = number < most and (key not in self.faults or (2 * number < most and is_ok))
        if well:
            part.intermittent_since = None
        elif part.intermittent_since is None:
            part.intermittent_since = now
        since = part.intermittent_since
        restless = part.flapping
        if part.slots is not None:
            restless = restless or part.slots.ratio >= settings.flapping.stop
        due = since is not None and now >= since + part.settings.confirm_after
        begins = number >= most and due and not restless
        begins = begins and not self._has_fault(where["robot"], place)
        update(key, since, begins, well=well)

    def _update(
        self, key: Key, since: int | None, begins: bool, *, well: bool, labels: Any, now: int
    ) -> None:
        if key in self.faults:
            if well:
                self._end(key, "recovered", now)
        elif begins and since is not None and (_is_critical(key) or self._in_hours(now)):
            self.faults[key] = {"since": since, "labels": tuple(sorted(labels.items()))}
            self._note_fault("began", key, now)

    def _in_hours(self, now: int) -> bool:
        """Whether warnings may begin."""
        hours = self.settings.warning_hours
        if hours is None:
            return True
        at = datetime.fromtimestamp(self.wall + now, ZoneInfo(hours.time_zone))
        minutes = at.weekday() * 1440 + at.hour * 60 + at.minute
        return any(day * 1440 + a <= minutes < day * 1440 + b for day, a, b in hours.weekly)

    def _explains(self, thing: Monitored | RobotModel, key: Key, now: int) -> bool:
        """Whether flapping is, or may be, a fault of its own, so that its changes are none."""
        return thing.flapping and (key in self.faults or self._in_hours(now))

    def _end(self, key: Key, what: str, now: int) -> None:
        if key in self.faults:
            self._note_fault(what, key, now)
            del self.faults[key]

    def _note_fault(self, what: str, key: Key, now: int) -> None:
        fault = self.faults[key]
        self.changes.append((now, what, key, fault["since"], fault["labels"]))
