"""Whether one robot does its work: the goals of its actions, and which of them are a problem.

Each action that an entry of fleet.yml names is a component, with a status as any other. Of the
others goals are counted alone. Pure: time is given.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import datetime, timezone
from functools import lru_cache
from math import inf
from typing import Annotated, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.config.missions import ActionRule, TooMany, rule_for
from ros_diagnostics_exporter.decode.goals import Goal
from ros_diagnostics_exporter.model import Feed, Instant, Level, Status
from ros_diagnostics_exporter.robots.autonomy import Autonomy, AutonomyLearned
from ros_diagnostics_exporter.robots.goals import (
    RESULTS,
    GoalEnd,
    Goals,
    GoalsLearned,
    Moment,
    Result,
)
from ros_diagnostics_exporter.robots.recent import MOST as MOST_RECENT
from ros_diagnostics_exporter.robots.recent import Recent
from ros_diagnostics_exporter.sources.action_servers import MOST
from ros_diagnostics_exporter.sources.graph_messages import Stopwatch

# Where a server is away nothing is known of its goals, which is no fault: others say so.
# `goals_running` is the number of goals of all actions, also of those that are no components.
ACTIONS = Feed("ROS actions", "Actions", inf, planned_stale=True, numbers=False, sent=True)
_SUCCEEDED, _ABORTED, _PREEMPTED = map(RESULTS.index, ("succeeded", "aborted", "preempted"))
REPORT = 30.0  # seconds between two statuses of what runs
_NEVER = -inf  # one object for all
Mode = tuple[bool | None, bool | None]  # it works by itself; it is stopped; None: not known
_Text = Annotated[str, Field(max_length=256)]
_Recent = Annotated[list[tuple[Moment, Result]], Field(max_length=MOST_RECENT)]


class ActionLearned(NamedTuple):
    """What a later process should know of one action.

    ``ended`` are (seconds ago, result), ``started`` seconds ago; ``aborted_at`` is Unix time.
    """

    goals: GoalsLearned
    ended: _Recent
    started: Annotated[list[Moment], Field(max_length=MOST_RECENT)]
    aborted_at: Moment


class MissionsLearned(NamedTuple):
    """What a later process should know of one robot, by the names of its actions."""

    actions: Annotated[dict[_Text, ActionLearned], Field(max_length=MOST)]
    autonomy: AutonomyLearned | None = None
    since: Moment = 0.0  # Unix time; 0: not known


class Action:
    """One action of a robot; ``rule`` is its entry in fleet.yml, None where it has none."""

    __slots__ = (
        *("name", "rule", "goals", "clock", "status", "due"),
        *("_ended", "_started", "_aborted_at", "_last_aborted", "_told_running"),
    )

    def __init__(self, name: str, rule: ActionRule | None) -> None:
        self.name = name
        self.goals = Goals()
        self.clock = Stopwatch()  # runs while its server is there
        self.status: Status | None = None  # as it was reported
        self.due = _NEVER  # when `tick` has something to do, or its status is another, monotonic
        # Indices of `RESULTS`, where its entry counts aborted ones.
        self._ended: Recent | None = None
        self._started: Recent | None = None  # where its entry counts these
        self._aborted_at = 0.0  # when the last was aborted, Unix time
        self._last_aborted = _NEVER  # ... by the clock
        self._told_running = 0  # goals that ran when its status was reported
        self.set_rule(rule)

    @property
    def is_mission(self) -> bool:
        """Whether how its goals end says whether the robot does its work."""
        return self.rule is not None and not self.rule.ignore_result

    def set_rule(self, rule: ActionRule | None) -> None:
        """Follow another entry, which judges it anew."""
        self.rule, self.status = rule, None
        aborted, started = (None, None) if rule is None else (rule.aborted, rule.started)
        self._ended = _counted_by(aborted, self._ended)
        self._started = _counted_by(started, self._started)

    @property
    def level(self) -> int:
        """As it was reported last; OK before that."""
        return Level.OK if self.status is None else self.status.level

    def see(self, goals: Iterable[Goal], now: Instant) -> list[GoalEnd]:
        """Take a list of its server; what ended by it."""
        self.clock.set(running=True, mono=now.mono)
        before = self.goals.counts.started
        ends = self.goals.see(goals, now.mono)
        if self._started is not None:
            begun = self.goals.counts.started - before
            self._started.add([0] * begun, self.clock.read(now.mono))
        return self._note(ends, now)

    def set_there(self, *, there: bool, now: Instant) -> list[GoalEnd]:
        """Take whether its server is in the graph."""
        self.clock.set(running=there, mono=now.mono)
        if there:
            return self._note(self.goals.return_(now.mono), now)
        self.goals.leave(now.mono)
        return []

    def restart(self, now: Instant) -> list[GoalEnd]:
        """Note that another process serves it."""
        return self._note(self.goals.restart(now.mono), now)

    def tick(self, now: Instant) -> list[GoalEnd]:
        """Let time pass."""
        return self._note(self.goals.tick(now.mono), now)

    def _note(self, ends: list[GoalEnd], now: Instant) -> list[GoalEnd]:
        if self._ended is not None and ends:
            clock = self.clock.read(now.mono)
            results = [RESULTS.index(each.result) for each in ends]
            self._ended.add(results, clock)
            if _ABORTED in results:
                self._aborted_at, self._last_aborted = now.wall, clock
        return ends

    def adopt(self, level: Level, since: float, now: Instant) -> None:
        """Count as many as this level takes: another process saw them, nobody knows when."""
        clock, rule = self.clock.read(now.mono), self.rule
        limits = (None, None) if rule is None else (rule.aborted, rule.started)
        for recent, limit in zip((self._ended, self._started), limits, strict=True):
            most = limit and (limit.critical if level is Level.ERROR else limit.warning)
            if recent is not None and most:
                recent.add([_ABORTED] * most, clock)
                self._aborted_at, self._last_aborted = since, clock

    def forget(self) -> None:
        """Count nothing of before any more."""
        self._ended = self._started = None
        self.set_rule(self.rule)

    # -- judged --------------------------------------------------------------------------------

    @property
    def tells_more(self) -> bool:
        """Whether what runs is another than its status says, or by now for longer."""
        running = self.goals.running
        return self.rule is not None and bool(running or running != self._told_running)

    def take_status(self, now: Instant, *, tells_values: bool) -> Status | None:
        """Its status, where that is another than before; None of a server that is away.

        Unless ``tells_values``, one that differs in nothing but its values can wait.
        """
        if self.rule is None or self.goals.is_away:
            return None
        judged, before = self._judge(self.rule, now), self.status
        if not tells_values and before is not None and judged == (before.level, before.message):
            return None
        self._told_running = self.goals.running
        longest = self.goals.longest(now.mono)
        values = _values(self._told_running, round(longest))
        status = Status(judged[0], self.name, judged[1], "", values)
        if status == before:
            return None
        self.status = status
        return status

    def _judge(self, rule: ActionRule, now: Instant) -> tuple[int, str]:
        problems = [*self._problems(rule, now)]
        if not problems:
            return int(Level.OK), "OK"
        text = "; ".join(text for _level, text in problems)
        return int(max(level for level, _text in problems)), text

    def _problems(self, rule: ActionRule, now: Instant) -> Iterator[tuple[Level, str]]:
        clock = self.clock.read(now.mono)
        if rule.aborted is not None and clock - self._last_aborted < rule.aborted.within:
            level, text = self._judge_aborted(rule.aborted, clock)
            if level:
                yield level, text
        if rule.started is not None and self._started is not None:
            count = len(self._started.since(clock - rule.started.within))
            if level := _level(rule.started, count):
                yield level, f"started {count} times within {_written(rule.started)}"
        if rule.longer_than is not None and self.goals.longest(now.mono) > rule.longer_than:
            limit = durations.written(rule.longer_than)
            yield Level.WARN, f"a goal has been running for longer than {limit}"

    def _judge_aborted(self, limit: TooMany, clock: float) -> tuple[Level, str]:
        """As many are too many, unless as many goals in a row have succeeded since."""
        ended = b"" if self._ended is None else self._ended.since(clock - limit.within)
        counted = ended.replace(bytes([_PREEMPTED]), b"")
        aborted = counted.count(_ABORTED)
        succeeded = len(counted) - len(counted.rstrip(bytes([_SUCCEEDED])))  # in a row, at last
        level = _level(limit, aborted, over=succeeded)
        last = datetime.fromtimestamp(self._aborted_at, timezone.utc)
        text = (
            f"aborted {aborted} of the last {len(counted)} goals, the last at {last:%H:%M:%S} UTC"
        )
        return level, text

    def schedule(self, mono: float) -> None:
        """Set when there is something to do next."""
        found = [self.goals.due]
        if self.rule is not None and self.goals.running:
            longest, limit = self.goals.longest(mono), self.rule.longer_than
            if limit is not None and longest <= limit:
                found.append(mono + limit - longest + 0.001)
        if self.status is not None and self.status.level:
            found += self._ends_of_windows(mono)
        self.due = min(found)

    def _ends_of_windows(self, mono: float) -> Iterator[float]:
        clock = self.clock.read(mono)
        for each in (self._ended, self._started):
            first = None if each is None else each.next_after(clock - each.within)
            if each is not None and first is not None:
                yield mono + first + each.within - clock

    # -- outliving the process -----------------------------------------------------------------

    def learned(self, now: Instant) -> ActionLearned:
        """What a later process should know."""
        clock = self.clock.read(now.mono)
        return ActionLearned(
            self.goals.learned(now.mono),
            [(clock - at, RESULTS[what]) for at, what in self._ended or ()],
            [clock - at for at, _what in self._started or ()],
            self._aborted_at,
        )

    def restore(self, learned: ActionLearned, now: Instant) -> None:
        """Go on from what an earlier process knew."""
        self.goals.restore(GoalsLearned(*learned.goals), now.mono)
        ended = [(age, RESULTS.index(word)) for age, word in learned.ended]
        _restore(self._ended, ended)
        _restore(self._started, [(age, 0) for age in learned.started])
        aborted = (age for age, what in ended if what == _ABORTED)
        self._aborted_at, self._last_aborted = learned.aborted_at, -min(aborted, default=inf)


class Missions:
    """The actions of one robot, by their names in its namespace."""

    __slots__ = (
        *("actions", "autonomy", "due", "mode", "since"),
        *("_namespace", "_report_at", "_rules"),
    )

    def __init__(self, rules: tuple[ActionRule, ...], namespace: str, since: float) -> None:
        self._rules, self._namespace = rules, namespace
        self.since = since  # when counting began, Unix time
        self.actions: dict[str, Action] = {}
        self.autonomy: Autonomy | None = None  # where an entry says what its mode is
        self.mode: Mode = (None, None)  # as it was taken last
        self.due = inf  # when `tick` has something to do, or a status is another, monotonic
        self._report_at = inf  # when what runs is said again, monotonic

    def configure(self, rules: tuple[ActionRule, ...], namespace: str) -> list[str]:
        """Follow other entries; the actions that have none any more, and so are no components."""
        self._rules, self._namespace = rules, namespace
        gone = []
        for name, action in self.actions.items():
            rule = rule_for(rules, namespace, name)
            if rule is None and action.rule is not None:
                gone.append(name)
            action.set_rule(rule)
        return gone

    def action(self, name: str) -> Action | None:
        """The action of this name, made where it is new; None where a robot has too many."""
        known = self.actions.get(name)
        if known is None and len(self.actions) < MOST:
            known = self.actions[name] = Action(name, rule_for(self._rules, self._namespace, name))
        return known

    def set_mode(self, mode: Mode, now: Instant) -> bool:
        """Take whether it works by itself, and is stopped; whether an intervention began."""
        self.mode = mode
        self.autonomy = self.autonomy or Autonomy()
        running = sum(each.goals.running for each in self.actions.values() if each.is_mission)
        autonomous, stopped = mode
        return self.autonomy.update(
            autonomous=autonomous, stopped=stopped, running=running, now=now
        )

    def tick(self, now: Instant) -> list[tuple[Action, GoalEnd]]:
        """Let time pass; what ended by it."""
        if self.autonomy is not None:
            self.autonomy.advance(now.mono)
        return [(each, end) for each in self.actions.values() for end in each.tick(now)]

    def take_statuses(self, actions: Iterable[Action], now: Instant) -> tuple[list[Status], bool]:
        """The statuses of these actions that are others than before, and if a level is another."""
        found, is_turned = list[Status](), False
        for each in actions:
            before = each.level
            status = each.take_status(now, tells_values=now.mono >= self._report_at)
            each.schedule(now.mono)
            if status is not None:
                found.append(status)
                is_turned |= status.level != before
        return found, is_turned

    def schedule(self, mono: float) -> None:
        """Set when there is something to do next."""
        actions = self.actions.values()
        is_autonomous = self.autonomy is not None and self.autonomy.is_running
        if not (is_autonomous or any(each.tells_more for each in actions)):
            self._report_at = inf
        elif self._report_at == inf or self._report_at <= mono:
            self._report_at = mono + REPORT
        self.due = min([self._report_at, *[each.due for each in actions]])

    def due_actions(self, mono: float) -> list[Action]:
        """Those whose status may be another by now."""
        says_again = mono >= self._report_at
        return [
            each
            for each in self.actions.values()
            if mono >= each.due or (says_again and each.tells_more)
        ]

    def learned(self, now: Instant) -> MissionsLearned:
        """What a later process should know."""
        actions = {name: each.learned(now) for name, each in self.actions.items()}
        autonomy = None if self.autonomy is None else self.autonomy.learned(now)
        return MissionsLearned(actions, autonomy, self.since)

    def restore(self, learned: MissionsLearned, now: Instant) -> None:
        """Go on from what an earlier process knew."""
        self.since = learned.since
        for name, each in learned.actions.items():
            if (action := self.action(name)) is not None:
                action.restore(ActionLearned(*each), now)
        if learned.autonomy is not None:
            self.autonomy = Autonomy()
            self.autonomy.restore(AutonomyLearned(*learned.autonomy))


@lru_cache(maxsize=4096)  # the actions of a fleet have the same ones, stored once
def _values(running: int, longest: int) -> tuple[tuple[str, str], ...]:
    """The key-values of an action."""
    return ("running", str(running)), ("longest", f"{longest} s")


def _counted_by(limit: TooMany | None, known: Recent | None) -> Recent | None:
    """What an entry counts, with what of it is known."""
    if limit is None or known is None:
        return None if limit is None else Recent(limit.within)
    known.within = limit.within
    return known


def _restore(recent: Recent | None, known: list[tuple[float, int]]) -> None:
    """Take what happened so many seconds ago, as an earlier process knew it."""
    if recent is not None:
        for age, what in sorted(known, key=lambda each: -each[0]):
            recent.add([what], -age)


def _level(limit: TooMany, count: int, *, over: int = 0) -> Level:
    """How bad so many are, where as many as ``over`` end it."""
    for most, level in ((limit.critical, Level.ERROR), (limit.warning, Level.WARN)):
        if most is not None and count >= most > over:
            return level
    return Level.OK


def _written(limit: TooMany) -> str:
    return durations.written(limit.within)
