"""The topics of one robot: endpoints that cannot match, publishers that were replaced. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

from ros_diagnostics_exporter.model import Instant, Level

# Seconds for which something has to be seen: endpoints are found one by one, and what is replaced
# is there twice until the middleware notices that a process was killed.
SEEN_FOR = 30.0
MOST = 1000  # topics of one robot
PARTICIPANT = 24  # hexadecimal digits of an endpoint's id that name its process


class Peer(NamedTuple):
    """One endpoint: the full name of its node, and its id in the middleware (hexadecimal)."""

    node: str
    gid: str

    @property
    def process(self) -> str:
        """What names the process, the same for all of its endpoints."""
        return self.gid[:PARTICIPANT]


class Mismatch(NamedTuple):
    """A publisher and a subscriber, by their nodes, that cannot match, and why."""

    publisher: str
    subscriber: str
    why: str


class TopicView(NamedTuple):
    """What the graph shows of one topic."""

    publishers: tuple[Peer, ...]
    subscribers: tuple[Peer, ...]
    mismatches: tuple[Mismatch, ...] = ()

    def without(self, is_ignored: Callable[[str], bool]) -> TopicView:
        """It, without what nodes have that do not count."""
        return TopicView(
            tuple(each for each in self.publishers if not is_ignored(each.node)),
            tuple(each for each in self.subscribers if not is_ignored(each.node)),
            tuple(
                each
                for each in self.mismatches
                if not (is_ignored(each.publisher) or is_ignored(each.subscriber))
            ),
        )


@dataclass(slots=True)
class _Topic:
    """One topic; times are monotonic.

    ``alone`` are the seconds for which it had exactly one publisher, ``read`` is when it was read
    last, ``publishers`` their ids by node.
    """

    alone: float = 0.0
    read: float = 0.0
    accepted: frozenset[Mismatch] = frozenset()  # of which a person knows
    publishers: dict[str, frozenset[str]] = field(default_factory=dict)
    doubled: float | None = None  # since when there are several
    mismatches: dict[Mismatch, float] = field(default_factory=dict)  # since when

    def problems(self, learn_after: float) -> Iterator[str]:
        """What is wrong with it, as far as two looks show."""
        for each, since in self.mismatches.items():
            if self.read - since >= SEEN_FOR and each not in self.accepted:
                yield f"{each.subscriber} receives nothing from {each.publisher}: {each.why}"
        is_late = self.doubled is not None and self.read - self.doubled >= SEEN_FOR
        if is_late and self.alone >= learn_after:
            nodes = ", ".join(sorted(self.publishers))
            yield f"{_count(self.publishers)} publishers where one was: {nodes}"

    def accept(self, learn_after: float) -> None:
        """Take what is there as usual."""
        self.accepted = frozenset(self.mismatches)
        self.alone = learn_after if _count(self.publishers) == 1 else 0.0


class Topics:
    """The topics of one robot by their names in its namespace."""

    def __init__(self) -> None:
        self._topics: dict[str, _Topic] = {}
        self._events: list[str] = []

    def update(self, name: str, view: TopicView, now: Instant) -> None:
        """Take what the graph shows of one topic."""
        if name not in self._topics and len(self._topics) >= MOST:
            return
        topic = self._topics.setdefault(name, _Topic())
        ids: dict[str, set[str]] = {}
        for each in view.publishers:
            ids.setdefault(each.node, set()).add(each.gid)
        publishers = {node: frozenset(found) for node, found in ids.items()}
        if len(view.publishers) == 1 and _count(topic.publishers) == 1:
            topic.alone += now.mono - topic.read
        self._note_restarts(name, topic.publishers, publishers)
        topic.publishers, topic.read = publishers, now.mono
        if len(view.publishers) > 1:
            topic.doubled = now.mono if topic.doubled is None else topic.doubled
        else:
            topic.doubled = None
        since = topic.mismatches
        topic.mismatches = {each: since.get(each, now.mono) for each in view.mismatches}

    def _note_restarts(
        self, name: str, before: Mapping[str, frozenset[str]], now: Mapping[str, frozenset[str]]
    ) -> None:
        for node, ids in now.items():
            former = before.get(node, frozenset())
            if len(ids) == 1 and former - ids:
                self._events.append(f"the publisher of {name} in {node} was restarted")

    def judge(self, learn_after: float) -> dict[str, tuple[int, str]]:
        """(level, text) of each problem, by component."""
        problems = {}
        for name, topic in self._topics.items():
            if texts := sorted(topic.problems(learn_after)):
                problems[f"topic {name}"] = int(Level.WARN), "; ".join(texts)
        return problems

    # -- by a person -----------------------------------------------------------------------------

    def accept(self, learn_after: float) -> None:
        """Take what is there as usual."""
        for topic in self._topics.values():
            topic.accept(learn_after)

    def forget(self, component: str, learn_after: float) -> None:
        """Take as usual what a component is about."""
        for name, topic in self._topics.items():
            if component == f"topic {name}":
                topic.accept(learn_after)

    def take_events(self) -> list[str]:
        """What happened since the last call."""
        events, self._events = self._events, []
        return events

    # -- outliving the process ---------------------------------------------------------------

    def learned(self) -> dict[str, float]:
        """For how long each had one publisher."""
        return {name: round(each.alone) for name, each in self._topics.items() if each.alone}

    def accepted(self) -> list[tuple[str, Mismatch]]:
        """The topics, and what of them a person knows."""
        return [(name, each) for name, of in self._topics.items() for each in sorted(of.accepted)]

    def restore(
        self, learned: Mapping[str, float], accepted: Iterable[tuple[str, Mismatch]]
    ) -> None:
        """Go on from what an earlier process learned."""
        for name, alone in learned.items():
            self._topics[name] = _Topic(alone=alone)
        for name, mismatch in accepted:
            topic = self._topics.setdefault(name, _Topic())
            topic.accepted |= {Mismatch(*mismatch)}


def _count(publishers: Mapping[str, Iterable[str]]) -> int:
    return sum(len([*ids]) for ids in publishers.values())
