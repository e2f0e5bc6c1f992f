"""Advice from a recording: confirm_after, stale_after and thresholds, each with its reason.

Conservative: it says nothing without at least FEW examples, never proposes to wait longer than
LONGEST, and takes what recovered by itself for harmless only where a clear step separates it from
what did not.
"""

from __future__ import annotations

import json
import math
from array import array
from bisect import bisect_left
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from ros_diagnostics_exporter.config.fleet import Profile
from ros_diagnostics_exporter.durations import written
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Instant, Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.values import ExportedValue
from ros_diagnostics_tools.backtest import words
from ros_diagnostics_tools.backtest.history import confirm_after
from ros_diagnostics_tools.backtest.replay import Result
from ros_diagnostics_tools.names import escaped

FEW = 5  # examples without which nothing is proposed
MANY = 10  # as many, where there is nothing longer to compare with
STEP = 3.0  # times by which what did not recover by itself lasted longer than what did
LONGEST = 300.0  # seconds that a proposal waits at most
MARGIN = 1.2  # times the longest that was seen
ORDINARY = 10.0  # times the median gap: a longer one is no pause between two messages
QUIET = 300.0  # seconds for which a robot goes on after what reported trouble and then nothing
ENDS_AFTER = 600.0  # seconds, where no two reports show how often it repeats itself
NUMBERS = 100  # gaps, or values while OK, without which nothing is proposed
APART = 0.2  # share of the OK range by which values in trouble have to be away from it
_NICE = (1, 2, 3, 5, 10, 15, 20, 30, 45, 60, 90, 120, 180, 300)


@dataclass(frozen=True)
class Suggestion:
    """One setting for fleet.yml. ``entry`` is the item of the profile's list ``section``.

    For a setting of the profile itself ``section`` is "" and ``entry`` the setting. ``current`` and
    ``proposed`` are texts as in fleet.yml.
    """

    profile: str
    section: str
    about: str
    setting: str
    current: str
    proposed: str
    reason: str
    entry: dict[str, Any]


@dataclass
class _Range:
    """The numbers of one key: while OK and while not."""

    ok: int = 0
    low: float = math.inf
    high: float = -math.inf
    bad: int = 0
    bad_low: float = math.inf
    bad_high: float = -math.inf
    troubles: int = 0  # times that it went from OK into trouble
    was_ok: bool = True

    def add(self, number: float, *, ok: bool) -> None:
        if ok:
            self.ok += 1
            self.low, self.high = min(self.low, number), max(self.high, number)
        else:
            self.bad += 1
            self.troubles += self.was_ok
            self.bad_low, self.bad_high = min(self.bad_low, number), max(self.bad_high, number)
        self.was_ok = ok


class Statistics:
    """Gaps and values of a recording, read from the state after each message."""

    def __init__(self) -> None:
        self.robot_gaps: dict[str, array[float]] = defaultdict(lambda: array("d"))
        self.component_gaps: dict[tuple[str, str], array[float]] = defaultdict(lambda: array("d"))
        self.values: dict[tuple[str, str, str], _Range] = defaultdict(_Range)
        self.ok: set[tuple[str, str]] = set()  # components that were ever OK
        self._robots: dict[str, float] = {}
        self._components: dict[tuple[str, Component], float] = {}

    def observe(self, state: FleetState, now: Instant) -> None:
        """Note what a message brought."""
        for robot in state.robots.values():
            if robot.last_mono == now.mono:
                self._note(robot, now.mono)

    def _note(self, robot: RobotState, now: float) -> None:
        name, profile = robot.settings.name, robot.settings.profile.name
        if name in self._robots:
            self.robot_gaps[profile].append(now - self._robots[name])
        self._robots[name] = now
        for component in robot.components:
            if component.received != now:
                continue
            key = name, component
            if key in self._components:
                self.component_gaps[profile, component.name].append(now - self._components[key])
            self._components[key] = now
            ok = component.level == Level.OK
            if ok:
                self.ok.add((profile, component.name))
            for value in component.values.all:
                if _is_free(value):
                    self.values[profile, component.name, value.key].add(value.number, ok=ok)

    def quiet(self, profile: str) -> Iterator[tuple[str, float]]:
        """Components that drivers published and that were never OK: (name, seconds since)."""
        for (robot, component), last in self._components.items():
            name = component.name
            if component.raw_received is not None and (profile, name) not in self.ok:
                yield name, self._robots[robot] - last


def _is_free(value: ExportedValue) -> bool:
    """Whether a value is a number without a threshold of its own."""
    return math.isfinite(value.number) and not (value.rule and value.rule.thresholds)


