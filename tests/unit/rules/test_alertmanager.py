"""The shipped Alertmanager configuration and its templates, rendered by amtool."""

from __future__ import annotations

import html
import json
import re
import shutil
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from ros_diagnostics_exporter.severity import COLOURS
from support.shipped_rules import ALERTMANAGER, ROOT, alerts, read_yaml, rules, run_tool

TWO = ("text", "html")  # the parts of a mail
QUOTED = re.compile(r'"(?:\\.|[^"\\])*"')
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


def render(
    template: str,
    content: dict[str, Any],
    folder: Path,
    templates: Path = ALERTMANAGER / "templates",
) -> str:
    file = folder / "data.json"
    file.write_text(json.dumps(content))
    return run_tool(
        "amtool",
        "template",
        "render",
        f"--template.glob={templates}/*.tmpl",
        f"--template.data={file}",
        f"--template.type={'html' if template.endswith('html') else 'text'}",
        f'--template.text={{{{ template "{template}" . }}}}',
    ).strip()


def test_amtool_accepts_configuration_and_templates():
    output = run_tool("amtool", "check-config", ALERTMANAGER / "alertmanager.yml")

    assert "SUCCESS" in output


MOTOR_FAULT = {**MOTOR, "scope": "component", "state": "critical", "severity": "critical"}
R1 = {"fleet": "f", "robot": "r1"}
SILENT = {**R1, "scope": "robot", "state": "silent", "severity": "critical"}
OWN = {"scope": "exporter", "state": "critical", "component": "domain 7"}
MANY = {**R1, "scope": "robot", "state": "many", "severity": "critical"}
SUBJECTS = [
    # status, alert, labels, the subject
    ("firing", "ComponentCritical", MOTOR_FAULT, "PROBLEM ** f/r1 Motor 1 is CRITICAL"),
    (
        "resolved",
        "ComponentCritical",
        MOTOR_FAULT,
        "RECOVERY ** f/r1 Motor 1 is no longer CRITICAL",
    ),
    (
        "firing",
        "ComponentWarning",
        {**MOTOR_FAULT, "state": "warning"},
        "PROBLEM ** f/r1 Motor 1 is WARNING",
    ),
    (
        "firing",
        "ComponentStale",
        {**MOTOR_FAULT, "state": "stale"},
        "PROBLEM ** f/r1 Motor 1 is STALE",
    ),
    (
        "firing",
        "ValueWarning",
        {**MOTOR, "scope": "value", "state": "warning", "key": "Level", "bound": "low"},
        "PROBLEM ** f/r1 Motor 1 Level is WARNING: too low",
    ),
    (
        "firing",
        "CheckShort",
        {**R1, "scope": "check", "state": "critical", "check": "motors"},
        "PROBLEM ** f/r1 check motors is CRITICAL: too few components",
    ),
    (
        "firing",
        "ComponentFlapping",
        {**MOTOR, "scope": "flapping", "state": "flapping"},
        "FLAPPING ** f/r1 Motor 1 started flapping",
    ),
    (
        "resolved",
        "ComponentFlapping",
        {**MOTOR, "scope": "flapping", "state": "flapping"},
        "FLAPPING ** f/r1 Motor 1 stopped flapping",
    ),
    (
        "firing",
        "RobotFlapping",
        {**SILENT, "state": "flapping"},
        "FLAPPING ** f/r1 started flapping",
    ),
    ("firing", "RobotSilent", SILENT, "PROBLEM ** f/r1 is SILENT"),
    ("firing", "Maintenance", R1, "MAINTENANCE ** f/r1 began"),
    ("resolved", "Maintenance", R1, "MAINTENANCE ** f/r1 ended"),
    (
        "firing",
        "Unacknowledged",
        {**MOTOR_FAULT, "step": "1"},
        "ESCALATION 1 ** f/r1 Motor 1 is CRITICAL and not acknowledged",
    ),
    (
        "firing",
        "Unacknowledged",
        {**SILENT, "step": "2"},
        "ESCALATION 2 ** f/r1 is SILENT and not acknowledged",
    ),
    (
        "firing",
        "Unacknowledged",
        {**MANY, "step": "1"},
        "ESCALATION 1 ** f/r1 is CRITICAL in many components and not acknowledged",
    ),
    (
        "firing",
        "Unacknowledged",
        {**MOTOR_FAULT, "state": "warning", "step": "0"},
        "REMINDER ** f/r1 Motor 1 is WARNING and not acknowledged",
    ),
    (
        "firing",
        "Unacknowledged",
        {"fleet": "f", "of": "RosDiagnosticsExporterDown", "severity": "critical", "step": "1"},
        "ESCALATION 1 ** f exporter is DOWN and not acknowledged",
    ),
    (
        "resolved",
        "Unacknowledged",
        {**MOTOR_FAULT, "step": "1"},
        "ESCALATION 1 ENDED ** f/r1 Motor 1 is no longer CRITICAL, or in maintenance now",
    ),
    (
        "resolved",
        "Unacknowledged",
        {"fleet": "f", "of": "RosDiagnosticsExporterDown", "severity": "critical", "step": "2"},
        "ESCALATION 2 ENDED ** f exporter is no longer DOWN",
    ),
    (
        "firing",
        "FleetPartDown",
        {"fleet": "f", "scope": "site", "state": "silent", "site": "hall"},
        "PROBLEM ** f site hall is SILENT",
    ),
    (
        "firing",
        "CommonCause",
        {"fleet": "f", "scope": "common", "state": "critical", "component": "Cam 1"},
        "PROBLEM ** f Cam 1 of many robots is CRITICAL",
    ),
    (
        "resolved",
        "ManyComponents",
        MANY,
        "RECOVERY ** f/r1 is no longer CRITICAL in many components",
    ),
    ("firing", "ExporterDown", {"fleet": "f"}, "PROBLEM ** f exporter is DOWN"),
    (
        "firing",
        "ExporterFault",
        {"fleet": "f", **OWN, "exporter": "north"},
        "PROBLEM ** f exporter north is CRITICAL: domain 7",
    ),
    (
        "resolved",
        "Unacknowledged",
        {"fleet": "f", **OWN, "step": "1"},
        "ESCALATION 1 ENDED ** f exporter is no longer CRITICAL: domain 7",
    ),
    (
        "firing",
        "AlertmanagerDown",
        {"instance": "a:9093"},
        "PROBLEM ** Alertmanager a:9093 is DOWN",
    ),
    (
        "firing",
        "PrometheusNotNotifying",
        {"instance": "p:9090"},
        "PROBLEM ** Prometheus p:9090 is not sending notifications",
    ),
    (
        "firing",
        "ExporterStalled",
        {"fleet": "f", "instance": "e:1"},
        "PROBLEM ** f exporter e:1 is STALLED",
    ),
    ("firing", "OnCallEnds", {}, "PROBLEM ** the rota of people on call is near its end"),
    (
        "firing",
        "CanaryLost",
        {"fleet": "f", "instance": "e:1"},
        "PROBLEM ** f exporter e:1 is waiting for its test notification",
    ),
]


