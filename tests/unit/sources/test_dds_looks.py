"""What one look at the ROS graph reports, asks for and ends."""

from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources import dds
from ros_diagnostics_exporter.sources.dds import MAX_ASKED, DdsDomain, describe_ros
from ros_diagnostics_exporter.sources.dds_endpoints import MAX_READ, ROUND, EndpointReader


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
