"""Who is told what: the shipped routes, and with all switched on that is shipped commented."""

from __future__ import annotations

import json
import re
import shutil
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.cli import ack
from support.shipped_rules import ALERTMANAGER, alerts, run_tool

# What begins like a route or goes on with one, behind a comment sign.
SWITCHED_OFF = re.compile(r"^    # (?=- matchers|  )", re.MULTILINE)
CRITICAL = "alertname=RosDiagnosticsComponentCritical severity=critical fleet=f robot=r1"
WARNING = "alertname=RosDiagnosticsComponentWarning severity=warning fleet=f robot=r1"
UNACKNOWLEDGED = "alertname=RosDiagnosticsUnacknowledged fleet=f robot=r1"
TABLE = {
    # labels: receivers as shipped, receivers with all routes switched on
    CRITICAL: ("email", "sms,email"),
    f"{CRITICAL} team=arms": ("email", "sms,team,email"),
    f"{CRITICAL} team=carts site=berlin": ("email", "sms,email"),
    WARNING: ("email", "email"),
    f"{WARNING} team=arms": ("email", "team,email"),
    "alertname=RosDiagnosticsComponentStale severity=warning": ("email", "email"),
    "alertname=RosDiagnosticsComponentFlapping severity=warning": ("email", "email"),
    "alertname=RosDiagnosticsRobotSilent severity=critical": ("email", "sms,email"),
    "alertname=RosDiagnosticsManyComponents severity=critical robot=r1": ("email", "sms,email"),
    "alertname=RosDiagnosticsFleetPartDown severity=critical site=hall": ("email", "sms,email"),
    "alertname=RosDiagnosticsExporterDown severity=critical fleet=f": ("email", "sms,email"),
    "alertname=RosDiagnosticsMaintenance severity=info": ("email", "email"),
    "alertname=RosDiagnosticsWatchdog severity=info": ("none", "none"),
    f"{UNACKNOWLEDGED} severity=warning step=0": ("reminder", "reminder"),
    f"{UNACKNOWLEDGED} severity=critical step=1": ("escalation-1", "escalation-1"),
    f"{UNACKNOWLEDGED} severity=critical step=2": ("escalation-2", "escalation-2"),
    "alertname=SomebodyElses severity=critical": ("email", "sms,email"),
    "alertname=SomebodyElses": ("email", "email"),
}


@pytest.fixture
def switched_on(tmp_path: Path) -> Path:
    """The shipped configuration with the comment signs taken away from its routes."""
    shutil.copytree(ALERTMANAGER, tmp_path / "alertmanager")
    path = tmp_path / "alertmanager" / "alertmanager.yml"
    text, number = SWITCHED_OFF.subn("    ", path.read_text())
    assert number
    path.write_text(text)
    return path


def receivers(config: Path, labels: str) -> str:
    options = f"--config.file={config}"
    return run_tool("amtool", "config", "routes", "test", options, *labels.split()).strip()


@pytest.mark.parametrize("labels", TABLE)
def test_route(labels: str):
    assert receivers(ALERTMANAGER / "alertmanager.yml", labels) == TABLE[labels][0]


@pytest.mark.parametrize("labels", TABLE)
def test_route_with_all_that_can_be_switched_on(labels: str, switched_on: Path):
    """What goes to a further receiver goes to the one for all as well."""
    assert receivers(switched_on, labels) == TABLE[labels][1]


def test_configuration_with_all_that_can_be_switched_on_passes_amtool(switched_on: Path):
    assert "SUCCESS" in run_tool("amtool", "check-config", switched_on)


def test_what_can_be_acknowledged_is_reminded_of_by_an_alert_that_it_holds():
    """Its own route repeats it seldom, and its mail says how to acknowledge it; no other alert."""
    config = yaml.safe_load((ALERTMANAGER / "alertmanager.yml").read_text())
    [others] = [each for each in config["route"]["routes"] if "!~" in each.get("matchers", [""])[0]]
    [seldom] = re.findall(r'!~ "(.*)"', others["matchers"][0])
    mail = (ALERTMANAGER / "templates" / "email.tmpl").read_text()
    [asked] = re.findall(r'if match "\^(RosDiagnostics\(Component.*)\$" ', mail)

    assert {name for name in alerts() if re.fullmatch(seldom, name)} == set(ack.STATES)
    escalation = {"RosDiagnosticsUnacknowledged"}
    assert {name for name in alerts() if re.fullmatch(asked, name)} == set(ack.STATES) | escalation


@pytest.mark.parametrize(
    ("labels", "address"),
    [
        ({"team": "arms", "site": "berlin"}, "arms@example.org"),
        ({"site": "berlin", "severity": "critical"}, "berlin@example.org, robots@example.org"),
        ({"severity": "critical", "fleet": "f"}, "robots@example.org, duty@example.org"),
        ({"severity": "warning", "team": "carts"}, "robots@example.org"),
        ({}, "robots@example.org"),
    ],
)
def test_the_example_in_the_sites_file_routes_by_label(
    labels: dict[str, str], address: str, tmp_path: Path
):
    """The lines stand in a comment; a person takes them for what follows `site.email.to`."""
    text = (ALERTMANAGER / "templates" / "site.tmpl").read_text()
    [example] = re.findall(r"^( {7}\{\{ if eq .*?\{\{ end \}\})$", text, re.MULTILINE | re.DOTALL)
    site = tmp_path / "site.tmpl"
    site.write_text(text.replace("}}robots@localhost{{", "}}" + example.strip() + "{{"))
    data = tmp_path / "data.json"
    data.write_text(json.dumps({"commonLabels": labels}))

    said = run_tool(
        "amtool",
        "template",
        "render",
        f"--template.glob={site}",
        f"--template.data={data}",
        '--template.text={{ template "site.email.to" . }}',
    )

    assert said.strip() == address
