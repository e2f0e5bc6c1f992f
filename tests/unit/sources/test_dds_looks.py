"""What one look at the ROS graph reports, asks for and ends."""

from types import SimpleNamespace
from unittest.mock import MagicMock, Mock

import pytest
from lifecycle_msgs.msg import State, TransitionEvent
from rcl_interfaces.msg import Log as RosLog
from rcl_interfaces.msg import Parameter, ParameterEvent
from rclpy.parameter import Parameter as RosParameter
from rclpy.qos import QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message

from ros_diagnostics_exporter.config.robots import MESSAGE_TYPE
from ros_diagnostics_exporter.model import Endpoint, Instant
from ros_diagnostics_exporter.sources import dds, dds_endpoints, dds_names, dds_watch
from ros_diagnostics_exporter.sources.dds import MAX_ASKED, SELDOM, TYPE, DdsDomain, describe_ros
from ros_diagnostics_exporter.sources.dds_endpoints import (
    ASKED_BEFORE,
    MAX_ENDPOINTS,
    MAX_READ,
    ROUND,
    EndpointReader,
    Subscribed,
)
from ros_diagnostics_exporter.sources.dds_subscription import Taken
from ros_diagnostics_exporter.sources.endpoint_names import NO_NODE
from ros_diagnostics_exporter.sources.graph_messages import (
    LOG_TYPE,
    TRANSITION_TYPE,
    Log,
    Parameters,
    Transition,
)
from ros_diagnostics_exporter.sources.graph_topics import UNKNOWN, US, Mismatch, Peer


@pytest.fixture
def domain() -> DdsDomain:
    domain = DdsDomain(0, (), Mock(), Mock(), 1.0)
    domain.receiver.wanted_topics.return_value = {}
    domain.receiver.update_nodes.return_value = False
    domain.receiver.finders.return_value = ()
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


def parameter(name: str, value: object) -> Parameter:
    return RosParameter(name, value=value).to_parameter_msg()


@pytest.mark.parametrize(
    ("message", "read"),
    [
        (
            TransitionEvent(start_state=State(label="a"), goal_state=State(label="b")),
            Transition("a", "b"),
        ),
        (RosLog(name="r.amcl", msg="no map", level=40), Log("r.amcl", "no map")),
        (
            ParameterEvent(
                node="/r/amcl",
                changed_parameters=[parameter("max", 0.5), parameter("text", "x" * 99)],
                deleted_parameters=[parameter("old", 1)],
            ),
            Parameters("/r/amcl", (("max", "0.5"), ("text", "x" * 80), ("old", None))),
        ),
    ],
)
def test_of_a_message_what_is_of_interest_is_read(message, read):
    assert dds_watch._read(message) == read


def log_of(level: int) -> bytes:
    return serialize_message(RosLog(name="r.amcl", msg="no map", level=level))


def test_what_is_watched_is_taken_counted_and_decoded_where_it_is_an_error():
    receiver, subscriber = Mock(), Mock()
    kinds = {"/rosout": LOG_TYPE, "/r/amcl/transition_event": TRANSITION_TYPE}
    receiver.watched_topics.return_value = kinds
    watcher = dds_watch.Watcher(0, receiver)
    waiting = [log_of(30), log_of(40), b"\0" * dds_watch.LEVEL_AT, b"\0\1\0\0", log_of(50)]
    size = sum(map(len, waiting))
    takes = iter([Taken(each, 1, 0, 0, "") for each in waiting])
    logs, life = Mock(), Mock()
    subscriber.subscribe.side_effect = lambda _kind, name, _profile: (
        (logs, lambda: next(takes, None)) if name == "/rosout" else (life, lambda: None)
    )

    for second in 100.0, 101.0, 160.0:
        list(watcher.look(subscriber, {}, Instant(second, second)))

    assert [each.args[3] for each in receiver.record_watched.call_args_list] == waiting
    assert [each.args[1:3] for each in receiver.receive_watched.call_args_list] == [
        ("/rosout", Log("r.amcl", "no map"))
    ] * 2
    [counted] = [each.args[1] for each in receiver.note_watched.call_args_list]
    assert counted == {"/rosout": pytest.approx(size / 60)}
    assert subscriber.subscribe.call_count == 2
    receiver.watched_topics.return_value = {"/rosout": LOG_TYPE}
    list(watcher.look(subscriber, {}, Instant(161.0, 161.0)))
    subscriber.node.destroy_subscription.assert_called_once_with(life)


