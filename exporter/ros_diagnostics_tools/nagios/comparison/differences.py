"""Pairs the notifications of both sides, and says where they disagree."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

from ros_diagnostics_tools.nagios.comparison.here import Here, Larger
from ros_diagnostics_tools.nagios.comparison.notice import Notice, changes


@dataclass(frozen=True)
class Pair:
    """One notification on both sides."""

    nagios: Notice
    here: Notice

    @property
    def later(self) -> float:
        """By how many seconds it was later here; negative: in Nagios."""
        return self.here.time - self.nagios.time


@dataclass
class Differences:
    """What both sides notified. ``explained`` are only in Nagios, and part of a larger one here."""

    pairs: list[Pair] = field(default_factory=list)
    late: list[Pair] = field(default_factory=list)
    only_in_nagios: list[Notice] = field(default_factory=list)
    only_here: list[Notice] = field(default_factory=list)
    explained: list[tuple[Notice, Larger]] = field(default_factory=list)

    @property
    def agree(self) -> bool:
        """Whether there is none."""
        return not (self.late or self.only_in_nagios or self.only_here)

    @property
    def empty(self) -> bool:
        """Whether neither side notified anything."""
        return self.agree and not (self.pairs or self.explained)

    def between(self, since: float, until: float) -> Differences:
        """What at least one side notified in that time; the other may have just before or after."""

        def is_in(*notices: Notice) -> bool:
            return any(since <= each.time <= until for each in notices)

        return Differences(
            pairs=[each for each in self.pairs if is_in(each.nagios, each.here)],
            late=[each for each in self.late if is_in(each.nagios, each.here)],
            only_in_nagios=[each for each in self.only_in_nagios if is_in(each)],
            only_here=[each for each in self.only_here if is_in(each)],
            explained=[each for each in self.explained if is_in(each[0])],
        )


def compare(nagios: Sequence[Notice], here: Here, *, late: float, within: float) -> Differences:
    """Pair what is about the same, of the same state and at most ``within`` seconds apart.

    Pairs that are more than ``late`` seconds apart disagree.
    """
    found = Differences()
    ours = _by_kind(changes(here.notices))
    for each in changes(list(nagios)):
        candidates = ours.get((*each.about, each.state), [])
        near = [other for other in candidates if abs(other.time - each.time) <= within]
        if near:
            # The first that is left, not the nearest: what follows needs the next one.
            candidates.remove(near[0])
            pair = Pair(each, near[0])
            (found.late if abs(pair.later) > late else found.pairs).append(pair)
        elif larger := next((one for one in here.larger if one.covers(each, within)), None):
            found.explained.append((each, larger))
        else:
            found.only_in_nagios.append(each)
    left = [each for candidates in ours.values() for each in candidates]
    found.only_here = sorted(left, key=lambda notice: notice.time)
    return found


def _by_kind(notices: Iterable[Notice]) -> dict[tuple[str, str, str], list[Notice]]:
    found: dict[tuple[str, str, str], list[Notice]] = {}
    for each in notices:
        found.setdefault((*each.about, each.state), []).append(each)
    return found
