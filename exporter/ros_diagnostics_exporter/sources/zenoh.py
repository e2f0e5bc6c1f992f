"""What zenoh's routers bring of robots beyond the LAN; the only file that knows zenoh.

Imported where fleet.yml has zenoh: the library takes 4 MB.

A session connects to a router and does so again when that was away; it keeps its subscriptions.
Messages wait in a ring for each topic, of which the oldest are dropped, and are taken as those of
DDS are (`reception`). Which robots there are, liveliness tokens tell, of zenoh's two ways to carry
ROS:

    zenoh-bridge-ros2dds  @/<zenoh id>/@ros2_lv                      the bridge
                          @/<zenoh id>/@ros2_lv/MP/<key>/<type>/<qos>      a publisher
                          @/<zenoh id>/@ros2_lv/AS/<key>/<type>            an action server
    rmw_zenoh             @ros2_lv/<domain>/<zenoh id>/<node>/<entity>/<kind>/<enclave>/<namespace>/
                              <node's name>[/<topic>/<type>/<type hash>/<qos>]

The bridge writes "/" in keys and types as a section sign, rmw_zenoh in names as "%" (docs/design.md
of ros2/rmw_zenoh). A topic's messages come on its key, of rmw_zenoh on
``<domain>/<topic>/<type>/<type hash>``.
"""

from __future__ import annotations

import json
import logging
import re
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

from typing_extensions import override

from ros_diagnostics_exporter.config.fleet import Zenoh
from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import ZENOH, Endpoint, Instant
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.receiver import Receiver
from ros_diagnostics_exporter.sources.reception import Count, Reception
from ros_diagnostics_exporter.sources.ros_environment import RosMissingError
from ros_diagnostics_exporter.sources.topic_entries import ends_of
from ros_diagnostics_exporter.sources.zenoh_fields import Offer, ZenohFields, asked_tokens

_BRIDGED_TYPE = "diagnostic_msgs§msg§DiagnosticArray"
_RMW_TYPE = "diagnostic_msgs::msg::dds_::DiagnosticArray_"
# Bridges and nodes, which show that what connects a robot is there; publishers of DiagnosticArray,
# and of any type on topics that are named like theirs. Of no other endpoint, so that a robot of
# hundreds costs as much as one of two.
TOKENS = (
    "@/*/@ros2_lv",
    f"@/*/@ros2_lv/MP/*/{_BRIDGED_TYPE}/*",
    "@/*/@ros2_lv/MP/$*diagnostics$*/*/*",
    "@ros2_lv/*/*/*/*/NN/*/*/*",
    f"@ros2_lv/*/*/*/*/MP/*/*/*/*/{_RMW_TYPE}/*/*",
    "@ros2_lv/*/*/*/*/MP/*/*/*/$*diagnostics$*/*/*/*",
)


class Token(NamedTuple):
    """What a token shows: ``connection``, and of a publisher its topic and the key of its messages.

    A connection is a bridge, or the nodes of one namespace in one ROS domain: with rmw_zenoh each
    process is a session of its own. A topic is "/" and the key, of rmw_zenoh without its type.
    ``other_type`` is that of the messages, "" where it is DiagnosticArray; ``type_hash`` is of its
    definition.
    """

    connection: str
    topic: str = ""
    key: str = ""
    other_type: str = ""
    type_hash: str = ""


def parse(token: str) -> Token | None:
    """What a token shows; None for one that is neither of these."""
    parts = token.split("/")
    if parts[0] == "@" and len(parts) >= 3 and parts[2] == "@ros2_lv":
        return _of_bridge(parts)
    if parts[0] == "@ros2_lv" and len(parts) >= 9:
        return _of_rmw(parts)
    return None