@pytest.mark.parametrize(
    ("status", "why"),
    [
        (None, ""),
        (Mock(total_count=0, last_policy_kind=QoSPolicyKind.RELIABILITY), ""),
        (Mock(total_count=1, last_policy_kind=QoSPolicyKind.RELIABILITY), "RELIABILITY"),
        (
            Mock(total_count=1, last_policy_kind=QoSPolicyKind.INVALID),
            "a policy that ROS has no name for, as ownership or data representation",
        ),
    ],
)
def test_the_middleware_is_asked_why_until_the_subscription_is_closed(monkeypatch, status, why):
    made = MagicMock()
    made.return_value.take_event.return_value = status
    monkeypatch.setattr(dds_endpoints.rclpy_implementation, "EventHandle", made)
    subscribed = Subscribed(MagicMock())
    assert [subscribed.refused for _ in range(ASKED_BEFORE - 1)] == [""] * (ASKED_BEFORE - 1)
    subscribed.close()
    assert not made.called  # it is asked later
    assert [subscribed.refused for _ in range(3)] == [why] * 3
    made.assert_called_once()
    subscribed.close()
    made.return_value.destroy_when_not_in_use.assert_called_once_with()


def endpoint(
    node: str, number: int, profile=RELIABLE, kind: str = "a/msg/A", namespace: str = "/r"
) -> SimpleNamespace:
    gid = [number] * 16
    return SimpleNamespace(
        node_name=node,
        node_namespace=namespace,
        endpoint_gid=gid,
        qos_profile=profile,
        topic_type=kind,
    )


class Endpoints:
    """Stands in for a node: who publishes and subscribes ``/t``; ``count`` if they are others."""

    def __init__(self, publishers=(), subscribers=(), count: int | None = None) -> None:
        self.publishers, self.subscribers, self.count = [*publishers], [*subscribers], count
        self.subscribed = None  # by this exporter

    def count_publishers(self, _name: str) -> int:
        return len(self.publishers) if self.count is None else self.count

    def count_subscribers(self, _name: str) -> int:
        return len(self.subscribers)

    def get_publishers_info_by_topic(self, _name: str):
        return self.publishers

    def get_subscriptions_info_by_topic(self, _name: str):
        return self.subscribers

    def mismatches(self) -> tuple[Mismatch, ...]:
        reader = EndpointReader(0, Mock(), lambda _name: self.subscribed)
        return reader._view(self, "/t").mismatches


def test_who_publishes_and_subscribes_a_topic_and_which_of_them_cannot_match():
    node = Endpoints(
        [endpoint("arm", 1), endpoint("leg", 2, BEST_EFFORT), endpoint("odd", 3, kind="b/msg/B")],
        [endpoint("eye", 4), endpoint("ear", 5, BEST_EFFORT, namespace="/")],
    )
    view = EndpointReader(0, Mock(), lambda _name: None)._view(node, "/t")
    assert [each.node for each in view.publishers] == ["/r/arm", "/r/leg", "/r/odd"]
    assert view.subscribers == (Peer("/r/eye", "04" * 16), Peer("/ear", "05" * 16))
    found = [(each.publisher, each.subscriber, each.why[:15]) for each in view.mismatches]
    assert found == [
        ("/r/leg", "/r/eye", "Best effort pub"),
        ("/r/odd", "/r/eye", "the types diffe"),
        ("/r/odd", "/ear", "the types diffe"),
    ]