@pytest.mark.parametrize(("status", "alert", "labels", "subject"), SUBJECTS)
def test_subject(status: str, alert: str, labels: dict[str, str], subject: str, tmp_path: Path):
    labels = {**labels, "alertname": f"RosDiagnostics{alert}"}

    output = render("ros_diagnostics.email.subject", data(status, labels), tmp_path)

    assert output == f"** {subject}"


@pytest.mark.parametrize("name", sorted(set(alerts()) - {"RosDiagnosticsWatchdog"}))
def test_no_subject_has_the_name_of_its_alert(name: str, tmp_path: Path):
    """Those with a state of their own are faults; the others need a text in email.tmpl."""
    faults = ("Component", "Value", "Check", "Host", "Many", "Robot", "Fleet", "Common", "Unack")
    own = name.removeprefix("RosDiagnostics")
    state = {"state": "critical"} if own.startswith(faults) and "Served" not in own else {}
    labels = {**R1, **state, "alertname": name}

    assert own not in render("ros_diagnostics.email.subject", data("firing", labels), tmp_path)


def test_the_header_of_a_mail_has_its_faults_that_fire(tmp_path: Path):
    alert = {"alertname": "RosDiagnosticsComponentCritical"}
    labels = {**alert, **MOTOR_FAULT, "fault": "0123456789ab"}
    name = "ros_diagnostics.email.faults"
    assert render(name, data("firing", labels), tmp_path).split() == ["0123456789ab"]
    assert render(name, data("resolved", labels), tmp_path).split() == []
    assert render(name, data("firing", {"alertname": "Other"}), tmp_path).split() == []


