"""What nodes of one robot log, and say of their life cycle and parameters. Pure.

Only where fleet.yml asks: these topics are subscribed for it, and cost bytes of the robot's link.
"""

from __future__ import annotations

import re
import struct
from collections import deque
from collections.abc import Callable, Iterator, Mapping
from math import inf
from typing import Annotated, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter.config.graph import Watched
from ros_diagnostics_exporter.model import Domain, Instant, Level
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.graph_nodes import START
from ros_diagnostics_exporter.sources.graph_topics import Seconds

LOGS, PARAMETERS = "/rosout", "/parameter_events"  # of all nodes of a domain
TRANSITIONS = "/transition_event"  # of one node, behind its name
LOG_TYPE = "rcl_interfaces/msg/Log"
PARAMETERS_TYPE = "rcl_interfaces/msg/ParameterEvent"
TRANSITION_TYPE = "lifecycle_msgs/msg/TransitionEvent"
RECENT = 60.0  # seconds for which a log message is beside the robot's faults
STUCK = 30.0  # ... for which a node may be between two states of its life cycle
MOST = 20  # log messages that are kept, and nodes of which one is a fault
MOST_NODES = 1000
MAX_TEXT = 1000  # characters of one that are kept
LOGGER_AT, NODE_AT = 16, 12  # of a Log's and of a ParameterEvent's in CDR: where a text begins
FALLEN = "errorprocessing"  # the state in which an error is handled
_STUCK, _FELL = re.compile("stuck in (.+)"), re.compile("fell to (.+) after an error")
GIVEN_UP = "watch"  # the component that names what is read no more

Problems = dict[str, tuple[int, str]]


class Log(NamedTuple):
    """A message of /rosout from ERROR on; ``logger`` is a node's name with dots."""

    logger: str
    text: str


class Transition(NamedTuple):
    """A step in the life cycle of a node."""

    start: str
    goal: str


class Parameters(NamedTuple):
    """What was set of a node: names and values as text; deleted ones have none."""

    node: str
    changed: tuple[tuple[str, str | None], ...]


Message = Log | Transition | Parameters
_Text = Annotated[str, Field(max_length=MAX_TEXT)]


class MessagesLearned(NamedTuple):
    """What a later process should know, by node or topic: (seconds, ...) of each.

    ``logs`` are messages that are faults, ``states`` where nodes were between two states or fell;
    the seconds are those for which the robot has been received since.
    """

    logs: Annotated[dict[_Text, tuple[Seconds, _Text]], Field(max_length=MOST)]
    states: Annotated[dict[_Text, tuple[Seconds, _Text, _Text]], Field(max_length=MOST_NODES)]


def node_of(topic: str, message: Message) -> str:
    """The full name of the node that a message is about."""
    if isinstance(message, Log):
        return f"/{message.logger.replace('.', '/')}"
    return message.node if isinstance(message, Parameters) else topic.removesuffix(TRANSITIONS)


def node_in(topic: str, kind: str, data: bytes) -> str:
    """`node_of` of a serialized message; "" where it names none."""
    if kind == TRANSITION_TYPE:
        return topic.removesuffix(TRANSITIONS)
    at = LOGGER_AT if kind == LOG_TYPE else NODE_AT
    try:
        (size,) = struct.unpack_from("<I" if data[1] else ">I", data, at)
    except (IndexError, struct.error):
        return ""
    name = data[at + 4 : at + 3 + size].decode(errors="replace")
    return f"/{name.replace('.', '/')}" if kind == LOG_TYPE else name


def is_wanted(topic: str, kind: str, watch: Watched) -> bool:
    """Whether a robot's config asks for a topic of this type; goals are counted of each."""
    if kind == GOALS_TYPE:
        return topic.endswith(STATUS)
    if kind == TRANSITION_TYPE:
        return watch.transitions and topic.endswith(TRANSITIONS)
    wanted = {(LOGS, LOG_TYPE): watch.logs, (PARAMETERS, PARAMETERS_TYPE): watch.parameters}
    return wanted.get((topic, kind), False)


