"""What all sources of messages share: the turns of a domain, and what an error in one stops."""

from itertools import count
from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.decode.cdr import SHARE, SHARED
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Array, Topic
from ros_diagnostics_exporter.sources import reception
from ros_diagnostics_exporter.sources.reception import (
    DEPTH,
    LOG_INTERVAL,
    MAX_ERROR,
    MAX_HISTORY,
    Reception,
)
from testbed.polling import until


class Broken(Reception):
    """Has one topic, with one message, and can neither read that nor look at the graph."""

    def __init__(self) -> None:
        super().__init__(7, Mock(), Mock(), 0.0)
        self.arrived = ["a message"]
        self.want("/diagnostics", None, shared=False)

    join = leave = lambda _self: None

    def look(self):
        raise RuntimeError("a bug")

    def open(self, *_wanted):
        return (lambda: self.arrived.pop() if self.arrived else None), lambda: None

    def data(self, taken):
        raise RuntimeError(f"another bug, with {taken}")


def test_errors_inside_a_turn_are_counted_and_the_turns_go_on(caplog):
    domain = Broken()
    domain.loop.start()
    try:
        until(lambda: not domain.arrived and domain.last_turn, "a message was taken")
        counted = domain.loop.errors
        assert counted >= 2
        until(lambda: domain.loop.errors > counted, "the next look fails too")
        assert domain.joined
    finally:
        domain.wait(30)
    assert "domain 7: internal error: a bug" in caplog.text


def test_a_domain_whose_graph_cannot_be_looked_at_says_why(monkeypatch):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.reception.NOT_LOOKED", 0.1)
    domain = Broken()
    assert domain.trouble == "it is not joined: it is still being joined"
    domain.arrived.clear()
    domain.loop.start()
    try:
        until(lambda: domain.trouble.endswith("more than 0 s: a bug"), "the look is late")
        domain.look = lambda: iter([domain.complete_look(read_clocks())])
        until(lambda: domain.trouble == "", "it was looked at")
    finally:
        domain.wait(30)


def test_a_domain_whose_messages_cannot_be_taken_says_why():
    domain = Broken()
    domain.look = lambda: iter([domain.complete_look(read_clocks())])
    domain.arrived = ["a message"] * 1000
    domain.loop.start()
    try:
        wanted = "its messages are not taken: another bug, with a message"
        until(lambda: domain.trouble == wanted, "messages are not taken")
    finally:
        domain.wait(30)


ENOUGH = 60.0  # seconds of a turn, however busy the machine is


class Played(Reception):
    """A joined domain whose turns a test makes; ``arriving`` are the messages of each topic."""

    def __init__(self) -> None:
        super().__init__(7, Mock(), Mock(), 1.0)
        self.arriving: dict[str, list[bytes]] = {}
        self.opened: list[tuple[str, object, int]] = []
        self.closed: list[str] = []
        self._is_open = True

    join = leave = lambda _self: None

    def look(self):
        return iter(())

    def open(self, name, offer, depth):
        self.opened.append((name, offer, depth))
        waiting = self.arriving.setdefault(name, [])
        return (lambda: waiting.pop(0) if waiting else None), lambda: self.closed.append(name)

    def data(self, taken):
        return taken

    def decode(self, data: bytes) -> Array:
        if data.startswith(b"wrong"):
            return super().decode(data)
        return Array(0.0, (), len(data))

    def turn(self, **arriving: list[bytes]) -> list[tuple[str, int]]:
        """Have these messages arrive; topic and bytes of what was received of late."""
        for name, messages in arriving.items():
            self.arriving[f"/{name}"] += messages
        self.receiver.receive.reset_mock()
        self._turn()
        calls = [each.args for each in self.receiver.receive.call_args_list]
        return [(topic.name, array.size) for topic, array, _now in calls]


@pytest.fixture
def played(monkeypatch) -> Played:
    for name in "DRAIN_TIME", "DECODE_TIME":
        monkeypatch.setattr(reception, name, ENOUGH)
    domain = Played()
    for name in ("/a", "/b"):
        domain.want(name, "offer", shared=False)
    return domain


def test_all_that_has_arrived_is_received_the_topic_that_costs_least_first(played):
    assert played.turn(a=[b"12345" * 1000, b"1"], b=[b"12"]) == [("/b", 2), ("/a", 5000), ("/a", 1)]
    assert played.turn() == []
    assert played.turn(a=[b"123"]) == [("/a", 3)]


def test_what_one_turn_has_no_time_for_is_received_with_the_next(played, monkeypatch):
    monkeypatch.setattr(reception, "DECODE_TIME", 0.0)
    assert played.turn(a=[b"1", b"2", b"3"]) == []
    monkeypatch.setattr(reception, "DECODE_TIME", ENOUGH)
    assert played.turn() == [("/a", 1)] * 3
    assert played._waiting == {}