@pytest.mark.parametrize("part", ["text", "html"])
def test_mail_has_fault_evidence_links_and_commands(part: str, tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsComponentCritical", **MOTOR_FAULT}
    problem = data(
        "firing",
        {**labels, "site": "hall"},
        description="What it means.",
        evidence="over <current>;\nvalues: Current: 12 A",
        work="cannot drive; values: none",
        since="2026-01-01 10:00:00.123 +0000 UTC",
    )

    output = render(f"ros_diagnostics.email.{part}", problem, tmp_path)

    for expected in (
        "Motor 1 of r1 (fleet f, site hall) is CRITICAL since 2026-01-01 10:00:00 UTC. Act now.",
        "2026-01-01 10:00:00 UTC",
        "over &lt;current&gt;" if part == "html" else "over <current>",
        "\n  values: Current: 12 A",
        "The robot cannot drive; values: none.",
        "What it means.",
        "hall",
        "http://localhost:9090/user/alerts/RosDiagnosticsComponentCritical.md",
        "http://alertmanager:9093/#/silences/new?filter=%7Bcomponent%3D",
        "alertname%3D%22RosDiagnosticsComponentCritical%22%7D",
        "component%3D%22Motor%201%22",
    ):
        assert expected in output
    acknowledge = (
        "ros-diagnostics ack --comment '...' --alertmanager http://alertmanager:9093 --fleet 'f'"
    )
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
        **MOTOR_FAULT,
        "component": component,
    }
    mail = html.unescape(render(f"ros_diagnostics.email.{part}", data("firing", labels), tmp_path))
    line = next(line for line in mail.splitlines() if "ros-diagnostics ack" in line)
    command = line[line.index("ros-diagnostics ack") :].partition("</code>")[0]

    printed = run_tool("sh", "-c", command.replace("ros-diagnostics ack", r"printf '%s\n'", 1))

    assert printed.splitlines()[-2:] == ["r1", component]