def test_a_topic_that_is_gone_has_no_endpoints_and_one_of_half_known_nodes_says_so():
    receiver = Mock()
    reader = EndpointReader(0, receiver, lambda _name: None)
    node = Endpoints([endpoint(NO_NODE, 1)])

    def read(second: float, *names: str) -> dict[str, tuple[Mismatch, ...]]:
        list(reader.read(node, names, Instant(second, second)))
        views = receiver.update_endpoints.call_args.args[1]
        return {name: view.mismatches for name, view in views.items()}

    assert read(100.0, "/t", "/rosout") == {"/t": (UNKNOWN,)}
    assert read(300.0, "/u") == {"/t": (), "/u": (UNKNOWN,)}
    assert read(500.0, "/u") == {"/u": (UNKNOWN,)}
    node.count = MAX_ENDPOINTS + 1
    assert read(700.0, "/u") == {}


@pytest.mark.parametrize(
    ("matched", "refused", "shown"),
    [
        (0, "DURABILITY", [Mismatch("/r/arm, /r/leg", US, "by DURABILITY")]),
        (1, "DURABILITY", [Mismatch("one of /r/arm, /r/leg", US, "by DURABILITY")]),
        (0, "", []),  # the middleware does not know yet
        (2, "DURABILITY", []),  # one that is gone
    ],
)
def test_publishers_that_the_exporter_does_not_match_are_named(matched, refused, shown):
    kind = MESSAGE_TYPE
    node = Endpoints([endpoint("leg", 2, kind=kind), endpoint("arm", 1, kind=kind)])
    node.publishers.append(endpoint("odd", 3))  # of another type
    node.subscribed = Mock(matched=matched, refused=refused)
    assert [*node.mismatches()] == shown


@pytest.mark.parametrize(("count", "is_read"), [(MAX_ENDPOINTS, True), (MAX_ENDPOINTS + 1, False)])
def test_a_topic_of_very_many_is_not_read(count, is_read):
    view = EndpointReader(0, Mock(), lambda _name: None)._view(Endpoints(count=count), "/tf")
    assert (view is not None) is is_read


def test_a_topic_of_a_node_whose_name_cannot_be_read_is_not_judged(monkeypatch):
    node = Endpoints([endpoint("arm", 1)])
    error = UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid")
    monkeypatch.setattr(node, "get_subscriptions_info_by_topic", Mock(side_effect=error))
    assert EndpointReader(0, Mock(), lambda _name: None)._view(node, "/t") is None


@pytest.mark.parametrize("looks", [SELDOM, 2 * SELDOM])
def test_each_topic_has_one_turn_in_so_many_looks(domain, looks):
    names = [f"/t{number}" for number in range(50)]
    turns = []
    for _ in range(looks):
        list(domain.look())
        turns += [each for each in names if domain._has_turn(each, looks)]
    assert sorted(turns) == sorted(names)


@pytest.mark.parametrize(
    ("publishers", "known"),
    [
        ([], Endpoint(0)),
        ([endpoint("arm", 1, kind=TYPE)], Endpoint(1, writers=frozenset({"01" * 16}))),
        (
            [endpoint("arm", 1, BEST_EFFORT, TYPE), endpoint("leg", 2, kind=TYPE)],
            Endpoint(2, reliable=False, writers=frozenset({"01" * 16, "02" * 16})),
        ),
        (
            [endpoint("arm", 1, kind="b/msg/B"), endpoint("leg", 2), endpoint("odd", 3)],
            Endpoint(
                0,
                wrong_type="a/msg/A, b/msg/B",
                writers=frozenset({"01" * 16, "02" * 16, "03" * 16}),
            ),
        ),
    ],
)
def test_what_publishes_a_topic_is_asked_in_full_once_their_number_changes(
    domain, monkeypatch, publishers, known
):
    monkeypatch.setattr(domain, "_has_turn", lambda _name, _looks: False)
    node = Endpoints(publishers)
    asked = Mock(side_effect=node.get_publishers_info_by_topic)
    monkeypatch.setattr(node, "get_publishers_info_by_topic", asked)
    for _ in range(3):
        domain._ask(node, "/t", (TYPE,))
    assert domain._known["/t"][1] == known
    assert asked.call_count == bool(publishers)
    node.publishers.append(endpoint("new", 9, kind=TYPE))
    domain._ask(node, "/t", (TYPE,))
    assert domain._known["/t"][1].publishers == known.publishers + 1


