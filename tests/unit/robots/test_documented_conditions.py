"""The three conditions of docs/configuration.md do what the sentence above each says."""

import re
from pathlib import Path
from textwrap import indent

from ros_diagnostics_exporter.model import Level, Status
from support.configs import load_text
from support.state_driver import SETTLED, StateDriver

DOCUMENT = Path(__file__).parents[3] / "docs" / "configuration.md"


def example(folder: Path, number: int, sentence: str) -> StateDriver:
    """A robot with the profile of one example."""
    text = DOCUMENT.read_text(encoding="utf-8")
    section = text.partition("\n### Condition\n")[2].partition("\n### ")[0]
    blocks = re.findall(r"\n([^\n]+):\n\n```yaml\n(.*?)```", section, re.DOTALL)
    assert len(blocks) == 3
    said, block = blocks[number]
    assert said == sentence
    robot = "robots: [{name: r, topic: /r/diagnostics, source: raw}]\n"
    profiles = f"profiles:\n  default:\n{indent(block, '    ')}"
    return StateDriver(fleet=load_text(folder, f"fleet: f\n{robot}{profiles}"))


def status(name: str, level: int = Level.OK, **values: str) -> Status:
    return Status(int(level), name, "", "", tuple(values.items()))


def faults_after(driver: StateDriver, seconds: float, *statuses: Status) -> set[tuple[str, str]]:
    """State and component of each fault after the robot published this for so long."""
    driver.stand(seconds, *statuses)
    return {(each.identity.state.value, each.identity.component) for each in driver.state.faults()}


def test_battery_low_while_charging(tmp_path):
    driver = example(tmp_path, 0, "A battery that is low while it charges is no fault")
    low, low_and = status("Battery", Charge="15"), status("Battery", Charge="9")
    charging, idle = status("Charger", State="Charging"), status("Charger", State="idle")

    assert faults_after(driver, SETTLED, low, charging) == set()
    assert faults_after(driver, 12, low, idle) == {("warning", "Battery")}
    assert faults_after(driver, 12, low_and, charging) == set()
    both = {("warning", "Battery"), ("critical", "Battery")}
    assert faults_after(driver, 30, low_and) >= both  # nothing is known of the charger
    assert faults_after(driver, 1, status("Battery", Charge="80"), idle) == set()


def test_docked_and_discharging(tmp_path):
    driver = example(tmp_path, 1, "A battery that discharges in the dock is a fault")
    discharging, charging = status("Battery", Current="-2"), status("Battery", Current="4")
    docked, away = status("Dock", Docked="True"), status("Dock", Docked="False")

    assert faults_after(driver, SETTLED, discharging, away) == set()
    assert faults_after(driver, 30, charging, docked) == set()
    assert faults_after(driver, 12, discharging, docked) == {("critical", "Battery")}
    stale = status("Dock", Level.STALE)
    assert faults_after(driver, 20, discharging, stale) >= {("critical", "Battery")}
    assert faults_after(driver, 1, discharging, away) == set()


def test_lasers_by_mode(tmp_path):
    driver = example(tmp_path, 2, "Lasers may fail, or be switched off, in every mode but two")
    broken, off = status("Laser 1", Level.ERROR), status("Laser 1", Level.STALE)
    auto, sleep = status("Mode", mode="auto"), status("Mode", mode="sleep")

    assert faults_after(driver, SETTLED, broken, sleep) == set()
    assert faults_after(driver, 30, off, sleep) == set()
    assert faults_after(driver, 12, off, auto) == {("stale", "Laser 1")}
    assert faults_after(driver, 12, broken, auto) >= {("critical", "Laser 1")}
