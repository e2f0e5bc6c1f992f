"""What another configuration changes: the notifications of one recording, side by side."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, fields
from statistics import median
from typing import Any

from ros_diagnostics_exporter.config.fleet import FaultSettings, Fleet, Profile
from ros_diagnostics_exporter.durations import written
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_tools.backtest import words
from ros_diagnostics_tools.backtest.history import Notification
from ros_diagnostics_tools.backtest.replay import Result

SAME = 0.5  # seconds by which two notifications may differ and are at the same time
SHOWN = 10  # faults that are named of each kind
_TIMES = ("stale_after", "confirm_after", "flap_interval", "forget_after")


@dataclass
class Comparison:
    """The notifications of both configurations, paired.

    ``covered`` are those of ``fewer`` for whose component or robot something else is notified, such
    as its flapping; ``missed`` those of the others whose trouble lasted as long as the other
    configuration's own confirm_after and more: a fault of which nobody would have known. The
    recording ends before it is known of those of ``unknown``.
    """

    settings: list[str]
    before: int
    after: int
    fewer: list[Notification] = field(default_factory=list)
    covered: list[Notification] = field(default_factory=list)
    missed: list[Notification] = field(default_factory=list)
    unknown: list[Notification] = field(default_factory=list)
    more: list[Notification] = field(default_factory=list)
    pairs: list[tuple[Notification, Notification]] = field(default_factory=list)

    @property
    def later(self) -> list[tuple[Notification, float]]:
        """Which are notified later, by how many seconds."""
        return [(new, late) for new, late in self._delays() if late > SAME]

    @property
    def earlier(self) -> list[tuple[Notification, float]]:
        """Which are notified earlier, by how many seconds."""
        return [(new, -late) for new, late in self._delays() if late < -SAME]

    @property
    def renamed(self) -> list[tuple[Notification, Notification]]:
        """Which are of another state than before."""
        return [(old, new) for old, new in self.pairs if old.identity != new.identity]

    def _delays(self) -> Iterator[tuple[Notification, float]]:
        for old, new in self.pairs:
            yield new, new.began.time - old.began.time


def compare(first: Result, second: Result, confirm_after: Callable[[Event], float]) -> Comparison:
    """Compare the results of one recording; ``confirm_after`` is the second one's, in seconds."""
    found = Comparison(
        settings_changed(first.fleet, second.fleet),
        len(first.notifications),
        len(second.notifications),
    )
    old, new = list(first.notifications), list(second.notifications)
    for key in (_identity, _place):
        old, new = _pair(old, new, key, found.pairs)
    found.fewer, found.more = old, new
    found.covered = [each for each in old if any(_covers(o, each) for o in second.notifications)]
    for each in old:
        if each in found.covered:
            continue
        if each.duration(first.end) >= confirm_after(each.began):
            found.missed.append(each)
        elif each.ended is None:
            found.unknown.append(each)
    return found


def _covers(other: Notification, notification: Notification) -> bool:
    """Whether who got the one notification knew of the trouble of the other."""
    by, fault = other.began, notification.began
    same = (by.robot, by.component) == (fault.robot, fault.component)
    larger = (
        (by.scope in ("robot", "capability") and by.robot == fault.robot)
        or (by.scope == "common" and by.component == fault.component)
        or (by.scope == "site" and by.site == fault.site)
    )
    return (same or larger) and _overlap(other, notification)


def _identity(notification: Notification) -> tuple[str, ...]:
    return notification.identity


def _place(notification: Notification) -> tuple[str, ...]:
    fault = notification.began
    return fault.scope, fault.site, fault.robot, fault.group, fault.component


def _pair(
    old: list[Notification],
    new: list[Notification],
    key: Callable[[Notification], object],
    pairs: list[tuple[Notification, Notification]],
) -> tuple[list[Notification], list[Notification]]:
    """Pair those of one key that overlap in time; returns those that are left."""
    left: list[Notification] = []
    waiting: dict[object, list[Notification]] = {}
    for each in new:
        waiting.setdefault(key(each), []).append(each)
    for each in old:
        others = waiting.get(key(each), [])
        other = next((other for other in others if _overlap(each, other)), None)
        if other is None:
            left.append(each)
        else:
            others.remove(other)
            pairs.append((each, other))
    unpaired = [each for others in waiting.values() for each in others]
    return left, sorted(unpaired, key=lambda each: each.began.time)


def _overlap(one: Notification, other: Notification) -> bool:
    return (one.ended is None or other.since <= one.ended) and (
        other.ended is None or one.since <= other.ended
    )


# -- words -------------------------------------------------------------------------------------


