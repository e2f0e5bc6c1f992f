"""Why a problem begins no fault: one problem explains another, and what people planned.

"P explains C" is one edge with one rule, whatever P is: C is suppressed only while P is a
fault, or can still become one in time, and P is at least as severe as C or says at least as much
about it. Once P is over, C has as long as P lasted to be healthy too, a minute at most, and then
its confirm_after.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from typing import NamedTuple

from ros_diagnostics_exporter import weekly
from ros_diagnostics_exporter.faults.book import TIME_TO_RETURN, Book
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    Identity,
    PartName,
    Reason,
    Scope,
    State,
    Verdict,
)
from ros_diagnostics_exporter.faults.records import (
    CapabilityRecord,
    ComponentRecord,
    Problem,
    RobotRecord,
)
from ros_diagnostics_exporter.model import Instant

_ABSENT, _FLAPPING, _SITE, _COMMON = Verdict.ABSENT, State.FLAPPING, Scope.SITE, Scope.COMMON
_OF_LEVEL = (Scope.COMPONENT, Scope.FLAPPING)  # a component's, and how often that changes
CLOCK_TOLERANCE = 0.001  # seconds by which a time that is computed by two clocks may be early
# Of the robot itself rather than of a part of it: its silence suppresses none of them.
_PRESENCE = {State.SILENT, State.PENDING, State.FLAPPING}
_OF_SITE = (State.SILENT, State.FLAPPING)  # what the silence of a site explains
# What a component that fails explains of those that depend on it; STALE only explains STALE.
_FRESH_FAILURES = (State.CRITICAL, State.FLAPPING)
_FAILURES = (*_FRESH_FAILURES, State.STALE)


class Edge(NamedTuple):
    """One problem that explains another.

    ``is_specific``: it says at least as much as the other would, whatever its severity.
    """

    reason: Reason
    problem: Problem
    is_specific: bool = False


class Suppression(NamedTuple):
    """Why a problem does not begin now, and the problem that explains it, if one does."""

    reason: Reason
    by: Problem | None = None


# -- why a problem does not begin, or a fault does not end ---------------------------------------


def why_not_begin(book: Book, problem: Problem, now: Instant) -> Suppression | None:
    """The first reason that keeps the problem from beginning now; None: it may."""
    robot = problem.robot
    if problem.in_downtime or _is_planned_silence(book, problem):
        return Suppression(Reason.MAINTENANCE)
    if robot is not None and robot.cut_off_since is not None and _rests_on_reception(problem):
        return Suppression(Reason.UNREACHABLE)
    edge = explanation(book, problem, now)
    of_silent = robot is not None and not robot.up and not _is_presence(problem.identity)
    if of_silent and (edge is None or edge.reason is not Reason.UNREACHABLE):
        return Suppression(Reason.ROBOT_SILENT)
    if edge is not None:
        return Suppression(edge.reason, edge.problem)
    reason = _why_not_yet(book, problem, now)
    return None if reason is None else Suppression(reason)


def _why_not_yet(book: Book, problem: Problem, now: Instant) -> Reason | None:
    """Why a problem that nothing explains does not begin now."""
    is_absent = problem.verdict is _ABSENT
    part_of = None if _is_presence(problem.identity) else problem.robot
    if problem.verdict is Verdict.NO_DATA:
        return Reason.NO_DATA
    if _may_flap(book, problem):
        return Reason.FLAPPING
    if is_absent and now.mono < book.grace_until:
        return Reason.RESTART
    if is_absent and part_of is not None and now.mono < part_of.returned_until:
        return Reason.RETURNED
    if not (problem.is_critical or warnings_may_begin(book, now)):
        return Reason.HOURS
    return None


def why_not_end(problem: Problem) -> Reason | None:
    """What keeps a fault from ending although it is healthy; None: it ends.

    Maintenance suppresses both ways, and so does a component's flapping.
    """
    component = problem.component
    if problem.in_downtime:
        return Reason.MAINTENANCE
    if component is not None and problem.identity.scope is Scope.COMPONENT and component.flapping:
        return Reason.FLAPPING
    return None


def warnings_may_begin(book: Book, now: Instant) -> bool:
    """Whether it is in the hours in which warnings begin, or the config names none."""
    hours = book.settings.warning_hours
    if hours is None:
        return True
    return weekly.holds(hours.weekly, hours.time_zone, int((now.wall + CLOCK_TOLERANCE) // 60))


def _is_presence(identity: Identity) -> bool:
    return identity.scope is Scope.ROBOT and identity.state in _PRESENCE


def _is_planned_silence(book: Book, problem: Problem) -> bool:
    """Whether a robot is not reached because its uplink, or one of that, fails in a downtime.

    Who plans that plans the silence of all robots that are reached through it.
    """
    robot, seen = problem.robot, set[RobotRecord]()
    if not _rests_on_reception(problem):
        return False
    while robot is not None and robot not in seen:
        seen.add(robot)
        failing = [edge.problem for edge in _uplinks(book, robot) if edge.problem.lasts]
        if any(each.in_downtime for each in failing):
            return True
        robot = book.robots.get(robot.settings.uplink) if failing else None
    return False


def _rests_on_reception(problem: Problem) -> bool:
    """Whether a problem may only mean that its robot is not reached."""
    if problem.component is None:
        return _is_presence(problem.identity)
    return problem.component.settings.measured or problem.verdict is _ABSENT


def _may_flap(book: Book, problem: Problem) -> bool:
    """Whether a component's changes may soon count as flapping, which says more than they do."""
    component = problem.component
    if component is None or problem.identity.state is not State.INTERMITTENT:
        return False
    ratio = 0.0 if component.flaps is None else component.flaps.ratio
    return component.flapping or ratio >= book.settings.flapping.stop


