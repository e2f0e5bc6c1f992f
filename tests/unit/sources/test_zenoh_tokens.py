"""What one session of zenoh notes, subscribes and reads: anybody may declare a token there."""

import json
import re
import time
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.config.fleet import Zenoh
from ros_diagnostics_exporter.decode.cdr import SHARED
from ros_diagnostics_exporter.model import ZENOH, Endpoint, Instant
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.topic_entries import REFUSED_FOR
from ros_diagnostics_exporter.sources.zenoh import (
    _RMW_TYPE,
    RETRY,
    TOKENS,
    Token,
    ZenohNetwork,
    _config,
    parse,
)
from ros_diagnostics_exporter.sources.zenoh_fields import Offer, ZenohFields, asked_tokens

zenoh = pytest.importorskip("zenoh")
BOOL = "std_msgs/msg/Bool"
TOKEN = "@/9f/@ros2_lv/MP/r{}§diagnostics/diagnostic_msgs§msg§DiagnosticArray/:1:::;"


def sample(number: int, kind) -> SimpleNamespace:
    return SimpleNamespace(key_expr=TOKEN.format(number), kind=kind)


@pytest.fixture
def network() -> ZenohNetwork:
    receiver = Mock()
    receiver.wanted_topics.return_value = {}
    receiver.finders.return_value = ()
    receiver.asked_topics.return_value = frozenset()
    return ZenohNetwork(Zenoh(("tcp/centre:7447",)), receiver, Mock(), 1.0)


def test_tokens_beyond_the_limit_are_not_noted_and_the_log_says_so(network, monkeypatch, caplog):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.zenoh.MAX_PUBLISHERS", 2)
    for number in range(3):
        network._note(sample(number, zenoh.SampleKind.PUT))
    list(network.look())

    _domain, topics, _now = network.receiver.update_graph.call_args.args
    assert set(topics) == {"/r0/diagnostics", "/r1/diagnostics"}
    assert "publishers beyond 2 are not noted" in caplog.text


def test_bridges_beyond_the_limit_take_no_room_of_publishers(network, monkeypatch, caplog):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.zenoh.MAX_CONNECTED", 1)
    for number in range(2):
        key = f"@/{number}/@ros2_lv"
        network._note(SimpleNamespace(key_expr=key, kind=zenoh.SampleKind.PUT))
    network._note(sample(0, zenoh.SampleKind.PUT))
    list(network.look())

    _domain, topics, _now = network.receiver.update_graph.call_args.args
    assert set(topics) == {"/r0/diagnostics"}
    assert "bridges and nodes beyond 1 are not noted" in caplog.text


def test_tokens_that_were_too_many_are_asked_for_again_once_there_is_room(network, monkeypatch):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.zenoh.MAX_PUBLISHERS", 2)
    network._session = Mock()
    asked = network._session.liveliness.return_value.declare_subscriber
    for number in range(3):
        network._note(sample(number, zenoh.SampleKind.PUT))
    list(network.look())
    assert asked.call_count == 0
    network._note(sample(0, zenoh.SampleKind.DELETE))
    list(network.look())
    assert asked.call_count == len(TOKENS)
    network._note(sample(2, zenoh.SampleKind.PUT))
    network._note(sample(0, zenoh.SampleKind.PUT))
    network._note(sample(2, zenoh.SampleKind.DELETE))
    list(network.look())
    assert asked.call_count == len(TOKENS)  # once a minute


@pytest.mark.parametrize(("share", "least", "most"), [(1e9, 1.9, 2.0), (1e-9, 9.0, 10.0)])
def test_looks_that_cost_much_are_further_apart(network, monkeypatch, share, least, most):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.reception.LOOK_SHARE", share)
    network.poll_interval = 2.0
    network._note(sample(1, zenoh.SampleKind.PUT))

    before = time.monotonic()
    network._look_on()

    assert least < network.look_at - before < most + time.monotonic() - before


