"""The shipped Alertmanager configuration and its templates, rendered by amtool."""

from __future__ import annotations

import html
import json
from pathlib import Path
from typing import Any

import pytest

from support.shipped_rules import ALERTMANAGER, run_tool

MOTOR = {"fleet": "f", "robot": "r1", "group": "/Motor", "component": "Motor 1"}


def data(status: str, labels: dict[str, str], **annotations: str) -> dict[str, Any]:
    """The data that Alertmanager passes to a template for a group of one alert."""
    alert = {
        "status": status,
        "labels": labels,
        "annotations": annotations,
        "startsAt": "2026-01-01T10:00:00Z",
        "endsAt": "2026-01-01T11:00:00Z",
        "generatorURL": "",
        "fingerprint": "0",
    }
    return {
        "receiver": "email",
        "status": status,
        "alerts": [alert],
        "groupLabels": labels,
        "commonLabels": labels,
        "commonAnnotations": annotations,
        "externalURL": "http://alertmanager:9093",
    }


def render(template: str, content: dict[str, Any], folder: Path) -> str:
    file = folder / "data.json"
    file.write_text(json.dumps(content))
    return run_tool(
        "amtool",
        "template",
        "render",
        f"--template.glob={ALERTMANAGER}/templates/*.tmpl",
        f"--template.data={file}",
        f"--template.type={'html' if template.endswith('html') else 'text'}",
        f'--template.text={{{{ template "{template}" . }}}}',
    ).strip()


def test_amtool_accepts_configuration_and_templates():
    output = run_tool("amtool", "check-config", ALERTMANAGER / "alertmanager.yml")

    assert "SUCCESS" in output


@pytest.mark.parametrize(
    ("status", "labels", "subject"),
    [
        (
            "firing",
            {"alertname": "ComponentCritical", **MOTOR},
            "PROBLEM ** f/r1 Motor 1 is CRITICAL",
        ),
        (
            "resolved",
            {"alertname": "ComponentCritical", **MOTOR},
            "RECOVERY ** f/r1 Motor 1 is no longer CRITICAL",
        ),
        (
            "firing",
            {"alertname": "ComponentWarning", **MOTOR},
            "PROBLEM ** f/r1 Motor 1 is WARNING",
        ),
        ("firing", {"alertname": "ComponentStale", **MOTOR}, "PROBLEM ** f/r1 Motor 1 is STALE"),
        (
            "firing",
            {"alertname": "ValueWarning", **MOTOR, "key": "Level"},
            "PROBLEM ** f/r1 Motor 1 Level is WARNING",
        ),
        (
            "firing",
            {"alertname": "ComponentFlapping", **MOTOR},
            "FLAPPING ** f/r1 Motor 1 started flapping",
        ),
        (
            "resolved",
            {"alertname": "ComponentFlapping", **MOTOR},
            "FLAPPING ** f/r1 Motor 1 stopped flapping",
        ),
        (
            "firing",
            {"alertname": "RobotSilent", "fleet": "f", "robot": "r1"},
            "PROBLEM ** f/r1 is SILENT",
        ),
        (
            "firing",
            {"alertname": "Maintenance", "fleet": "f", "robot": "r1"},
            "MAINTENANCE ** f/r1 began",
        ),
        (
            "resolved",
            {"alertname": "Maintenance", "fleet": "f", "robot": "r1"},
            "MAINTENANCE ** f/r1 ended",
        ),
        (
            "firing",
            {"alertname": "Unacknowledged", "step": "1", "state": "critical", **MOTOR},
            "ESCALATION 1 ** f/r1 Motor 1 is CRITICAL and not acknowledged",
        ),
        (
            "firing",
            {"alertname": "Unacknowledged", "step": "2", "fleet": "f", "robot": "r1"},
            "ESCALATION 2 ** f/r1 is SILENT and not acknowledged",
        ),
        (
            "firing",
            {
                "alertname": "Unacknowledged",
                "step": "1",
                "state": "critical in many components",
                "fleet": "f",
                "robot": "r1",
            },
            "ESCALATION 1 ** f/r1 is CRITICAL IN MANY COMPONENTS and not acknowledged",
        ),
        (
            "firing",
            {"alertname": "Unacknowledged", "step": "0", "state": "warning", **MOTOR},
            "REMINDER ** f/r1 Motor 1 is WARNING and not acknowledged",
        ),
        (
            "firing",
            {"alertname": "FleetPartDown", "fleet": "f", "site": "hall"},
            "PROBLEM ** f site hall is SILENT",
        ),
        (
            "firing",
            {"alertname": "CommonCause", "fleet": "f", "component": "Cam 1"},
            "PROBLEM ** f Cam 1 of many robots is CRITICAL",
        ),
        (
            "resolved",
            {"alertname": "ManyComponents", "fleet": "f", "robot": "r1"},
            "RECOVERY ** f/r1 many components is no longer CRITICAL",
        ),
        (
            "firing",
            {"alertname": "UplinkDown", "fleet": "f", "uplink": "ap-1"},
            "PROBLEM ** f uplink ap-1 is DOWN",
        ),
        ("firing", {"alertname": "ExporterDown", "fleet": "f"}, "PROBLEM ** f exporter is DOWN"),
        (
            "firing",
            {"alertname": "AlertmanagerDown", "instance": "a:9093"},
            "PROBLEM ** Alertmanager a:9093 is DOWN",
        ),
    ],
)
def test_subject(status: str, labels: dict[str, str], subject: str, tmp_path: Path):
    labels = {**labels, "alertname": "RosDiagnostics" + labels["alertname"]}

    output = render("ros_diagnostics.email.subject", data(status, labels), tmp_path)

    assert output == f"** {subject}"


