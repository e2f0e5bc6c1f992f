"""What the ROS graph shows of one robot and no driver reports. Pure: no ROS, no clock, no lock.

What belongs to a robot is what is in its namespace. The statuses are of a node or topic from its
first trouble until an hour after the last, so that a robot without any has none.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator
from datetime import datetime, timezone
from math import inf
from typing import Annotated, Any, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.model import Domain, Feed, Instant, Level, Status
from ros_diagnostics_exporter.sources.action_servers import STATUS
from ros_diagnostics_exporter.sources.graph_messages import (
    GIVEN_UP,
    Message,
    Messages,
    MessagesLearned,
    Parameters,
    is_asked_for,
)
from ros_diagnostics_exporter.sources.graph_nodes import Nodes
from ros_diagnostics_exporter.sources.graph_topics import (
    MAX_NAME,
    Mismatch,
    Seconds,
    TopicLearned,
    Topics,
    TopicView,
)
from ros_diagnostics_exporter.sources.link import WINDOW, LinkReading

GROUP = "ROS graph"
FRESH = 120.0  # seconds after which what is not reported again is STALE, which is no fault
REPORT = 30.0  # ... between two reports in which nothing has changed
GRAPH = Feed(GROUP, GROUP, FRESH, planned_stale=True)
SHADOW = GRAPH._replace(shadow=True)
SENT = GRAPH._replace(sent=True)  # in messages of its nodes, which fleet.yml asks for
SHADOW_TIME = 7 * 86_400.0  # seconds for which a robot is known until its silent faults are faults
ANNOUNCED = 86_400.0  # ... before that end, in which it is announced
HELD = 120.0  # ... after a start, until what is no problem any more is healthy
UNREAD = 900.0  # ... more after which a topic that was not read again is not there any more
KEPT = 3600.0  # seconds for which a status is made after its trouble
WRITTEN = 3600.0  # ... between two writes of what was learned
SOON = 10.0  # ... after a message that a later process should know, until it is written
LINK = "link"
LEAST_MESSAGES = 20  # that are expected, until a loss is judged
MAX_OWN = MAX_NAME - len("lifecycle ")  # characters of a name of which a component is made
MOST_KNOWN = 1000  # nodes, or topics, of one robot

# Tools and helpers, and names that have the number of a process or something random in them.
IGNORED = re.compile(
    r".*/((_|rviz|rqt|launch_ros_|ros2cli|rosbag2|transform_listener_impl_)[^/]*"
    r"|ros_diagnostics_exporter|[^/]*[0-9]{4,}[^/]*|[^/]*_(?=[0-9a-f]*[0-9])[0-9a-f]{6,})"
)
_NO_TOPIC = re.compile(r".*/(rosout|parameter_events|_action/.*)")  # every node's, an action's
_Name = Annotated[str, Field(max_length=MAX_NAME)]
_Accepted = tuple[_Name, tuple[_Name, _Name, Annotated[str, Field(max_length=1000)]]]


class Learned(NamedTuple):
    """What a later process should know of one robot.

    ``known`` is the Unix time since when it is, ``nodes`` are seconds by name; ``shown`` are the
    components that are or were a problem, ``accepted`` mismatches that a person knows, by topic.
    """

    known: Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
    nodes: Annotated[dict[_Name, Seconds], Field(max_length=MOST_KNOWN)]
    topics: Annotated[dict[_Name, TopicLearned], Field(max_length=MOST_KNOWN)]
    shown: Annotated[list[_Name], Field(max_length=2 * MOST_KNOWN)]
    accepted: Annotated[list[_Accepted], Field(max_length=MOST_KNOWN)]
    messages: MessagesLearned


class Report(NamedTuple):
    """All statuses of one robot, and what happened.

    ``held`` are components of which nothing is known yet, or any more; so many nodes are
    ``expected``; ``lossy``: too many messages are lost. ``logs`` are those of the last minute, and
    ``watched`` the bytes per second of what is subscribed beside diagnostics, None: nothing is.
    Of a robot that is not watched any more, ``expected`` is None, and nothing is wrong. ``unread``
    are the components of fields of which no topic is read.
    """

    robot: str
    feed: Feed
    statuses: tuple[Status, ...]
    held: frozenset[str]
    expected: int | None
    lossy: bool
    events: tuple[str, ...] = ()
    logs: tuple[str, ...] = ()
    watched: float | None = None
    unread: frozenset[str] = frozenset()

    def by_feed(self) -> Iterator[tuple[Feed, tuple[Status, ...]]]:
        """The statuses: what fleet.yml asks for is nothing learned, and so never a shadow."""
        yield SENT, tuple(each for each in self.statuses if is_asked_for(each.name))
        yield self.feed, tuple(each for each in self.statuses if not is_asked_for(each.name))


class FewMessages:
    """Adds up minutes with few messages until a loss can be judged."""

    def __init__(self) -> None:
        self._expected = self._lost = 0
        self._next = -inf  # when another minute has passed, monotonic

    def loss(self, link: LinkReading, mono: float) -> float | None:
        """The share that was lost; None while the messages are too few."""
        if mono >= self._next:
            self._next = mono + WINDOW
            self._expected += link.expected
            self._lost += link.lost
        if link.expected >= LEAST_MESSAGES:
            self._expected, self._lost = link.expected, link.lost
        if self._expected < LEAST_MESSAGES:
            return None
        loss = self._lost / self._expected
        self._expected = self._lost = 0
        return loss


class RobotGraph:
    """What is seen of one robot."""

    def __init__(self, settings: Graph, namespace: str, now: Instant) -> None:
        self.settings = settings
        self.namespace = namespace
        self.known = now.wall
        self.lossy = False
        self.report_at = self.write_at = now.mono
        self.met = False  # whether any of its nodes was ever there
        self.is_offered = False  # any topic of it, where nodes are not seen
        self.has_topics = False  # any whose fields are asked for
        self._nodes = Nodes()
        self._topics = Topics()
        self.messages = Messages()
        self.watched: float | None = None
        self._link: LinkReading | None = None
        self._few = FewMessages()
        self._problems: dict[str, tuple[int, str]] = {}
        self._healthy: dict[str, float] = {}  # since when what had trouble has none, monotonic
        self._held: set[str] = set()  # of an earlier process, and nothing is known yet
        self._held_until = inf
        self._says_anyway = False  # also while none of its nodes is there
        self._is_announced = False  # that its silent faults will be faults; again by a new process

    def configure(self, settings: Graph, namespace: str, now: Instant) -> None:
        """Go on by another config, and drop what counts no more: a person's word ends it."""
        if (settings, namespace) == (self.settings, self.namespace):
            return
        self.settings, self.namespace = settings, namespace
        dropped = {
            *self._nodes.drop(self._is_dropped, self._expected()),
            *self._topics.drop(self._is_dropped),
            *self.messages.drop(self._is_dropped, settings.watch),
        }
        for component in dropped:
            self._drop(component)
        self._says_anyway = self._says_anyway or bool(dropped)
        self.report_at = self.write_at = now.mono

    def _is_dropped(self, name: str) -> bool:
        """Whether the config ignores a node or topic by its name as it is kept."""
        return self._is_ignored(name if name.startswith("/") else f"{self.namespace}/{name}")

    def _drop(self, component: str) -> None:
        """Say nothing more of a component."""
        self._problems.pop(component, None)
        self._healthy.pop(component, None)
        self._held.discard(component)

    @property
    def gone_nodes(self) -> Iterator[str]:
        """The full names of its nodes of which it is a problem that they are gone."""
        return (f"{self.namespace.rstrip('/')}/{name}" for name in self._nodes.gone)

    @property
    def is_there(self) -> bool:
        """Whether any of its nodes or, where none are seen, topics is."""
        return bool(self._nodes.there) or self.is_offered

    # -- seen --------------------------------------------------------------------------------

    def see_nodes(self, names: Iterable[str], now: Instant) -> None:
        """Take the full names of all its nodes; one that several have is there as often."""
        found = Counter(each for each in map(self._own, names) if each)
        if found and not self.met:
            self.met, self.known = True, now.wall
        self._nodes.update(found, now)
        self.report_at = now.mono

    def see_topic(self, name: str, view: TopicView, now: Instant) -> None:
        """Take one of its topics."""
        own = self._own(name)
        if own and not _NO_TOPIC.fullmatch(name):
            self._topics.update(own, view.without(self._is_ignored).limited(), now)
            self._nodes.note_processes(self._processes(view))
            self.report_at = now.mono

    def _processes(self, view: TopicView) -> Iterator[tuple[str, str]]:
        for each in (*view.publishers, *view.subscribers):
            if own := self._own(each.node):
                yield own, each.process

    def see_message(self, node: str, message: Message, now: Instant) -> None:
        """Take a message of one of its nodes, by its full name."""
        if own := self._own(node):
            self.messages.note(own, message, self.settings.watch, now)
            self.report_at = now.mono
            if not isinstance(message, Parameters):
                self.write_at = min(self.write_at, now.mono + SOON)

    def action_of(self, topic: str) -> str:
        """The action that a topic has the goals of, by its name here; "" where it is ignored."""
        return self._own(topic.removesuffix(STATUS)) if self._own(topic) else ""

    def note_unread(self, about: tuple[Domain, str], why: str, now: Instant) -> None:
        """Note why a topic, or what an entry asks for, is not read; "": it is again."""
        unread = self.messages.given_up
        if unread.get(about, "") == why:
            return
        if why:
            unread[about] = why
        else:
            del unread[about]
        self._says_anyway = True
        self.report_at = now.mono

    def forget_unread(self, now: Instant) -> None:
        """Know no more why entries have no status: they may be others now."""
        for about in [each for each in self.messages.given_up if not each[1].startswith("/")]:
            self.note_unread(about, "", now)

    def see_link(self, reading: LinkReading | None, now: Instant) -> None:
        """Take what arrived of late."""
        self._link = reading
        if reading is not None and self._judge_link(reading, now):
            self.report_at = now.mono

    def _own(self, name: str) -> str:
        """A name in the robot's namespace; "" where it does not count.

        One that is longer than what is stored does not: no driver has such a name.
        """
        if len(name) > MAX_OWN or self._is_ignored(name):
            return ""
        return name.removeprefix(self.namespace).removeprefix("/")

    def _is_ignored(self, name: str) -> bool:
        if IGNORED.fullmatch(name):
            return True
        own = name.removeprefix(self.namespace).removeprefix("/")
        return any(each.fullmatch(name) or each.fullmatch(own) for each in self.settings.ignore)

    # -- judged ------------------------------------------------------------------------------

    def report(self, robot: str, now: Instant) -> Report | None:
        """What is to be said of it now; None where nothing is there of which anything is known."""
        self.report_at = now.mono + REPORT
        self.messages.follow(now, there=self._nodes.there, lossy=self.lossy)
        if not (self.is_there or self.has_topics or self._link or self._says_anyway):
            return None
        self._says_anyway = False
        self._take(self._find_problems(now), now)
        self._release(now)
        for name in [name for name, since in self._healthy.items() if now.mono - since > KEPT]:
            del self._healthy[name]
        parts = (self._nodes, self._topics, self.messages)
        happened = tuple(each for part in parts for each in part.take_events())
        statuses, held = tuple(self._statuses()), frozenset(self._held)
        expected, logs = self._nodes.expected, self.messages.recent(now)
        feed, watched = self._feed(now), self.watched
        lossy = self.lossy and not feed.shadow  # of a shadow's link nobody is notified
        events = (*happened, *self._announcement(now))
        return Report(robot, feed, statuses, held, expected, lossy, events, logs, watched)

    def _find_problems(self, now: Instant) -> dict[str, tuple[int, str]]:
        """What is wrong now; of what is not seen, what was wrong last."""
        problems = dict(self._problems)
        if self._nodes.there and not self.lossy:
            problems = self._judge(now)
            due = self.messages.due(self.settings.watch, now)
            self.report_at = min(self.report_at, self._nodes.due, due)
        problems.pop(GIVEN_UP, None)
        problems |= self.messages.unread()
        if not self.lossy:
            problems.pop(LINK, None)
        elif self._link is not None:
            lost = f"{100 * self._link.loss:.0f} % of its messages are lost"
            problems[LINK] = int(Level.ERROR), lost
        return problems

    def _release(self, now: Instant) -> None:
        """Once what it is about is known again, what is held and is no problem is healthy."""
        if not self._nodes.there and not self._held <= {LINK, GIVEN_UP}:
            self._held_until = inf  # of its nodes nothing is seen
        elif self._held and self._held_until == inf:
            self._held_until = now.mono + HELD
        if now.mono >= self._held_until:
            is_late = now.mono >= self._held_until + UNREAD
            known = {each for each in self._held if is_late or self._topics.is_known(each)}
            self._healthy |= dict.fromkeys(known, now.mono)
            self._held -= known

    def _judge(self, now: Instant) -> dict[str, tuple[int, str]]:
        learn_after = self.settings.learn_after
        problems = self._nodes.judge(learn_after, self._expected(), now)
        problems |= self.messages.judge(self.settings.watch, now)
        return problems | self._topics.judge(learn_after, self._there_since)

    def _expected(self) -> frozenset[str]:
        return frozenset(filter(None, map(self._own, self.settings.expect)))

    def _there_since(self, node: str) -> float:
        """Since when a node is there, by its full name; of those of others nobody knows."""
        own = node.startswith(f"{self.namespace}/")
        return self._nodes.there_since(self._own(node)) if own else inf

    def _take(self, problems: dict[str, tuple[int, str]], now: Instant) -> None:
        for name in self._problems.keys() - problems.keys():
            self._healthy[name] = now.mono
        for name in problems:
            self._healthy.pop(name, None)
            self._held.discard(name)
        if problems.keys() != self._problems.keys():
            self.write_at = now.mono
        self._problems = problems

    def _judge_link(self, link: LinkReading, now: Instant) -> bool:
        """Faulty above ``max_loss``, healthy again below half of it; whether that changed."""
        before, loss = self.lossy, self._few.loss(link, now.mono)
        if loss is not None:
            self.lossy = loss > self.settings.max_loss * (0.5 if before else 1.0)
        return self.lossy != before

    def _feed(self, now: Instant) -> Feed:
        young = self._shadow_left(now) > 0
        return SHADOW if young or self.settings.mode == "shadow" else GRAPH

    def _shadow_left(self, now: Instant) -> float:
        """Seconds until the robot is no shadow any more by itself; nobody asked for that moment."""
        return self.known + SHADOW_TIME - now.wall if self.settings.mode == "auto" else 0.0

    def _announcement(self, now: Instant) -> Iterator[str]:
        if not self._is_announced and 0 < self._shadow_left(now) <= ANNOUNCED:
            self._is_announced = True
            end = datetime.fromtimestamp(self.known + SHADOW_TIME, timezone.utc)
            yield f"silent faults notify from {end:%Y-%m-%d %H:%M} UTC on (graph.mode: auto)"

    def _statuses(self) -> Iterator[Status]:
        for name, (level, text) in sorted(self._problems.items()):
            yield Status(level, name, text)
        for name in sorted(self._healthy.keys() - self._problems.keys()):
            yield Status(int(Level.OK), name, "OK")

    # -- by a person -----------------------------------------------------------------------------

    def accept(self, now: Instant) -> int:
        """Take what is there as expected, and be no shadow any more; how many nodes are expected.

        What is faulty now is healthy.
        """
        self._nodes.accept(self.settings.learn_after)
        self._topics.accept(self.settings.learn_after)
        self.messages.accept()
        self.known = min(self.known, now.wall - SHADOW_TIME)
        self.report_at = self.write_at = now.mono
        return self._nodes.expected

    def forget(self, component: str, now: Instant) -> None:
        """Expect no more what a component is about."""
        self._nodes.forget(component)
        self._topics.forget(component, self.settings.learn_after)
        self.messages.forget(component)
        self._drop(component)
        self.report_at = self.write_at = now.mono

    def adopt(self, component: str, text: str, now: Instant) -> None:
        """Go on with a problem that another process knew: it is over once that is seen.

        What was learned of a topic is not known: only a person says that it is over.
        """
        self._nodes.adopt(component, text, self.settings.learn_after, now)
        self.messages.adopt(component, text, now)
        self.met, self.known = True, min(self.known, now.wall - SHADOW_TIME)
        if not component.startswith("topic "):
            self._held.add(component)
            self._held_until = inf
        self.report_at = self.write_at = now.mono

    # -- outliving the process ---------------------------------------------------------------

    def learned(self, now: Instant) -> Learned:
        """What a later process should know: no more of it than can be read."""
        shown = [*self._problems, *sorted(self._held), *self._healthy][: 2 * MOST_KNOWN]
        accepted: list[Any] = self._topics.accepted()[:MOST_KNOWN]  # a Mismatch is three texts
        nodes, topics = self._nodes.learned(now), self._topics.learned(shown)
        known = sorted(nodes, key=nodes.__getitem__, reverse=True)[:MOST_KNOWN]
        nodes = {name: nodes[name] for name in known}
        return Learned(self.known, nodes, topics, shown, accepted, self.messages.learned(now))

    def restore(self, learned: Learned, now: Instant) -> None:
        """Go on from what an earlier process knew."""
        self.met, self.known = True, min(learned.known, now.wall)
        self._nodes.restore(learned.nodes, now)
        topics = {name: TopicLearned(*each) for name, each in learned.topics.items()}
        accepted = [(name, Mismatch(*each)) for name, each in learned.accepted]
        self._topics.restore(topics, accepted)
        self.messages.restore(MessagesLearned(*learned.messages), now)
        self._held = set(learned.shown)
