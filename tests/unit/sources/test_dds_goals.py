"""How goals are subscribed and taken, with a subscriber that stands in for DDS."""

from types import SimpleNamespace

import pytest
from action_msgs.msg import GoalStatusArray
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy

from ros_diagnostics_exporter.decode.goals import Goal
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.dds_subscription import Taken
from ros_diagnostics_exporter.sources.dds_watch import GOALS_DEPTH, Watcher
from support.goal_lists import encode_goals

TOPIC = f"/r/dock_robot{STATUS}"
WALL = 1_700_000_000.0
LIST = encode_goals([Goal(bytes([7]) * 16, 5.0, 2)])


class Subscriber:
    """Stands in for that of a node; ``waiting`` are messages with when they were received."""

    def __init__(self) -> None:
        self.node = None
        self.subscribed = []
        self.waiting: list[tuple[bytes, float | None]] = []

    def subscribe(self, kind, name, profile):
        self.subscribed.append((kind, name, profile))
        return None, self._take

    def _take(self):
        if not self.waiting:
            return None
        data, received = self.waiting.pop(0)
        return Taken(data, 1, 0, round((received or 0.0) * 1e9), "")


class Receiver:
    """Keeps the goals that are received."""

    def __init__(self) -> None:
        self.received: list[tuple[str, bytes, Instant]] = []

    def watched_topics(self, *_arguments):
        return {TOPIC: GOALS_TYPE}

    def record_watched(self, *_arguments) -> None:
        """Record nothing."""

    def note_watched(self, *_arguments) -> None:
        """Give nothing up."""

    def receive_goals(self, _domain, topic, data, now) -> None:
        self.received.append((topic, data, now))


@pytest.fixture
def watched():
    """A watcher that has looked once, its subscriber and its receiver."""
    subscriber, receiver = Subscriber(), Receiver()
    watcher = Watcher(0, receiver)
    list(watcher.look(subscriber, {}, Instant(10.0, WALL)))
    return SimpleNamespace(watcher=watcher, subscriber=subscriber, received=receiver.received)


def test_the_list_that_a_server_keeps_is_asked_for(watched):
    ((kind, name, profile),) = watched.subscriber.subscribed

    assert (kind, name, profile.depth) == (GoalStatusArray, TOPIC, GOALS_DEPTH)
    assert profile.durability == DurabilityPolicy.TRANSIENT_LOCAL
    assert profile.reliability == ReliabilityPolicy.RELIABLE


@pytest.mark.parametrize(
    ("received", "mono"),
    [
        (WALL + 0.25, 10.25),
        (WALL + 1.5, 11.0),  # while it was taken
        (WALL - 3600.0, 10.0),  # the clock was set: not before the look before
        (None, 11.0),
    ],
)
def test_a_list_was_received_when_the_middleware_says_between_two_looks(watched, received, mono):
    watched.subscriber.waiting = [(LIST, received)]
    list(watched.watcher.look(watched.subscriber, {}, Instant(11.0, WALL + 1.0)))

    ((topic, data, now),) = watched.received
    assert (topic, data) == (TOPIC, LIST)
    assert now.mono == pytest.approx(mono, abs=1e-3)
    assert now.wall - WALL == pytest.approx(mono - 10.0, abs=1e-3)


def test_of_several_lists_all_are_taken(watched):
    watched.subscriber.waiting = [(LIST, None), (LIST, None)]
    list(watched.watcher.look(watched.subscriber, {}, Instant(11.0, WALL + 1.0)))

    assert len(watched.received) == 2
