"""Which domains are joined and left, and why messages are not received; with played domains."""

import math
from dataclasses import dataclass, field
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Limits, Robot, Zenoh
from ros_diagnostics_exporter.model import ZENOH, Domain, Instant
from ros_diagnostics_exporter.sources import listener as listener_module
from ros_diagnostics_exporter.sources.dds import DdsDomain
from ros_diagnostics_exporter.sources.listener import LEAVE_TIME, STALLED, Listener
from ros_diagnostics_exporter.sources.zenoh import ZenohNetwork

NOW = Instant(50_000.0, 1_700_000_000.0)
WELL = {"joined": True, "joined_at": 1.0, "last_look": NOW.wall, "last_turn": NOW.mono}


@dataclass
class Played:
    """A domain whose thread runs once it is started, and ends when it is asked, unless it hangs."""

    domain: Domain = 0
    settings: object = None
    alive: bool = False
    hangs: bool = False
    joined: bool = False
    joining: bool = False
    error: str = ""
    trouble: str = ""
    odd: str = ""
    joined_at: float = math.inf
    last_look: float = 0.0
    last_turn: float = 0.0
    max_message: int = 0
    topics: dict[str, object] = field(default_factory=dict)
    waited: list[float] = field(default_factory=list)

    @property
    def loop(self):
        return self

    def start(self) -> None:
        assert not self.alive
        self.alive = self.joined = True

    def ask_to_stop(self) -> None:
        self.joined = False

    def wait(self, seconds: float) -> None:
        assert not self.joined  # all were asked before one is waited for
        self.waited.append(seconds)
        self.alive = self.hangs


class Playing(Listener):
    """A listener; ``made`` are all of its domains that were ever made."""

    def __init__(self, *domains: Played) -> None:
        self.receiver = Mock()
        super().__init__(self.receiver)
        self.made = list(domains)
        self._domains = {each.domain: each for each in domains}

    def _new(self, domain, zenoh):
        self.made.append(Played(domain, zenoh))
        return self.made[-1]

    def follow(self, *robots: Robot, **more) -> list[Domain]:
        """Take a config; the domains that it made."""
        before = len(self.made)
        self.configure(Fleet("f", robots, **more), NOW)
        return [each.domain for each in self.made[before:]]


ONE, TWO = Robot("a", 1, namespace="/a"), Robot("b", 2, namespace="/b")
FAR = Robot("c", ZENOH, zenoh="/", namespace="/c")


@pytest.fixture(autouse=True)
def _clock(monkeypatch):
    monkeypatch.setattr(listener_module.time, "monotonic", lambda: NOW.mono)


def test_the_domains_of_the_config_are_joined_and_the_others_left():
    playing = Playing()
    playing.join()  # as nothing is configured yet
    assert playing.made == []
    assert playing.follow(ONE, TWO, limits=Limits(message_bytes=77)) == [1, 2]
    assert playing.domain_ids == (1, 2)
    assert [each.max_message for each in playing.made] == [77, 77]
    assert [each.args for each in playing.receiver.domain_joined.call_args_list] == [(1,), (2,)]
    first, second = playing.made
    assert playing.follow(TWO, limits=Limits(message_bytes=88)) == []
    assert (playing.domain_ids, second.max_message) == ((2,), 88)
    assert (first.waited, second.waited) == ([LEAVE_TIME], [])
    assert playing.loops == [second]

    playing.leave([2])
    assert (playing.domain_ids, second.waited) == ((), [LEAVE_TIME])
    playing.join()
    assert [each.domain for each in playing.made] == [1, 2, 2]
    playing.stop()
    playing.join()
    assert (playing.domain_ids, len(playing.made)) == ((), 3)


def test_zenoh_is_joined_anew_with_other_settings_only():
    playing = Playing()
    near, away = Zenoh(("tcp/a:7447",)), Zenoh(("tcp/b:7447",))
    assert playing.follow(ONE, FAR, zenoh=near) == [1, ZENOH]
    assert playing.follow(ONE, FAR, zenoh=near) == []
    assert playing.follow(ONE, FAR, zenoh=away) == [ZENOH]
    assert [each.settings for each in playing.made] == [None, near, away]