def test_an_action_server_of_a_bridge_offers_the_status_of_its_goals():
    token = "@/9f/@ros2_lv/AS/site§r§dock_robot/test_msgs§action§Fibonacci"
    [asked] = {*asked_tokens([STATUS])} - {
        each for each in asked_tokens([STATUS]) if "/MP/" in each
    }

    assert zenoh.KeyExpr(asked).includes(zenoh.KeyExpr(token))
    assert not [each for each in asked_tokens(["io/e_stop"]) if "/AS/" in each]
    key = f"site/r/dock_robot{STATUS}"
    assert parse(token) == Token("9f", f"/{key}", key, GOALS_TYPE)


def test_tokens_of_what_is_asked_for_are_noted_and_no_others(network):
    network._session = Mock()
    asked = network._session.liveliness.return_value.declare_subscriber
    network.receiver.asked_topics.return_value = frozenset({"io/e_stop"})
    network.receiver.update_offered.return_value = {}
    list(network.look())
    keys = {each.args[0] for each in asked.call_args_list} - {*TOKENS}
    expressions = [zenoh.KeyExpr(each) for each in keys]

    def is_noted(token: str) -> bool:
        return any(each.includes(zenoh.KeyExpr(token)) for each in expressions)

    assert is_noted("@/9f/@ros2_lv/MP/r§io§e_stop/std_msgs§msg§Bool/:1:::;")
    assert is_noted("@ros2_lv/2/aa/0/11/MP/%/%r/plc/%r%io%e_stop/std_msgs::msg::dds_::Bool_/R/::,")
    assert not is_noted("@/9f/@ros2_lv/MP/r§e_stop/std_msgs§msg§Bool/:1:::;")
    assert not is_noted("@/9f/@ros2_lv/MS/r§io§e_stop/std_msgs§msg§Bool/:1:::;")
    list(network.look())
    assert asked.call_count == len(TOKENS) + len(keys)  # once


@pytest.mark.parametrize("is_found", [True, False])
def test_a_small_topic_is_offered_by_the_end_of_its_name_or_where_robots_are_found_by_it(
    network, is_found
):
    network._session = Mock()
    network.receiver.asked_topics.return_value = frozenset({"io/e_stop"})
    network.receiver.update_offered.return_value = {}
    network.receiver.finders.return_value = (re.compile("/s[^/]*/mode"),) * is_found
    for key in "r§io§e_stop", "s1§mode", "r§mode":
        token = f"@/9f/@ros2_lv/MP/{key}/std_msgs§msg§Bool/:1:::typehash=RIHS01_5;"
        network._note(SimpleNamespace(key_expr=token, kind=zenoh.SampleKind.PUT))
    list(network.look())

    offers = network.receiver.note_offered.call_args.args[1]
    assert offers["/r/io/e_stop"] == Offer("r/io/e_stop", BOOL, "RIHS01_5")
    assert offers.keys() == {"/r/io/e_stop"} | ({"/s1/mode"} if is_found else set())
    # Where robots are found by a topic, it is known although it has no diagnostics.
    [graph] = [each.args[1] for each in network.receiver.update_graph.call_args_list]
    assert graph == ({"/s1/mode": Endpoint(0, wrong_type=BOOL)} if is_found else {})
    others = network.receiver.note_other_types.call_args.args[1]
    assert others == {"/r/mode": (BOOL,)} | ({} if is_found else {"/s1/mode": (BOOL,)})