def suggest(result: Result, statistics: Statistics, state: FleetState) -> list[Suggestion]:
    """All proposals, in the order of profiles and components."""
    profiles = {
        each.profile.name: each.profile
        for each in state.visit(lambda robot: robot.settings)
        if each.name in result.robots
    }
    found: list[Suggestion] = []
    for name, profile in sorted(profiles.items()):
        robots = [each for each in result.robots if _profile(state, each) == name]
        found += _stale_after(result, statistics, profile, robots)
        found += _confirm_after(result, state, profile, robots)
        found += _component_stale_after(statistics, profile)
        found += _on_change(state, statistics, profile, robots)
        found += _thresholds(statistics, profile)
    return found


def _profile(state: FleetState, robot: str) -> str:
    return state.robots[robot].settings.profile.name


# -- times -------------------------------------------------------------------------------------


def split(durations: Sequence[float]) -> tuple[int, float] | None:
    """Where what recovers by itself ends: (how many are short, the longest of them, in seconds).

    The widest step by which sorted durations grow; None where there is no clear one.
    """
    known = sorted(durations)
    short = bisect_left(known, LONGEST / MARGIN)
    steps = [
        (after / max(before, 0.1), number)
        for number, (before, after) in enumerate(pairwise(known), 1)
        if FEW <= number <= short
    ]
    widest, number = max(steps, default=(0.0, 0))
    if widest >= STEP:
        return number, known[number - 1]
    if short == len(known) >= MANY:
        return short, known[-1]
    return None


def nice(seconds: float) -> float:
    """The next round duration from ``seconds`` on, at most LONGEST."""
    return next((float(each) for each in _NICE if each >= seconds), LONGEST)


def _confirm_after(
    result: Result, state: FleetState, profile: Profile, robots: Sequence[str]
) -> Iterator[Suggestion]:
    outages: dict[str, list[float]] = defaultdict(list)
    robot_of: dict[str, str] = {}
    for each in result.outages:
        if each.component and each.ended and each.robot in robots:
            outages[each.component].append(each.seconds)
            robot_of[each.component] = each.robot
    rest: list[float] = []  # of the components that do not have enough of their own
    for component, durations in sorted(outages.items()):
        current = confirm_after(state, robot_of[component], component)
        found = _longer(durations, current)
        if found is not None:
            yield _component(profile, component, "confirm_after", (current, found[0]), found[1])
        elif current == profile.confirm_after:
            rest += durations
    found = _longer(rest, profile.confirm_after)
    if found is not None:
        yield _robot(profile, "confirm_after", (profile.confirm_after, found[0]), found[1])


def _longer(durations: Sequence[float], current: float) -> tuple[float, str] | None:
    """(a longer confirm_after, why) for outages of these durations; None where none helps."""
    found = split(durations)
    if found is None:
        return None
    short, longest = found
    proposed = nice(longest * MARGIN)
    avoided = sum(current <= each < proposed for each in durations)
    if proposed <= current or avoided < FEW:
        return None
    others = sorted(durations)[short:]
    reason = (
        f"{short} of {len(durations)} outages were over by themselves within "
        f"{words.duration(longest)}, "
        + (f"the next lasted {words.duration(others[0])}" if others else "none was longer")
        + f": {avoided} fewer, the others {words.duration(proposed - current)} later"
    )
    return proposed, reason