def is_asked_for(component: str) -> bool:
    """Whether a component is made of such messages."""
    return component.partition(" ")[0] in ("log", "lifecycle", GIVEN_UP)


class Stopwatch:
    """Seconds for which a robot was received: what nobody could repeat meanwhile has not ended."""

    __slots__ = ("_seconds", "_since")

    def __init__(self) -> None:
        self._seconds = 0.0
        self._since: float | None = None  # monotonic; None: it is not received

    def set(self, *, running: bool, mono: float) -> bool:
        """Take whether it is received now; whether that differs from before."""
        differs = running != (self._since is not None)
        if differs:
            self._seconds = self.read(mono)
            self._since = mono if running else None
        return differs

    def read(self, mono: float) -> float:
        """The seconds until now."""
        return self._seconds + (0.0 if self._since is None else mono - self._since)


class Messages:
    """What was received of one robot's nodes, by their names in its namespace.

    ``clock`` has the times of what time makes a problem, that of logs the times of what it ends.
    """

    def __init__(self) -> None:
        self.clock, self._of_logs = Stopwatch(), Stopwatch()
        self._logs: deque[tuple[float, str]] = deque(maxlen=MOST)
        self._matches: dict[str, tuple[float, str]] = {}  # node -> when, text
        self._states: dict[str, tuple[float, Transition]] = {}
        self._events: deque[str] = deque(maxlen=MOST)
        self.given_up: dict[tuple[Domain, str], str] = {}  # topics -> why

    def note(self, node: str, message: Message, watch: Watched, now: Instant) -> None:
        """Take a message of a node."""
        if isinstance(message, Parameters):
            for name, value in message.changed:
                what = "was deleted" if value is None else f"is now {value}"
                self._events.append(f"parameter {name} of {node} {what}")
        elif isinstance(message, Transition):
            if node in self._states or len(self._states) < MOST_NODES:
                limited = Transition(message.start[:MAX_TEXT], message.goal[:MAX_TEXT])
                self._states[node] = self.clock.read(now.mono), limited
        else:
            text = message.text[:MAX_TEXT]
            self._logs.append((now.mono, f"{node}: {text}"))
            has_room = node in self._matches or len(self._matches) < MOST
            if has_room and _is_fault(text, watch):
                self._matches[node] = self._of_logs.read(now.mono), text

    def follow(self, now: Instant, *, there: bool, lossy: bool) -> None:
        """Take whether any node is there, and whether too many messages are lost.

        What was logged before nodes were there again, and read, is not over before these had time
        to start.
        """
        self.clock.set(running=there, mono=now.mono)
        is_read = all(topic != LOGS for _domain, topic in self.given_up)
        running = there and is_read and not lossy
        if self._of_logs.set(running=running, mono=now.mono) and running:
            self._matches = {node: (at + START, text) for node, (at, text) in self._matches.items()}

    def recent(self, now: Instant) -> tuple[str, ...]:
        """The log messages of the last minute, the newest first."""
        while self._logs and now.mono - self._logs[0][0] >= RECENT:
            self._logs.popleft()
        return tuple(text for _at, text in reversed(self._logs))

    def judge(self, watch: Watched, now: Instant) -> Problems:
        """(level, text) of each problem, by component."""
        problems, clock = dict(self._judge_states(now)), self._of_logs.read(now.mono)
        for node, (at, text) in list(self._matches.items()):
            if clock - at < watch.log_ends_after:
                problems[f"log {node}"] = int(Level.ERROR), text
            else:
                del self._matches[node]
        return problems

    def unread(self) -> Problems:
        """What is not read, though it is asked for."""
        text = "; ".join(sorted(self.given_up.values()))
        return {GIVEN_UP: (int(Level.WARN), text)} if text else {}

    def _judge_states(self, now: Instant) -> Iterator[tuple[str, tuple[int, str]]]:
        clock = self.clock.read(now.mono)
        for node, (at, each) in self._states.items():
            if _is_between(each) and clock - at >= STUCK:
                yield f"lifecycle {node}", (int(Level.ERROR), f"stuck in {each.goal}")
            elif _fell(each):
                text = f"fell to {each.goal} after an error"
                yield f"lifecycle {node}", (int(Level.ERROR), text)

    def due(self, watch: Watched, now: Instant) -> float:
        """When time makes a problem of what was received, or ends it; monotonic."""
        behind, of_logs = (now.mono - each.read(now.mono) for each in (self.clock, self._of_logs))
        stuck = (behind + at + STUCK for at, each in self._states.values() if _is_between(each))
        ends = (of_logs + at + watch.log_ends_after for at, _text in self._matches.values())
        recent = (at + RECENT for at, _text in self._logs)
        return min((each for each in (*stuck, *ends, *recent) if each > now.mono), default=inf)

    def take_events(self) -> list[str]:
        """What happened since the last call."""
        events = list(self._events)
        self._events.clear()
        return events

    # -- by a person -----------------------------------------------------------------------------

    def drop(self, is_dropped: Callable[[str], bool], watch: Watched) -> set[str]:
        """Know no more what does not count; the components that are about it."""
        logs = {
            node
            for node, (_at, text) in self._matches.items()
            if is_dropped(node) or not _is_fault(text, watch)
        }
        states = {node for node in self._states if is_dropped(node) or not watch.transitions}
        for node in logs:
            del self._matches[node]
        for node in states:
            del self._states[node]
        return {f"log {node}" for node in logs} | {f"lifecycle {node}" for node in states}

    def accept(self) -> None:
        """Take as usual what is a problem."""
        self._matches.clear()
        self._states.clear()

    def forget(self, component: str) -> None:
        """Know no more what a component is about."""
        kind, _blank, node = component.partition(" ")
        if kind == "log":
            self._matches.pop(node, None)
        elif kind == "lifecycle":
            self._states.pop(node, None)

    def adopt(self, component: str, text: str, now: Instant) -> None:
        """Go on with a problem that another process knew, as if it were of now."""
        kind, _blank, node = component.partition(" ")
        stuck, fell = _STUCK.fullmatch(text), _FELL.fullmatch(text)
        if kind == "log":
            self._matches.setdefault(node, (self._of_logs.read(now.mono), text))
        elif kind == "lifecycle" and (goal := stuck or fell):
            state = Transition("" if stuck else FALLEN, goal[1])
            self._states.setdefault(node, (self.clock.read(now.mono) - STUCK, state))

    # -- outliving the process ---------------------------------------------------------------

    def learned(self, now: Instant) -> MessagesLearned:
        """What a later process should know."""
        clock, of_logs = self.clock.read(now.mono), self._of_logs.read(now.mono)
        return MessagesLearned(
            {node: (max(0.0, of_logs - at), text) for node, (at, text) in self._matches.items()},
            {
                node: (clock - at, *each)
                for node, (at, each) in self._states.items()
                if _is_between(each) or _fell(each)
            },
        )

    def restore(self, learned: MessagesLearned, now: Instant) -> None:
        """Go on from what an earlier process knew: nothing of it was received just now."""
        clock = self.clock.read(now.mono)
        of_logs = self._of_logs.read(now.mono)
        self._matches = {node: (of_logs - age, text) for node, (age, text) in learned.logs.items()}
        self._states = {
            node: (clock - age, Transition(*each)) for node, (age, *each) in learned.states.items()
        }


def _is_fault(text: str, watch: Watched) -> bool:
    return watch.logs and any(each.fullmatch(text) for each in watch.log_faults)


def _is_between(state: Transition) -> bool:
    return state.goal.endswith(("ing", "cleaningup", "shuttingdown"))  # as rcl_lifecycle names them


def _fell(state: Transition) -> bool:
    return state.start == FALLEN and state.goal in ("unconfigured", "finalized")


def over_budget(rates: Mapping[str, float], most: float) -> list[str]:
    """Which topics to give up, the largest first, so that the others stay within ``most``."""
    given_up, left = [], sum(rates.values())
    for topic in sorted(rates, key=lambda each: (-rates[each], each)):
        if left > most:
            given_up.append(topic)
            left -= rates[topic]
    return given_up