def _of_bridge(parts: list[str]) -> Token | None:
    _at, session, _admin, *publisher = parts
    if not publisher:
        return Token(session)
    if len(publisher) == 3 and publisher[0] == "AS":
        key = publisher[1].replace("§", "/") + STATUS
        return Token(session, f"/{key}", key, GOALS_TYPE)
    if len(publisher) != 4 or publisher[0] != "MP":
        return None
    key, kind = (each.replace("§", "/") for each in publisher[1:3])
    other = "" if publisher[2] == _BRIDGED_TYPE else kind
    type_hash = publisher[3].partition("typehash=")[2].partition(";")[0] if other else ""
    return Token(session, f"/{key}", key, other, type_hash)


def _of_rmw(parts: list[str]) -> Token | None:
    domain, kind, namespace = parts[1], parts[5], parts[7]
    connection = f"{domain}/{namespace}"
    if kind == "NN":
        return Token(connection)
    if kind != "MP" or len(parts) != 13:
        return None
    topic = domain + parts[9].replace("%", "/")
    other = parts[10].replace("dds_::", "").removesuffix("_").replace("::", "/")
    other = "" if parts[10] == _RMW_TYPE else other
    key = f"{topic}/{parts[10]}/{parts[11]}"
    return Token(connection, f"/{topic}", key, other, parts[11] if other else "")


try:
    import zenoh
except ImportError as error:  # raised by check_zenoh before anything is started
    _IMPORT_ERROR: ImportError | None = error
else:
    _IMPORT_ERROR = None

log = logging.getLogger(__name__)

SMALL_DEPTH = 200  # messages of a small topic that wait between two looks
RETRY = 2.0  # seconds between two attempts to reach a router
# Publishers, and bridges and nodes, that are known at once: a router may be shared with anybody.
# Each publisher takes memory and a part of each look. A robot has up to ten that are asked for.
MAX_PUBLISHERS, MAX_CONNECTED = 20_000, 100_000
ASK_AGAIN = 60.0  # seconds between two questions for all tokens, once more may be kept


def check_zenoh() -> None:
    """Raise RosMissingError, with the way out, where the package is not installed."""
    if _IMPORT_ERROR is not None:
        raise RosMissingError(
            f"fleet.yml has zenoh, and eclipse-zenoh was not found ({_IMPORT_ERROR}): install it "
            f"beside this package: {install_command('zenoh')}"
        )


