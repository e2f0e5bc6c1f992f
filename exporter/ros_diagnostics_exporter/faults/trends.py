"""Values that fall towards the critical low threshold of the config: where they will be.

A value with such a threshold is sampled at equal intervals, changed or not. The line through all
samples, continued, is the forecast; nothing is known before there are as many as it needs, so that
silence, STALE and a restart begin and end nothing. What is no number (NaN) is a sample that is
missing.
"""

from __future__ import annotations

from collections import deque
from math import isnan

from ros_diagnostics_exporter.config.fleet import Threshold
from ros_diagnostics_exporter.faults import components
from ros_diagnostics_exporter.faults.book import Book
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    ComponentSettings,
    Identity,
    Scope,
    State,
    ValueReport,
    Verdict,
)
from ros_diagnostics_exporter.faults.records import (
    TREND_STEPS,
    ComponentRecord,
    Problem,
    RobotRecord,
    Trend,
)
from ros_diagnostics_exporter.model import Instant


def follow(
    book: Book,
    location: tuple[RobotRecord, ComponentName, ComponentSettings],
    report: ValueReport,
    now: Instant,
) -> None:
    """Take one value of a component of a robot that is up."""
    robot, name, settings = location
    threshold = next((each for each in report.thresholds if _is_followed(each)), None)
    if threshold is None or report.number is None:
        robot.trends.pop((name, report.key), None)
        problem = _problem(robot, name, report.key)
        if problem is not None:
            book.give_verdict(problem, Verdict.NO_DATA)
        return
    trend = robot.trends.get((name, report.key))
    if trend is None:
        trend = robot.trends[name, report.key] = Trend()
        book.timers.set_at_latest(("trends", robot), now.mono + _step(book))
    trend.number, trend.threshold = report.number, threshold
    trend.most, trend.settings = report.most, settings


def sample(book: Book, robot: RobotRecord, now: Instant) -> None:
    """Sample all that is followed of a robot, and judge it."""
    step = _step(book)
    for (name, key), trend in robot.trends.items():
        if trend.step != step:  # another config: the samples are of other moments
            trend.step = step
            trend.samples.clear()
        trend.samples.append(trend.number)
        _judge(book, (robot, name, key), trend, now)
    if robot.trends:
        book.timers.set(("trends", robot), now.mono + step)


def drop(robot: RobotRecord, name: ComponentName) -> None:
    """No longer follow the values of a component."""
    for place in [place for place in robot.trends if place[0] == name]:
        del robot.trends[place]


def forecast(samples: deque[float], steps: float) -> float:
    """Where the least-squares line through samples at equal intervals is ``steps`` after them."""
    known = [(place, each) for place, each in enumerate(samples) if not isnan(each)]
    middle = sum(place for place, _each in known) / len(known)
    mean = sum(each for _place, each in known) / len(known)
    spread = sum((place - middle) ** 2 for place, _each in known)
    slope = sum((place - middle) * each for place, each in known) / spread
    return mean + slope * (len(samples) - 1 - middle + steps)


def _problem(robot: RobotRecord, name: ComponentName, key: str) -> Problem | None:
    component = robot.components.get(name)
    return None if component is None else component.values.get((key, "low", "falling"))


def _is_followed(threshold: Threshold) -> bool:
    return threshold.bound == "low" and threshold.severity == "critical"


def _step(book: Book) -> float:
    """Seconds between two samples."""
    return book.settings.falling.over / TREND_STEPS


def _judge(
    book: Book, place: tuple[RobotRecord, ComponentName, str], trend: Trend, now: Instant
) -> None:
    robot, name, key = place
    problem = _problem(robot, name, key)
    verdict = _verdict(book, trend, in_trouble=problem is not None and problem.lasts)
    if verdict is Verdict.FAILING and name not in robot.components:
        book.add_component(ComponentRecord(robot, name, trend.settings))
    identity = Identity(Scope.VALUE, State.FALLING, "", robot.name, *name, key=key, bound="low")
    book.judge(identity, verdict, now)


def _verdict(book: Book, trend: Trend, *, in_trouble: bool) -> Verdict:
    """Too low already is no end: that is another fault, and this one goes on under it."""
    samples, known = trend.samples, [each for each in trend.samples if not isnan(each)]
    if len(samples) <= TREND_STEPS or trend.threshold.is_beyond(trend.number):
        return Verdict.NO_DATA
    if isnan(trend.number) or 2 * len(known) <= len(samples):
        return Verdict.NO_DATA
    if known[-1] >= known[0]:
        return Verdict.HEALTHY
    steps = book.settings.falling.ahead / _step(book)
    number, hysteresis = forecast(samples, steps), book.settings.value_hysteresis
    verdict = components.of_value(trend.threshold, number, hysteresis, in_trouble=in_trouble)
    return min(verdict, trend.most)
