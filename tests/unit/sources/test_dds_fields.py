"""Small topics are subscribed as they are offered, and taken no more often than they are read."""

from types import SimpleNamespace
from unittest.mock import Mock

import pytest
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from std_msgs.msg import Bool

from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources import dds_types
from ros_diagnostics_exporter.sources.dds_fields import FieldTopics
from ros_diagnostics_exporter.sources.dds_subscription import Taken
from ros_diagnostics_exporter.sources.watched_bytes import WatchedBytes

BOOL = "std_msgs/msg/Bool"
TOPIC = "/r/e_stop"


def offer(
    durability=DurabilityPolicy.VOLATILE,
    type_hash="RIHS01_1",
    reliability=ReliabilityPolicy.RELIABLE,
):
    profile = QoSProfile(depth=1, durability=durability, reliability=reliability)
    return SimpleNamespace(qos_profile=profile, topic_type_hash=type_hash)


class Site:
    """One domain, whose node has what is offered, and a message when there is one."""

    def __init__(self) -> None:
        self.subscriber, self.receiver, self.bytes = Mock(), Mock(), WatchedBytes()
        self.receiver.offered.return_value = True
        self.receiver.receive_fields.return_value = 0.0
        self.node, self.subscribe = self.subscriber.node, self.subscriber.subscribe
        self.take = Mock(return_value=None)
        self.subscribe.return_value = Mock(), self.take
        self.topics = FieldTopics(0, self.receiver, self.bytes)

    def look(self, at: float, wanted=None) -> None:
        wanted = {TOPIC: BOOL} if wanted is None else wanted
        list(self.topics.look(self.subscriber, wanted, Instant(at, at)))

    def offer(self, *offers) -> None:
        self.node.get_publishers_info_by_topic.return_value = list(offers)

    def send(self, data: bytes, number: int) -> None:
        self.take.return_value = Taken(data, number, 0, 0, "")


@pytest.fixture
def site() -> Site:
    return Site()


@pytest.mark.parametrize(
    ("offers", "reliability", "durability"),
    [
        ([DurabilityPolicy.VOLATILE], ReliabilityPolicy.BEST_EFFORT, DurabilityPolicy.VOLATILE),
        (
            [DurabilityPolicy.TRANSIENT_LOCAL] * 2,
            ReliabilityPolicy.RELIABLE,
            DurabilityPolicy.TRANSIENT_LOCAL,
        ),
        (
            [DurabilityPolicy.TRANSIENT_LOCAL, DurabilityPolicy.VOLATILE],
            ReliabilityPolicy.BEST_EFFORT,
            DurabilityPolicy.VOLATILE,
        ),
    ],
)
def test_a_topic_is_subscribed_as_all_its_publishers_offer_it(
    site, offers, reliability, durability
):
    site.offer()
    site.look(0.0)
    assert not site.subscribe.called
    site.offer(*map(offer, offers))
    site.look(1.0)

    kind, name, profile = site.subscribe.call_args.args
    assert (kind, name, profile.depth) == (Bool, TOPIC, 1)
    assert (profile.reliability, profile.durability) == (reliability, durability)
    assert site.receiver.offered.call_args.args[:4] == (0, TOPIC, BOOL, "RIHS01_1")


def test_what_is_kept_and_not_sent_reliably_is_taken_as_it_is_offered(site):
    best_effort = {"reliability": ReliabilityPolicy.BEST_EFFORT}
    site.offer(offer(DurabilityPolicy.TRANSIENT_LOCAL, **best_effort))
    site.look(0.0)
    profile = site.subscribe.call_args.args[2]
    assert profile.reliability == ReliabilityPolicy.BEST_EFFORT


def test_a_topic_is_taken_when_it_is_due_and_what_was_missed_is_counted(site):
    site.offer(offer())
    site.look(0.0)
    site.receiver.receive_fields.return_value = 5.0
    site.send(b"12345", 7)
    site.look(1.0)
    site.look(4.0)
    assert site.receiver.receive_fields.call_count == 1
    site.send(b"12345", 37)
    site.look(5.0)
    assert site.receiver.receive_fields.call_args.args[:4] == (0, TOPIC, BOOL, b"12345")
    site.bytes.rates(0.0)
    assert site.bytes.rates(60.0) == {TOPIC: 31 * 5 / 60}


def test_a_silent_topic_is_subscribed_anew_once_its_publishers_offer_something_else(site):
    site.offer(offer(DurabilityPolicy.TRANSIENT_LOCAL))
    site.look(0.0)
    site.look(61.0)
    assert site.subscribe.call_count == 1
    site.offer(offer())
    site.send(b"12345", 1)
    site.look(100.0)
    site.take.return_value = None
    site.look(159.0)
    assert site.subscribe.call_count == 1
    site.look(160.0)
    assert site.subscribe.call_count == 2
    assert site.subscribe.call_args.args[2].durability == DurabilityPolicy.VOLATILE


def test_a_topic_that_is_refused_is_asked_for_again_later(site):
    site.offer(offer())
    site.receiver.offered.return_value = False
    for at in (0.0, 1.0, 29.0):
        site.look(at)
    assert (site.receiver.offered.call_count, site.subscribe.called) == (1, False)
    site.receiver.offered.return_value = True
    site.look(31.0)
    assert site.subscribe.called


def test_a_topic_that_is_not_wanted_any_more_or_has_another_type_is_subscribed_no_more(site):
    site.offer(offer())
    site.look(0.0)
    site.look(1.0, {TOPIC: "std_msgs/msg/String"})
    assert site.node.destroy_subscription.call_count == 1
    assert site.subscribe.call_count == 2
    site.look(2.0, {})
    assert site.node.destroy_subscription.call_count == 2


def test_a_type_that_is_not_installed_is_borrowed_or_named(site, monkeypatch):
    site.offer(offer())
    site.look(0.0, {TOPIC: "mir_msgs/msg/State"})
    kind = site.subscribe.call_args.args[0]
    support, callbacks, _find = type(kind)._kept
    assert (callbacks.message_namespace, callbacks.message_name) == (b"mir_msgs::msg", b"State")
    assert support.identifier == b"rosidl_typesupport_fastrtps_c"

    dds_types.borrowed_type.cache_clear()
    monkeypatch.setattr(dds_types, "get_rmw_implementation_identifier", lambda: "rmw_other")
    site.look(1.0, {TOPIC: "mir_msgs/msg/Other"})
    why = site.receiver.refuse_watched.call_args.args[2]
    assert why == "rmw_other needs the package of mir_msgs/msg/Other: install mir_msgs"
