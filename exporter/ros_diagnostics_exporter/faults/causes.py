"""Larger causes: when many problems are one.

A cause is active from the threshold on until fewer than half of that are left. It is a problem of
its own from then on, which explains what it counts: see `suppression`.
"""

from __future__ import annotations

from collections.abc import Collection
from math import ceil, inf

from ros_diagnostics_exporter.faults import suppression
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import (
    NO_OTHERS,
    Count,
    Counts,
    Identity,
    Others,
    Reason,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.records import (
    Cause,
    ComponentRecord,
    Presence,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant, Level

_OK, _WARN, _ERROR, _STALE = Level
_HEALTHY, _NO_DATA, _ABSENT, _FAILING = Verdict
_CRITICAL, _SITE, _COMMON = State.CRITICAL, Scope.SITE, Scope.COMMON
_OUT_OF_REACH = (Reason.UNREACHABLE, Reason.DEPENDS_ON)
_BY_OTHERS = (*_OUT_OF_REACH, Reason.COMMON)


def count_component(book: Book, component: ComponentRecord, now: Instant) -> None:
    """Count a component, or not, towards what many robots have in common.

    It counts from when it is CRITICAL, out of maintenance, until it is received better, or, where
    it is measured, until its robot's uplink explains it, or a component that it depends on.
    """
    has_time = component.has_time(now)
    is_error = component.level is _ERROR and not has_time and component.is_failing
    if not (is_error or component.counted):
        return
    lasts = component.counted and component.level not in (_OK, _WARN)
    name = component.name.component
    explained = _is_explained(book, component, _OUT_OF_REACH, now)
    fresh = is_error and not explained
    counted = fresh or (lasts and (_is_fault(book, Scope.COMMON, name) or not explained))
    if not (counted or component.counted):
        return
    if counted != component.counted:
        component.counted = counted
        book.write(component)
    cause = book.cause(Scope.COMMON, name)
    cause.count(component.robot.name, component.name.group, counts=counted, fresh=fresh)
    book.touched_causes[cause] = None


def _is_fault(book: Book, scope: Scope, name: str) -> bool:
    cause = book.causes.get((scope, name))
    return cause is not None and cause.is_fault


def _is_explained(
    book: Book, component: ComponentRecord, reasons: tuple[Reason, ...], now: Instant
) -> bool:
    settings, robot = component.settings, component.robot
    if settings.measured and robot.cut_off_since is not None:
        return Reason.UNREACHABLE in reasons
    # Most components have nothing that could, and are counted at each change of their level.
    name = (_COMMON, component.name.component)
    is_common = name in book.causes and Reason.COMMON in reasons
    is_absent = settings.measured or component.level is _STALE
    if not (settings.depends_on or is_common or (is_absent and robot.settings.uplink)):
        return False
    return suppression.is_explained(book, component.problems.values(), reasons, now)


def count_robot(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Count a robot, or not, towards the silence of its site, until it is back or unreachable.

    That nothing was received of it since a start is no silence within restart_grace.
    """
    silent, site = robot.presence is Presence.SILENT, robot.settings.site
    if not (silent or robot.counted):
        lasting = book.causes.get((_SITE, site))
        if lasting is not None and now.mono < book.grace_until:
            book.touched_causes[lasting] = None  # it waited for this one: see `_may_grow`
        return
    unreachable = suppression.is_unreachable(book, robot, now)
    in_grace = not robot.counted and now.mono < max(book.grace_until, robot.returns_until)
    fresh = silent and not (robot.maintenance or unreachable or in_grace)
    lasts = robot.counted and not robot.up
    counted = fresh or (lasts and (_is_fault(book, Scope.SITE, site) or not unreachable))
    if not (counted or robot.counted):
        return
    robot.counted = counted
    cause = book.cause(Scope.SITE, site)
    cause.count(robot.name, "", counts=counted, fresh=fresh)
    book.touched_causes[cause] = None


def update_touched(book: Book, now: Instant) -> None:
    """Judge the causes that were touched; those of robots last, because others explain them.

    Those of several robots not before a reload is over: what has enough only while some robots
    follow the config and others do not would go on with half of that.
    """
    for of_robots in (False, True):
        touched = [each for each in book.touched_causes if (each.robot is not None) is of_robots]
        for cause in touched:
            del book.touched_causes[cause]
            if of_robots or not book.is_reloading:
                _update(book, cause, now)


def drop_usual(book: Book, cause: Cause) -> None:
    """Take out the cause if there is nothing to keep."""
    if cause.robot is None and cause.is_usual and (cause.scope, cause.name) in book.causes:
        del book.causes[cause.scope, cause.name]
        book.touched_causes.pop(cause, None)


def _update(book: Book, cause: Cause, now: Instant) -> None:
    needed = _needed(book, cause)
    left, fresh = _counts(book, cause, needed, now)
    adopted = cause.adopted and _is_adopted(book, cause, now)
    if cause.active is None and fresh >= needed:
        cause.active = now
        book.write(cause)
    elif (
        cause.active is not None
        and 2 * left < needed
        and not (adopted or _may_grow(book, cause, now))
    ):
        cause.active = None
        book.write(cause)
    cause.thinned = cause.thinned and cause.active is None
    if cause.active is not None or cause.problems:
        _judge(book, cause, _FAILING if 2 * fresh >= needed else _NO_DATA, now)
    if cause.robot is None:
        drop_usual(book, cause)


def _may_grow(book: Book, cause: Cause, now: Instant) -> bool:
    """Whether it is not known yet how many robots other exporters count, or which are silent.

    Those are the robots of which nothing was received since a start, in restart_grace.
    """
    if cause.robot is not None:
        return False
    if book.others.known < 1:
        return True
    if cause.scope is not Scope.SITE or now.mono >= book.grace_until:
        return False
    return any(
        each.presence is Presence.SILENT and not (each.counted or each.maintenance)
        for each in robots_of(book, cause.scope, cause.name)
    )


def _is_adopted(book: Book, cause: Cause, now: Instant) -> bool:
    """Whether a cause of before the start lasts, because too little has been received since.

    What it counted then is not known: that nothing is counted now is no end of it. Where all robots
    are received that it is about, and be it none, nothing more will be known.
    """
    if cause.robot is not None:
        is_known = cause.robot.up and now.mono >= cause.robot.returned_until
    else:
        robots = robots_of(book, cause.scope, cause.name)
        received = sum(robot.up for robot in robots)
        enough = 2 * received >= _needed(book, cause) or received == len(robots)
        is_known = now.mono >= book.fleet_known_at and enough
    cause.adopted = not is_known
    book.write(cause)
    return cause.adopted


def robots_of(book: Book, scope: Scope, name: str) -> list[RobotRecord]:
    """The robots that a cause may be about: those of its site, or all."""
    site = name if scope is Scope.SITE else None
    return [each for each in book.robots.values() if site in (None, each.settings.site)]


def _judge(book: Book, cause: Cause, verdict: Verdict, now: Instant) -> None:
    """Pass the verdict on to the cause's problems, made where there are none yet."""
    if cause.scope is _SITE and verdict is _FAILING:
        verdict = _ABSENT
    for severity, (applies, since) in _severities(cause, now).items():
        problem = cause.problems.get(severity)
        if problem is None and applies is _FAILING and cause.active is not None:
            # That many are CRITICAL counts from then, as of one: see `components`.
            begin = now if severity == "critical" else cause.active
            problem = book.new_problem(_identity(cause, severity), begin)
        if problem is None:
            continue
        is_healthy = cause.active is None or applies is _HEALTHY
        new = _HEALTHY if is_healthy else min(applies, verdict)
        if cause.active is not None and new > _NO_DATA:
            problem.clock = max(cause.active.mono, since)
        book.give_verdict(problem, new)


def _severities(cause: Cause, now: Instant) -> dict[str, tuple[Verdict, float]]:
    """Which problems a cause is, whether each of them applies, and since when (monotonic) at least.

    Many components are as severe as the worst of them; the milder goes on under the worse.
    """
    if cause.robot is None:
        return {"": (_FAILING, -inf)}
    if cause.adopted:
        return dict.fromkeys(cause.problems, (_NO_DATA, -inf))
    critical, since = _HEALTHY, inf
    for component in cause.robot.components.values():
        problem = component.problems.get(_CRITICAL)
        if problem is not None and problem.lasts:
            counts = problem.effect.counts and not component.has_time(now)
            critical = max(critical, _FAILING if counts else _NO_DATA)
            since = min(since, problem.clock) if counts else since
        elif component.flapping:  # that it is OK at the moment ends nothing
            critical = max(critical, _NO_DATA)
    worse = cause.problems.get("critical")
    is_worse = worse is not None and worse.fault is not None and critical is not _HEALTHY
    mild = _NO_DATA if is_worse or critical is _FAILING else _FAILING
    return {"critical": (critical, since), "warning": (mild, -inf)}


def _counts(book: Book, cause: Cause, needed: int, now: Instant) -> tuple[int, int]:
    """(how many keep it active, how many of them are in trouble now)."""
    robot = cause.robot
    if robot is None:
        if book.others is NO_OTHERS:  # as at most sites: asked at each change of a level
            return len(cause.counted), len(cause.fresh)
        others = book.others.counts.get((cause.scope, cause.name), Count())
        return _number(book, cause.counted) + others.counted, (
            _number(book, cause.fresh) + others.fresh
        )
    if 2 * len(robot.components) < needed:  # as on most robots: too few, whatever they are
        return 0, 0
    lasting = [each for each in robot.components.values() if each.since or each.flapping]
    unplanned = _unplanned(robot, lasting, now)
    # What is planned begins no fault, and ends none.
    left = len(lasting if cause.is_fault else unplanned)
    fresh = [each for each in unplanned if each.level is not _OK or each.flapping]
    nothing_known = not robot.up or robot.maintenance or now.mono < robot.returned_until
    if nothing_known or 2 * len(fresh) < needed:
        return left, 0
    if may_leave_out(book, robot):
        fresh = [each for each in fresh if not _is_explained(book, each, _BY_OTHERS, now)]
    return left, len(fresh)


def _unplanned(
    robot: RobotRecord, components: list[ComponentRecord], now: Instant
) -> list[ComponentRecord]:
    """Those components of a robot whose trouble nobody planned, nor has time to be over."""
    if robot.maintenance:
        return []
    return [
        each
        for each in components
        if not (each.has_time(now) or each.name.component in robot.maintained)
        and not (each.settings.planned_stale and each.is_planned_stale)
    ]


def may_leave_out(book: Book, robot: RobotRecord) -> bool:
    """Whether there is anything for which a component of it may not be counted: mostly not."""
    is_cut_off = robot.cut_off_since is not None
    return bool(robot.has_dependencies or book.causes or is_cut_off or robot.settings.uplink)


def _needed(book: Book, cause: Cause) -> int:
    """How many have to be in trouble, of all that it counts."""
    whole: float
    if cause.robot is not None:
        settings, whole = book.settings.many, cause.robot.total
    elif cause.scope is _SITE:
        settings, whole = book.settings.site, len(book.present.get(cause.name, ()))
    else:
        settings, whole = book.settings.common, sum(map(len, book.present.values()))
    if cause.robot is None and book.others is not NO_OTHERS:
        whole = _present(book, cause)
    # The tolerance keeps 0.1 of 30 at 3, whatever floating point makes of it.
    share = ceil(settings.share * whole - 1e-9)
    needed = max(settings.number, share)
    return needed if settings.absolute is None else min(needed, settings.absolute)


# -- of several exporters ----------------------------------------------------------------------


def take_others(book: Book, others: Others) -> None:
    """Go on with what other exporters count; each judges the sum, and so comes to the same."""
    if others != book.others:
        book.others = others
        for (scope, name), count in others.counts.items():
            if count.counted:
                book.cause(scope, name)
        book.touch_causes()


def counts(book: Book) -> Counts:
    """What is counted of this exporter's robots; those of which nothing is are left out."""
    found = {(Scope.SITE, site): Count(_number(book, each)) for site, each in book.present.items()}
    found[Scope.COMMON, ""] = Count(sum(each.present for each in found.values()))
    for key, cause in book.causes.items():
        counted, fresh = _number(book, cause.counted), _number(book, cause.fresh)
        if counted:
            found[key] = found.get(key, Count())._replace(counted=counted, fresh=fresh)
    return found


def _present(book: Book, cause: Cause) -> float:
    """How many robots there are of a site, or all; of exporters not known yet they are guessed."""
    is_site = cause.scope is Scope.SITE
    sites = (book.present.get(cause.name, ()),) if is_site else book.present.values()
    own = sum(_number(book, each) for each in sites)
    others = book.others.counts.get((cause.scope, cause.name if is_site else ""), Count())
    return (own + others.present) / book.others.known


def _number(book: Book, robots: Collection[str]) -> int:
    """How many robots these are, without those that another exporter counts."""
    twice = book.others.twice
    return len(robots) - sum(name in robots for name in twice)


def _identity(cause: Cause, severity: str) -> Identity:
    if cause.scope is Scope.SITE:
        return Identity(Scope.SITE, State.SILENT, site=cause.name)
    if cause.scope is Scope.COMMON:
        return Identity(Scope.COMMON, State.CRITICAL, component=cause.name)
    return Identity(Scope.ROBOT, State.MANY, robot=cause.name, severity=severity)
