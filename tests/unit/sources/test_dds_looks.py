"""What one look at the ROS graph reports, asks for and ends."""

from unittest.mock import Mock

import pytest
from lifecycle_msgs.msg import State, TransitionEvent
from rclpy.qos import QoSProfile, ReliabilityPolicy

from ros_diagnostics_exporter.model import Endpoint, Instant
from ros_diagnostics_exporter.sources import dds, dds_watch
from ros_diagnostics_exporter.sources.dds import MAX_ASKED, DdsDomain, describe_ros
from ros_diagnostics_exporter.sources.dds_endpoints import (
    MAX_READ,
    ROUND,
    EndpointReader,
    Subscribed,
)
from ros_diagnostics_exporter.sources.graph_messages import Transition
from ros_diagnostics_exporter.sources.listener import LEAVE_TIME, Listener


@pytest.fixture
def domain() -> DdsDomain:
    domain = DdsDomain(0, (), Mock(), Mock(), 1.0)
    domain.receiver.wanted_topics.return_value = {}
    domain.receiver.update_nodes.return_value = False
    domain._subscriber = Mock()
    return domain


def test_topics_that_nobody_wants_are_asked_for_in_turns(domain):
    types = {f"/t{number:04}": ("a/msg/A",) for number in range(MAX_ASKED + 10)}
    first, second = domain._to_be_asked(types), domain._to_be_asked(types)
    assert first == sorted(types)[:MAX_ASKED]
    assert second == [*sorted(types)[MAX_ASKED:], *first[: MAX_ASKED - 10]]
    assert domain._to_be_asked({}) == []


def test_what_is_not_wanted_any_more_is_unsubscribed(domain):
    topic = domain.topics["/r/diagnostics"] = Mock()
    list(domain._subscribe_wanted({}))
    assert domain.topics == {}
    topic.close.assert_called_once_with()


@pytest.mark.parametrize("is_listed", [True, False])
def test_nodes_are_reported_only_where_the_graph_can_be_read(domain, monkeypatch, is_listed):
    """A graph that cannot be read shows no nodes: all would be gone."""
    listed = Mock(return_value=[], side_effect=None if is_listed else OSError("no memory"))
    monkeypatch.setattr(domain, "_list_topics", listed)
    monkeypatch.setattr(domain, "_list_nodes", lambda _node: [])
    list(domain.look())
    assert domain.receiver.update_nodes.called is is_listed


def test_the_distribution_is_that_of_the_package_of_rclpy(monkeypatch):
    monkeypatch.delenv("ROS_DISTRO", raising=False)
    found = [Mock(metadata={"Name": name}) for name in (None, "ros-jazzy-rclpy", "rclpy")]
    monkeypatch.setattr(dds.metadata, "distributions", lambda: found)
    assert describe_ros()[0] == "jazzy"


def test_endpoints_are_read_a_few_topics_at_a_time_and_again_after_a_while():
    node, receiver = Mock(), Mock()
    node.count_publishers.return_value = node.count_subscribers.return_value = 0
    node.get_publishers_info_by_topic.return_value = []
    node.get_subscriptions_info_by_topic.return_value = []
    reader = EndpointReader(0, receiver, lambda _name: None)
    names = [f"/t{number}" for number in range(MAX_READ + 10)]

    def read(second: float) -> int:
        list(reader.read(node, names, Instant(second, second)))
        return len(receiver.update_endpoints.call_args.args[1])

    assert [read(100.0 * ROUND), read(100.9 * ROUND)] == [MAX_READ, 10]
    assert read(102.0 * ROUND) == MAX_READ


RELIABLE, BEST_EFFORT = (
    QoSProfile(depth=1, reliability=each)
    for each in (ReliabilityPolicy.RELIABLE, ReliabilityPolicy.BEST_EFFORT)
)


@pytest.mark.parametrize(
    ("publisher", "subscriber", "why"),
    [(RELIABLE, BEST_EFFORT, ""), (BEST_EFFORT, RELIABLE, "Best effort publisher")],
)
def test_why_nothing_is_received_is_what_the_middleware_says_of_the_two(publisher, subscriber, why):
    one, other = (Mock(topic_type="T", qos_profile=each) for each in (publisher, subscriber))
    found = EndpointReader(0, Mock(), lambda _name: None)._why_no_match(one, other)
    assert found.partition(" and")[0] == why


def test_the_link_of_a_topic_is_known_while_it_has_one_publisher(domain):
    domain.topics = {"/a": Mock(), "/b": Mock()}
    domain._report_links({"/a": Endpoint(1), "/b": Endpoint(2)}, Instant(100.0, 100.0))
    reading = domain.topics["/a"].content.link.reading.return_value
    assert domain.receiver.update_links.call_args.args[1] == {"/a": reading, "/b": None}


def test_of_a_transition_its_two_states_are_read():
    message = TransitionEvent(start_state=State(label="a"), goal_state=State(label="b"))
    assert dds_watch._read(message) == Transition("a", "b")


def test_the_middleware_is_asked_why_until_the_subscription_is_closed():
    subscribed, event = Subscribed(Mock()), Mock()
    assert subscribed.refused == ""  # it is asked later
    subscribed.close()
    subscribed._event = event
    subscribed.close()
    event.destroy_when_not_in_use.assert_called_once_with()


def test_a_domain_that_is_left_is_waited_for():
    left = Mock()
    Listener._leave(Mock(), [left])
    assert 0 < left.wait.call_args.args[0] <= LEAVE_TIME