def test_what_is_wanted_is_subscribed_by_its_publishers_key_and_cut_off_without_its_bridge(network):
    made = network._session = Mock()
    subscribed = made.declare_subscriber
    network.receiver.wanted_topics.return_value = {"/r1/diagnostics": False, "/late": True}
    rmw = f"@ros2_lv/2/aa/0/11/MP/%/%r2/node/%r2%diagnostics/{_RMW_TYPE}/RIHS01_5/::,"
    for key in TOKEN.format(1), TOKEN.format(1).replace("9f", "8e"), rmw:
        network._note(SimpleNamespace(key_expr=key, kind=zenoh.SampleKind.PUT))
    list(network.look())

    assert {each.args[0] for each in subscribed.call_args_list} == {"r1/diagnostics", "late"}
    graph = network.receiver.update_graph.call_args.args[1]
    assert graph == {"/r1/diagnostics": Endpoint(2), "/2/r2/diagnostics": Endpoint(1)}
    topic = network.topics["/late"]
    assert topic.take is subscribed.return_value.try_recv
    assert topic.content.queue.share == SHARED

    network.receiver.wanted_topics.return_value = {"/r1/diagnostics": False}
    for key in TOKEN.format(1), TOKEN.format(1).replace("9f", "8e"):
        network._note(SimpleNamespace(key_expr=key, kind=zenoh.SampleKind.DELETE))
    list(network.look())
    assert network.topics.keys() == {"/r1/diagnostics"}
    subscribed.return_value.undeclare.assert_called_once_with()
    graph = network.receiver.update_graph.call_args.args[1]
    assert graph["/r1/diagnostics"] == Endpoint(0, is_cut_off=True)
    assert network.last_look > 0
    bridge = SimpleNamespace(key_expr="@/8e/@ros2_lv", kind=zenoh.SampleKind.PUT)
    network._note(bridge)
    list(network.look())
    graph = network.receiver.update_graph.call_args.args[1]
    assert not graph["/r1/diagnostics"].is_cut_off
    assert [each.args[0] for each in subscribed.call_args_list].count("r1/diagnostics") == 1


def test_topics_that_are_known_with_another_type_are_known_with_it(network):
    network._session = Mock()
    network.receiver.wanted_topics.return_value = {"/r1/diagnostics": False}
    other = TOKEN.format(1).replace("diagnostic_msgs§msg§DiagnosticArray", "std_msgs§msg§Bool")
    network._note(SimpleNamespace(key_expr=other, kind=zenoh.SampleKind.PUT))
    list(network.look())
    graph = network.receiver.update_graph.call_args.args[1]
    assert graph == {"/r1/diagnostics": Endpoint(0, wrong_type=BOOL)}
    assert not network.receiver.note_other_types.called
    network.error = "no router"
    network.receiver.update_graph.reset_mock()
    list(network.look())
    assert not network.receiver.update_graph.called  # without a router nothing is known


def test_a_router_that_is_away_is_said_once_and_tried_again_soon(network, monkeypatch, caplog):
    now = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now)
    for _ in range(2):
        network.give_up(RuntimeError("Unable to connect to any of [tcp/centre:7447] at /src.rs:9"))
        assert network.look_at == now + RETRY
    assert network.error.startswith("no router answers at tcp/centre:7447 and accepts this")
    assert network.receiver.domain_failed.call_count == len(caplog.messages) == 1
    network.give_up(RuntimeError("no such file at /src.rs:9"))
    assert network.error == "no such file"
    network._session = Mock(info=Mock(routers_zid=list, peers_zid=lambda: ["a bridge"]))
    for _ in range(2):
        network.check()
        assert network.error == ""
    network.receiver.domain_joined.assert_called_once_with(ZENOH)
    network._session.info.peers_zid = list
    for _ in range(2):
        network.check()
        assert network.error.startswith("no router answers at")
    assert network.receiver.domain_failed.call_count == 3


def test_a_session_is_made_of_what_fleet_yml_has(tmp_path):
    files = {each: tmp_path / each for each in ("ca", "cert", "key", "password")}
    for path in files.values():
        path.write_text("secret\r\n")
    tls = {f"{each}_file": files[each] for each in ("ca", "cert", "key", "password")}
    routers = ("tls/one:7447", "tls/two:7447")
    made = _config(Zenoh(routers, mode="peer", user="ann", **tls))

    def value(key: str):
        return json.loads(made.get_json(key))

    assert (value("mode"), value("connect/endpoints")) == ("peer", [*routers])
    assert (value("connect/timeout_ms"), value("connect/exit_on_failure")) == (-1, False)
    assert value("listen/endpoints") == []
    for each in "scouting/multicast", "scouting/gossip", "transport/shared_memory":
        assert value(f"{each}/enabled") is False
    assert value("transport/link/tls/enable_mtls") is True
    assert value("transport/link/tls/root_ca_certificate") == str(files["ca"])
    assert value("transport/link/tls/connect_certificate") == str(files["cert"])
    assert value("transport/link/tls/connect_private_key") == str(files["key"])
    assert value("transport/auth/usrpwd/user") == "ann"
    assert value("transport/auth/usrpwd/password") == "secret"

    made = _config(Zenoh(routers))
    assert (value("connect/timeout_ms"), value("connect/exit_on_failure")) == (0, True)
    assert value("connect/retry")["period_max_ms"] == 1000 * RETRY
    assert value("transport/link/tls/enable_mtls") is not True
    with pytest.raises(FileNotFoundError, match="away"):
        _config(Zenoh(routers, ca_file=tmp_path / "away"))