def test_a_domain_that_hangs_while_it_is_left_stays_until_it_is():
    playing = Playing()
    playing.follow(ONE, TWO)
    first, second = playing.made
    first.hangs = True
    assert playing.follow(TWO) == []
    assert playing.loops == [second, first]
    assert playing.follow(ONE, TWO) == []  # it cannot be joined beside itself
    first.alive = False
    assert playing.follow(ONE, TWO) == [1]


def test_what_a_domain_is_made_of_is_what_the_config_has(monkeypatch):
    for each in ("free_large_blocks_at_once", "use_profiles", "use_log_folder"):
        monkeypatch.setattr(listener_module, each, Mock())
    listener = Listener(Mock(), 0.5, ("--ros-args",))
    for domain, settings, kind in (5, None, DdsDomain), (ZENOH, Zenoh(("tcp/a:1",)), ZenohNetwork):
        made = listener._new(domain, settings)
        assert (type(made), made.settings, made.poll_interval) == (kind, settings, 0.5)
    listener._new(6, None)
    listener_module.use_log_folder.assert_called_once()


@pytest.mark.parametrize(
    ("domains", "why"),
    [
        ([Played(1, **WELL), Played(2, **WELL)], None),
        ([Played(1, **WELL), Played(2, joining=True)], "domain 2 is still being joined"),
        (
            [Played(1, joining=True), Played(2, error="no memory"), Played(3, error="no network")],
            "cannot join domain 2: no memory; cannot join domain 3: no network",
        ),
        (
            [Played(1, **WELL), Played(2, **WELL | {"last_look": 0.0})],
            "the ROS graph has not been looked at yet",
        ),
        ([Played(1, **WELL)], "the ROS graph has not been looked at yet"),  # 2 is to be joined
        (
            [Played(1, **WELL, trouble="a bug"), Played(2, **WELL)],
            "domain 1: a bug",
        ),
        (
            [Played(1, **WELL), Played(2, **WELL | {"last_turn": NOW.mono - STALLED - 1})],
            "no message was taken for 10 s in domain 2",
        ),
        ([Played(1, **WELL), Played(2, **WELL | {"last_turn": NOW.mono - STALLED})], None),
        ([Played(1, **WELL), Played(2, **WELL), Played(3, last_turn=0.0)], None),  # it is left
    ],
)
def test_why_messages_are_not_received(domains, why):
    assert Playing(*domains).not_ready_reason([1, 2]) == why


def test_what_is_known_of_domains_is_by_their_names():
    joined = Played(1, **WELL, trouble="a bug", odd="2 nodes have no name")
    playing = Playing(joined, Played(2, joining=True), Played(ZENOH, error="no router"))
    assert playing.domain_ids == (1,)
    assert playing.joining == (2,)
    assert playing.joined_at == {1: 1.0, 2: math.inf}
    assert playing.last_looks == {1: NOW.wall}
    assert playing.errors == {ZENOH: "no router"}
    assert playing.troubles == {1: "a bug", 2: "", ZENOH: ""}
    assert playing.oddities == {1: "2 nodes have no name", 2: "", ZENOH: ""}


def test_topics_of_which_something_was_received_since():
    def topic(at: float) -> SimpleNamespace:
        return SimpleNamespace(content=SimpleNamespace(received_at=at))

    playing = Playing(Played(1, topics={"/a": topic(5.0), "/b": topic(6.0), "/c": topic(7.0)}))
    assert playing.received_since(1, ["/a", "/b", "/c", "/d"], 5.0) == {"/b", "/c"}


def test_processor_time_is_added_up():
    playing = Playing()
    playing.count(1.0, 10.0)
    playing.count(2.0, 20.0)
    assert (playing.decode_seconds, playing.ingest_seconds) == (3.0, 30.0)
