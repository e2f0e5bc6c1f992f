"""One configuration and recorded messages -> what would have been notified, by the real State.

The recording's time takes the place of both clocks: the state is ticked as often as the exporter
ticks it, and what happens in a pause of the recording is not known, as while it is stopped.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, field, replace

from ros_diagnostics_exporter.config.fleet import Fleet, Source
from ros_diagnostics_exporter.config.fleet import Robot as RobotSettings
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.model import Domain, Endpoint, Instant, Topic
from ros_diagnostics_tools.backtest import words
from ros_diagnostics_tools.backtest.formats import Fields
from ros_diagnostics_tools.backtest.history import History, Notification, Outage
from ros_diagnostics_tools.backtest.measured import Past
from ros_diagnostics_tools.backtest.recordings import Message, Recordings
from ros_diagnostics_tools.backtest.small_topics import SmallTopics, small_topics

TICK = 0.25  # seconds, as Service.TICK
LONGEST_GAP = 86_400.0  # seconds without any message that are played
LOOK = 1.0  # seconds between two looks at which topics are wanted, as the listener's
Observer = Callable[[FleetState, Instant], None]


@dataclass(frozen=True)
class Result:
    """What one configuration makes of the recording; times are Unix time.

    ``robots`` are those of whom something was received; ``unknown`` the topics that no robot of
    the configuration has; ``undecodable`` how many of the messages could not be decoded, and
    ``reason`` what is wrong with the first of them.
    """

    fleet: Fleet
    begin: float
    end: float
    messages: int
    robots: tuple[str, ...]
    unknown: tuple[str, ...]
    undecodable: int = 0
    reason: str = ""
    notifications: list[Notification] = field(default_factory=list)
    outages: list[Outage] = field(default_factory=list)


class Replay:
    """A fleet that receives messages of the past.

    ``observe`` is called after each message; ``each_tick`` after each tick. ``prometheus`` answers
    the queries of the configuration.
    """

    def __init__(
        self,
        fleet: Fleet,
        recordings: Recordings,
        *,
        observe: Observer | None = None,
        each_tick: Observer | None = None,
        prometheus: Client | None = None,
    ) -> None:
        self.fleet = recorded_part(fleet, recordings.topics, measured=prometheus is not None)
        self.past = Past(prometheus, self.fleet, recordings.periods)
        self._periods = iter(recordings.periods[1:])
        self._begin = recordings.periods[0].begin
        self._pause_ends = next(self._periods, None)
        self._now = self._instant(self._begin)
        self._last = self._begin
        self.state = FleetState(self.fleet, self._now)
        self.history = History()
        self._restarts = Restarts()
        self._small = SmallTopics()
        self._observe, self._each_tick = observe, each_tick
        self._seen: dict[Domain, dict[str, Endpoint]] = {}
        self._wanted: dict[Domain, dict[str, bool]] = {}
        self._look_at = self._begin
        self._messages = self._undecodable = 0
        self._reason = ""
        self.warnings: list[str] = []

    def _instant(self, wall: float) -> Instant:
        return Instant(wall - self._begin, wall)

    # -- time --------------------------------------------------------------------------------

    def receive(self, message: Message) -> None:
        """Let time pass up to a message, and take it."""
        if self._pause_ends is not None and message.at >= self._pause_ends.begin:
            self._restart(self._pause_ends.begin)
            self._pause_ends = next(self._periods, None)
        if message.at - self._last > LONGEST_GAP:
            self._skip(message.at)
        self._advance(message.at)
        self._last = max(self._last, message.at)
        now = self._instant(self._last)
        if isinstance(message.content, Fields):
            self._messages += self._small.receive(self.state, message.topic, message.content, now)
            self._note(now)
            return
        self._discover(message.topic, now)
        if message.topic.name not in self._wanted.get(message.topic.domain_id, {}):
            return
        self._messages += 1
        try:
            array = message.decode()
        except ValueError as error:
            self._undecodable += 1
            self._reason = self._reason or f"{message.topic.name}: {error}"
            self.state.reject_undecodable(message.topic, str(error), now)
        else:
            self.state.receive(message.topic, array, now)
        self._note(now)

    def _note(self, now: Instant) -> None:
        self.history.note(self.state)
        if self._observe is not None:
            self._observe(self.state, now)

    def _advance(self, wall: float) -> None:
        """Tick as the exporter does, up to a time."""
        while self._now.wall + TICK <= wall:
            self._now = self._instant(self._now.wall + TICK)
            self.past.deliver(self.state, self._now.wall, self._instant)
            self._small.deliver(self.state, self._now)
            self.state.tick(self._now)
            self.history.note(self.state)
            if self._each_tick is not None:
                self._each_tick(self.state, self._now)
            if self._now.wall >= self._look_at:
                self._look()

    def _restart(self, wall: float) -> None:
        """Go on after a pause of the recording, as an exporter that was stopped meanwhile."""
        self._advance(self._last)
        former, self._now = self._instant(self._last), self._instant(wall)
        self._last = wall
        self.state = self._restarts.restart(self.state, self.fleet, former, self._now)
        for domain_id, endpoints in self._seen.items():
            self.state.update_graph(domain_id, endpoints, self._now)
        self._small.enter(self.state)
        self._look()
        self.history.note(self.state)

    def _skip(self, wall: float) -> None:
        """Leave out the rest of a long time without messages, as where a clock was set."""
        gap = wall - self._last
        self.warnings.append(
            f"nothing was recorded for {words.duration(gap)}: of that time the first "
            f"{words.duration(LONGEST_GAP)} count, and then the exporter as stopped"
        )
        self._last += LONGEST_GAP
        self._restart(wall)

    # -- topics ------------------------------------------------------------------------------

    def _discover(self, topic: Topic, now: Instant) -> None:
        """Show the state a topic's publisher from its first message on."""
        seen = self._seen.setdefault(topic.domain_id, {})
        if topic.name not in seen:
            seen[topic.name] = Endpoint(1)
            self.state.update_graph(topic.domain_id, seen, now)
            self._look()

    def _look(self) -> None:
        self._look_at = self._now.wall + LOOK
        self._wanted = {each: self.state.wanted_topics(each) for each in self._seen}
        self._small.look(self.state, self._now)

    # -- what came of it ---------------------------------------------------------------------

    def result(self) -> Result:
        """What is known after the last message."""
        self._advance(self._last)
        received = self.state.visit(lambda robot: robot.settings.name if robot.last_wall else "")
        return Result(
            fleet=self.fleet,
            begin=self._begin,
            end=self._last,
            messages=self._messages,
            robots=tuple(filter(None, received)),
            unknown=tuple(sorted(self._unknown())),
            undecodable=self._undecodable,
            reason=self._reason,
            notifications=self.history.notifications,
            outages=self.history.outages(self.state, self._last),
        )

    def _unknown(self) -> Iterator[str]:
        settings = list(self.state.visit(lambda robot: robot.settings))
        known = {topic for each in settings for topic in topics_of(each)}
        known |= {Topic(each.domain_id, each.topic) for each in self.fleet.shared}
        for domain_id, seen in self._seen.items():
            yield from (name for name in seen if Topic(domain_id, name) not in known)


