"""What connects the goals of robots' actions to their components, events and rows.

Called only under the lock of the State that holds it.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from ros_diagnostics_exporter.decode.goals import Goal
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.model import (
    MISSIONS,
    Fault,
    ProblemView,
    Row,
    State,
    as_texts,
)
from ros_diagnostics_exporter.fleet.fault_reports import FaultReports
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.robots.goals import GoalEnd
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.missions import ACTIONS, Action, Missions, MissionsLearned
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.updates import query_of
from ros_diagnostics_exporter.severity import problem_state, subject
from ros_diagnostics_exporter.sources.action_servers import ServerChange
from ros_diagnostics_exporter.texts import first_few

SOON = 10.0  # seconds after a change until it is written, unless a level changed
MOST_EVENTS, MINUTE = 10, 60.0  # of one robot in so many seconds; of more there are only counts
MOST_NAMED = 5  # problems of a robot that are named with an event


class FleetMissions:
    """The missions of all robots."""

    def __init__(self, events: deque[Event], faults: FaultReports) -> None:
        self._events, self._faults = events, faults
        self._recent: dict[str, deque[float]] = {}  # when events of robots were, monotonic
        self._write_at: dict[str, float] = {}  # by robot, monotonic
        self._written: set[str] = set()  # robots that have a row

    def see(self, robot: RobotState, name: str, goals: Iterable[Goal], now: Instant) -> bool:
        """Take the goals of an action of a robot; whether anything is another than before."""
        missions = _missions(robot, now)
        is_new = name not in missions.actions
        action = missions.action(name)
        if action is None:
            return False
        before = action.goals.state
        ends = action.see(goals, now)
        is_same = action.goals.state == before  # as when a goal that was accepted is executed
        if is_same and not (ends or is_new):
            return False
        self._take(robot, [action], [(action, end) for end in ends], now)
        return True

    def follow_server(self, robot: RobotState, change: ServerChange, now: Instant) -> None:
        """Take that a server of a robot came, went or was restarted."""
        action = _missions(robot, now).action(change.server.action)
        if action is None:
            return
        ends: list[GoalEnd] = []
        if change.what != "restarted":
            ends = action.set_there(there=change.what == "came", now=now)
        elif action.goals.received_at <= change.since:  # else its goals may be the new server's
            ends = action.restart(now)
        self._take(robot, [action], [(action, end) for end in ends], now)

    def adopt(self, robot: RobotState, fault: Fault, now: Instant) -> None:
        """Go on with the fault of an action that this process does not know."""
        missions, name = _missions(robot, now), fault.identity.component
        is_new = name not in missions.actions
        action = missions.action(name)
        if action is not None:
            if is_new:
                action.set_there(there=False, now=now)
            level = Level.ERROR if fault.identity.state is State.CRITICAL else Level.WARN
            action.adopt(level, fault.since, now)
            self._take(robot, [action], [], now)

    def forget(self, robot: RobotState, name: str, now: Instant) -> None:
        """Count nothing more of what an action of a robot did before, as a person wants it."""
        action = _missions(robot, now).actions.get(name)
        if action is not None:
            action.forget()
            self._take(robot, [action], [], now)

    def follow_mode(self, robot: RobotState, now: Instant) -> None:
        """Take whether a robot works by itself, as its components are now."""
        mode, missions = self._faults.mode(robot), _missions(robot, now)
        if mode == missions.mode:
            return
        if missions.set_mode(mode, now):
            self._record(robot, "", now)
        self._take(robot, (), [], now)

    def tick(self, robot: RobotState, now: Instant) -> None:
        """Let time pass for a robot."""
        missions = robot.missions
        if missions is not None and now.mono >= missions.due:
            due = missions.due_actions(now.mono)
            self._take(robot, due, missions.tick(now), now)

    def configure(self, robot: RobotState, now: Instant) -> None:
        """Follow the entries that a robot has now."""
        missions, settings = robot.missions, robot.settings
        if missions is None:
            return
        gone = missions.configure(settings.profile.actions, settings.namespace)
        for component in [*robot.components]:
            is_action = query_of(component.identity) == ACTIONS.name
            if is_action and component.identity[0] in gone:
                robot.forget(component, now)
        self._take(robot, missions.actions.values(), [], now)

    def _take(
        self,
        robot: RobotState,
        actions: Iterable[Action],
        ends: list[tuple[Action, GoalEnd]],
        now: Instant,
    ) -> None:
        """Have these actions judged, and what changed served and written."""
        missions, name = _missions(robot, now), robot.settings.name
        for action, end in ends:
            if action.is_mission:
                self._note_end(robot, action, end, now)
        statuses, is_turned = missions.take_statuses(actions, now)
        if statuses:
            robot.measure(ACTIONS, statuses, now)
        missions.schedule(now.mono)
        robot.marks.note(Mark.GOALS)
        # Its row is written with the fault's: a process that is killed must not end that.
        write_at = now.mono if is_turned else now.mono + SOON
        self._write_at[name] = min(self._write_at.get(name, write_at), write_at)

    def _note_end(self, robot: RobotState, action: Action, end: GoalEnd, now: Instant) -> None:
        autonomy = _missions(robot, now).autonomy
        if autonomy is not None:
            autonomy.note_end(end)
        if end.result == "aborted":
            self._record(robot, action.name, now)

    def _record(self, robot: RobotState, component: str, now: Instant) -> None:
        """Record an aborted goal, or (of no component) an intervention, and what else is wrong."""
        name = robot.settings.name
        recent = self._recent.setdefault(name, deque(maxlen=MOST_EVENTS))
        if len(recent) == MOST_EVENTS and now.mono - recent[0] < MINUTE:
            return
        recent.append(now.mono)
        own = (ACTIONS.group, component)
        wrong = [_problem(each) for each in self._faults.problems(now, name) if _about(each) != own]
        self._events.append(
            Event(
                now.wall,
                "goal" if component else "intervention",
                name,
                ACTIONS.group if component else "",
                component,
                after="aborted" if component else "",
                message=moment_text(wrong),
                details={"problems": wrong[:MOST_NAMED]} if wrong else None,
            )
        )

    # -- outliving the process -----------------------------------------------------------------

    def take_rows(
        self, robots: Mapping[str, RobotState], now: Instant, *, at_once: bool
    ) -> Iterator[Row]:
        """The rows that are to be written now; ``at_once``, all that changed."""
        for name in [each for each in self._written if each not in robots]:
            self._written.discard(name)
            self._recent.pop(name, None)
            yield Row(MISSIONS, (name,), None)
        for name in [each for each, at in self._write_at.items() if at_once or now.mono >= at]:
            del self._write_at[name]
            missions = robots[name].missions if name in robots else None
            if missions is not None:
                self._written.add(name)
                yield Row(MISSIONS, (name,), missions.learned(now)._asdict())

    def restore(self, rows: Iterable[Row], robots: Mapping[str, RobotState], now: Instant) -> None:
        """Go on from the rows of an earlier process."""
        for row in rows:
            self._written.add(row.key[0])
            if row.key[0] in robots and row.fields is not None:
                learned: Any = row.fields
                robot = robots[row.key[0]]
                missions = _missions(robot, now)
                missions.restore(MissionsLearned(**learned), now)
                missions.schedule(now.mono)
                robot.marks.note(Mark.GOALS)


def _missions(robot: RobotState, now: Instant) -> Missions:
    """Those of a robot, made where none of its actions was known."""
    if robot.missions is None:
        settings = robot.settings
        robot.missions = Missions(settings.profile.actions, settings.namespace, now.wall)
    return robot.missions


def _about(view: ProblemView) -> tuple[str, str]:
    return view.identity.group, view.identity.component


def _problem(view: ProblemView) -> dict[str, str]:
    """A problem as it is recorded with an event."""
    texts = as_texts(view.identity, {})
    suppressed = {"suppressed": view.suppressed.value} if view.suppressed else {}
    return {"about": subject(texts), "state": problem_state(texts), **suppressed}


def moment_text(problems: list[dict[str, str]]) -> str:
    """What was wrong with a robot at that moment, for people."""
    if not problems:
        return "nothing else was wrong"
    named = [f"{each['about']} was {each['state']}" for each in problems]
    return f"while {first_few(named, MOST_NAMED)}"
