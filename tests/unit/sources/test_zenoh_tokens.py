"""How many tokens are noted, and how often all are looked at: anybody may declare some."""

import time
from types import SimpleNamespace
from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.config.fleet import Zenoh
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.zenoh import TOKENS, Token, ZenohNetwork, parse
from ros_diagnostics_exporter.sources.zenoh_fields import ZenohFields, asked_tokens

zenoh = pytest.importorskip("zenoh")
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


@pytest.mark.parametrize(("share", "least", "most"), [(1e9, 0.9, 1.0), (1e-9, 4.0, 5.0)])
def test_looks_that_cost_much_are_further_apart(network, monkeypatch, share, least, most):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.reception.LOOK_SHARE", share)
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


def test_a_topic_is_closed_once_it_is_not_wanted_any_more():
    receiver, close, offers = Mock(), Mock(), {"/r/battery": Mock()}
    fields = ZenohFields(receiver, lambda _key: (lambda: None, close))
    for wanted, number in ([*offers], 0), ([], 1):
        receiver.update_offered.return_value = wanted
        list(fields.look(offers, Instant(1.0, 1.0)))
        assert close.call_count == number
