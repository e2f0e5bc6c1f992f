"""What the sources of arrays report to: the state of the fleet, as they see it."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping, Sequence
from typing import Protocol

from ros_diagnostics_exporter.model import Array, Domain, Endpoint, Instant, Topic
from ros_diagnostics_exporter.sources.graph_messages import Message
from ros_diagnostics_exporter.sources.graph_topics import TopicView
from ros_diagnostics_exporter.sources.link import LinkReading


class Receiver(Protocol):
    """What is reported to; all methods are called from the domains' threads."""

    def receive(self, topic: Topic, array: Array, now: Instant) -> None:
        """Take one array."""

    def reject_undecodable(self, topic: Topic, error: str, now: Instant) -> None:
        """Note that a message could not be decoded."""

    def reject_dropped(self, topic: Topic, count: int) -> None:
        """Note that so many messages of a topic were dropped undecoded."""

    def update_graph(self, domain: Domain, endpoints: Mapping[str, Endpoint], now: Instant) -> None:
        """Take all topics of a domain, by name."""

    def finders(self, domain: Domain) -> Sequence[re.Pattern[str]]:
        """The patterns of topics of a domain by which robots are found, whatever their types."""

    def note_other_types(
        self, domain: Domain, types: Mapping[str, tuple[str, ...]], now: Instant
    ) -> None:
        """Take the types of all topics of a domain that have no DiagnosticArray, by name."""

    def update_nodes(self, domain: Domain, nodes: list[tuple[str, str]], now: Instant) -> bool:
        """Take the name and namespace of all nodes of a domain; whether endpoints are wanted."""

    def update_endpoints(
        self, domain: Domain, topics: Mapping[str, TopicView], now: Instant
    ) -> None:
        """Take all endpoints of some topics of a domain, by name."""

    def watched_topics(
        self, domain: Domain, types: Mapping[str, Sequence[str]], now: Instant
    ) -> Mapping[str, str]:
        """Of the topics of a domain those to be subscribed beside diagnostics, with their types."""

    def record_watched(
        self, domain: Domain, topic: str, kind: str, data: bytes, now: Instant
    ) -> None:
        """Take a message of such a topic and type as it was received."""

    def receive_watched(self, domain: Domain, topic: str, message: Message, now: Instant) -> None:
        """Take a message of such a topic."""

    def asked_topics(self, domain: Domain) -> frozenset[str]:
        """The names, or ends of names, of all small topics that are asked for in a domain."""

    def update_offered(
        self, domain: Domain, types: Mapping[str, Sequence[str]], now: Instant
    ) -> Mapping[str, str]:
        """Take the types of what is published where nodes are not seen; `watched_topics`."""

    def note_offered(self, domain: Domain, topics: Iterable[str], now: Instant) -> None:
        """Take the small topics that somebody publishes there."""

    def offered(self, domain: Domain, topic: str, kind: str, type_hash: str, now: Instant) -> bool:
        """Whether such a topic is read whose publishers offer this definition of its type."""

    def refuse_watched(self, domain: Domain, topic: str, why: str, now: Instant) -> None:
        """Note why such a topic cannot be read."""

    def receive_fields(
        self, domain: Domain, topic: str, kind: str, data: bytes, now: Instant
    ) -> float:
        """Take a message of a topic whose fields are asked for; until when (monotonic) no other."""

    def receive_goals(self, domain: Domain, topic: str, data: bytes, now: Instant) -> None:
        """Take a list of goals as its action server sent it."""

    def note_watched(self, domain: Domain, rates: Mapping[str, float], now: Instant) -> None:
        """Take how many bytes per second such topics were in the last minute."""

    def update_links(
        self, domain: Domain, links: Mapping[str, LinkReading | None], now: Instant
    ) -> None:
        """Take what arrived of late on subscribed topics; None where one has several publishers."""

    def wanted_topics(self, domain: Domain) -> Mapping[str, bool]:
        """Name -> whether robots share it, for each topic to be subscribed."""

    def domain_joined(self, domain: Domain) -> None:
        """Note that a domain was joined."""

    def domain_failed(self, domain: Domain, error: str, now: Instant) -> None:
        """Note that a domain could not be joined."""
