"""Which receivers get which alert, as shipped and with all commented-out routes enabled."""

import json
import re
import shutil
from pathlib import Path

import pytest

from support.shipped_rules import ALERTMANAGER, run_tool

# A line of a commented-out route.
COMMENTED_OUT = re.compile(r"^    # (?=- matchers|  )", re.MULTILINE)
CRITICAL = "alertname=RosDiagnosticsComponentCritical severity=critical fleet=f robot=r1"
WARNING = "alertname=RosDiagnosticsComponentWarning severity=warning fleet=f robot=r1"
LOST = "alertname=RosDiagnosticsCapabilityLost scope=capability fleet=f robot=r1 check=lifting"
UNACKNOWLEDGED = "alertname=RosDiagnosticsUnacknowledged fleet=f robot=r1"
TABLE = {
    # labels: receivers as shipped, receivers with all routes enabled
    CRITICAL: ("email", "sms,email"),
    f"{CRITICAL} team=arms": ("email", "sms,team,email"),
    f"{CRITICAL} team=carts site=berlin": ("email", "sms,email"),
    WARNING: ("email", "digest"),
    f"{WARNING} team=arms": ("email", "digest"),
    "alertname=RosDiagnosticsExporterDown severity=critical fleet=f": ("email", "sms,email"),
    "alertname=RosDiagnosticsMaintenance severity=info": ("email", "email"),
    "alertname=RosDiagnosticsWatchdog severity=info": ("none", "heartbeat"),
    "alertname=RosDiagnosticsCanary severity=info fleet=f": ("canary", "canary"),
    "alertname=RosDiagnosticsCanaryLost severity=critical fleet=f": ("email", "sms,email"),
    f"{UNACKNOWLEDGED} severity=warning step=0": ("reminder", "none"),
    f"{UNACKNOWLEDGED} severity=critical step=1": ("escalation-1", "sms-escalation,escalation-1"),
    f"{UNACKNOWLEDGED} severity=critical step=0": ("reminder", "reminder"),
    f"{UNACKNOWLEDGED} severity=critical step=2": ("escalation-2", "sms-escalation,escalation-2"),
    f"{LOST} severity=critical": ("email", "sms,email"),
    f"{LOST} severity=warning": ("email", "digest"),
    "alertname=SomebodyElses severity=critical": ("email", "sms,email"),
    "alertname=SomebodyElses": ("email", "email"),
}


@pytest.fixture
def enabled(tmp_path: Path) -> Path:
    """The shipped configuration with all routes uncommented."""
    shutil.copytree(ALERTMANAGER, tmp_path / "alertmanager")
    path = tmp_path / "alertmanager" / "alertmanager.yml"
    text, number = COMMENTED_OUT.subn("    ", path.read_text())
    assert number
    path.write_text(text)
    return path


def receivers(config: Path, labels: str) -> str:
    options = f"--config.file={config}"
    return run_tool("amtool", "config", "routes", "test", options, *labels.split()).strip()


@pytest.mark.parametrize("labels", TABLE)
def test_route_as_shipped_and_with_all_routes_enabled(labels: str, enabled: Path):
    """An alert for another receiver is also sent to the default receiver."""
    configs = ALERTMANAGER / "alertmanager.yml", enabled
    assert tuple(receivers(each, labels) for each in configs) == TABLE[labels]


def test_amtool_accepts_the_configuration_with_all_routes_enabled(enabled: Path):
    assert "SUCCESS" in run_tool("amtool", "check-config", enabled)


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
def test_the_example_in_site_tmpl_routes_by_label(labels, address, tmp_path):
    """The example is in a comment, to be copied into `site.email.to`."""
    text = (ALERTMANAGER / "templates" / "site.tmpl").read_text()
    [example] = re.findall(
        r"^( {7}\{\{ if eq .CommonLabels.team.*?\{\{ end \}\})$", text, re.MULTILINE | re.DOTALL
    )
    site = tmp_path / "site.tmpl"
    site.write_text(text.replace("}}robots@localhost{{", "}}" + example.strip() + "{{"))
    data = tmp_path / "data.json"
    data.write_text(json.dumps({"commonLabels": labels}))
    options = f"--template.glob={site}", f"--template.data={data}"
    template = '--template.text={{ template "site.email.to" . }}'
    assert run_tool("amtool", "template", "render", *options, template).strip() == address
