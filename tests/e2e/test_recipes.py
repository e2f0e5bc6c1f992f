"""Topics of many drivers side by side, published by rclpy: fault, mail and recovery of each."""

import shutil
from pathlib import Path

import pytest

from support.orders import Orders
from testbed import http
from testbed.configuration import KINDS
from testbed.polling import until
from testbed.site import Site

RECIPES = Path(__file__).parents[1] / "data" / "recipes"
# Robot, component and fault of virtual robots -> the mail: subject, and what it says.
FAULTS = {
    ("arm_1", "E-stop", "pressed"): ("E-stop is CRITICAL", "data is true"),
    ("arm_1", "Robot mode", "power_off"): ("Robot mode is CRITICAL", "mode is POWER_OFF"),
    ("arm_1", "Safety mode", "reduced"): ("Safety mode is WARNING", "mode is REDUCED"),
    ("arm_1", "Joints", "overload"): (
        "Joints Effort shoulder_lift_joint (Nm) is CRITICAL: too high",
        "above the threshold of 120 Nm",
    ),
    ("create3_1", "Dock", "off_dock"): ("Dock is WARNING", "is_docked is false"),
    ("create3_1", "Hazards", "lifted"): ("Hazards is CRITICAL", "Hazard 0 is WHEEL_DROP"),
    ("plant_1", "Battery", "empty"): (
        "Battery Charge is CRITICAL: too low",
        "10 %, below the threshold of 15 %",
    ),
    ("plant_1", "Joint temperatures", "hot"): (
        "Joint temperatures Temperature elbow (°C) is CRITICAL: too high",
        "85 degC, above the threshold of 80 degC",
    ),
    ("plant_1", "Hardware", "broken"): ("Hardware is CRITICAL", "Health left_wheel is ERROR"),
    ("plant_1", "MiR", "failed"): ("MiR is CRITICAL", "robot_state is ERROR"),
    ("plant_1", "Mode", "manual"): ("Mode is WARNING", "data is manual"),
    ("plant_1", "Pressure", "leak"): (
        "Pressure Pressure (bar) is CRITICAL: too low",
        "3.5 bar, below the threshold of 4 bar",
    ),
    ("plant_1", "Error code", "set"): ("Error code is CRITICAL", "data is -205"),
}


@pytest.fixture
def stack(site: Site) -> Site:
    """Robots, exporter and all servers; each robot is up."""
    site.start_mail_server()
    site.start_robots(scenario=RECIPES / "robots.yaml")
    for folder in (KINDS, RECIPES):
        shutil.copytree(folder / "msg", site.folder / "msg", dirs_exist_ok=True)
    text = (RECIPES / "fleet.yml").read_text().replace("DOMAIN", str(site.domain_id))
    site.start_exporter(site.write("fleet.yml", text))
    site.start_prometheus(interval=1, tenth=True)
    site.wait_until_ready(lambda: "" if len(site.exporter.receives()) == 3 else "all robots")
    # Before it is scraped, the exporter is down: on a busy machine for a tenth of a minute, too.
    down = 'ALERTS{alertname="RosDiagnosticsExporterDown"}'
    scraped = f"count(exporter:ros_diagnostics_exporter:held) unless on () {down}"
    until(lambda: site.engine.value(scraped) == 1, "the exporter is scraped", 60)
    site.start_alertmanager(edit=lambda it: it["route"].update(group_interval="1s"))
    site.wait_until_ready()
    return site


def wait_for_mails(site: Site, expected: set[str]) -> None:
    """Exactly these, as far as they are no reminders."""

    def found() -> list[str]:
        return [each for each in site.inbox.subjects() if "UNACKNOWLEDGED" not in each]

    until(
        lambda: set(found()) >= expected,
        lambda: f"{sorted(expected - set(found()))}, beside {found()}",
        120,
    )
    assert sorted(found()) == sorted(expected)


def components(site: Site) -> dict[str, set[str]]:
    """The components of each robot."""
    robots = http.get_json(site.addresses.exporter, "/api/v1/fleet")["robots"]
    return {each["robot"]: {one["component"] for one in each["components"]} for each in robots}


def test_each_recipe_is_a_fault_a_mail_and_a_recovery(stack: Site):
    # The motor of the last is in its diagnostics: a robot that has both is one.
    expected = {"arm_1": set[str](), "create3_1": set[str](), "plant_1": {"base: Motor"}}
    for robot, component, _fault in FAULTS:
        expected[robot].add(component)
    until(lambda: components(stack) == expected, lambda: f"{components(stack)}", 60)

    orders = stack.use(Orders(stack.domain_id))
    orders.give([(f"{robot}/{name}", fault) for robot, name, fault in FAULTS])
    mailed = {key: f"** PROBLEM ** hall/{key[0]} {what}" for key, (what, _says) in FAULTS.items()}
    wait_for_mails(stack, set(mailed.values()))
    texts = {each.subject: each.text for each in stack.inbox.mails()}
    for key, (_what, says) in FAULTS.items():
        assert says in texts[mailed[key]]

    orders.give([(f"{robot}/{name}", "ok") for robot, name, _fault in FAULTS])
    over = {
        each.replace("PROBLEM", "RECOVERY").replace(" is ", " is no longer ")
        for each in mailed.values()
    }
    wait_for_mails(stack, {*mailed.values(), *over})
