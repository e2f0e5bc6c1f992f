"""``ros-diagnostics capabilities`` on a real robot's state, through HTTP."""

import json

import pytest

from ros_diagnostics_exporter.api.capabilities import capability_tree
from ros_diagnostics_exporter.model import Status
from support.configs import load_text
from support.state_driver import ERROR, OK, WARN, StateDriver

FLEET = """
fleet: f
profiles:
  default:
    checks: {motors: {match: Motor, expect: 2}}
    capabilities:
      view: {any: [Laser]}
      navigation: [{capability: view}, {check: motors}]
      arm: {all: Arm, when: {component: Mode, key: mode, equals: arm}}
      greeting: [{any: [Speaker, {component: Screen, key: Lit}]}]
robots: [{name: r, topic: /r/diagnostics, source: raw}]
"""
STRICT = """
fleet: f
profiles:
  default:
    capabilities:
      careful: [{degraded_is_lost: [Laser 1, Laser 2]}]
      easy: [{degraded_is_ok: {any: [Laser 1, Laser 2]}}]
robots: [{name: r, topic: /r/diagnostics, source: raw}]
"""
NAMES = ("Laser 1", "Laser 2", "Motor 1", "Motor 2", "Arm", "Speaker", "Screen")


@pytest.fixture
def ask(tmp_path, serve, run):
    """Has the robot publish these components as broken; what the command prints of it."""
    driver = StateDriver(fleet=load_text(tmp_path, FLEET))
    server = serve(capabilities=lambda name: capability_tree(driver.state, name, driver.now))

    def ask(*broken: str, output: str = "table", robot: str = "r") -> str:
        statuses = [Status(ERROR if name in broken else OK, name) for name in NAMES]
        statuses.append(Status(OK, "Mode", "", "", (("mode", "drive"),)))
        driver.stand(40, *statuses)
        return run("capabilities", robot, "--output", output, at=server).out

    return ask


def losses(text: str) -> dict[str, tuple[list[str], list[str]]]:
    return {
        each["part"]["component"] or each["part"]["check"]: (each["now"], each["single"])
        for each in json.loads(text)["losses"]
    }


MOTORS = {part: (["navigation"], ["navigation"]) for part in ("motors", "Motor 1", "Motor 2")}
ARM = {"Arm": ([], ["arm"])}  # not needed now, by its condition


def test_with_all_parts_well_what_is_lost_next_are_the_single_points_of_failure(ask):
    assert losses(ask(output="json")) == {**MOTORS, **ARM, "Speaker": (["greeting"],) * 2}


def test_the_second_of_two_is_what_loses_both_that_need_it(ask):
    found = losses(ask("Laser 1", output="json"))
    assert found == {
        **MOTORS,
        **ARM,
        "Speaker": (["greeting"],) * 2,
        "Laser 2": (["view", "navigation"], []),
    }


def test_what_is_lost_is_not_lost_once_more(ask):
    found = losses(ask("Motor 1", output="json"))
    assert {part: found[part] for part in MOTORS} == {part: ([], ["navigation"]) for part in MOTORS}


def test_the_tree_shows_each_state_and_the_parts_below(ask):
    lines = ask("Laser 1").splitlines()
    assert [" ".join(line.split()) for line in lines] == [
        "State What",
        "NO RESERVE navigation: needs all of",
        "NO RESERVE view: needs 1 of these 2",
        "LOST Laser 1",
        "OK Laser 2",
        "needs all of",
        "OK check motors",
        "OK Motor 1",
        "OK Motor 2",
        "OK arm: needs this, not needed now",
        "OK Arm",
        "OK greeting: needs this",
        "needs this",
        "OK Speaker",
        "",
        "If one more part fails:",
        "Part Lost with it",
        "Laser 2 view, navigation",
        "check motors navigation",
        "Motor 1 navigation",
        "Motor 2 navigation",
        "Speaker greeting",
        "",
        "Single points of failure:",
        "Part Lost with it",
        "check motors navigation",
        "Motor 1 navigation",
        "Motor 2 navigation",
        "Arm arm",
        "Speaker greeting",
    ]


def test_what_degraded_counts_as_is_shown_and_counts(tmp_path, serve, run):
    driver = StateDriver(fleet=load_text(tmp_path, STRICT))
    server = serve(capabilities=lambda name: capability_tree(driver.state, name, driver.now))
    driver.raw_every(1, 40, Status(WARN, "Laser 1"), Status(OK, "Laser 2"))
    shown = run("capabilities", "r", at=server).out
    lines = [" ".join(line.split()) for line in shown.splitlines()]
    assert lines[:10] == [
        "State What",
        "LOST careful: needs this",
        "needs all of, degraded counts as lost",
        "DEGRADED Laser 1",
        "OK Laser 2",
        "OK easy: needs this",
        "needs this, degraded counts as ok",
        "needs 1 of these 2",
        "DEGRADED Laser 1",
        "OK Laser 2",
    ]
    assert lines[10:13] == [
        "",
        "If one more part fails:",
        "nothing more is lost",
    ]  # it is lost already


def test_what_is_no_exporter_of_this_version_is_named(serve, run):
    server = serve(capabilities=lambda _name: {"capabilities": [{}]})
    assert "of this version" in run("capabilities", "r", at=server, code=3).err


def test_without_capabilities_it_says_so(serve, run):
    assert "has no capabilities" in run("capabilities", "r", at=serve()).out
