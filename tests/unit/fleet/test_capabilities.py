"""What a robot can do, from fleet.yml and arrays to faults, metrics, snapshot and page."""

import re
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.faults.model import PartName
from ros_diagnostics_exporter.faults.needs import MISSING, AtLeast
from ros_diagnostics_exporter.model import Level, Status
from ros_diagnostics_exporter.severity import state_of
from support.configs import load_text
from support.state_driver import ERROR, OK, SETTLED, StateDriver

PROFILES = """
fleet: f
profiles:
  base:
    checks: {motors: {match: Motor, expect: 2}}
    capabilities: {drive: [Motor, Laser], lift: Lift, sing: Speaker}
  amr:
    extends: base
    capabilities:
      charge: [{component: Battery, key: Charge}]
      sing: null
      view: {any: Laser}
      tour: [{capability: view}, {capability: drive}, {check: motors}]
      dock: {all: Dock, when: {component: Mode, key: mode, equals: auto}}
    components:
      - {match: Lift, planned_stale: true}
      - {match: Laser 2, unless: {component: Motor, level: WARN}}
    values: [{component: Battery, key: Charge, thresholds: {low: {warning: 20, critical: 10}}}]
robots: [{name: r, topic: /r/diagnostics, source: raw, profile: amr}]
"""
FINE = (
    *(Status(OK, name) for name in ("Motor 1", "Motor 2", "Laser 1", "Laser 2", "Lift", "Dock")),
    Status(OK, "Battery", "", "", (("Charge", "80"),)),
    Status(OK, "Mode", "", "", (("mode", "auto"),)),
)


def started(tmp_path, text=PROFILES):
    return StateDriver(fleet=load_text(tmp_path, text)).raw_every(1, SETTLED, *FINE)


@pytest.fixture
def driver(tmp_path):
    return started(tmp_path)


def publish(driver: StateDriver, *changed: Status, seconds: float = 12) -> None:
    names = {each.name for each in changed}
    statuses = (*(each for each in FINE if each.name not in names), *changed)
    driver.stand(seconds, *statuses)


def states(driver: StateDriver) -> dict[str, str]:
    """Those that are not OK."""
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    return {
        each["capability"]: each["state"] for each in robot["capabilities"] if each["state"] != "ok"
    }


def faults(driver: StateDriver) -> set[tuple[str, str]]:
    return {
        (each.identity.check or each.identity.component, each.identity.state.value)
        for each in driver.state.faults()
    }


def status_of(text: str) -> Status:
    name, level, *value = re.fullmatch(r"(.+) ([A-Z]{2,})(?: (\w+))?", text).groups()
    key = {"Battery": "Charge", "Mode": "mode"}.get(name, "")
    return Status(int(Level[level]), name, "", "", ((key, value[0]),) if value[0] else ())


@pytest.mark.parametrize(
    ("changed", "expected", "found"),
    [
        ("", "", ""),
        ("Motor 1 ERROR", "drive lost, tour lost", "drive lost"),
        ("Motor 1 WARN", "drive degraded, tour degraded", "drive degraded"),
        ("Motor 1 STALE", "drive unknown, tour unknown", "Motor 1 stale"),
        pytest.param("Lift STALE", "", "", id="as planned"),
        pytest.param(
            *("Laser 2 ERROR, Motor 2 WARN", "drive degraded, tour degraded", "drive degraded"),
            id="Laser 2 is suppressed",
        ),
        ("Laser 1 ERROR", "drive lost, tour lost, view no_reserve", "drive lost"),
        ("Battery OK 5", "charge lost", "charge lost"),
        ("Battery ERROR 80", "", "Battery critical"),
        ("Dock ERROR", "dock lost", "dock lost"),
        ("Dock ERROR, Mode OK off", "", "Dock critical"),
        ("Dock ERROR, Mode STALE", "dock unknown", "Dock critical, Mode stale"),
    ],
)
def test_what_is_lost_has_a_fault_and_its_parts_have_none(driver, changed, expected, found):
    publish(driver, *map(status_of, filter(None, changed.split(", "))))
    assert {*map(" ".join, states(driver).items())} == {*expected.split(", ")} - {""}
    assert {*map(" ".join, faults(driver))} == {*found.split(", ")} - {""}


def test_a_robots_state_is_that_of_its_worst_component_whatever_it_can_do(tmp_path):
    driver = started(tmp_path, PROFILES.replace("drive: [Motor, Laser]", "drive: Motor"))
    publish(driver, Status(ERROR, "Laser 1"))
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    assert states(driver)["view"] == "no_reserve"
    assert state_of(robot) == "CRITICAL"


def test_metrics_have_every_capability(driver):
    publish(driver, Status(ERROR, "Motor 1"))
    served = driver.samples()["capability_state"].items()
    found = {dict(labels)["capability"]: value for labels, value in served}
    assert found == {"drive": 3, "lift": 0, "charge": 0, "view": 0, "tour": 3, "dock": 0}


def test_the_fault_says_which_parts_and_what_else_the_robot_can_and_cannot_do(driver):
    publish(driver, Status(ERROR, "Laser 1", "Blind"), Status(ERROR, "Lift", "Stuck"))
    others = "has no reserve for view, still has charge and dock"
    assert {
        each.identity.check: (each.evidence, each.capabilities) for each in driver.state.faults()
    } == {
        "drive": ("Laser 1 CRITICAL: Blind", f"has lost lift and tour, {others}"),
        "lift": ("Lift CRITICAL: Stuck", f"has lost drive and tour, {others}"),
    }


def test_a_fault_that_no_capability_explains_says_what_still_works(driver):
    publish(driver, Status(ERROR, "Battery", "Hot", "", (("Charge", "80"),)))
    (fault,) = driver.state.faults()
    assert fault.capabilities == "still has drive and lift and charge and view and tour and dock"


