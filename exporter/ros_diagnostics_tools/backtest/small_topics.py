"""Messages of small topics in a recording: fields that `topics` asks for, goals of `actions`."""

from __future__ import annotations

from ros_diagnostics_exporter.config.fleet import Robot
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Domain, Instant, Topic
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE
from ros_diagnostics_tools.backtest.formats import Fields


def small_topics(robot: Robot) -> set[Topic]:
    """Those that the entries of a robot name."""
    names = (each.name_in(robot.namespace, robot.zenoh or "") for each in robot.profile.topics)
    return {Topic(robot.domain_id, name) for name in names}


class SmallTopics:
    """What was recorded of them so far; a topic's newest message waits until it is read again."""

    def __init__(self) -> None:
        self._kinds: dict[Domain, dict[str, list[str]]] = {}
        self._definitions: dict[str, str] = {}
        self._wanted: dict[Domain, dict[str, str]] = {}
        self._waiting: dict[Topic, Fields] = {}
        self._due: dict[Topic, float] = {}

    def enter(self, state: FleetState) -> None:
        """Go on with another state, at the start or after a pause of the recording."""
        self._due.clear()
        self._waiting.clear()
        for kind, definition in self._definitions.items():
            state.define(kind, definition)

    def receive(self, state: FleetState, topic: Topic, message: Fields, now: Instant) -> bool:
        """Take a message; whether an entry asks for its topic."""
        if message.definition and message.kind not in self._definitions:
            self._definitions[message.kind] = message.definition
            state.define(message.kind, message.definition)
        kinds = self._kinds.setdefault(topic.domain_id, {})
        if kinds.get(topic.name) != [message.kind]:
            kinds[topic.name] = [message.kind]
            self.look(state, now)
        is_wanted = topic.name in self._wanted[topic.domain_id]
        if is_wanted and message.kind == GOALS_TYPE:  # each says what the one before does not
            state.receive_fields(*topic, message.kind, message.data, now)
        elif is_wanted:
            self._waiting[topic] = message
            self.deliver(state, now)
        return is_wanted

    def look(self, state: FleetState, now: Instant) -> None:
        """Follow which topics are wanted."""
        for domain_id, kinds in self._kinds.items():
            self._wanted[domain_id] = state.update_offered(domain_id, kinds, now)

    def deliver(self, state: FleetState, now: Instant) -> None:
        """Have the messages read that are due."""
        for topic, message in list(self._waiting.items()):
            if now.mono >= self._due.get(topic, 0.0):
                del self._waiting[topic]
                self._due[topic] = state.receive_fields(*topic, message.kind, message.data, now)