@pytest.mark.parametrize("part", ["text", "html"])
def test_mail_has_fault_evidence_links_and_commands(part: str, tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsComponentCritical", "severity": "critical", **MOTOR}
    problem = data(
        "firing",
        {**labels, "site": "hall"},
        description="Motor 1 failed.",
        since="2026-01-01 10:00:00.123 +0000 UTC",
        driver_message="over <current>",
        values="Current 12 A; Duty 1 ratio; ",
        neighbours="all OK",
        runbook_url="http://runbook",
        dashboard_url="http://dashboard",
    )

    output = render(f"ros_diagnostics.email.{part}", problem, tmp_path)

    for expected in (
        "** PROBLEM ** f/r1 Motor 1 is CRITICAL",
        "Motor 1 failed.",
        "2026-01-01 10:00:00 UTC",
        "over &lt;current&gt;" if part == "html" else "over <current>",
        "Current 12 A\nDuty 1 ratio<" if part == "html" else "Current 12 A; Duty 1 ratio\n",
        "all OK",
        "hall",
        "http://runbook",
        "http://dashboard",
        "http://alertmanager:9093/#/silences/new?filter=%7Balertname%3D%22RosDiagnosticsComponent",
        "component%3D%22Motor%201%22",
    ):
        assert expected in output
    acknowledge = "ros-diagnostics-ack --comment '...' --url http://alertmanager:9093"
    assert f"{acknowledge} -- 'r1' 'Motor 1'" in html.unescape(output)


@pytest.mark.parametrize("part", ["text", "html"])
@pytest.mark.parametrize(
    "component", ["--list", "$(touch a)", "`touch a`", '"; touch a; "', "'; touch a; '", "a\\", "*"]
)
def test_the_command_in_a_mail_is_no_other_command_for_a_shell(
    part: str, component: str, tmp_path: Path
):
    labels = {
        "alertname": "RosDiagnosticsComponentCritical",
        "severity": "critical",
        **MOTOR,
        "component": component,
    }
    mail = html.unescape(render(f"ros_diagnostics.email.{part}", data("firing", labels), tmp_path))
    line = next(line for line in mail.splitlines() if "ros-diagnostics-ack" in line)
    command = line[line.index("ros-diagnostics-ack") :].partition("</code>")[0]

    printed = run_tool("sh", "-c", command.replace("ros-diagnostics-ack", r"printf '%s\n'", 1))

    assert printed.splitlines()[-2:] == ["r1", component]


@pytest.mark.parametrize("part", ["text", "html"])
def test_mail_about_a_recovery_has_its_end_and_no_commands(part: str, tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsComponentCritical", "severity": "critical", **MOTOR}

    output = render(f"ros_diagnostics.email.{part}", data("resolved", labels), tmp_path)

    assert "Over since 2026-01-01 11:00:00 UTC." in output
    assert "silences/new" not in output
    assert "ros-diagnostics-ack" not in output


def test_mail_about_flapping_has_no_command_to_acknowledge(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsComponentFlapping", "severity": "warning", **MOTOR}

    output = render("ros_diagnostics.email.text", data("firing", labels), tmp_path)

    assert "ros-diagnostics-ack" not in output


def test_all_mails_about_one_component_are_one_thread(tmp_path: Path):
    threads = {
        render("ros_diagnostics.email.thread", data(status, {"alertname": name, **MOTOR}), tmp_path)
        for status in ("firing", "resolved")
        for name in ("RosDiagnosticsComponentWarning", "RosDiagnosticsComponentCritical")
    }

    assert threads == {"<f.r1.Motor-1@ros-diagnostics>"}


def test_text_message_about_a_recovery(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsUplinkDown", "fleet": "f", "uplink": "ap-1"}
    over = data("resolved", labels, summary="Uplink ap-1 of fleet f does not answer.")

    output = render("ros_diagnostics.sms", over, tmp_path)

    assert output == "RECOVERY f: no longer: Uplink ap-1 of fleet f does not answer."


def test_text_message_has_at_most_160_characters(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsComponentCritical", **MOTOR}
    long = data("firing", labels, summary="Motor 1 of r1 is CRITICAL.", driver_message="ä" * 300)

    output = render("ros_diagnostics.sms", long, tmp_path)

    assert output.startswith("PROBLEM f: Motor 1 of r1 is CRITICAL. ääää")
    assert len(output) == 160