# -- the rule ------------------------------------------------------------------------------------


def explanation(book: Book, problem: Problem, now: Instant) -> Edge | None:
    """The first edge that explains a problem now; one from a fault rather than any other."""
    first = None
    for edge in edges(book, problem, now):
        if (first is None or edge.problem.fault is not None) and _holds(book, edge, problem, now):
            first = edge
            if edge.problem.fault is not None:
                break
    return first


def latest(book: Book, problem: Problem, now: Instant) -> float:
    """When (monotonic) an explanation has to be a fault at the latest.

    As long after the problem could have begun as its confirm_after, or a minute: so an explanation
    that never becomes a fault suppresses nothing for longer.
    """
    start = problem.waits_since
    if start is None:
        start = max(now.mono, book.due(problem))
    return start + max(TIME_TO_RETURN, book.confirm_after(problem))


def is_explained(
    book: Book, problems: Iterable[Problem], reasons: Iterable[Reason], now: Instant
) -> bool:
    """Whether one of these reasons explains one of these problems, for what counts problems.

    It does not ask whether the explanation will be a fault in time. That may rest on the count, and
    then both would change each other for ever. What its uplink's downtime plans is unreachable.
    """
    problems, reasons = list(problems), set(reasons)
    if Reason.UNREACHABLE in reasons and any(_is_planned_silence(book, each) for each in problems):
        return True
    return any(
        edge.reason in reasons and _may_hold(edge, each)
        for each in problems
        for edge in edges(book, each, now)
    )


def is_reported(book: Book, component: ComponentRecord, now: Instant) -> bool:
    """Whether what explains its trouble is a fault, so that people know of it."""
    return any(
        edge.problem.fault is not None and _holds(book, edge, each, now)
        for each in component.problems.values()
        for edge in edges(book, each, now)
    )


def is_unreachable(book: Book, robot: RobotRecord, now: Instant) -> bool:
    """Whether its uplink or its DDS domain explains that nothing is received of a robot."""
    if robot.cut_off_since is not None:
        return True
    if robot.settings.uplink not in book.robots:
        return False
    return is_explained(book, robot.problems.values(), (Reason.UNREACHABLE,), now)


def _may_hold(edge: Edge, problem: Problem) -> bool:
    """Whether an edge explains a problem if what it names is a fault, or will be one in time."""
    explains = edge.problem.effect.explains
    if explains == "never" or (explains == "as a fault" and edge.problem.fault is None):
        return False
    return _says_enough(edge, problem)


def _holds(book: Book, edge: Edge, problem: Problem, now: Instant) -> bool:
    explainer = edge.problem
    if explainer.fault is not None:
        return _may_hold(edge, problem)
    # Asked already: in a circle, as while other settings are taken one by one.
    if explainer in book.asked or explainer.effect.explains != "as a problem":
        return False
    book.asked.add(explainer)
    reporter = reporter_of(book, explainer, now)
    book.asked.discard(explainer)
    if reporter is None:
        return False
    # What is specific of the explainer is not known of another that speaks for it.
    reported = edge if reporter is explainer else Edge(edge.reason, reporter)
    return _says_enough(reported, problem) and (
        reporter.fault is not None or book.due(reporter) <= latest(book, problem, now)
    )


def _says_enough(edge: Edge, problem: Problem) -> bool:
    """Whether what explains a problem says as much about it, or is at least as severe."""
    is_specific = edge.is_specific and edge.problem.verdict >= Verdict.ABSENT
    return is_specific or edge.problem.is_critical or not problem.is_critical