class Small:
    """Small topics of a session that a test plays; ``waiting`` are the messages of each key."""

    def __init__(self) -> None:
        self.receiver, self.close = Mock(), Mock()
        self.receiver.receive_fields.return_value = 0.0
        self.waiting: dict[str, list[bytes]] = {}
        self.opened: list[str] = []
        self.fields = ZenohFields(self.receiver, self.open)

    def open(self, key: str):
        self.opened.append(key)
        waiting = self.waiting.setdefault(key, [])

        def take():
            if not waiting:
                return None
            return Mock(payload=Mock(to_bytes=Mock(return_value=waiting.pop(0))))

        return take, self.close

    def look(self, at: float, *offers: Offer, wanted=None) -> list[tuple[str, bytes]]:
        """What is received of what is offered; ``wanted`` are some of their keys."""
        named = {f"/{each.key}": each for each in offers}
        keys = [each.key for each in offers] if wanted is None else wanted
        self.receiver.update_offered.return_value = {f"/{each}": "" for each in keys}
        self.receiver.receive_fields.reset_mock()
        list(self.fields.look(named, Instant(at, at)))
        return [each.args[1::2][:2] for each in self.receiver.receive_fields.call_args_list]


BATTERY, DOCK = Offer("r/battery", BOOL, "RIHS01_5"), Offer("r/dock", GOALS_TYPE, "")


def test_of_a_small_topic_the_newest_message_is_read_once_it_is_due_and_of_goals_all():
    small = Small()
    assert small.look(100.0, BATTERY, DOCK) == []
    assert small.opened == ["r/battery", "r/dock"]
    small.receiver.receive_fields.return_value = 110.0  # when it is read again
    for waiting in small.waiting.values():
        waiting += [b"one", b"newest"]
    received = small.look(101.0, BATTERY, DOCK)
    assert received == [
        ("/r/battery", b"newest"),
        ("/r/dock", b"one"),
        ("/r/dock", b"newest"),
    ]
    for waiting in small.waiting.values():
        waiting.append(b"later")
    assert small.look(109.0, BATTERY, DOCK) == [("/r/dock", b"later")]
    assert small.look(110.0, BATTERY, DOCK) == [("/r/battery", b"later")]
    small.look(160.0, BATTERY, DOCK)
    [rates] = [each.args[1] for each in small.receiver.note_watched.call_args_list]
    assert rates == {name: pytest.approx(14 / 60) for name in ("/r/battery", "/r/dock")}


def test_a_small_topic_is_closed_once_it_is_not_wanted_or_offered_otherwise():
    small = Small()
    small.look(100.0, BATTERY, DOCK)
    small.look(101.0, BATTERY._replace(type_hash="RIHS01_6"), DOCK)
    assert (small.close.call_count, small.opened) == (1, ["r/battery", "r/dock", "r/battery"])
    small.look(102.0, BATTERY, DOCK, wanted=["r/dock"])
    assert (small.close.call_count, len(small.opened)) == (2, 3)


def test_a_small_topic_that_is_refused_is_asked_for_again_after_a_while():
    small = Small()
    small.receiver.offered.return_value = False
    for at in 100.0, 101.0, 99.0 + REFUSED_FOR:
        small.look(at, BATTERY)
    assert (small.receiver.offered.call_count, small.opened) == (1, [])
    small.receiver.offered.return_value = True
    small.look(100.0 + REFUSED_FOR, BATTERY)
    assert small.opened == ["r/battery"]
    assert small.receiver.offered.call_args.args[1:4] == ("/r/battery", BOOL, "RIHS01_5")
