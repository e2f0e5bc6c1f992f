"""The topics of one robot: endpoints that cannot match, are alone, or were replaced. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter.model import Instant, Level

# Seconds for which something has to be seen: endpoints are found one by one, and what is replaced
# is there twice until the middleware notices that a process was killed.
SEEN_FOR = 30.0
MOST = 1000  # topics of one robot
MAX_NAME = 256  # characters of a name that are kept
MAX_WHY = 1000
MAX_PEERS = 100  # endpoints of a topic on each side
DISCOVERY = "discovery"
PARTICIPANT = 24  # hexadecimal digits of an endpoint's id that name its process


NodeName = Annotated[str, Field(max_length=512)]  # MAX_NAME of what is written now
Seconds = Annotated[float, Field(ge=0, le=1e11, allow_inf_nan=False)]


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

    def limited(self) -> Mismatch:
        """It, with no longer texts than are stored: of twelve publishers all are named."""
        publisher, subscriber = self.publisher[:MAX_NAME], self.subscriber[:MAX_NAME]
        return Mismatch(publisher, subscriber, self.why[:MAX_WHY])


US = "this exporter"  # as the subscriber of a mismatch
# What stands for endpoints that the middleware cannot say the node of: half of it was discovered.
UNKNOWN = Mismatch("", "", "of no known node")
_Side = Literal["publishes", "subscribes"]


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

    def limited(self) -> TopicView:
        """It, with no more and no longer texts than are stored."""
        sides = (self.publishers[:MAX_PEERS], self.subscribers[:MAX_PEERS])
        publishers, subscribers = (
            tuple(each._replace(node=each.node[:MAX_NAME]) for each in side) for side in sides
        )
        mismatches = tuple(each.limited() for each in self.mismatches)
        return TopicView(publishers, subscribers, mismatches)


class TopicLearned(NamedTuple):
    """What a later process should know of one topic; see `_Topic`."""

    alone: Seconds
    matched: Seconds
    ends: dict[_Side, Annotated[list[NodeName], Field(max_length=MAX_PEERS)]]


@dataclass(slots=True)
class _Topic:
    """One topic; times are monotonic.

    ``alone`` are the seconds for which it had exactly one publisher, ``matched`` those for which it
    had publishers and subscribers; ``read`` is when it was read last, and ``found`` for the first
    time; ``publishers`` are their ids by node, ``ends`` the nodes of each side when it last had
    both.
    """

    alone: float = 0.0
    matched: float = 0.0
    read: float = 0.0
    found: float | None = None
    ends: dict[_Side, frozenset[str]] = field(default_factory=dict)
    broken: tuple[_Side, float] | None = None  # the side that is missing, and since when
    accepted: frozenset[Mismatch] = frozenset()  # of which a person knows
    publishers: dict[str, frozenset[str]] = field(default_factory=dict)
    doubled: float | None = None  # since when there are several
    mismatches: dict[Mismatch, float] = field(default_factory=dict)  # since when

    def problems(self, learn_after: float) -> Iterator[str]:
        """What is wrong with it, as far as two looks show."""
        for each, since in self.mismatches.items():
            is_new = each != UNKNOWN and each not in self.accepted
            if is_new and self.read - since >= SEEN_FOR:
                yield f"{each.subscriber} receives nothing from {each.publisher}: {each.why}"
        is_late = self.doubled is not None and self.read - self.doubled >= SEEN_FOR
        if is_late and self.alone >= learn_after and not self._is_of_doubled_node():
            nodes = ", ".join(sorted(self.publishers))
            yield f"{_count(self.publishers)} publishers where one was: {nodes}"

    def _is_of_doubled_node(self) -> bool:
        """Whether processes with one node of the same name publish it: the node is the problem."""
        gids = [each for ids in self.publishers.values() for each in ids]
        return len(self.publishers) == 1 and len({each[:PARTICIPANT] for each in gids}) > 1

    def lost(self, learn_after: float, there_since: Callable[[str], float]) -> Iterator[str]:
        """What it had on both sides for long and has on one, although the others' nodes go on.

        Those that are back have time to publish, or to subscribe, again.
        """
        if self.broken is not None and self.matched >= learn_after:
            side, since = self.broken
            nodes = self.ends[side]
            if self.read - max(since, *map(there_since, nodes)) >= SEEN_FOR:
                yield f"nobody {side} any more, as {', '.join(sorted(nodes))} did"

    @property
    def is_unknown(self) -> bool:
        """Whether some endpoints are of no known node, as far as two looks show."""
        since = self.mismatches.get(UNKNOWN, self.read)
        return UNKNOWN not in self.accepted and self.read - since >= SEEN_FOR

    def accept(self, learn_after: float) -> None:
        """Take what is there as usual."""
        self.accepted = frozenset(self.mismatches)
        self.alone = learn_after if _count(self.publishers) == 1 else 0.0
        if self.broken is not None:
            self.matched, self.ends, self.broken = 0.0, {}, None

    def see_ends(
        self, publishers: frozenset[str], subscribers: frozenset[str], mono: float
    ) -> None:
        """Take the nodes of both sides."""
        if publishers and subscribers:
            if self.ends and self.broken is None:
                self.matched += mono - self.read
            self.ends, self.broken = {"publishes": publishers, "subscribes": subscribers}, None
        elif self.ends and (publishers or subscribers):
            side: _Side = "subscribes" if publishers else "publishes"
            if self.broken is None or self.broken[0] != side:
                self.broken = side, mono
        else:
            self.broken = None

    def drop(self, is_dropped: Callable[[str], bool]) -> bool:
        """Know no more what nodes have that do not count; whether there was any."""
        mismatches = {
            each: since
            for each, since in self.mismatches.items()
            if not (is_dropped(each.publisher) or is_dropped(each.subscriber))
        }
        publishers = {node: ids for node, ids in self.publishers.items() if not is_dropped(node)}
        is_left = any(is_dropped(node) for nodes in self.ends.values() for node in nodes)
        if is_left:
            self.matched, self.ends, self.broken = 0.0, {}, None
        if _count(publishers) < 2:
            self.doubled = None
        changed = is_left or (mismatches, publishers) != (self.mismatches, self.publishers)
        self.mismatches, self.publishers = mismatches, publishers
        return changed


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
        subscribers = frozenset(each.node for each in view.subscribers)
        topic.see_ends(frozenset(publishers), subscribers, now.mono)
        if topic.found is None:
            topic.found = now.mono
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

    def judge(
        self, learn_after: float, there_since: Callable[[str], float]
    ) -> dict[str, tuple[int, str]]:
        """(level, text) of each problem, by component.

        ``there_since`` says since when a node is there, monotonic; infinity for one that is not.
        """
        problems = {}
        for name, topic in self._topics.items():
            texts = sorted((*topic.problems(learn_after), *topic.lost(learn_after, there_since)))
            if texts:
                problems[f"topic {name}"] = int(Level.WARN), "; ".join(texts)
        unknown = sorted(name for name, topic in self._topics.items() if topic.is_unknown)
        if unknown:
            text = f"endpoints of {len(unknown)} topics are of no known node: {', '.join(unknown)}"
            problems[DISCOVERY] = int(Level.WARN), text
        return problems

    def is_known(self, component: str) -> bool:
        """Whether all topics that a component is about were read for long enough to be judged."""
        about = [
            each for name, each in self._topics.items() if component in (f"topic {name}", DISCOVERY)
        ]
        return all(each.found is not None and each.read - each.found >= SEEN_FOR for each in about)

    # -- by a person -----------------------------------------------------------------------------

    def drop(self, is_dropped: Callable[[str], bool]) -> set[str]:
        """Know no more the topics that do not count, nor what such nodes have of the others.

        Returns the components that are about them; what is still wrong is a problem again.
        """
        ignored = {name for name in self._topics if is_dropped(name)}
        changed = {name for name, topic in self._topics.items() if topic.drop(is_dropped)}
        for name in ignored:
            del self._topics[name]
        return {f"topic {name}" for name in ignored | changed}

    def accept(self, learn_after: float) -> None:
        """Take what is there as usual."""
        for topic in self._topics.values():
            topic.accept(learn_after)

    def forget(self, component: str, learn_after: float) -> None:
        """Take as usual what a component is about."""
        for name, topic in self._topics.items():
            if component in (f"topic {name}", DISCOVERY):
                topic.accept(learn_after)

    def take_events(self) -> list[str]:
        """What happened since the last call."""
        events, self._events = self._events, []
        return events

    # -- outliving the process ---------------------------------------------------------------

    def learned(self, shown: Iterable[str]) -> dict[str, TopicLearned]:
        """What a later process should know of each; ``shown`` are components."""
        return {
            name: TopicLearned(
                round(each.alone),
                round(each.matched),
                # Those that are alone now, else nobody would know that they were not.
                {side: sorted(nodes) for side, nodes in each.ends.items()} if each.broken else {},
            )
            for name, each in self._topics.items()
            if each.alone or each.matched or f"topic {name}" in shown
        }

    def accepted(self) -> list[tuple[str, Mismatch]]:
        """The topics, and what of them a person knows."""
        return [(name, each) for name, of in self._topics.items() for each in sorted(of.accepted)]

    def restore(
        self, learned: Mapping[str, TopicLearned], accepted: Iterable[tuple[str, Mismatch]]
    ) -> None:
        """Go on from what an earlier process learned."""
        for name, (alone, matched, ends) in learned.items():
            sides = {side: frozenset(nodes) for side, nodes in ends.items()}
            self._topics[name] = _Topic(alone=alone, matched=matched, ends=sides)
        for name, mismatch in accepted:
            topic = self._topics.setdefault(name, _Topic())
            topic.accepted |= {mismatch}


def _count(publishers: Mapping[str, Iterable[str]]) -> int:
    return sum(len([*ids]) for ids in publishers.values())