def reporter_of(book: Book, problem: Problem, now: Instant) -> Problem | None:
    """The problem that is a fault, or will be one, for this one; None: there will be none."""
    if problem.fault is not None:
        return problem
    suppression = why_not_begin(book, problem, now)
    if suppression is None:
        return problem
    if suppression.by is not None:
        return reporter_of(book, suppression.by, now)
    # Who writes a capability says what the loss of a part is worth: if that is a warning, it may
    # wait for the hours of warnings.
    waits = suppression.reason is Reason.HOURS and problem.capability is not None
    return problem if waits else None


# -- the edges -----------------------------------------------------------------------------------


def edges(book: Book, problem: Problem, now: Instant) -> Iterator[Edge]:
    """Every problem that may explain this one, whether it does now or not."""
    robot, component = problem.robot, problem.component
    if robot is None:
        return
    if _rests_on_reception(problem):
        yield from _uplinks(book, robot)
    if _is_presence(problem.identity) and problem.identity.state is not State.PENDING:
        yield from _site(book, robot)
    flaps = robot.problems.get(_FLAPPING)
    # What is freshly received of a robot that comes and goes is as true as of any other, and one
    # that stays away does not come and go.
    if (
        flaps is not None
        and flaps is not problem
        and problem.verdict is _ABSENT
        and not robot.stays_away(book.settings.flapping)
    ):
        yield Edge(Reason.ROBOT_FLAPPING, flaps, is_specific=True)
    if component is not None:
        yield from _depended_on(problem, component)
        yield from _of_itself(problem, component)
    if problem.identity.scope in _OF_LEVEL and component is not None:
        yield from _many(robot)
        yield from _common(book, component.name.component)
    elif problem.capability is not None:
        yield from _many(robot)
        yield from _common_to_all(book, problem.capability)
    if robot.capabilities:
        yield from _capabilities(robot, problem, now)


def _uplinks(book: Book, robot: RobotRecord | None) -> Iterator[Edge]:
    uplink = None if robot is None else book.robots.get(robot.settings.uplink)
    if uplink is None or uplink is robot:
        return
    for component in uplink.components.values():
        failure = component.problems.get(State.CRITICAL)
        if failure is not None and component.settings.uplink:
            yield Edge(Reason.UNREACHABLE, failure)


def _site(book: Book, robot: RobotRecord) -> Iterator[Edge]:
    cause = book.causes.get((_SITE, robot.settings.site))
    for problem in () if cause is None else cause.problems.values():
        yield Edge(Reason.SITE, problem)


def _many(robot: RobotRecord) -> Iterator[Edge]:
    for problem in robot.many.problems.values():
        yield Edge(Reason.MANY, problem)


def _common(book: Book, name: str) -> Iterator[Edge]:
    cause = book.causes.get((_COMMON, name))
    for problem in () if cause is None else cause.problems.values():
        yield Edge(Reason.COMMON, problem)


def _common_to_all(book: Book, capability: CapabilityRecord) -> Iterator[Edge]:
    """What explains a capability: that each of its parts is common to many robots."""
    causes = [list(_common(book, part.component)) for part in capability.parts]
    if all(causes):
        yield from (edge for found in causes for edge in found)


def _depended_on(problem: Problem, component: ComponentRecord) -> Iterator[Edge]:
    components = component.robot.components
    states = _FAILURES if problem.verdict is _ABSENT else _FRESH_FAILURES
    for name in component.settings.depends_on:
        other = components.get(ComponentName(*name))
        if other is not None:
            for state in states:
                if state in other.problems:
                    yield Edge(Reason.DEPENDS_ON, other.problems[state], is_specific=True)


def _of_itself(problem: Problem, component: ComponentRecord) -> Iterator[Edge]:
    """What says more about the same component: that it flaps, or a fault of its level or value."""
    identity, flaps = problem.identity, component.problems.get(_FLAPPING)
    if flaps is not None and flaps is not problem and identity.scope is not Scope.VALUE:
        yield Edge(Reason.FLAPPING, flaps, is_specific=True)
    worse: Iterable[Problem] = ()
    if identity.state is State.INTERMITTENT:
        worse = component.problems.values()
    elif identity.state is State.FALLING:
        place = identity.key, identity.bound
        worse = [each for key, each in component.values.items() if key[:2] == place]
    for each in worse:
        if each is not problem and each.fault is not None:
            yield Edge(Reason.FAULT, each)


def _capabilities(robot: RobotRecord, problem: Problem, now: Instant) -> Iterator[Edge]:
    """The capabilities in trouble because of what the problem is about."""
    parts = _parts(problem.identity)
    for capability in robot.capabilities.values():
        if problem.capability is not None:
            is_part = is_larger(capability, problem.capability, now)
        else:
            is_part = not capability.parts.keys().isdisjoint(parts)
        for each in capability.problems.values() if is_part else ():
            yield Edge(Reason.CAPABILITY, each, is_specific=True)