def in_words(comparison: Comparison) -> list[str]:
    """The comparison as lines of text."""
    lines = comparison.settings or ["the configurations differ in nothing that judges faults"]
    less = comparison.before - comparison.after
    total = f"{comparison.after} instead of {comparison.before}"
    verb = "the same number" if not less else f"{abs(less)} {'fewer' if less > 0 else 'more'}"
    lines = [*lines, f"notifications: {total}, {verb}"]
    lines += _delayed("later", comparison.later)
    lines += _delayed("earlier", comparison.earlier)
    if comparison.renamed:
        states = {f"{old.began.state} now {new.began.state}"
                  for old, new in comparison.renamed}  # fmt: skip
        lines.append(f"{words.count(len(comparison.renamed), 'fault')} of another state: "
                     f"{', '.join(sorted(states))}")  # fmt: skip
    lines += _named("only with the other configuration", comparison.more)
    lines += _named("no longer notified, recovered by themselves", _others(comparison))
    lines += _named("covered by another notification", comparison.covered)
    lines += _named("not known: the recording ends before their confirm_after", comparison.unknown)
    lines += _named("MISSED: lasted longer than their confirm_after", comparison.missed)
    return lines if comparison.missed or comparison.unknown else [*lines, "none missed"]


def _others(comparison: Comparison) -> list[Notification]:
    explained = (*comparison.missed, *comparison.covered, *comparison.unknown)
    return [each for each in comparison.fewer if each not in explained]


def _delayed(what: str, delays: list[tuple[Notification, float]]) -> list[str]:
    if not delays:
        return []
    seconds = sorted(each for _new, each in delays)
    text = words.duration(round(median(seconds)))
    if seconds[-1] - seconds[0] > 1:
        text += f" (median; {words.duration(seconds[0])} to {words.duration(seconds[-1])})"
    return [f"{words.count(len(delays), 'fault')} {what} by {text}"]


def _named(what: str, notifications: list[Notification]) -> list[str]:
    if not notifications:
        return []
    names = [
        f"  {words.moment(each.since)}  {each.began.robot} {words.place(each.began)}: "
        f"{words.state(each.began)}"
        for each in notifications[:SHOWN]
    ]
    if len(notifications) > SHOWN:
        names.append(f"  and {len(notifications) - SHOWN} more: --output json has all")
    return [f"{words.count(len(notifications), 'fault')} {what}:", *names]


def settings_changed(first: Fleet, second: Fleet) -> list[str]:
    """What the second configuration has other than the first, of what judges faults."""
    lines = []
    old, new = _profiles(first), _profiles(second)
    for name in sorted(old.keys() & new.keys()):
        lines += [f"profile {name}: {each}" for each in _profile_changed(old[name], new[name])]
    lines += [f"profile {name}: new" for name in sorted(new.keys() - old.keys())]
    lines += [f"profile {name}: gone" for name in sorted(old.keys() - new.keys())]
    if first.faults != second.faults:
        lines += _faults_changed(first.faults, second.faults)
    if first.maintenance != second.maintenance:
        lines.append("maintenance: other windows")
    return lines


def _faults_changed(old: FaultSettings, new: FaultSettings) -> Iterator[str]:
    for each in fields(old):
        before, after = getattr(old, each.name), getattr(new, each.name)
        if before != after:
            yield f"faults: {each.name} {after} instead of {before}"


def _profiles(fleet: Fleet) -> dict[str, Profile]:
    return {**{each.profile.name: each.profile for each in fleet.entries}, **fleet.profiles}


def _profile_changed(old: Profile, new: Profile) -> Iterator[str]:
    for name in _TIMES:
        before, after = getattr(old, name), getattr(new, name)
        if before != after:
            yield f"{name} {written(after)} instead of {written(before)}"
    if old.stale_is_critical != new.stale_is_critical:
        yield f"stale_is_critical {str(new.stale_is_critical).lower()}"
    for name in ("components", "values", "checks"):
        if getattr(old, name) != getattr(new, name):
            yield f"other rules of {name}"


# -- for programs ------------------------------------------------------------------------------


def as_json(
    comparison: Comparison, until: float, one: Callable[..., dict[str, Any]]
) -> dict[str, Any]:
    """The comparison as JSON values; ``one`` makes them of a notification."""
    return {
        "settings": comparison.settings,
        "notifications": {"before": comparison.before, "after": comparison.after},
        **{
            name: [one(each, until) for each in getattr(comparison, name)]
            for name in ("fewer", "covered", "missed", "unknown", "more")
        },
        "later": [{**one(each, until), "by": seconds} for each, seconds in comparison.later],
        "earlier": [{**one(each, until), "by": seconds} for each, seconds in comparison.earlier],
        "words": in_words(comparison),
    }