class ZenohNetwork(Reception):
    """What the routers of one config connect: one session."""

    settings: Zenoh

    def __init__(
        self, settings: Zenoh, receiver: Receiver, count: Count, poll_interval: float
    ) -> None:
        super().__init__(ZENOH, receiver, count, poll_interval, settings)
        self._session: Any = None
        self._watched: list[Any] = []  # subscriptions to tokens
        self._tokens: dict[str, Token] = {}  # of publishers
        self._connected: dict[int, str] = {}  # hash of a bridge's or node's token -> its connection
        self._connections: dict[str, str] = {}  # wanted topic -> that of its last publisher
        self._too_many = ""  # which tokens are there that are not noted
        self._again_at = 0.0  # when all tokens may be asked for again, monotonic
        self._other_types: dict[str, tuple[str, ...]] = {}  # by topics without DiagnosticArray
        self._asked = frozenset[str]()  # ends of the names of small topics
        self._fields = ZenohFields(receiver, self._open_small)

    @override
    def join(self) -> None:
        check_zenoh()
        # RUST_LOG=warn: why a router cannot be connected
        zenoh.try_init_log_from_env()
        self._session = zenoh.open(_config(self.settings))
        self.error, self.look_at = "", 0.0
        self._watch_tokens()

    def _watch_tokens(self) -> None:
        """Have all tokens noted that are there or come; those that go meanwhile are not missed."""
        before, tokens = self._watched, self._session.liveliness()
        keys = (*TOKENS, *asked_tokens(self._asked))
        self._watched = [tokens.declare_subscriber(key, self._note, history=True) for key in keys]
        for each in before:
            each.undeclare()

    @override
    def leave(self) -> None:
        if self._session is not None:
            self._session.close()

    @override
    def give_up(self, error: Exception) -> None:
        """Try again soon: mostly no router answers."""
        why = str(error).partition(" at /")[0]  # without where zenoh's source raised it
        why = self._away if why.startswith("Unable to connect") else why
        if why != self.error:
            log.warning("zenoh: %s", why)
            self.fail(why)
        self.look_at = time.monotonic() + RETRY

    @override
    def check(self) -> None:
        """Follow whether a router is there: the session reconnects by itself."""
        if not self.is_connected and not self.error:
            log.warning("zenoh: %s", self._away)
            self.fail(self._away)
        elif self.is_connected and self.error:
            log.info("a zenoh router answers again")
            self.error = ""
            self.receiver.domain_joined(ZENOH)

    @property
    def is_connected(self) -> bool:
        """Whether a router, or with mode peer a bridge, is connected."""
        info = self._session.info
        return bool(info.routers_zid() or info.peers_zid())

    @property
    def _away(self) -> str:
        where = ", ".join(self.settings.routers)
        why = "with RUST_LOG=warn the log says why, except for a wrong user or password"
        return f"no router answers at {where} and accepts this exporter ({why})"

    # -- tokens ---------------------------------------------------------------------------------

    def _note(self, sample: zenoh.Sample) -> None:
        """Take a token that came or went; called by zenoh's threads."""
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.DELETE:
            self._tokens.pop(key, None)
            self._connected.pop(hash(key), None)
            return
        token = parse(key)
        if token is None:
            return
        if token.topic:
            if len(self._tokens) < MAX_PUBLISHERS:
                self._tokens[key] = token
            else:
                self._too_many = f"publishers beyond {MAX_PUBLISHERS}"
        elif len(self._connected) < MAX_CONNECTED:
            self._connected[hash(key)] = sys.intern(token.connection)
        else:
            self._too_many = f"bridges and nodes beyond {MAX_CONNECTED}"

    @override
    def look(self) -> Iterator[None]:
        now, self.is_same = read_clocks(), True  # tokens come by themselves, at any time
        if self.error:
            return  # without a router nothing is known of robots
        self._follow_asked(now)
        wanted = self.receiver.wanted_topics(ZENOH)
        tokens = list(self._tokens.values())
        publishers = [each for each in tokens if not each.other_type]
        yield
        finders = self.receiver.finders(ZENOH)
        offers = self._offers(tokens, finders)
        endpoints = self._endpoints(tokens, publishers, wanted)
        endpoints |= {
            name: Endpoint(0, wrong_type=offer.kind)
            for name, offer in offers.items()
            if any(each.fullmatch(name) for each in finders)
        }
        others = _other_types(each for each in tokens if each.topic not in offers)
        for name in others.keys() & (endpoints.keys() | wanted.keys()):
            known = endpoints.get(name, Endpoint(0))
            endpoints[name] = known._replace(wrong_type=", ".join(others.pop(name)))
        if others != self._other_types:
            self.receiver.note_other_types(ZENOH, others, now)
            self._other_types = others
        self.receiver.update_graph(ZENOH, endpoints, now)
        yield
        keys = {each.topic: each.key for each in publishers}
        for name in self.topics.keys() - wanted.keys():
            self.unsubscribe(name)
            yield
        for name, shared in wanted.items():
            topic = self.topics.get(name)
            key = keys.get(name) or (topic.offer if topic else name.removeprefix("/"))
            self.want(name, key, shared=shared)
            yield
        if self._asked:
            yield from self._fields.look(offers, now)
        self.complete_look(now)

    def _follow_asked(self, now: Instant) -> None:
        """Have the tokens noted of what is asked for, and all again once more may be kept."""
        asked = self.receiver.asked_topics(ZENOH)
        again = asked != self._asked
        self._asked = asked
        if self._too_many:
            text = "%s%s: %s are not noted; a robot or another program has too many"
            self.log_seldom("", "tokens", text, self._too_many)
            has_room = len(self._tokens) < MAX_PUBLISHERS and len(self._connected) < MAX_CONNECTED
            if has_room and now.mono >= self._again_at:
                self._too_many, self._again_at, again = "", now.mono + ASK_AGAIN, True
        if again:
            self._watch_tokens()

    def _offers(self, tokens: list[Token], finders: Sequence[re.Pattern[str]]) -> dict[str, Offer]:
        """The small topics that are asked for and that somebody publishes."""
        ends = ends_of(self._asked)
        return {
            each.topic: Offer(each.key, each.other_type, each.type_hash)
            for each in tokens
            if each.other_type
            and (each.topic.endswith(ends) or any(one.fullmatch(each.topic) for one in finders))
        }

    def _endpoints(
        self, tokens: list[Token], publishers: list[Token], wanted: Mapping[str, bool]
    ) -> dict[str, Endpoint]:
        """What the tokens show of each topic."""
        connections = {*self._connected.copy().values(), *(each.connection for each in tokens)}
        last = {each.topic: each.connection for each in publishers if each.topic in wanted}
        known = {name: of for name, of in self._connections.items() if name in wanted}
        self._connections = known | last
        found = {
            name: Endpoint(0, is_cut_off=of not in connections)
            for name, of in self._connections.items()
        }
        for each in publishers:
            count = found[each.topic].publishers if each.topic in found else 0
            found[each.topic] = Endpoint(count + 1)
        return found

    # -- messages -------------------------------------------------------------------------------

    @override
    def open(
        self, name: str, offer: str, depth: int
    ) -> tuple[Callable[[], Any], Callable[[], object]]:
        made = self._session.declare_subscriber(offer, zenoh.handlers.RingChannel(depth))
        return made.try_recv, made.undeclare

    def _open_small(self, key: str) -> tuple[Callable[[], Any], Callable[[], object]]:
        return self.open(key, key, SMALL_DEPTH)

    @override
    def data(self, taken: zenoh.Sample) -> bytes:
        message: bytes = taken.payload.to_bytes()
        return message