def _parts(identity: Identity) -> set[PartName]:
    """The parts of capabilities to which a problem of this identity belongs."""
    if identity.scope is Scope.CHECK:
        return {PartName(check=identity.check)}
    if identity.scope not in (Scope.COMPONENT, Scope.VALUE, Scope.FLAPPING):
        return set()
    component = PartName(identity.group, identity.component)
    return {component, component._replace(key=identity.key)}


def is_larger(one: CapabilityRecord, other: CapabilityRecord, now: Instant) -> bool:
    """Whether one is in trouble for all parts of another, and worse, a fault or listed first."""
    if one is other or not one.problems or one.robot is None:
        return False
    mine, others = _confirmed(one, now), _confirmed(other, now)
    if not others <= mine:
        return False
    if one.worst is not other.worst:
        return one.worst > other.worst
    if others != mine:
        return True
    if one.is_fault is not other.is_fault:
        return one.is_fault
    names = list(one.robot.capabilities)
    return names.index(one.name) < names.index(other.name)


def _confirmed(capability: CapabilityRecord, now: Instant) -> set[PartName]:
    """The parts that keep it from being OK for long enough, and out of maintenance."""
    maintained = frozenset() if capability.robot is None else capability.robot.maintained
    return {
        part
        for part, bad in capability.parts.items()
        if bad.due <= now.mono and part.component not in maintained
    }


# -- what a problem explains ---------------------------------------------------------------------


def explained_by(book: Book, explainer: Problem, now: Instant) -> list[Problem]:
    """All problems that it explains, or that one which it explains does."""
    found = dict.fromkeys(_directly(book, explainer, now))
    ahead = [each for each in found if each.fault is None and each.may_explain]
    while ahead:
        for problem in _directly(book, ahead.pop(), now):
            if problem is not explainer and problem not in found:
                found[problem] = None
                if problem.fault is None and problem.may_explain:
                    ahead.append(problem)
    return list(found)


def _directly(book: Book, explainer: Problem, now: Instant) -> list[Problem]:
    """The problems to which there is an edge from it, and which it is severe enough for."""
    if explainer.cause is not None:  # of which there may be many: its edges are simple ones
        found = list(_candidates(book, explainer))
        return found if explainer.is_critical else [each for each in found if not each.is_critical]
    return [
        problem
        for problem in _candidates(book, explainer)
        for edge in edges(book, problem, now)
        if edge.problem is explainer
        and (edge.is_specific or explainer.is_critical or not problem.is_critical)
    ]


def _candidates(book: Book, explainer: Problem) -> Iterator[Problem]:
    """The problems among which those are that a problem explains; of a cause, just those."""
    robot, cause, component = explainer.robot, explainer.cause, explainer.component
    if cause is not None and cause.scope is Scope.SITE:
        for name in book.present.get(cause.name, ()):
            problems = book.robots[name].problems
            yield from (problems[state] for state in _OF_SITE if state in problems)
    elif cause is not None:
        components = book.named.get(cause.name, ()) if robot is None else robot.components.values()
        for each in components:
            yield from each.problems.values()
        for owner in {each.robot: None for each in components}:
            for capability in owner.capabilities.values():
                yield from capability.problems.values()
    elif component is not None:
        yield from component.all_problems()
        yield from _dependents(book, component)
    elif robot is not None:
        yield from robot.all_problems()


def _dependents(book: Book, component: ComponentRecord) -> Iterator[Problem]:
    robot = component.robot
    for each in robot.components.values() if robot.has_dependencies else ():
        if component.name in each.settings.depends_on:
            yield from each.all_problems()
    if component.settings.uplink:
        for other in book.robots.values():
            if other.settings.uplink == robot.name:
                yield from other.all_problems()


def release(book: Book, explainer: Problem, explained: Iterable[Problem], now: Instant) -> None:
    """Give what a problem explained as long to be healthy as that lasted, a minute at most.

    Where that was never a fault, not beyond the time at which it had to be one. What is a part of
    a capability gets it by itself: else the capability would wait for its own parts. What flapped
    has been at rest for long by then, and a component does not wait for itself. What changed
    meanwhile is not counted: people knew of it by the fault.
    """
    if explainer.identity.state is State.FLAPPING:
        return
    until = now.mono + min(max(0.0, now.mono - explainer.clock), TIME_TO_RETURN)
    component = explainer.component
    for problem in explained:
        if component is not None and problem.component is component:
            continue
        if explainer.fault is not None and problem.component is not None:
            book.forget_changes(problem.component)
        bound = until
        if explainer.fault is None and problem.waits_since is not None:
            bound = min(until, latest(book, problem, now))
        if component is not None and problem.robot is not None:
            book.await_return(problem.subject, problem.robot, bound)
        else:
            book.explain_until(problem.subject if explainer.capability is None else problem, bound)
