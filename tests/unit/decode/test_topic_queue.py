"""What waits of one topic is bounded, and a topic that costs much waits for those that do not."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.decode.cdr import (
    MAX_BYTES,
    MAX_MESSAGES,
    SHARE,
    SHARED,
    TopicQueue,
)


def test_messages_come_out_in_the_order_in_which_they_arrived():
    queue = TopicQueue()
    for message in (b"one", b"two", b"three"):
        queue.put(message)

    assert [queue.get()[0] for _ in range(len(queue))] == [b"one", b"two", b"three"]
    assert not queue.dropped()
    with pytest.raises(IndexError):
        queue.get()


def test_beyond_the_number_of_messages_the_oldest_are_dropped_and_counted_once():
    queue = TopicQueue()
    for number in range(MAX_MESSAGES + 3):
        queue.put(b"%d" % number)

    assert len(queue) == MAX_MESSAGES
    assert queue.get() == (b"3", "")
    assert (queue.dropped(), queue.dropped()) == (3, 0)


def test_beyond_the_bytes_the_oldest_are_dropped_and_the_newest_stays_however_large():
    queue = TopicQueue()
    for letter in (b"a", b"b", b"c"):
        queue.put(letter * (MAX_BYTES // 2))
    assert [queue.get()[0][:1] for _ in range(len(queue))] == [b"b", b"c"]

    queue.put(b"small")
    queue.put(b"x" * (MAX_BYTES + 1))
    assert [len(queue.get()[0]) for _ in range(len(queue))] == [MAX_BYTES + 1]
    assert queue.dropped() == 2


@pytest.mark.parametrize("share", [SHARE, SHARED])
def test_however_long_a_topic_floods_it_uses_its_share_and_one_second_more(share):
    queue, now, used = TopicQueue(share), 0.0, 0.0
    while now < 100.0:
        for _ in range(3):
            queue.put(b"message")
        while queue.is_due(now):
            queue.get()
            queue.spend(0.02)
            used += 0.02
        now += 0.05

    assert share < 1  # of a core
    assert 100 * share * 0.9 < used <= 101 * share + 0.02


def test_a_message_that_cost_minutes_silences_its_topic_for_two_seconds_at_most():
    queue = TopicQueue()
    queue.put(b"message")
    queue.spend(100.0)

    assert not queue.is_due(0.0)
    assert queue.is_due(2.1)


def test_nothing_is_due_where_nothing_waits():
    assert not TopicQueue().is_due(5.0)


def test_who_has_cost_less_and_sends_less_costs_less():
    quiet, busy, large = TopicQueue(), TopicQueue(), TopicQueue()
    for queue in (quiet, busy):
        queue.put(b"message")
    busy.spend(0.1)
    large.put(b"x" * 1_000_000)

    assert quiet.cost(0.0) < large.cost(0.0)
    assert quiet.cost(0.0) < busy.cost(0.0)
    assert busy.cost(10.0) == quiet.cost(10.0)