def test_of_a_topic_that_is_not_wanted_any_more_nothing_is_received(played, monkeypatch):
    monkeypatch.setattr(reception, "DECODE_TIME", 0.0)
    played.turn(a=[b"1"], b=[b"1"])
    played.unsubscribe("/a")
    monkeypatch.setattr(reception, "DECODE_TIME", ENOUGH)
    assert (played.turn(), played.closed) == ([("/b", 1)], ["/a"])


def test_a_message_that_is_too_large_or_none_is_rejected_and_logged_once_a_minute(
    played, monkeypatch, caplog
):
    played.max_message = 10
    assert played.turn(a=[b"x" * 11, b"x" * 10, b"wrong"]) == [("/a", 10)]
    too_large = "11 bytes, more than 10 are not decoded"
    rejected = [each.args[:2] for each in played.receiver.reject_undecodable.call_args_list]
    assert rejected == [
        (Topic(7, "/a"), too_large),
        (Topic(7, "/a"), "not a ROS message (CDR): it begins with 77726f6e"),
    ]
    assert caplog.messages == [f"domain 7, /a: undecodable message dropped: {too_large}"]
    now = reception.time.monotonic()
    monkeypatch.setattr(reception.time, "monotonic", lambda: now + LOG_INTERVAL + 1)
    played.turn(a=[b"x" * 11])
    assert len(caplog.messages) == 2


def test_a_topic_of_large_messages_waits_in_a_shallower_queue(played):
    assert played.opened == [("/a", "offer", DEPTH), ("/b", "offer", DEPTH)]
    size = MAX_HISTORY // DEPTH + 1
    played.turn(a=[b"x" * size], b=[b"x" * (size - 1)])
    assert played.opened[2:] == [("/a", "offer", MAX_HISTORY // size)]
    played.turn(a=[b"x" * size])
    assert len(played.opened) == 3
    played.want("/a", "other", shared=False)
    assert played.opened[3:] == [("/a", "other", MAX_HISTORY // size)]
    played.max_message = 2 * MAX_HISTORY
    played.turn(a=[b"x" * (MAX_HISTORY + 1)])
    assert played.opened[4:] == [("/a", "other", 1)]


def test_a_topic_has_the_share_of_one_robot_or_of_all(played):
    assert played.topics["/a"].content.queue.share == SHARE
    played.want("/a", "offer", shared=True)
    assert played.topics["/a"].content.queue.share == SHARED
    assert len(played.opened) == 2


def test_what_more_arrives_than_can_wait_is_counted_as_dropped(played, caplog):
    played.turn(a=[b"x"] * 1200)
    [(topic, count)] = [each.args for each in played.receiver.reject_dropped.call_args_list]
    assert (topic, count > 0) == (Topic(7, "/a"), True)
    assert f"{count} messages were dropped just now" in caplog.text


def test_a_domain_that_cannot_be_joined_says_why_and_its_thread_ends(played, caplog):
    played._is_open = False
    played.join = Mock(side_effect=OSError("no\nmemory" + "!" * 300))
    played._turn()
    assert (played.joined, played.joining, played.loop.stopping) == (False, False, True)
    assert played.error == ("no memory" + "!" * 300)[:MAX_ERROR]
    assert played.receiver.domain_failed.call_args.args[:2] == (7, played.error)
    assert not played.receiver.domain_joined.called
    assert "cannot join domain 7" in caplog.text


def test_a_domain_is_joined_at_the_first_turn_that_is_due(played):
    played._is_open, played.look_at = False, reception.time.monotonic() + 60
    played._turn()
    assert not played.receiver.domain_joined.called
    played.look_at = 0.0
    played._turn()
    played.receiver.domain_joined.assert_called_once_with(7)
    assert played.joined_at == played.last_turn <= reception.time.monotonic()
    assert played.addresses


@pytest.mark.parametrize("error", ["", "no router"])
def test_a_domain_that_is_left_or_fails_while_it_is_joined_is_not_said_to_be_joined(played, error):
    played._is_open = False
    played.join = lambda: played.fail(error) if error else played.loop.ask_to_stop()
    played._turn()
    assert not played.receiver.domain_joined.called


@pytest.mark.parametrize(("cost", "apart"), [(0.0, 1.0), (0.01, 1.0), (0.06, 3.0), (9.0, 5.0)])
def test_a_look_that_shows_the_same_is_as_far_from_the_next_as_its_cost_allows(
    played, monkeypatch, cost, apart
):
    ticks = count(1_000)  # of the processor time before the look, and behind it
    monkeypatch.setattr(reception.time, "thread_time", lambda: 1_000.0 + cost * (next(ticks) % 2))
    monkeypatch.setattr(reception.time, "monotonic", lambda: 50_000.0)
    played.is_same = False

    def look():
        played.is_same = True
        yield

    played.look = look
    played._look_on()
    assert played.look_at == pytest.approx(50_000.0 + apart)
