"""While a subscription replaces another one, each message is taken once."""

from collections import deque
from collections.abc import Callable
from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.model import Endpoint
from ros_diagnostics_exporter.sources import handover
from ros_diagnostics_exporter.sources.reception import Reception
from testbed.polling import until


class Middleware:
    """What each subscription has, the oldest subscription first; None: it is closed."""

    def __init__(self) -> None:
        self.queues: list[deque[bytes] | None] = []

    def open(self) -> tuple[Callable[[], bytes | None], Callable[[], None]]:
        number = len(self.queues)
        self.queues.append(deque())

        def take() -> bytes | None:
            queue = self.queues[number]
            assert queue is not None, "a closed subscription is taken from"
            return queue.popleft() if queue else None

        def close() -> None:
            self.queues[number] = None

        return take, close

    def send(self, data: bytes, *numbers: int) -> None:
        """To the subscriptions with these numbers, by default to all."""
        for number, queue in enumerate(self.queues):
            if queue is not None and (not numbers or number in numbers):
                queue.append(data)

    @property
    def open_ones(self) -> int:
        return sum(each is not None for each in self.queues)


class Domain(Reception):
    """A topic of which the test says what arrives; ``taken`` is what was."""

    def __init__(self) -> None:
        super().__init__(7, Mock(), Mock(), 0.0)
        self.middleware = Middleware()
        self.taken: list[bytes] = []
        self.want("/a", Endpoint(1), shared=False)

    join = leave = lambda _self: None

    def look(self):
        yield

    def open(self, *_wanted):
        return self.middleware.open()

    def data(self, taken):
        return taken

    def measure(self, _link, taken):
        self.taken.append(taken)

    def take(self) -> list[bytes]:
        """What one turn takes."""
        self._take()
        taken, self.taken = self.taken, []
        return taken


@pytest.fixture
def clock(monkeypatch):
    now = Mock(return_value=100.0)
    monkeypatch.setattr("ros_diagnostics_exporter.sources.reception.time.monotonic", now)
    return now


@pytest.fixture
def domain(clock):
    assert clock() == 100.0
    return Domain()


def test_the_old_one_goes_on_until_publishers_know_the_new_one(domain, clock):
    domain.want("/a", Endpoint(2), shared=False)
    domain.middleware.send(b"1", 0)  # the publisher does not know of the new one yet
    domain.middleware.send(b"2")
    assert domain.take() == [b"1", b"2"]
    domain.middleware.send(b"3", 1)
    domain.middleware.send(b"4")
    assert sorted(domain.take()) == [b"3", b"4"]
    clock.return_value += handover.OVERLAP
    domain.middleware.send(b"5")
    assert domain.take() == [b"5"]
    assert domain.middleware.queues[0] is None
    domain.middleware.send(b"6")
    assert domain.take() == [b"6"]


def test_what_comes_late_to_the_new_one_is_taken_once(domain, clock):
    domain.want("/a", Endpoint(2), shared=False)
    domain.middleware.send(b"1", 0)
    assert domain.take() == [b"1"]
    clock.return_value += handover.OVERLAP
    assert domain.take() == []
    domain.middleware.send(b"1")  # sent again to the one that is left
    domain.middleware.send(b"2")
    assert domain.take() == [b"2"]
    clock.return_value += handover.LATE
    domain.take()
    domain.middleware.send(b"1")  # another message with the same bytes
    assert domain.take() == [b"1"]


def test_there_are_two_subscriptions_of_a_topic_at_most_one_of_them_known(domain, clock):
    for number in range(5):
        domain.want("/a", Endpoint(number + 2), shared=False)
        assert domain.middleware.open_ones == 2
        domain.middleware.send(b"%d" % number, 0)
        assert domain.take() == [b"%d" % number]
    clock.return_value += handover.OVERLAP
    domain.middleware.send(b"last")
    assert domain.take() == [b"last"]
    assert domain.middleware.open_ones == 1
    domain.want("/a", Endpoint(9), shared=False)  # what was replaced may still come late
    domain.middleware.send(b"0", 5)
    domain.middleware.send(b"new", 5)
    assert domain.take() == [b"new"]


def test_one_that_is_unsubscribed_meanwhile_leaves_none_open(domain, clock):
    domain.want("/a", Endpoint(2), shared=False)
    domain.unsubscribe("/a")
    assert domain.middleware.open_ones == 0
    clock.return_value += handover.OVERLAP + handover.LATE
    assert domain.take() == []


def test_a_message_above_the_limit_is_rejected_with_its_size(domain):
    domain.max_message = 1_999
    domain.middleware.send(b"x" * 2_000)
    domain.take()
    error = domain.receiver.reject_undecodable.call_args.args[1]
    assert error == "2000 bytes, more than 1999 are not decoded"


def test_a_shallower_queue_of_large_messages_loses_none():
    domain = Domain()
    domain.loop.start()
    try:
        domain.middleware.send(b"x" * 300_000)
        until(lambda: domain.middleware.open_ones == 2, "it is subscribed anew")
        domain.middleware.send(b"y", 0)
        until(lambda: b"y" in domain.taken, "what only the old one has is taken")
    finally:
        domain.wait(30)