def _stale_after(
    result: Result, statistics: Statistics, profile: Profile, robots: Sequence[str]
) -> Iterator[Suggestion]:
    gaps = statistics.robot_gaps.get(profile.name, ())
    if len(gaps) < NUMBERS:
        return
    known, current = sorted(gaps), profile.stale_after
    ordinary = known[bisect_left(known, ORDINARY * known[len(known) // 2]) - 1]
    silences = [gap for gap in known if gap > current]
    found = split(silences)
    if found is not None:
        short, longest = found
        proposed = nice(longest * MARGIN)
        reason = (
            f"{short} of {len(silences)} silences were over by themselves within "
            f"{words.duration(longest)}; messages otherwise come every "
            f"{words.duration(known[len(known) // 2])}"
        )
        if proposed > current:
            yield _robot(profile, "stale_after", (current, proposed), reason)
    elif current > 10 * ordinary and current >= 30 and not silences:
        proposed = max(5.0, nice(3 * ordinary))
        reason = (
            f"no gap between two messages of {words.count(len(robots), 'robot')} was longer than "
            f"{words.duration(known[-1])}, in {words.duration(result.end - result.begin)}: "
            f"silence is noticed {words.duration(current - proposed)} sooner"
        )
        yield _robot(profile, "stale_after", (current, proposed), reason)


def _component_stale_after(statistics: Statistics, profile: Profile) -> Iterator[Suggestion]:
    for (name, component), gaps in sorted(statistics.component_gaps.items()):
        late = [gap for gap in gaps if gap > profile.stale_after]
        found = split(late) if name == profile.name and len(gaps) >= NUMBERS else None
        if found is None:
            continue
        short, longest = found
        reason = (
            f"{short} of {len(late)} pauses longer than {written(profile.stale_after)} were over "
            f"by themselves within {words.duration(longest)}"
        )
        times = profile.stale_after, nice(longest * MARGIN)
        if times[1] > times[0]:
            yield _component(profile, component, "stale_after", times, reason)


def _on_change(
    state: FleetState, statistics: Statistics, profile: Profile, robots: Sequence[str]
) -> Iterator[Suggestion]:
    """Drivers that report trouble and then nothing, while their robot goes on."""
    known = {
        each.name for name in robots for each in state.robots[name].components if each.is_on_change
    }
    for component, seconds in sorted(statistics.quiet(profile.name)):
        gaps = statistics.component_gaps.get((profile.name, component), ())
        longest = max(gaps, default=0.0)
        if component in known or seconds < max(QUIET, STEP * longest):
            continue
        times = "once" if not gaps else f"{len(gaps) + 1} times"
        reason = (
            f"reported {times}, never OK, and nothing for the {words.duration(seconds)} in which "
            "its robot was received after that"
        )
        after = written(max(ENDS_AFTER, nice(STEP * longest)))
        entry = {
            "match": {"regex": _exactly(component)},
            "reports": "on_change",
            "ends_after": after,
        }
        texts = "always", f"on_change, ends_after {after}", reason
        yield Suggestion(profile.name, "components", component, "reports", *texts, entry)


def _robot(profile: Profile, setting: str, times: tuple[float, float], reason: str) -> Suggestion:
    entry = {setting: written(times[1])}
    texts = "(all)", setting, written(times[0]), written(times[1]), reason
    return Suggestion(profile.name, "", *texts, entry)


def _component(
    profile: Profile, component: str, setting: str, times: tuple[float, float], reason: str
) -> Suggestion:
    entry = {"match": {"regex": _exactly(component)}, setting: written(times[1])}
    texts = component, setting, written(times[0]), written(times[1]), reason
    return Suggestion(profile.name, "components", *texts, entry)


def _exactly(name: str) -> str:
    return f"^{escaped(name)}$"


# -- thresholds --------------------------------------------------------------------------------


def _thresholds(statistics: Statistics, profile: Profile) -> Iterator[Suggestion]:
    for (name, component, key), seen in sorted(statistics.values.items()):
        if name != profile.name or seen.ok < NUMBERS or seen.troubles < FEW:
            continue
        apart = APART * max(seen.high - seen.low, 1e-9)
        if seen.bad_low >= seen.high + apart:
            bound, near = "high", (seen.high + seen.bad_low) / 2
        elif seen.bad_high <= seen.low - apart:
            bound, near = "low", (seen.low + seen.bad_high) / 2
        else:
            continue
        number = float(f"{near:.3g}")
        reason = (
            f"{seen.low:g} to {seen.high:g} while OK ({seen.ok:,} values), "
            f"{seen.bad_low:g} to {seen.bad_high:g} while not, {seen.troubles} times"
        )
        entry = {
            "component": {"regex": _exactly(component)},
            "key": {"regex": escaped(key)},
            "thresholds": {bound: {"warning": number}},
        }
        about = f"{component}: {key}"
        texts = about, f"thresholds {bound} warning", "none", f"{number:g}", reason
        yield Suggestion(profile.name, "values", *texts, entry)


# -- for fleet.yml -----------------------------------------------------------------------------


def as_yaml(suggestions: Sequence[Suggestion]) -> str:
    """What to put into fleet.yml: the profiles with the proposed settings, reasons as comments.

    The lists go before a profile's own: the first entry that matches applies.
    """
    lines = ["profiles:"]
    for profile in dict.fromkeys(each.profile for each in suggestions):
        lines.append(f"  {profile}:")
        own = [each for each in suggestions if each.profile == profile]
        for section in sorted({each.section for each in own}):
            lines += [f"    {section}:"] if section else []
            for each in own:
                if each.section == section:
                    lines += _lines(each)
    return "\n".join(lines) + "\n"


def _lines(suggestion: Suggestion) -> list[str]:
    indent = "      " if suggestion.section else "    "
    comment = f"{indent}# {suggestion.reason}"
    if not suggestion.section:
        return [comment, *(f"{indent}{key}: {value}" for key, value in suggestion.entry.items())]
    return [comment, f"{indent}- {json.dumps(suggestion.entry, ensure_ascii=False)}"]
