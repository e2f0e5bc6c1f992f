"""Robots with an address become targets of Prometheus."""

import pytest

from ros_diagnostics_exporter.api.snapshot import targets
from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from support.state_driver import StateDriver

ROBOTS = (
    Robot("a", address="10.0.0.1", labels={"site": "hall"}),
    Robot("b", address="fd00::2"),
    Robot("c"),
)


@pytest.fixture
def state():
    return StateDriver(fleet=Fleet("f", ROBOTS)).state


@pytest.mark.parametrize(
    ("job", "port", "expected"),
    [
        ("node", None, ["10.0.0.1:9100", "[fd00::2]:9100"]),
        ("node", 19100, ["10.0.0.1:19100", "[fd00::2]:19100"]),
        ("ssh", None, ["10.0.0.1:22", "[fd00::2]:22"]),
        ("http", None, ["10.0.0.1:80", "[fd00::2]:80"]),
        ("tcp", 7, ["10.0.0.1:7", "[fd00::2]:7"]),
        ("ping", None, ["10.0.0.1", "[fd00::2]"]),
    ],
)
def test_each_job_asks_its_port(state, job, port, expected):
    found = targets(state, job, port)

    assert [target for each in found for target in each["targets"]] == expected
    assert found[0]["labels"] == {"fleet": "f", "robot": "a", "site": "hall"}


def test_tcp_has_no_usual_port_and_ping_none_at_all(state):
    """blackbox_exporter's tcp module cannot do anything with an address alone."""
    with pytest.raises(ValueError, match=r"/sd/tcp\?port="):
        targets(state, "tcp", None)
    with pytest.raises(ValueError, match="ping"):
        targets(state, "ping", 22)


def test_a_job_that_there_is_not_is_told_with_those_that_there_are(state):
    with pytest.raises(LookupError, match="http, node, ping, ssh, tcp, uplink"):
        targets(state, "nodes", None)


def test_what_robots_name_as_uplink_is_pinged_as_such_and_has_no_other_check():
    robots = (
        Robot("r", address="10.0.0.1", labels={"uplink": "ap"}),
        Robot("far", address="10.0.0.2", labels={"uplink": "r"}),
        Robot("ap", address="ap.lan", source=Source.QUERIES),
        Robot("dock", address="dock.lan", source=Source.QUERIES),
    )
    state = StateDriver(fleet=Fleet("f", robots)).state

    def names(job: str) -> list[str]:
        return [each["labels"]["robot"] for each in targets(state, job, None)]

    assert names("uplink") == ["ap", "r"]
    assert names("ping") == names("ssh") == ["dock", "far", "r"]
    assert targets(state, "uplink", 443)[0]["targets"] == ["ap.lan:443"]