@pytest.mark.parametrize("part", ["text", "html"])
def test_mail_about_a_recovery_has_its_end_and_no_commands(part: str, tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsComponentCritical", **MOTOR_FAULT}

    output = render(f"ros_diagnostics.email.{part}", data("resolved", labels), tmp_path)

    assert "Motor 1 of r1 (fleet f) is no longer CRITICAL." in output
    assert (
        "It lasted from 2026-01-01 10:00:00 UTC to 2026-01-01 11:00:00 UTC, 1 h after the alert."
        in output
    )
    assert "What ended it: a fresh message with a better level." in output
    assert "silences/new" not in output
    assert "ros-diagnostics ack" not in output


def test_mail_about_the_end_of_an_escalation(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsUnacknowledged", **MOTOR_FAULT, "step": "1"}

    output = render("ros_diagnostics.email.text", data("resolved", labels), tmp_path)

    assert output.splitlines() == [
        "Motor 1 of r1 (fleet f) is no longer CRITICAL, or in maintenance now.",
        (
            "It lasted from 2026-01-01 10:00:00 UTC to 2026-01-01 11:00:00 UTC, "
            "1 h after it was escalated."
        ),
        (
            "What ended it: a fresh message with a better level, or a planned downtime of the "
            "robot, in which nothing escalates."
        ),
    ]


def test_who_was_notified_of_an_escalation_is_notified_of_its_end():
    """A reminder and its recovery go to the same people: the recovery is sent to them already."""
    receivers = read_yaml(ALERTMANAGER / "alertmanager.yml")["receivers"]
    sent = {
        each["name"]: {c["send_resolved"] for kind in each if kind != "name" for c in each[kind]}
        for each in receivers
    }

    assert sent["escalation-1"] == sent["escalation-2"] == sent["sms-escalation"] == {True}
    assert sent["email"] == sent["team"] == sent["sms"] == {True}
    assert sent["reminder"] == {False}


# What an alert about the monitoring is told apart by.
APART = [
    {"alertname": "RosDiagnosticsExporterFault", "fleet": "f", **OWN},
    {"alertname": "RosDiagnosticsExporterStalled", "fleet": "f", "instance": "e:1"},
    {"alertname": "RosDiagnosticsAlertmanagerNotNotifying", "instance": "a", "integration": "sns"},
    {"alertname": "RosDiagnosticsFleetPartDown", "fleet": "f", "scope": "site", "state": "silent"},
    {"alertname": "RosDiagnosticsExporterAbsent"},
    {"alertname": "SomebodyElses", "device": 'a "b" \\c', "instance": "db1"},
]
ESCALATED = {"fleet": "f", "of": "RosDiagnosticsExporterDown", "severity": "critical", "step": "1"}


def silenced(labels: dict[str, str], folder: Path) -> dict[str, str]:
    """What the link of a mail silences: the same in both parts of the mail."""
    alert = data("firing", {**labels})
    links = {
        unquote(re.findall(r"silences/new\?filter=([^\s\"]*)", html.unescape(mail))[0])
        for mail in (render(f"ros_diagnostics.email.{part}", alert, folder) for part in TWO)
    }
    [link] = links
    # As Alertmanager's page reads it: no comma at the end, texts as JSON.
    inner = re.fullmatch(r'\{(\w+="(?:\\.|[^"\\])*"(?:,(?!\})|(?=\})))*\}', link)
    assert inner, link
    pairs = re.findall(r'(\w+)=("(?:\\.|[^"\\])*")', link)
    return {name: json.loads(text) for name, text in pairs}


@pytest.mark.parametrize("labels", APART)
def test_the_link_silences_this_alert_and_no_other(labels: dict[str, str], tmp_path: Path):
    found = silenced(labels, tmp_path)

    assert {name: value for name, value in found.items() if value} == labels
    assert all(labels.get(name, "") == value for name, value in found.items())


def test_the_link_about_a_whole_fleet_does_not_silence_its_sites(tmp_path: Path):
    assert silenced(APART[3], tmp_path)["site"] == ""
    assert silenced(APART[4], tmp_path)["fleet"] == ""


def test_the_link_of_an_escalation_silences_all_steps_of_this_fault(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsUnacknowledged", **ESCALATED}

    found = silenced(labels, tmp_path)

    assert found["of"] == "RosDiagnosticsExporterDown"
    assert "step" not in found


def escalating() -> str:
    """Which alerts without a fault escalate, as escalation.yml has it."""
    [found] = {
        each
        for rule in rules()
        for each in re.findall(r'ALERTS_FOR_STATE\{alertname=~"(.*?)"', rule["expr"])
    }
    return found


@pytest.mark.parametrize("name", sorted(alerts()))
def test_the_first_mail_about_what_escalates_has_the_command_that_acknowledges_it(
    name: str, tmp_path: Path
):
    labels = {"alertname": name, "severity": "critical", "fleet": "f", "instance": "e:1"}

    for part in TWO:
        mail = html.unescape(
            render(f"ros_diagnostics.email.{part}", data("firing", labels), tmp_path)
        )
        command = f"--fleet 'f' --alert '{name}'"
        assert (command in mail) == bool(re.fullmatch(escalating(), name))


def test_the_command_for_a_fleet_without_sites(tmp_path: Path):
    mail = render("ros_diagnostics.email.text", data("firing", APART[3]), tmp_path)

    assert mail.endswith("--fleet 'f' --site ''")


def test_no_template_uses_title():
    """Of two mails that Alertmanager 0.25 renders at once with it, one has no text (3277)."""
    for file in (ROOT / "alertmanager").rglob("*"):
        actions = (
            re.findall(r"\{\{(?!/\*).*?\}\}", file.read_text(), re.DOTALL) if file.is_file() else []
        )
        assert not [each for each in actions if re.search(r"\btitle\b", QUOTED.sub("", each))], file


def several(number: int, resolved: int = 0) -> dict[str, Any]:
    """The data of one group of alerts, the first of which are over."""
    labels = {"alertname": "RosDiagnosticsComponentCritical", "fleet": "f"} | MOTOR_FAULT
    group = data("firing", {"alertname": labels["alertname"], "fleet": "f"})
    group["alerts"] = [
        data(
            "resolved" if each < resolved else "firing",
            {**labels, "robot": f"r{each}"},
            evidence="over current",
            description="What it means.",
        )["alerts"][0]
        for each in range(number)
    ]
    return group


def test_subject_of_several_alerts(tmp_path: Path):
    def subject(group: dict[str, Any]) -> str:
        return render("ros_diagnostics.email.subject", group, tmp_path)

    assert subject(several(500)) == "** PROBLEM ** f 500 alerts"
    assert subject(several(3, resolved=1)) == "** PROBLEM ** f 3 alerts, 1 of them over"


VIEW = {"fleet": "f", "robot": "r1", "scope": "capability", "check": "front view"}
OF_STATE = {
    "lost": {"alertname": "RosDiagnosticsCapabilityLost", "severity": "critical"},
    "no_reserve": {"alertname": "RosDiagnosticsCapabilityNoReserve", "severity": "warning"},
}


def view(**states: str) -> dict[str, Any]:
    """The data of the group of one capability: state -> whether its alert fires."""
    alerts = [
        data(
            status,
            {**VIEW, **OF_STATE[state], "state": state},
            end="" if status == "firing" else "recovered",
            evidence=f"evidence of {state}",
            work="has no reserve for front view",
        )["alerts"][0]
        for state, status in states.items()
    ]
    group = data("firing" if "firing" in states.values() else "resolved", VIEW)
    ends = {each["annotations"]["end"] for each in alerts}
    common = {"end": ends.pop()} if len(ends) == 1 else {}
    return {**group, "alerts": alerts, "commonAnnotations": common}


def test_what_is_no_longer_lost_and_has_no_reserve_is_one_mail(tmp_path: Path):
    group = view(lost="resolved", no_reserve="firing")
    subject = render("ros_diagnostics.email.subject", group, tmp_path)
    assert subject == "** PROBLEM ** f/r1 front view is WITHOUT RESERVE, no longer LOST"
    lead = (
        "front view of r1 (fleet f) is WITHOUT RESERVE since 2026-01-01 10:00:00 UTC. It can wait "
        "until the next working hours. The robot has no reserve for front view. It is no longer "
        "LOST."
    )
    for part in TWO:
        mail = render(f"ros_diagnostics.email.{part}", group, tmp_path)
        assert lead in mail
        assert "evidence of no_reserve" in mail
        assert "evidence of lost" not in mail
        assert "RosDiagnosticsCapabilityNoReserve.md" in mail
        assert "-- 'r1' 'front view'" in html.unescape(mail)
        link = unquote(re.findall(r"silences/new\?filter=([^\s\"]*)", html.unescape(mail))[0])
        assert link.endswith('alertname=~"RosDiagnosticsCapability.+"}')
        assert 'check="front view"' in link


def test_the_end_of_all_states_of_a_capability_is_one_recovery(tmp_path: Path):
    group = view(lost="resolved", no_reserve="resolved")
    subject = render("ros_diagnostics.email.subject", group, tmp_path)
    assert subject == "** RECOVERY ** f/r1 front view is no longer LOST or WITHOUT RESERVE"
    mail = render("ros_diagnostics.email.text", group, tmp_path)
    assert mail.startswith("front view of r1 (fleet f) is no longer LOST.\nIt lasted from ")
    assert "It is no longer" not in mail


def test_what_a_person_removed_of_a_capability_is_no_recovery(tmp_path: Path):
    group = view(lost="resolved", no_reserve="resolved")
    group["commonAnnotations"] = {"end": "removed"}
    subject = render("ros_diagnostics.email.subject", group, tmp_path)
    assert subject == "** REMOVED ** f/r1 front view is no longer monitored"


def test_mail_about_what_the_fleet_can_do(tmp_path: Path):
    labels = {**OF_STATE["no_reserve"], "fleet": "f", "scope": "capability", "state": "no_reserve"}
    group = data("firing", {**labels, "check": "lifting at hall"}, evidence="3 of 5 robots can")
    subject = render("ros_diagnostics.email.subject", group, tmp_path)
    assert subject == "** PROBLEM ** f lifting at hall is WITHOUT RESERVE"
    mail = render("ros_diagnostics.email.text", group, tmp_path)
    assert mail.startswith("lifting at hall (fleet f) is WITHOUT RESERVE since ")
    assert "  3 of 5 robots can\n" in mail
    assert "Repair the robots that are named" in mail
    assert "--fleet 'f' --capability 'lifting at hall'" in mail
    group["status"] = group["alerts"][0]["status"] = "resolved"
    assert "What ended it: more robots can" in render("ros_diagnostics.email.text", group, tmp_path)


def test_several_capabilities_in_one_mail_are_a_list(tmp_path: Path):
    group = view(lost="firing", no_reserve="firing")
    group["commonLabels"] = {"fleet": "f", "robot": "r1", "scope": "capability"}
    subject = render("ros_diagnostics.email.subject", group, tmp_path)
    assert subject == "** PROBLEM ** f/r1 2 alerts"
    assert "2 alerts" in render("ros_diagnostics.email.text", group, tmp_path)


@pytest.mark.parametrize("part", ["text", "html"])
def test_a_mail_lists_the_first_hundred_of_several_alerts(part: str, tmp_path: Path):
    mail = render(f"ros_diagnostics.email.{part}", several(500, resolved=2), tmp_path)

    assert "f 500 alerts, 2 of them over" in mail
    assert mail.count(" is CRITICAL since ") == 100
    assert "These are the first 100 of 498." in mail
    assert mail.count(" is no longer CRITICAL.") == 2
    assert "What it means." not in mail
    assert len(mail) < {"text": 20_000, "html": 100_000}[part]
    assert "ros-diagnostics ack --list --alertmanager http://alertmanager:9093" in mail


def test_a_text_message_about_several_alerts_says_how_many(tmp_path: Path):
    group = several(3)
    group["alerts"][0]["annotations"]["summary"] = "Motor 1 of r0 is CRITICAL."

    output = render("ros_diagnostics.sms", group, tmp_path)

    assert output == "PROBLEM f: 3 alerts, the first: Motor 1 of r0 is CRITICAL. over current"


def test_mail_about_a_clock_has_no_command_to_acknowledge(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsClockOffset", "severity": "warning", **R1}

    output = render("ros_diagnostics.email.text", data("firing", labels), tmp_path)

    assert "ros-diagnostics ack" not in output


def test_without_an_address_of_grafana_a_mail_has_no_link_to_it(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsRobotSilent", **SILENT}

    for part in ("text", "html"):
        output = render(f"ros_diagnostics.email.{part}", data("firing", labels), tmp_path)
        assert "ashboard" not in output


def test_a_mail_links_the_exporters_page_of_its_fault_as_the_sites_file_shows(tmp_path: Path):
    fault = {**MOTOR_FAULT, "fault": "0123456789ab"}
    labels = {"alertname": "RosDiagnosticsComponentCritical", **fault}
    templates = tmp_path / "templates"
    shutil.copytree(ALERTMANAGER / "templates", templates)
    site = templates / "site.tmpl"
    text = site.read_text()
    shown = re.search(r"with its address:\n(.*?)\n +Several exporters", text, re.DOTALL)
    assert shown is not None
    site.write_text(text + re.sub(r"(?m)^ +", "", shown[1]))

    for part in TWO:
        template = f"ros_diagnostics.email.{part}"
        output = render(template, data("firing", labels), tmp_path, templates)
        assert "http://localhost:9877/faults/0123456789ab" in output
        assert "http://localhost:9877/api/v1/faults/0123456789ab/capsule.mcap" in output
        common = {**labels, "robot": "", "scope": "common"}
        output = render(template, data("firing", common), tmp_path, templates)
        assert "/faults/0123456789ab" in output
        assert "capsule" not in output
        own = {"alertname": "RosDiagnosticsExporterDown", "fleet": "f"}
        for given in (
            render(template, data("firing", own), tmp_path, templates),
            render(template, data("firing", labels), tmp_path),
        ):
            assert "9877" not in given


def test_all_mails_about_one_component_are_one_thread(tmp_path: Path):
    threads = {
        render("ros_diagnostics.email.thread", data(status, {"alertname": name, **MOTOR}), tmp_path)
        for status in ("firing", "resolved")
        for name in ("RosDiagnosticsComponentWarning", "RosDiagnosticsComponentCritical")
    }

    assert threads == {"<f.r1.Motor-1@ros-diagnostics>"}


DURATIONS = [
    ("10:00:07", "7 s"),
    ("10:02:00", "2 min"),
    ("10:59:59", "59 min 59 s"),
    ("11:00:00", "1 h"),
    ("11:00:05", "1 h 5 s"),
    ("20:10:00", "10 h 10 min"),
]


@pytest.mark.parametrize(("end", "lasted"), DURATIONS)
def test_a_recovery_says_how_long_it_lasted(end: str, lasted: str, tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsRobotSilent", **SILENT}
    over = data("resolved", labels, summary="r1 is silent.")
    over["alerts"][0]["endsAt"] = f"2026-01-01T{end}Z"

    mail = render("ros_diagnostics.email.text", over, tmp_path)
    message = render("ros_diagnostics.sms", over, tmp_path)

    assert f" UTC, {lasted} after the alert." in mail
    assert message == f"RECOVERY f: r1 is no longer silent. It lasted {lasted}."


def test_text_message_about_a_recovery(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsExporterDown", "fleet": "f"}
    over = data("resolved", labels, summary="The exporter of fleet f does not answer.")

    output = render("ros_diagnostics.sms", over, tmp_path)

    assert output == "RECOVERY f: The exporter of fleet f answers again. It lasted 1 h."


def test_text_message_has_at_most_160_characters(tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsComponentCritical", **MOTOR}
    long = data("firing", labels, summary="Motor 1 of r1 is CRITICAL.", evidence="ä" * 300)

    output = render("ros_diagnostics.sms", long, tmp_path)

    assert output.startswith("PROBLEM f: Motor 1 of r1 is CRITICAL. ääää")
    assert len(output) == 160


ESCALATIONS = [
    (MOTOR_FAULT, "Motor 1 of r1 is CRITICAL and not acknowledged. hot"),
    (
        {**MOTOR, "scope": "value", "state": "critical", "key": "Level", "bound": "low"},
        "Level of Motor 1 of r1 is low and not acknowledged. hot",
    ),
    (
        {**R1, "scope": "check", "state": "critical", "check": "motors"},
        "check motors of r1 is CRIT",
    ),
    (SILENT, "r1 is SILENT and not acknowledged. hot"),
    ({"fleet": "f", "scope": "site", "state": "silent", "site": "hall"}, "hall is SILENT and not"),
    (
        {"fleet": "f", "scope": "common", "state": "critical", "component": "Cam 1"},
        "Cam 1 of many robots is CRITICAL and not acknowledged. hot",
    ),
    ({"fleet": "f", "of": "RosDiagnosticsExporterDown"}, "Exporter Down is not acknowledged."),
]


@pytest.mark.parametrize(("fault", "text"), ESCALATIONS)
def test_text_message_of_an_escalation(fault: dict[str, str], text: str, tmp_path: Path):
    labels = {"alertname": "RosDiagnosticsUnacknowledged", **fault, "step": "1"}

    output = render("ros_diagnostics.sms", data("firing", labels, evidence="hot"), tmp_path)

    assert output.startswith(f"ESCALATION 1 f: {text}")


@pytest.mark.parametrize(
    ("fault", "text"),
    [
        (MOTOR_FAULT, "Motor 1 of r1 is no longer CRITICAL, or in maintenance now."),
        (
            {"fleet": "f", "scope": "site", "state": "silent", "site": "hall"},
            "hall is no longer SILENT.",
        ),
        ({"fleet": "f", "of": "RosDiagnosticsExporterDown"}, "Exporter Down is over."),
    ],
)
def test_text_message_about_the_end_of_an_escalation(
    fault: dict[str, str], text: str, tmp_path: Path
):
    labels = {"alertname": "RosDiagnosticsUnacknowledged", **fault, "step": "1"}

    output = render("ros_diagnostics.sms", data("resolved", labels, evidence="hot"), tmp_path)

    assert output == f"ESCALATION 1 ENDED f: {text}"


OTHERS = [
    ("firing", {"summary": "The disk of db1 is full."}, "PROBLEM ** The disk of db1 is full."),
    ("resolved", {"summary": "The disk is full."}, "RECOVERY ** over: The disk is full."),
    ("firing", {}, "PROBLEM ** Disk Full"),
    ("firing", {"summary": "full\nBcc: x@example.org"}, "PROBLEM ** full?Bcc: x@example.org"),
]


@pytest.mark.parametrize(("status", "texts", "subject"), OTHERS)
def test_subject_of_an_alert_of_other_rules(
    status: str, texts: dict[str, str], subject: str, tmp_path: Path
):
    alert = data(status, {"alertname": "DiskFull", "severity": "warning"}, **texts)

    assert render("ros_diagnostics.email.subject", alert, tmp_path) == f"** {subject}"
    assert "RosDiagnostics" not in render("ros_diagnostics.email.text", alert, tmp_path)


@pytest.mark.parametrize("part", ["text", "html"])
def test_an_alert_of_other_rules_has_its_own_runbook(part: str, tmp_path: Path):
    url = "https://wiki.example.org/disk"
    alert = data("firing", {"alertname": "DiskFull"}, summary="It is full.", runbook_url=url)

    assert url in render(f"ros_diagnostics.email.{part}", alert, tmp_path)


HOSTILE = "\x1b[2J\u202egnol\n\u2028{{ .ExternalURL }}<script>\x03" + "x" * 500


@pytest.mark.parametrize("part", ["subject", "text", "html"])
def test_names_and_texts_of_a_robot_stay_text(part: str, tmp_path: Path):
    labels = {
        "alertname": "RosDiagnosticsComponentCritical",
        **MOTOR_FAULT,
        "robot": HOSTILE,
        "component": HOSTILE,
    }
    alert = data("firing", labels, evidence=HOSTILE, description=HOSTILE)

    output = render(f"ros_diagnostics.email.{part}", alert, tmp_path)

    assert not [char for char in output if char in "\x1b\u202e\u2028\x03"]
    assert "{{ .ExternalURL }}" in html.unescape(output)
    if part == "subject":
        assert len(output) < 300
        assert "\n" not in output
    else:
        assert ("<script>" in output) == (part == "text")
        assert "--comment" not in output


@pytest.mark.parametrize(
    ("status", "labels", "shown"),
    [
        ("firing", {"severity": "critical", "state": "critical"}, "CRITICAL"),
        ("firing", {"severity": "warning", "state": "warning"}, "WARNING"),
        ("firing", {"severity": "warning", "state": "flapping"}, "WARNING"),
        ("firing", {"severity": "warning", "state": "stale"}, "STALE"),
        ("firing", {"severity": "critical", "state": "silent"}, "UNKNOWN"),
        ("firing", {"severity": "warning", "state": "pending"}, "PENDING"),
        ("firing", {"severity": "critical"}, "CRITICAL"),  # about the monitoring itself
        ("resolved", {"severity": "critical", "state": "silent"}, "OK"),
    ],
)
def test_a_mail_has_the_colours_of_the_state_that_the_pages_have(status, labels, shown, tmp_path):
    alert = {"alertname": "RosDiagnosticsComponentCritical", **MOTOR, **labels}
    mail = render("ros_diagnostics.email.html", data(status, alert), tmp_path)
    background, text = COLOURS[shown]

    assert f"color: {text}; background: {background}".lower() in mail


@pytest.mark.parametrize("part", ["text", "html"])
@pytest.mark.parametrize("ends_after", ["10m", "1h30m", "3d"])
def test_the_end_by_ends_after_says_that_nobody_knows_whether_it_works(part, ends_after, tmp_path):
    ended = data("resolved", MOTOR_FAULT | {"alertname": "RosDiagnosticsComponentCritical"})
    ended["alerts"][0]["annotations"] = ended["commonAnnotations"] = {
        "end": "recovered",
        "evidence": f"OK: not reported again for {ends_after}",
        "summary": "Motor 1 of r1 is CRITICAL.",
    }
    text = html.unescape(render(f"ros_diagnostics.email.{part}", ended, tmp_path))
    assert (
        "What ended it: it was not reported again for as long as `ends_after` in fleet.yml says; "
        "whether it works is not known." in text
    )
    assert "a fresh message with a better level" not in text
    for of_driver in (f"OK: not reported again for {ends_after}, it says", "OK: running"):
        ended["alerts"][0]["annotations"]["evidence"] = of_driver
        text = html.unescape(render(f"ros_diagnostics.email.{part}", ended, tmp_path))
        assert f"a fresh message with a better level ({of_driver})." in text


def test_what_a_person_removed_is_no_recovery_and_a_recovery_says_what_ended_it(tmp_path):
    ended = data("resolved", MOTOR_FAULT | {"alertname": "RosDiagnosticsComponentCritical"})
    ended["alerts"][0]["annotations"] = ended["commonAnnotations"] = {
        "end": "recovered",
        "evidence": "OK: running",
        "summary": "Motor 1 of r1 is CRITICAL.",
    }
    assert "(OK: running)." in render("ros_diagnostics.email.text", ended, tmp_path)
    assert render("ros_diagnostics.sms", ended, tmp_path).startswith("RECOVERY ")

    ended["commonAnnotations"].update(end="removed", evidence="")
    subject = render("ros_diagnostics.email.subject", ended, tmp_path)
    assert subject == "** REMOVED ** f/r1 Motor 1 is no longer monitored"
    for kind in ("text", "html"):
        text = render(f"ros_diagnostics.email.{kind}", ended, tmp_path)
        assert "What ended it: a person removed it; whether it works is not known." in text
    text = render("ros_diagnostics.sms", ended, tmp_path)
    assert text.startswith("REMOVED f: Motor 1 of r1 is no longer monitored. It lasted ")
    ended["commonLabels"]["state"] = "flapping"
    assert render("ros_diagnostics.email.subject", ended, tmp_path) == subject