def topics_of(robot: RobotSettings) -> set[Topic]:
    """The topics that a robot has, used or not."""
    return {Topic(robot.domain_id, name) for name in (robot.topic_agg, robot.topic_raw) if name}


def recorded_part(fleet: Fleet, topics: Iterable[Topic], *, measured: bool = False) -> Fleet:
    """The fleet without declared robots of which no topic was recorded: they were not silent.

    Those that only queries are about belong to it where it is ``measured``.
    """
    known = set(topics)
    robots = tuple(
        each
        for each in fleet.robots
        if known & (topics_of(each) | small_topics(each))
        or (measured and each.source is Source.QUERIES)
    )
    return replace(fleet, robots=robots)


class Restarts:
    """Stops a state and starts another that goes on from what the first one had stored."""

    def __init__(self) -> None:
        self._rows: dict[tuple[str, tuple[str, ...]], Row] = {}  # as in the database

    def restart(self, state: FleetState, fleet: Fleet, now: Instant, later: Instant) -> FleetState:
        """A new state, ``later``, of what the former one stored ``now``."""
        stored = dict(state.visit(lambda robot: (robot.settings.name, robot.persist(now))))
        for row in state.take_fault_rows(now):
            if row.fields is None:
                self._rows.pop((row.kind, row.key), None)
            else:
                self._rows[row.kind, row.key] = row
        new = FleetState(fleet, later)
        new.restore(stored, later)
        new.restore_faults(self._rows.values(), later)
        return new


def play(recordings: Recordings, replays: Iterable[Replay]) -> Iterator[Message]:
    """Pass every message to all replays; yields each afterwards, to show the progress."""
    receivers = list(replays)
    for message in recordings.messages():
        for replay in receivers:
            replay.receive(message)
        yield message
