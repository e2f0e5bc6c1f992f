"""Small topics whose fields fleet.yml asks for, of robots that zenoh connects.

Knows zenoh's session by what it is given alone. A topic that is published seldom, and whose last
message DDS keeps for late joiners, is received here with its next message.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from typing import Any, NamedTuple

from ros_diagnostics_exporter.model import ZENOH, Instant
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.receiver import Receiver
from ros_diagnostics_exporter.sources.topic_entries import REFUSED_FOR
from ros_diagnostics_exporter.sources.watched_bytes import WatchedBytes


class Offer(NamedTuple):
    """What publishes a topic: the key of its messages, their type, and its definition's hash."""

    key: str
    kind: str
    type_hash: str


class _Followed(NamedTuple):
    """A subscribed topic; ``take`` returns the next sample, or None."""

    offer: Offer
    take: Callable[[], Any]
    close: Callable[[], object]


def asked_tokens(names: Collection[str]) -> list[str]:
    """The key expressions of the tokens of what publishes topics, by the ends of their names."""
    ends = [name.removeprefix("/").replace("*", "$*") for name in sorted(names)]
    bridged = [f"@/*/@ros2_lv/MP/$*{end.replace('/', '§')}/*/*" for end in ends]
    # Of an action server the bridge declares the action, and none of its topics.
    bridged += ["@/*/@ros2_lv/AS/*/*"] if STATUS in names else []
    rmw = [f"@ros2_lv/*/*/*/*/MP/*/*/*/$*%{end.replace('/', '%')}/*/*/*" for end in ends]
    return [*bridged, *rmw]


class ZenohFields:
    """Those of one session; ``open_topic`` subscribes a key: (take, close)."""

    def __init__(
        self,
        receiver: Receiver,
        open_topic: Callable[[str], tuple[Callable[[], Any], Callable[[], object]]],
    ) -> None:
        self._receiver, self._open = receiver, open_topic
        self._topics: dict[str, _Followed] = {}
        self._due: dict[str, float] = {}  # when a topic is read, or asked for, again; monotonic
        self._bytes = WatchedBytes()

    def look(self, offers: Mapping[str, Offer], now: Instant) -> Iterator[None]:
        """Follow what is wanted of the topics that somebody publishes, and take what is due."""
        kinds = {name: [each.kind] for name, each in offers.items()}
        wanted = self._receiver.update_offered(ZENOH, kinds, now)
        self._receiver.note_offered(ZENOH, offers, now)
        for name, followed in list(self._topics.items()):
            if name not in wanted or offers[name] != followed.offer:
                self._topics.pop(name).close()
                yield
        for name in wanted:
            if name not in self._topics and now.mono >= self._due.get(name, now.mono):
                self._subscribe(name, offers[name], now)
                yield
        for name, followed in self._topics.items():
            if now.mono >= self._due.get(name, now.mono):
                self._take(name, followed, now)
                yield
        rates = self._bytes.rates(now.mono)
        if rates is not None:
            self._receiver.note_watched(ZENOH, rates, now)

    def _subscribe(self, name: str, offer: Offer, now: Instant) -> None:
        if self._receiver.offered(ZENOH, name, offer.kind, offer.type_hash, now):
            self._topics[name] = _Followed(offer, *self._open(offer.key))
        else:
            self._due[name] = now.mono + REFUSED_FOR

    def _take(self, name: str, followed: _Followed, now: Instant) -> None:
        latest, kind = None, followed.offer.kind
        while (sample := followed.take()) is not None:
            latest = sample.payload.to_bytes()
            self._bytes.add(name, len(latest))
            if kind == GOALS_TYPE:  # each says what the one before does not
                self._receiver.receive_fields(ZENOH, name, kind, latest, now)
        if latest is not None and kind != GOALS_TYPE:
            self._due[name] = self._receiver.receive_fields(ZENOH, name, kind, latest, now)
