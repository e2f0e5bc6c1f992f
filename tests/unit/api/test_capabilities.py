"""The expressions of capabilities as the API shows them, with the state of each part."""

import pytest

from ros_diagnostics_exporter.api.capabilities import capability_tree
from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.model import Downtime, Status
from support.configs import load_text
from support.state_driver import ERROR, OK, WALL, StateDriver

FLEET = """
fleet: f
profiles:
  default:
    capabilities:
      view: {any: Laser}
      arm: {all: Arm, when: {component: Mode, key: mode, equals: arm}}
      careful: [{capability: view}, {degraded_is_lost: Mode}]
capabilities: {a view: {at_least: {k: 1, of: {can: view}}}}
robots: [{name: r, topic: /r/diagnostics, source: raw}]
"""


def part(state, *, maintenance=False, **of):
    names = dict.fromkeys(("group", "component", "key", "check", "robot"), "")
    return {"part": names | of | {"state": state, "maintenance": maintenance}}


@pytest.fixture
def driver(tmp_path):
    return StateDriver(fleet=load_text(tmp_path, FLEET))


def test_each_expression_has_its_parts_and_what_it_needs_of_others(driver):
    driver.state.plan([Downtime("r", "Laser 2", WALL, WALL + 99, "ann", "new")], driver.now)
    mode = Status(OK, "Mode", values=(("mode", "drive"),))
    lasers = Status(OK, "Laser 1"), Status(ERROR, "Laser 2")
    driver.raw_every(1, 40, *lasers, Status(OK, "Arm"), mode)

    of = {"fleet": "f", "time": WALL + 40}
    lasers_needed = [
        part("ok", component="Laser 1"),
        part("lost", component="Laser 2", maintenance=True),
    ]
    strictly = {"k": None, "of": [part("ok", component="Mode")], "degraded": "lost"}
    shown = [
        ("view", "no_reserve", True, 1, lasers_needed),
        ("arm", "ok", False, None, [part("ok", component="Arm")]),
        ("careful", "no_reserve", True, None, [{"capability": "view"}, strictly]),
    ]
    assert capability_tree(driver.state, "r", driver.now) == of | {
        "robot": "r",
        "capabilities": [capability(*each) for each in shown],
    }
    view = part("no_reserve", check="view", robot="r")
    assert capability_tree(driver.state, None, driver.now) == of | {
        "robot": None,
        "capabilities": [capability("a view", "ok", True, 1, [view])],
    }


def test_a_robot_has_a_text_of_what_it_can_do_while_it_is_received(driver):
    driver.raw_every(1, 40, Status(OK, "Laser 1"), Status(OK, "Arm"))
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    assert "view" in robot["capabilities_text"]
    (robot,) = fleet_snapshot(driver.at(100).state, driver.now)["robots"]
    assert (robot["up"], robot["capabilities_text"]) == (False, "")


def test_what_was_never_received_is_missing(driver):
    driver.raw_every(1, 40, Status(OK, "Laser 1"))
    arm = capability_tree(driver.state, "r", driver.now)["capabilities"][1]
    assert arm["need"]["of"] == [{"missing": True}]


def test_of_a_robot_that_there_is_not_nothing_is_shown(driver):
    with pytest.raises(LookupError):
        capability_tree(driver.state, "nobody", driver.now)


def capability(name, state, needed, k, of):
    need = {"k": k, "of": of, "degraded": "degraded"}
    return {"capability": name, "state": state, "needed": needed, "need": need}
