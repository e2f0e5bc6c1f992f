"""Memory of the middleware for large messages: given back after a pause, or beyond a budget."""

from __future__ import annotations

from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.sources import pools
from ros_diagnostics_exporter.sources.pools import BUDGET, LARGE, PAUSE, SHORT_PAUSE, Pools
from ros_diagnostics_exporter.sources.reception import Reception
from testbed.polling import until


def test_a_topic_is_due_once_nothing_has_come_for_a_pause():
    held = Pools()
    held.note("/a", LARGE, 1, 0.0)
    held.note("/small", LARGE - 1, 1_000, 0.0)
    held.note("/a", 10, 1, PAUSE)  # a small one: it goes on
    assert held.take_due(2 * PAUSE - 0.1) == []
    assert held.take_due(2 * PAUSE) == ["/a"]
    assert held.take_due(9 * PAUSE) == []


def test_beyond_the_budget_those_with_most_are_due_soon_but_none_that_is_being_received():
    held = Pools()
    for number in range(10):
        held.note(f"/{number}", (number + 1) * BUDGET // 40, 1, 0.0)
    assert held.take_due(SHORT_PAUSE - 0.1) == []
    assert held.take_due(SHORT_PAUSE) == ["/9", "/8"]


def test_a_turn_has_time_for_a_few_topics():
    held = Pools()
    for number in range(pools.MOST + 5):
        held.note(f"/{number}", LARGE, 1, 0.0)
    assert len(held.take_due(PAUSE)) == pools.MOST
    assert len(held.take_due(PAUSE)) == 5


def test_one_that_is_no_longer_subscribed_is_never_due():
    held = Pools()
    held.note("/a", LARGE, 1, 0.0)
    held.forget("/a")
    assert held.take_due(PAUSE) == []


class Domain(Reception):
    """Has one topic; ``opened`` is how often it was subscribed."""

    def __init__(self, *arrived: bytes) -> None:
        super().__init__(7, Mock(), Mock(), 0.0)
        self.arrived = list(arrived)
        self.opened = 0
        self.want("/diagnostics", None, shared=False)

    join = leave = lambda _self: None

    def look(self):
        yield

    def open(self, *_wanted):
        self.opened += 1
        return (lambda: self.arrived.pop() if self.arrived else None), lambda: None

    def data(self, taken):
        return taken


@pytest.mark.parametrize(("size", "opened"), [(300_000, 3), (100, 1)])
def test_a_topic_that_had_large_messages_is_subscribed_anew_after_them(monkeypatch, size, opened):
    monkeypatch.setattr(pools, "PAUSE", 0.05)
    domain = Domain(b"x" * size)
    domain.loop.start()
    try:
        until(lambda: domain.opened == opened and not domain.arrived, "it is subscribed anew")
        at = domain.last_turn
        until(lambda: domain.last_turn > at + 0.3, "some turns more")
    finally:
        domain.wait(30)
    assert domain.opened == opened  # for its depth, and once for its memory


def test_a_message_above_the_limit_is_rejected_with_its_size():
    domain = Domain(b"x" * 2_000)
    domain.max_message = 1_999
    domain.loop.start()
    try:
        until(lambda: domain.receiver.reject_undecodable.called, "it is rejected")
    finally:
        domain.wait(30)
    error = domain.receiver.reject_undecodable.call_args.args[1]
    assert error == "2000 bytes, more than 1999 are not decoded"
