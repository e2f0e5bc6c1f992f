"""Larger causes: when many problems are one, and what that one explains.

A cause is active from the threshold on until fewer than half of that are left. It is a problem of
its own from then on; what it explains is quiet at once, and for confirm_after after its end, so
that neither the first robots to fail nor the last to recover are reported one by one.
"""

from __future__ import annotations

from collections.abc import Iterable
from math import ceil, inf

from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import Identity, Scope, State, Verdict
from ros_diagnostics_exporter.faults.records import (
    Cause,
    ComponentRecord,
    Presence,
    Problem,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant, Level


def count_component(book: Book, component: ComponentRecord) -> None:
    """Count a component, or not, towards what many robots have in common.

    It counts from when it is CRITICAL, out of maintenance, until it is received better, or, where
    it is measured, until what the robot is behind explains it, or what the component is behind.
    """
    explained = component.settings.measured and component.robot.unreachable
    if component.settings.behind:
        explained = explained or component.is_behind(stale=component.level is Level.STALE)
    fresh = component.level is Level.ERROR and not (component.maintenance or explained)
    lasts = component.counted and component.level not in (Level.OK, Level.WARN)
    if not (fresh or lasts or component.counted):
        return
    cause = book.cause(Scope.COMMON, component.name.component)
    counted = fresh or (lasts and (cause.is_fault or not explained))
    if counted != component.counted:
        component.counted = counted
        book.write(component)
    cause.count(component.robot.name, component.name.group, counts=counted, fresh=fresh)
    book.touched_causes[cause] = None


def count_robot(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Count a robot, or not, towards the silence of its site, until it is back or unreachable.

    That nothing was received of it since a start is no silence within restart_grace.
    """
    silent = robot.presence is Presence.SILENT and not (robot.maintenance or robot.unreachable)
    fresh = silent and (robot.counted or now.mono >= book.grace_until)
    lasts = robot.counted and not robot.up
    if not (fresh or lasts or robot.counted):
        return
    cause = book.cause(Scope.SITE, robot.settings.site)
    counted = robot.counted = fresh or (lasts and (cause.is_fault or not robot.unreachable))
    cause.count(robot.name, "", counts=counted, fresh=fresh)
    book.touched_causes[cause] = None


def update_touched(book: Book, now: Instant) -> None:
    """Judge the causes that were touched; those of robots last, because others explain them."""
    for of_robots in (False, True):
        touched = [each for each in book.touched_causes if (each.robot is not None) is of_robots]
        for cause in touched:
            del book.touched_causes[cause]
            _update(book, cause, now)


def end_cover(book: Book, cause: Cause) -> None:
    """Judge again what a cause explained, now that it no longer does."""
    cause.covers_until = -inf
    book.write(cause)
    _touch_explained(book, cause)
    drop_usual(book, cause)


def drop_usual(book: Book, cause: Cause) -> None:
    """Take out the cause if there is nothing to keep."""
    if cause.robot is None and cause.is_usual and (cause.scope, cause.name) in book.causes:
        del book.causes[cause.scope, cause.name]
        book.touched_causes.pop(cause, None)
        book.timers.clear(("cover", cause))


def _update(book: Book, cause: Cause, now: Instant) -> None:
    needed = _needed(book, cause)
    counted, fresh = _counts(book, cause, needed, now)
    adopted = cause.adopted and _is_adopted(book, cause, now)
    if cause.active is None and fresh >= needed:
        cause.active = now
        book.write(cause)
        _touch_excluding(book, cause)
    elif cause.active is not None and 2 * counted < needed and not adopted:
        cause.active = None
        cause.covers_until = now.mono + confirm_after(book, cause)
        book.timers.set(("cover", cause), cause.covers_until)
        book.write(cause)
    if cause.active is not None or cause.problems:
        _judge(book, cause, Verdict.BAD if 2 * fresh >= needed else Verdict.HELD)
    if cause.robot is None:
        drop_usual(book, cause)


def _is_adopted(book: Book, cause: Cause, now: Instant) -> bool:
    """Whether a cause of before the start lasts, because too little has been received since.

    What it counted then is not known: that nothing is counted now is no end of it.
    """
    if cause.robot is not None:
        is_known = cause.robot.up and now.mono >= cause.robot.returned_until
    else:
        needed = _needed(book, cause)
        is_known = now.mono >= book.grace_until and 2 * _received(book, cause) >= needed
    cause.adopted = not is_known
    book.write(cause)
    return cause.adopted


def _received(book: Book, cause: Cause) -> int:
    """How many robots are received of those that the cause is about."""
    sites = [cause.name] if cause.scope is Scope.SITE else list(book.present)
    return sum(book.robots[name].up for site in sites for name in book.present.get(site, ()))


def _judge(book: Book, cause: Cause, verdict: Verdict) -> None:
    """Pass the verdict on to the cause's problems, made where there are none yet."""
    if cause.scope is Scope.SITE and verdict is Verdict.BAD:
        verdict = Verdict.ABSENT
    for severity, applies in _severities(cause).items():
        problem = cause.problems.get(severity)
        if problem is None and applies is Verdict.BAD and cause.active is not None:
            problem = Problem(
                _identity(cause, severity), cause.active, robot=cause.robot, cause=cause
            )
            cause.problems[severity] = book.add_problem(problem)
        if problem is None:
            continue
        well = cause.active is None or applies is Verdict.WELL
        new = Verdict.WELL if well else min(applies, verdict)
        if cause.active is not None:
            problem.clock = cause.active.mono
        if new is Verdict.BAD:
            problem.restored = False
        if new is not problem.verdict:
            problem.verdict = new
            book.write(problem)
        book.touch((problem,))


def _severities(cause: Cause) -> dict[str, Verdict]:
    """Which problems a cause is, and whether each of them applies.

    Many components are as severe as the worst of them; the milder goes on under the worse.
    """
    if cause.robot is None:
        return {"": Verdict.BAD}
    if cause.adopted:
        return dict.fromkeys(cause.problems, Verdict.HELD)
    critical = any(
        State.CRITICAL in each.problems and each.problems[State.CRITICAL].in_trouble
        for each in cause.robot.components.values()
    )
    return {
        "critical": Verdict.BAD if critical else Verdict.WELL,
        "warning": Verdict.HELD if critical else Verdict.BAD,
    }


def _counts(book: Book, cause: Cause, needed: int, now: Instant) -> tuple[int, int]:
    """(how many keep it active, how many of them may make it active)."""
    robot = cause.robot
    if robot is None:
        return len(cause.counted), len(cause.fresh)
    troubled = [
        each
        for each in robot.components.values()
        if each.since is not None
        and each.name.component not in robot.maintained
        and not (each.settings.behind and each.is_behind(stale=each.level is Level.STALE))
    ]
    is_quiet = robot.maintenance or robot.unreachable_since is not None
    nothing_known = not robot.up or is_quiet or now.mono < robot.returned_until
    if nothing_known or len(troubled) < needed / 2:
        return len(troubled), 0
    own = sum(not book.covered(Scope.COMMON, each.name.component, now) for each in troubled)
    return len(troubled), own


def _needed(book: Book, cause: Cause) -> int:
    """How many have to be in trouble, of all that it counts."""
    if cause.robot is not None:
        settings, whole = book.settings.many, cause.robot.total
    elif cause.scope is Scope.SITE:
        settings, whole = book.settings.site, len(book.present.get(cause.name, ()))
    else:
        settings, whole = book.settings.common, sum(map(len, book.present.values()))
    # The tolerance keeps 0.1 of 30 at 3, whatever floating point makes of it.
    share = ceil(settings.share * whole - 1e-9)
    needed = max(1, settings.number, share)
    return needed if settings.absolute is None else min(needed, max(1, settings.absolute))


def confirm_after(book: Book, cause: Cause) -> float:
    """Seconds for which a cause goes on covering what it explained, after its end."""
    robot = cause.robot
    return book.settings.confirm_after if robot is None else robot.settings.confirm_after


def _identity(cause: Cause, severity: str) -> Identity:
    if cause.scope is Scope.SITE:
        return Identity(Scope.SITE, State.SILENT, site=cause.name)
    if cause.scope is Scope.COMMON:
        return Identity(Scope.COMMON, State.CRITICAL, component=cause.name)
    return Identity(Scope.ROBOT, State.MANY, robot=cause.name, severity=severity)


def _explained_components(book: Book, cause: Cause) -> Iterable[ComponentRecord]:
    if cause.robot is not None:
        return cause.robot.components.values()
    return book.named.get(cause.name, ())


def _touch_explained(book: Book, cause: Cause) -> None:
    """Have all that a cause explains judged again."""
    if cause.scope is Scope.SITE:
        for name in book.present.get(cause.name, ()):
            book.touch(book.robots[name].problems.values())
        return
    for component in _explained_components(book, cause):
        book.touch(component.problems.values())
    _touch_excluding(book, cause)


def _touch_excluding(book: Book, cause: Cause) -> None:
    """What is common to many robots does not count as many components of one of them."""
    if cause.scope is Scope.COMMON:
        for component in book.named.get(cause.name, ()):
            book.touched_causes[component.robot.many] = None