@pytest.mark.parametrize(("matched", "refused"), [(0, "DURABILITY"), (1, "")])
def test_publishers_are_refused_where_the_subscription_matches_none(domain, matched, refused):
    domain._subscriptions["/t"] = Mock(matched=matched, refused="DURABILITY")
    domain._ask(Endpoints([endpoint("arm", 1, kind=TYPE)]), "/t", (TYPE,))
    assert domain._known["/t"][1].refused == refused


@pytest.mark.parametrize(
    ("known", "offered", "reliable"),
    [
        (None, {}, True),
        (None, {"/t": Endpoint(1)}, True),
        (None, {"/t": Endpoint(1, reliable=False)}, False),
        (True, {"/t": Endpoint(1)}, True),
        (True, {"/t": Endpoint(1, reliable=False)}, False),
        (False, {"/t": Endpoint(1)}, False),  # one that sends best effort may come back
    ],
)
def test_a_topic_is_subscribed_reliably_unless_one_ever_offered_less(
    domain, known, offered, reliable
):
    if known is not None:
        domain.topics["/t"] = Mock(offer=known)
    assert domain._offer("/t", offered) is reliable
    policy = ReliabilityPolicy.RELIABLE if reliable else ReliabilityPolicy.BEST_EFFORT
    assert dds.quality(reliable=reliable, depth=7).reliability == policy


@pytest.mark.parametrize(
    ("number", "sent", "received", "is_measured"),
    [(7, 1, 2, True), (0, 1, 2, True), (None, 1, 2, False), (7, 0, 2, False), (7, 1, 0, False)],
)
def test_the_link_is_measured_by_messages_of_which_all_is_known(
    domain, number, sent, received, is_measured
):
    link, taken = Mock(), Taken(b"data", number, sent, received, "p")
    domain.measure(link, taken)
    assert [each.args for each in link.note.call_args_list] == [
        (number, sent, received)
    ] * is_measured
    is_numbered = number is not None and sent
    assert domain.identity(taken) == ((number, sent) if is_numbered else hash(b"data"))


def test_names_that_cannot_be_read_are_left_out_counted_and_said(domain, monkeypatch, caplog):
    raw = [(b"/r/diagnostics", [b"a/msg/A", b"\xff"]), (b"/evil\xff" + b"x" * 200, [])]
    monkeypatch.setattr(dds_names, "_topics", lambda _node: raw)
    nodes = [(b"arm", b"/r"), (b"", b"/r"), (b"leg", b""), (b"\xff", b"/")]
    monkeypatch.setattr(dds_names, "_nodes", lambda _node: nodes)
    error = UnicodeDecodeError("utf-8", b"\xff", 0, 1, "invalid")
    node = domain._subscriber.node
    node.get_topic_names_and_types.side_effect = error
    node.get_node_names_and_namespaces.side_effect = error
    list(domain.look())

    topics, oddities = {"/r/diagnostics": ("a/msg/A", "")}, domain.odd.split("; ")
    assert domain.receiver.note_other_types.call_args.args[1] == topics
    assert domain.receiver.update_nodes.call_args.args[1] == [("arm", "/r"), ("leg", "/")]
    shown = "/evil\\xff" + "x" * (dds_names.MAX_SHOWN - len("/evil\\xff"))
    assert oddities == [
        f"1 topics have a name that is no UTF-8: {shown}",
        "2 nodes have no name, or none that is UTF-8",
    ]
    assert all(f"domain 0: left out: {each}" in caplog.text for each in oddities)