def _other_types(tokens: Iterable[Token]) -> dict[str, tuple[str, ...]]:
    """Topic -> types other than DiagnosticArray that are published on it."""
    found: dict[str, set[str]] = {}
    for each in tokens:
        if each.other_type:
            found.setdefault(each.topic, set()).add(each.other_type)
    return {topic: tuple(sorted(types)) for topic, types in found.items()}


def _config(settings: Zenoh) -> Any:
    """The session's config.

    Raises:
        OSError: a file cannot be read.
    """
    tls = {
        "root_ca_certificate": settings.ca_file,
        "connect_certificate": settings.cert_file,
        "connect_private_key": settings.key_file,
    }
    for path in tls.values():
        if path is not None:
            path.open("rb").close()  # zenoh does not name what it cannot read
    values: dict[str, object] = {
        "mode": settings.mode,
        "connect/endpoints": list(settings.routers),
        # A client tries once, and is opened again; a peer goes on to look for those that are away.
        "connect/timeout_ms": 0 if settings.mode == "client" else -1,
        "connect/exit_on_failure": settings.mode == "client",
        "connect/retry": {"period_init_ms": 500, "period_max_ms": int(1000 * RETRY)},
        "listen/endpoints": [],
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "transport/shared_memory/enabled": False,  # with whoever else is on this host
        **{f"transport/link/tls/{key}": str(path) for key, path in tls.items() if path is not None},
    }
    if settings.cert_file is not None:
        values["transport/link/tls/enable_mtls"] = True
    if settings.password_file is not None:
        password = settings.password_file.read_text("utf-8").rstrip("\r\n")
        values["transport/auth/usrpwd/user"] = settings.user
        values["transport/auth/usrpwd/password"] = password
    config = zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return config
