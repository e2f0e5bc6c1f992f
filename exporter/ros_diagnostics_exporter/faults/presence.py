"""Whether robots are received: silent, pending, back, coming and going."""

from __future__ import annotations

from math import inf

from ros_diagnostics_exporter.faults import causes, components, suppression
from ros_diagnostics_exporter.faults.book import TIME_TO_RETURN, Book
from ros_diagnostics_exporter.faults.model import Identity, Reason, Scope, State, Verdict
from ros_diagnostics_exporter.faults.records import (
    DOWN,
    SLOTS,
    FlapHistory,
    Presence,
    Problem,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant

_SILENT, _PENDING, _FLAPPING, _CLOCK = State.SILENT, State.PENDING, State.FLAPPING, State.CLOCK
_UP = 1  # a state of a robot's history, as DOWN


def fall_silent(
    book: Book, robot: RobotRecord, since: Instant, now: Instant, *, counts: bool
) -> None:
    """Note that a robot is no longer received; ``counts``: as one time that it went.

    ``since`` is its last message, from which the fault will be dated.
    """
    problem = robot.problems.get(_SILENT) or _add(book, robot, _SILENT, since, now)
    if problem.fault is None and since.wall < problem.since.wall:
        problem.since = since
    if robot.presence is Presence.SILENT:
        book.write(problem)
        return
    robot.history_before, robot.is_restarted = None, False
    if robot.up and counts and not robot.maintenance:
        _note_absence(book, robot, now)
    problem.clock = now.mono
    book.give_verdict(problem, Verdict.ABSENT)
    for state in (_PENDING, _CLOCK):
        if state in robot.problems:
            book.give_verdict(robot.problems[state], Verdict.NO_DATA)
    robot.presence = Presence.SILENT
    components.hold(book, robot, now)
    _note_presence(book, robot, now)


def become_pending(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Note that a robot was never received, or hardly, and that none of its publishers is there."""
    robot.presence = Presence.NEVER
    components.hold(book, robot, now)
    if _SILENT in robot.problems:
        book.give_verdict(robot.problems[_SILENT], Verdict.NO_DATA)
    if robot.declared:
        pending = robot.problems.get(_PENDING)
        pending = pending or _add(book, robot, _PENDING, now, now)
        book.give_verdict(pending, Verdict.ABSENT)
    _note_presence(book, robot, now)


def come_back(book: Book, robot: RobotRecord, now: Instant, *, may_boot: bool) -> None:
    """Note that a robot is received, for the first time or again; see `Faults.robot_back`."""
    if robot.up:
        return
    if now.mono >= book.grace_until or robot.presence is Presence.NEVER:
        robot.is_restarted = not may_boot
    _note_return(book, robot, now)
    robot.presence = Presence.UP
    _judge_flapping(book, robot, now)
    robot.returned_until = now.mono + robot.settings.confirm_after
    if not robot.is_restarted:
        robot.booted_until = now.mono + robot.settings.boot_grace
    book.timers.set(("returned", robot), robot.returned_until)
    await_time(book, robot, now)
    for state in (_SILENT, _PENDING):
        if state in robot.problems:
            book.give_verdict(robot.problems[state], Verdict.HEALTHY)
    for component in list(robot.components.values()):  # one that is at rest is dropped
        components.resume(book, component, now)
    _note_presence(book, robot, now)


def await_time(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Have all about a robot counted anew once it, or a part, had its time to boot or return."""
    ends = (robot.booted_until, robot.returns_until)
    ahead = [*ends, *(each.returns_until for each in robot.components.values())]
    due = min((each for each in ahead if each > now.mono), default=inf)
    book.timers.set_at_latest(("waits", robot), due)


def end_wait(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Count all about a robot whose time, or that of a part, to boot or return is over."""
    count_anew(book, robot, now)
    await_time(book, robot, now)


def set_maintenance(book: Book, robot: RobotRecord, now: Instant, *, planned: bool) -> None:
    """Begin or end the planned downtime of a robot."""
    robot.maintenance = planned
    count_anew(book, robot, now)


def cut_off(book: Book, robot: RobotRecord, now: Instant, *, is_so: bool) -> None:
    """Note that a robot's DDS domain cannot be joined, or can again."""
    since, robot.cut_off_since = robot.cut_off_since, None
    if is_so:
        robot.cut_off_since = now.mono if since is None else since
    elif since is not None:
        until = now.mono + min(now.mono - since, TIME_TO_RETURN)
        for problem in robot.all_problems():
            book.await_return(problem.subject, robot, until)
    count_anew(book, robot, now)


def count_anew(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Judge all about a robot, and all that it explains: what is planned changed, or it is up."""
    for component in robot.components.values():
        causes.count_component(book, component, now)
    _note_presence(book, robot, now)
    touch_all(book, robot)


def maintain_components(
    book: Book, robot: RobotRecord, names: frozenset[str], now: Instant
) -> None:
    """Begin or end the planned downtimes of some components."""
    robot.maintained = names
    count_anew(book, robot, now)


def settle(book: Book, now: Instant) -> None:
    """Judge what restart_grace suppressed, now that it is over."""
    if now.mono < book.fleet_known_at:
        book.timers.set(("settled", None), book.fleet_known_at)
    for robot in book.robots.values():
        _note_presence(book, robot, now)
    for problem in book.problems.values():
        problem.restored = False
    book.touch(book.problems.values())
    book.touch_causes()


def touch_all(book: Book, robot: RobotRecord) -> None:
    """Have everything about a robot judged again, and what it explains."""
    for problem in robot.all_problems():
        book.changed.setdefault(problem, problem.verdict)
    book.touch(robot.all_problems())
    book.touched_causes[robot.many] = None
    book.touched_robots[robot] = None


def decay(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Let a robot that came and went come to rest."""
    if robot.history is not None:
        robot.history.decay(now.mono, robot.settings.presence_interval)
        _judge_flapping(book, robot, now)
        if robot.flapping and robot.stays_away(book.settings.flapping):
            touch_all(book, robot)
        book.write(robot)


def judge_anew(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Judge all about a robot by other settings."""
    decay(book, robot, now)
    for component in list(robot.components.values()):
        components.decay(book, component, now)
    touch_all(book, robot)


def _note_presence(book: Book, robot: RobotRecord, now: Instant) -> None:
    book.note_presence(robot)
    causes.count_robot(book, robot, now)
    book.touched_causes[robot.many] = None
    if robot.capabilities:
        book.touched_robots[robot] = None
    book.write(robot)


def _note_absence(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Count that a robot went; what there was before is kept until it is back."""
    history = robot.history or FlapHistory([_UP] * SLOTS, now.mono)
    robot.history_before = FlapHistory(history.slots, history.last)
    robot.history = history
    history.change(DOWN, now.mono, robot.settings.presence_interval)
    _judge_flapping(book, robot, now)


def _note_return(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Count that a robot came back, or neither that nor that it went: what is larger explains both.

    Only now it is clear what else fell silent with it.
    """
    before, robot.history_before = robot.history_before, None
    silence = robot.problems.get(_SILENT)
    if before is None or silence is None or robot.history is None:
        return
    site = book.causes.get((Scope.SITE, robot.settings.site))
    is_larger = suppression.is_unreachable(book, robot, now) or robot.explained_until > now.mono
    if site is not None and site.problems:
        is_larger |= suppression.is_explained(book, [silence], (Reason.SITE,), now)
    if is_larger:
        robot.history = before
        before.decay(now.mono, robot.settings.presence_interval)
    elif not robot.maintenance:
        robot.history.change(_UP, now.mono, robot.settings.presence_interval)


def _judge_flapping(book: Book, robot: RobotRecord, now: Instant) -> None:
    history, was_flapping = robot.history, robot.flapping
    if history is None:
        return
    # While it is away it may be broken: that it no longer changes does not end what it had.
    problems = robot.problems
    if _FLAPPING in problems or history.ratio >= book.settings.flapping.start:  # of most neither
        identity = Identity(Scope.ROBOT, _FLAPPING, robot=robot.name)
        components.judge_flapping(book, problems, history, identity, now, is_known=robot.up)
    if robot.flapping != was_flapping:
        touch_all(book, robot)
    if history.ratio > 0.0:
        due = history.last + robot.settings.presence_interval
        book.timers.set_at_latest(("presence", robot), due)  # too early: it is set again then
    elif history.slots[-1] == _UP:
        robot.history = None


def _add(book: Book, robot: RobotRecord, state: State, since: Instant, now: Instant) -> Problem:
    problem = book.new_problem(Identity(Scope.ROBOT, state, robot=robot.name), since)
    problem.clock = now.mono
    return problem