def test_nothing_is_known_of_a_silent_robot(driver):
    publish(driver, Status(ERROR, "Motor 1"))
    driver.wait(60)
    assert set(states(driver).values()) == {"unknown"}
    assert {each.identity.state.value: each.capabilities for each in driver.state.faults()} == {
        "lost": "has lost tour, still has lift and charge and view and dock",
        "silent": "",
    }


def test_a_component_that_the_robot_does_not_have_is_not_known_to_work(tmp_path):
    driver = started(tmp_path, PROFILES.replace("lift: Lift", "lift: [Lift, Fork]"))
    assert states(driver) == {"lift": "unknown"}
    publish(driver, Status(ERROR, "Lift"))
    assert states(driver) == {"lift": "lost"}


def test_only_as_many_parts_are_missing_as_are_needed_beyond_those_that_there_are(tmp_path):
    for k, missing in ((1, ()), (2, ()), (3, (MISSING,))):
        text = PROFILES.replace("{any: Laser}", f"{{at_least: {{k: {k}, of: Laser}}}}")
        driver = started(tmp_path, text)
        lasers = (PartName(component="Laser 1"), PartName(component="Laser 2"))
        assert driver.state.needs("r")["view"].wanted.need == AtLeast(k, (*lasers, *missing))


def test_without_capabilities_there_is_nothing_of_them():
    driver = StateDriver().raw_every(1, SETTLED, Status(ERROR, "Motor", "Hot"))
    assert [each.evidence for each in driver.state.faults()] == ["Hot"]
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    assert (robot["capabilities_text"], robot["capabilities"]) == ("", [])
    assert "capability_state" not in driver.samples()


def test_a_config_without_the_capability_has_its_parts_as_faults(driver, tmp_path):
    publish(driver, Status(ERROR, "Motor 1"))
    text = PROFILES.replace("drive: [Motor, Laser], ", "").replace("{capability: drive}, ", "")
    driver.configure(load_text(tmp_path, text.replace("{check: motors}", "Laser")))
    publish(driver, Status(ERROR, "Motor 1"))
    assert faults(driver) == {("Motor 1", "critical")}
    assert [(each.state, each.reason) for each in driver.events if each.kind == "fault_ended"] == [
        ("lost", "removed")
    ]


def test_what_fires_of_what_fleet_yml_no_longer_has_is_no_fault(tmp_path):
    """Neither a process without its database nor one with it has a fault that nothing ends."""
    (tmp_path / "without").mkdir()
    before = started(tmp_path)
    low = Status(OK, "Battery", "", "", (("Charge", "5"),))
    publish(before, Status(ERROR, "Speaker"), Status(ERROR, "Motor 1"), low)
    gone = {("drive", "lost"), ("charge", "lost")}
    assert gone <= faults(before)
    other = PROFILES.replace("profile: amr", "profile: default")
    without = started(tmp_path / "without", other)
    without.state.adopt(before.state.faults(), without.now)
    assert not gone & faults(without)
    again = before.again(tmp_path / "state", fleet=load(tmp_path / "without" / "fleet.yml"))
    publish(again)
    assert not gone & faults(again)


def test_when_it_is_needed_is_followed_where_nothing_else_has_a_condition(tmp_path):
    """Once the mode was not read again, and what was lost stayed so in every mode."""
    text = PROFILES.replace("unless: {component: Motor, level: WARN}", "stale_after: 90s")
    driver = started(tmp_path, text)
    broken = status_of("Dock ERROR")
    publish(driver, broken)
    assert faults(driver) == {("dock", "lost")}
    publish(driver, broken, status_of("Mode OK off"), seconds=60)
    assert (states(driver), faults(driver)) == ({}, {("Dock", "critical")})


VIEW = """
fleet: f
robots: [{name: r, topic: /r/diagnostics, source: raw}]
profiles:
  default:
    components: []
    capabilities: {view: {any: [Lidar A, Lidar B]}}
"""
LIDARS = (Status(OK, "Lidar A"), Status(OK, "Lidar B"))
BLIND = tuple(each._replace(level=ERROR) for each in LIDARS)


def test_a_component_that_a_reload_ignores_is_no_part_that_works(tmp_path):
    driver = StateDriver(fleet=load_text(tmp_path, VIEW)).stand(SETTLED, *LIDARS)
    rule = VIEW.replace("components: []", "components: [{match: Lidar A, ignore: true}]")
    driver.configure(load_text(tmp_path, rule)).stand(12, *BLIND)
    assert driver.fault_names() == {("capability", "lost", "r", "view")}


def test_what_was_lost_for_a_part_ends_with_that_though_another_is_ignored(tmp_path):
    rule = VIEW.replace("components: []", "components: [{match: Lidar A, ignore: true}]")
    driver = StateDriver(fleet=load_text(tmp_path, rule.replace("any:", "all:")))
    driver.stand(SETTLED, *LIDARS).stand(12, *BLIND)
    assert driver.fault_names() == {("capability", "lost", "r", "view")}
    driver.stand(12, *LIDARS)
    assert (states(driver), driver.fault_names()) == ({"view": "unknown"}, set())


def test_a_reload_that_drops_a_capability_and_the_thresholds_of_its_part_begins_nothing(driver):
    low = Status(OK, "Battery", "", "", (("Charge", "5"),))
    publish(driver, low)
    assert driver.fault_names() == {("capability", "lost", "r", "charge")}
    (robot,) = driver.state.fleet.robots
    driver.follow_profile(replace(robot.profile, capabilities={}, values=()))
    publish(driver, low)
    ended = [each for each in driver.events if each.kind.startswith("fault")][1:]
    assert [(each.reason, each.check) for each in ended] == [("removed", "charge")]
