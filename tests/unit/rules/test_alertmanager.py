"""The shipped Alertmanager configuration and its templates, rendered by amtool."""

from __future__ import annotations

import html
import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import pytest

from ros_diagnostics_exporter.severity import COLOURS
from support.shipped_rules import ALERTMANAGER, ROOT, alerts, read_yaml, rules, run_tool

BEGIN = "2026-01-01 10:00:00 UTC"
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


@pytest.fixture(params=TWO)
def part(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def render(tmp_path: Path) -> Callable[..., str]:
    """A function (name, content): what the template ros_diagnostics.NAME makes of it."""

    def rendered(
        name: str, content: dict[str, Any], templates: Path = ALERTMANAGER / "templates"
    ) -> str:
        file = tmp_path / "data.json"
        file.write_text(json.dumps(content))
        return run_tool(
            *("amtool", "template", "render", f"--template.glob={templates}/*.tmpl"),
            f"--template.data={file}",
            f"--template.type={'html' if name.endswith('html') else 'text'}",
            f'--template.text={{{{ template "ros_diagnostics.{name}" . }}}}',
        ).strip()

    return rendered


@pytest.fixture(scope="module")
def with_pages(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The templates of a site whose Alertmanager has pages: as the comment in site.tmpl shows."""
    folder = tmp_path_factory.mktemp("site") / "templates"
    shutil.copytree(ALERTMANAGER / "templates", folder)
    site = folder / "site.tmpl"
    text = site.read_text()
    shown = re.search(r"The link to Alertmanager's form.*?:\n(.*?) \*/", text, re.DOTALL)
    assert shown is not None
    site.write_text(text + re.sub(r"(?m)^ {7}", "", shown[1]))
    return folder


FAULT = {**MOTOR, "scope": "component", "state": "critical", "severity": "critical"}
CRITICAL = {"alertname": "RosDiagnosticsComponentCritical", **FAULT}
WARM = {**FAULT, "state": "warning"}
VALUE = {**MOTOR, "scope": "value", "state": "warning", "key": "Level", "bound": "low"}
R1 = {"fleet": "f", "robot": "r1"}
CHECK = {**R1, "scope": "check", "state": "critical", "check": "motors"}
FLAPS = {**MOTOR, "scope": "flapping", "state": "flapping"}
SILENT = {**R1, "scope": "robot", "state": "silent", "severity": "critical"}
MANY = {**R1, "scope": "robot", "state": "many", "severity": "critical"}
HALL = {"fleet": "f", "scope": "site", "state": "silent", "site": "hall"}
COMMON = {"fleet": "f", "scope": "common", "state": "critical", "component": "Cam 1"}
OWN = {"fleet": "f", "scope": "exporter", "state": "critical", "component": "domain 7"}
DOWN = {"fleet": "f", "of": "RosDiagnosticsExporterDown", "severity": "critical"}
AT = {"fleet": "f", "instance": "e:1"}
FIRING = [
    # alert, labels, the subject
    ("ComponentCritical", FAULT, "PROBLEM ** f/r1 Motor 1 is CRITICAL"),
    (
        *("ComponentCritical", {**FAULT, "component": "turtlebot4_diagnostics:  scan topic: lost"}),
        "PROBLEM ** f/r1 scan topic: lost (turtlebot4_diagnostics) is CRITICAL",
    ),
    ("ComponentWarning", WARM, "PROBLEM ** f/r1 Motor 1 is WARNING"),
    ("ComponentStale", FAULT | {"state": "stale"}, "PROBLEM ** f/r1 Motor 1 is STALE"),
    ("ValueWarning", VALUE, "PROBLEM ** f/r1 Motor 1 Level is WARNING: too low"),
    ("CheckShort", CHECK, "PROBLEM ** f/r1 check motors is CRITICAL: too few components"),
    ("ComponentFlapping", FLAPS, "FLAPPING ** f/r1 Motor 1 started flapping"),
    ("RobotFlapping", SILENT | {"state": "flapping"}, "FLAPPING ** f/r1 started flapping"),
    ("RobotSilent", SILENT, "PROBLEM ** f/r1 is SILENT"),
    ("Maintenance", R1, "MAINTENANCE ** f/r1 began"),
    ("FleetPartDown", HALL, "PROBLEM ** f site hall is SILENT"),
    ("CommonCause", COMMON, "PROBLEM ** f Cam 1 of many robots is CRITICAL"),
    ("ExporterDown", {"fleet": "f"}, "PROBLEM ** f exporter is DOWN"),
    ("ExporterFault", OWN | {"exporter": "n"}, "PROBLEM ** f exporter n is CRITICAL: domain 7"),
    ("AlertmanagerDown", {"instance": "a:9093"}, "PROBLEM ** Alertmanager a:9093 is DOWN"),
    (
        *("PrometheusNotNotifying", {"instance": "p:9090"}),
        "PROBLEM ** Prometheus p:9090 is failing to send to an Alertmanager",
    ),
    ("ExporterStalled", AT, "PROBLEM ** f exporter e:1 is STALLED"),
    ("OnCallEnds", {}, "PROBLEM ** the rota of people on call is near its end"),
    ("CanaryLost", AT, "PROBLEM ** f exporter e:1 is waiting for its test notification"),
]
RESOLVED = [
    ("ComponentCritical", FAULT, "RECOVERY ** f/r1 Motor 1 is no longer CRITICAL"),
    ("ComponentFlapping", FLAPS, "FLAPPING ** f/r1 Motor 1 stopped flapping"),
    ("Maintenance", R1, "MAINTENANCE ** f/r1 ended"),
    ("ManyComponents", MANY, "RECOVERY ** f/r1 is no longer CRITICAL in many components"),
]
ESCALATED = [
    # step, labels, the subject while it fires
    (1, FAULT, "ESCALATION 1 ** f/r1 Motor 1 is CRITICAL and not acknowledged"),
    (2, SILENT, "ESCALATION 2 ** f/r1 is SILENT and not acknowledged"),
    (1, MANY, "ESCALATION 1 ** f/r1 is CRITICAL in many components and not acknowledged"),
    (0, WARM, "REMINDER ** f/r1 Motor 1 is WARNING and not acknowledged"),
    (1, DOWN, "ESCALATION 1 ** f exporter is DOWN and not acknowledged"),
]
NO_LONGER = [
    (1, FAULT, "** f/r1 Motor 1 is no longer CRITICAL, or in maintenance now"),
    (2, DOWN, "** f exporter is no longer DOWN"),
    (1, OWN, "** f exporter is no longer CRITICAL: domain 7"),
]


def escalation(fault: dict[str, str], step: int = 1) -> dict[str, str]:
    return {"alertname": "RosDiagnosticsUnacknowledged", **fault, "step": str(step)}


SUBJECTS = [
    *(("firing", *row) for row in FIRING),
    *(("resolved", *row) for row in RESOLVED),
    *(("firing", "Unacknowledged", escalation(of, n), text) for n, of, text in ESCALATED),
    *(
        ("resolved", "Unacknowledged", escalation(of, n), f"ESCALATION {n} ENDED {text}")
        for n, of, text in NO_LONGER
    ),
]


@pytest.mark.parametrize(("status", "alert", "labels", "subject"), SUBJECTS)
def test_subject(render, status, alert, labels, subject):
    labels = {**labels, "alertname": f"RosDiagnostics{alert}"}
    assert render("email.subject", data(status, labels)) == f"** {subject}"


@pytest.mark.parametrize("name", sorted(set(alerts()) - {"RosDiagnosticsWatchdog"}))
def test_no_subject_has_the_name_of_its_alert(render, name):
    """Those with a state of their own are faults; the others need a text in email.tmpl."""
    faults = ("Component", "Value", "Check", "Host", "Many", "Robot", "Fleet", "Common", "Unack")
    own = name.removeprefix("RosDiagnostics")
    state = {"state": "critical"} if own.startswith(faults) and "Served" not in own else {}
    labels = {**R1, **state, "alertname": name}

    assert own not in render("email.subject", data("firing", labels))


def test_the_header_of_a_mail_has_its_faults_that_fire(render):
    labels = {**CRITICAL, "fault": "0123456789ab"}
    assert render("email.faults", data("firing", labels)).split() == ["0123456789ab"]
    for none in (data("resolved", labels), data("firing", {"alertname": "Other"})):
        assert render("email.faults", none).split() == []


def test_mail_has_fault_evidence_links_and_commands(render, part):
    problem = data(
        "firing",
        {**CRITICAL, "site": "hall"},
        description="What it means.",
        evidence="since 2026-01-01 10:00:00.123 +0000 UTC;\nover <current>;\n"
        "values: Current: 12 A;\nthe robot cannot drive; values: none",
    )

    output = render(f"email.{part}", problem)

    for expected in (
        "Motor 1 of r1 (fleet f, site hall) is CRITICAL since 2026-01-01 10:00:00 UTC. Act now.",
        "2026-01-01 10:00:00 UTC",
        "over &lt;current&gt;" if part == "html" else "over <current>",
        "\n  values: Current: 12 A",
        "The robot cannot drive; values: none.",
        "What it means.",
        "hall",
        "http://localhost:9877/runbooks/RosDiagnosticsComponentCritical.html?robot=r1",
    ):
        assert expected in output
    assert "silence" not in output.lower()
    acknowledge = (
        "ros-diagnostics ack --comment '...' --alertmanager http://alertmanager:9093 --fleet 'f'"
    )
    assert f"{acknowledge} -- 'r1' 'Motor 1'" in html.unescape(output)


@pytest.mark.parametrize(
    "component", ["--list", "$(touch a)", "`touch a`", '"; touch a; "', "'; touch a; '", "a\\", "*"]
)
def test_the_command_in_a_mail_is_no_other_command_for_a_shell(render, part, component):
    labels = {**CRITICAL, "component": component}
    mail = html.unescape(render(f"email.{part}", data("firing", labels)))
    line = next(line for line in mail.splitlines() if "ros-diagnostics ack" in line)
    command = line[line.index("ros-diagnostics ack") :].partition("</code>")[0]

    printed = run_tool("sh", "-c", command.replace("ros-diagnostics ack", r"printf '%s\n'", 1))

    assert printed.splitlines()[-2:] == ["r1", component]


def test_mail_about_a_recovery_has_its_end_and_no_commands(render, part):
    output = render(f"email.{part}", data("resolved", CRITICAL))

    assert "Motor 1 of r1 (fleet f) is no longer CRITICAL." in output
    lasted = f"It lasted from {BEGIN} to 2026-01-01 11:00:00 UTC, 1 h after the alert."
    assert lasted in output
    assert "What ended it: a fresh message with a better level." in output
    assert "silences/new" not in output
    assert "ros-diagnostics ack" not in output
    warning = {**CRITICAL, "state": "warning", "severity": "warning"}
    ended = "since 2026-01-01 10:00:00 UTC;\nOK;\nended 2026-01-01 11:00:00 UTC, after 1h"
    output = render(f"email.{part}", data("resolved", warning, evidence=ended))
    assert "a fresh message with a better level (OK)." in html.unescape(output)


def test_a_test_page_asks_for_nothing_and_ends_by_itself(render):
    firing = render("email.text", data("firing", FAULT | {"alertname": "RosDiagnosticsTest"}))
    over = render("email.text", data("resolved", FAULT | {"alertname": "RosDiagnosticsTest"}))
    assert "First step: None: this is a test." in firing
    assert "What ended it: the end of the test." in over


def test_mail_about_the_end_of_an_escalation(render):
    labels = escalation(FAULT)

    output = render("email.text", data("resolved", labels))

    assert output.splitlines() == [
        "Motor 1 of r1 (fleet f) is no longer CRITICAL, or in maintenance now.",
        f"It lasted from {BEGIN} to 2026-01-01 11:00:00 UTC, 1 h after it was escalated.",
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
    {"alertname": "RosDiagnosticsExporterFault", **OWN},
    {"alertname": "RosDiagnosticsExporterStalled", "fleet": "f", "instance": "e:1"},
    {"alertname": "RosDiagnosticsAlertmanagerNotNotifying", "instance": "a", "integration": "sns"},
    {"alertname": "RosDiagnosticsFleetPartDown", "fleet": "f", "scope": "site", "state": "silent"},
    {"alertname": "RosDiagnosticsExporterDown"},
    {"alertname": "SomebodyElses", "device": 'a "b" \\c', "instance": "db1"},
]


def silenced(render: Callable[..., str], labels: dict[str, str], templates: Path) -> dict[str, str]:
    """What the link of a mail silences: the same in both parts of the mail."""
    alert = data("firing", {**labels})
    mails = [render(f"email.{part}", alert, templates) for part in TWO]
    assert "Silence:    http://alertmanager:9093/#/silences/new?filter=%7B" in mails[0]
    links = {
        unquote(re.findall(r"silences/new\?filter=([^\s\"]*)", html.unescape(mail))[0])
        for mail in mails
    }
    [link] = links
    # As Alertmanager's page reads it: no comma at the end, texts as JSON.
    inner = re.fullmatch(r'\{(\w+="(?:\\.|[^"\\])*"(?:,(?!\})|(?=\})))*\}', link)
    assert inner, link
    pairs = re.findall(r'(\w+)=("(?:\\.|[^"\\])*")', link)
    return {name: json.loads(text) for name, text in pairs}


@pytest.mark.parametrize("labels", APART)
def test_the_link_silences_this_alert_and_no_other(render, with_pages, labels):
    found = silenced(render, labels, with_pages)

    assert {name: value for name, value in found.items() if value} == labels
    assert all(labels.get(name, "") == value for name, value in found.items())


def test_the_link_about_a_whole_fleet_does_not_silence_its_sites(render, with_pages):
    assert silenced(render, APART[3], with_pages)["site"] == ""
    assert silenced(render, APART[4], with_pages)["fleet"] == ""


def test_the_link_of_an_escalation_silences_all_steps_of_this_fault(render, with_pages):
    labels = escalation(DOWN)

    found = silenced(render, labels, with_pages)

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
def test_the_first_mail_about_what_escalates_has_the_command_that_acknowledges_it(render, name):
    labels = {"alertname": name, "severity": "critical", "fleet": "f", "instance": "e:1"}

    for part in TWO:
        mail = html.unescape(render(f"email.{part}", data("firing", labels)))
        command = f"--fleet 'f' --alert '{name}'"
        assert (command in mail) == bool(re.fullmatch(escalating(), name))


def test_the_command_for_a_fleet_without_sites(render):
    mail = render("email.text", data("firing", APART[3]))

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
    labels = {"alertname": "RosDiagnosticsComponentCritical", "fleet": "f"} | FAULT
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


def test_subject_of_several_alerts(render):
    def subject(group: dict[str, Any]) -> str:
        return render("email.subject", group)

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
            evidence=f"evidence of {state};\nthe robot has no reserve for front view",
        )["alerts"][0]
        for state, status in states.items()
    ]
    group = data("firing" if "firing" in states.values() else "resolved", VIEW)
    return {**group, "alerts": alerts}


def test_what_is_no_longer_lost_and_has_no_reserve_is_one_mail(render, with_pages):
    group = view(lost="resolved", no_reserve="firing")
    subject = render("email.subject", group)
    assert subject == "** PROBLEM ** f/r1 front view is WITHOUT RESERVE, no longer LOST"
    lead = (
        "front view of r1 (fleet f) is WITHOUT RESERVE since 2026-01-01 10:00:00 UTC. It can wait "
        "until the next working hours. The robot has no reserve for front view. It is no longer "
        "LOST."
    )
    for part in TWO:
        mail = render(f"email.{part}", group, with_pages)
        assert lead in mail
        assert "evidence of no_reserve" in mail
        assert "evidence of lost" not in mail
        assert "RosDiagnosticsCapabilityNoReserve.html?robot=r1" in mail
        assert "-- 'r1' 'front view'" in html.unescape(mail)
        link = unquote(re.findall(r"silences/new\?filter=([^\s\"]*)", html.unescape(mail))[0])
        assert link.endswith('alertname=~"RosDiagnosticsCapability.+"}')
        assert 'check="front view"' in link


def test_the_end_of_all_states_of_a_capability_is_one_recovery(render):
    group = view(lost="resolved", no_reserve="resolved")
    subject = render("email.subject", group)
    assert subject == "** RECOVERY ** f/r1 front view is no longer LOST or WITHOUT RESERVE"
    mail = render("email.text", group)
    assert mail.startswith("front view of r1 (fleet f) is no longer LOST.\nIt lasted from ")
    assert "It is no longer" not in mail


def test_mail_about_what_the_fleet_can_do(render):
    labels = {**OF_STATE["no_reserve"], "fleet": "f", "scope": "capability", "state": "no_reserve"}
    group = data("firing", {**labels, "check": "lifting at hall"}, evidence="3 of 5 robots can")
    subject = render("email.subject", group)
    assert subject == "** PROBLEM ** f lifting at hall is WITHOUT RESERVE"
    mail = render("email.text", group)
    assert mail.startswith("lifting at hall (fleet f) is WITHOUT RESERVE since ")
    assert "  3 of 5 robots can\n" in mail
    assert "Repair the robots that are named" in mail
    assert "--fleet 'f' --capability 'lifting at hall'" in mail
    group["status"] = group["alerts"][0]["status"] = "resolved"
    assert "What ended it: more robots can" in render("email.text", group)


def test_a_mail_lists_the_first_hundred_of_several_alerts(render, part):
    mail = render(f"email.{part}", several(500, resolved=2))

    assert "f 500 alerts, 2 of them over" in mail
    assert mail.count(" is CRITICAL since ") == 100
    assert "These are the first 100 of 498." in mail
    assert mail.count(" is no longer CRITICAL.") == 2
    assert "What it means." not in mail
    assert len(mail) < {"text": 20_000, "html": 100_000}[part]
    assert "ros-diagnostics ack --list --alertmanager http://alertmanager:9093" in mail


def test_a_text_message_about_several_alerts_says_how_many(render):
    group = several(3)
    group["alerts"][0]["annotations"]["summary"] = "Motor 1 of r0 is CRITICAL."

    output = render("sms", group)

    assert (
        output
        == "PROBLEM 10:00 UTC f: 3 alerts, the first: Motor 1 of r0 is CRITICAL. over current"
    )


def test_without_an_address_of_grafana_a_mail_has_no_link_to_it(render):
    labels = {"alertname": "RosDiagnosticsRobotSilent", **SILENT}

    for part in ("text", "html"):
        output = render(f"email.{part}", data("firing", labels))
        assert "ashboard" not in output


def test_a_mail_links_the_exporters_page_of_its_fault(render, part, tmp_path):
    labels = {**CRITICAL, "fault": "0123456789ab", "exporter": "north"}
    templates = tmp_path / "templates"
    shutil.copytree(ALERTMANAGER / "templates", templates)
    site = templates / "site.tmpl"
    site.write_text(
        site.read_text().replace("http://localhost:9877{{", "https://{{ .Labels.exporter }}:9877{{")
    )

    output = render(f"email.{part}", data("firing", labels), templates)
    assert "https://north:9877/faults/0123456789ab" in output
    assert "https://north:9877/runbooks/RosDiagnosticsComponentCritical.html" in output
    output = render(f"email.{part}", data("firing", labels))
    assert "http://localhost:9877/faults/0123456789ab" in output
    own = {"alertname": "RosDiagnosticsExporterDown", "fleet": "f"}
    assert "9877/faults" not in render(f"email.{part}", data("firing", own))


def test_all_mails_about_one_component_are_one_thread(render):
    threads = {
        render("email.thread", data(status, {"alertname": name, **MOTOR}))
        for status in ("firing", "resolved")
        for name in ("RosDiagnosticsComponentWarning", "RosDiagnosticsComponentCritical")
    }

    assert threads == {"<f.r1.Motor+1@ros-diagnostics>"}


ENDED = "2025-12-31 09:59:58 UTC, after 3d1h0m2s"
OWN_ENDS = [
    # the evidence, in brackets
    (f"OK: running;\nended {ENDED}", " (OK: running)"),
    (f"ended {ENDED}", ""),
    (f"Last received: OK: running;\nended {ENDED}", " (OK: running)"),
    (f"Last received: ended {ENDED}", ""),
    (f"OK: ended 2020-01-01 00:00:00 UTC, after 1s;\nended {ENDED}", None),
]


@pytest.mark.parametrize(("evidence", "shown"), OWN_ENDS)
def test_a_recovery_has_the_faults_own_end_not_that_of_its_alert(render, part, evidence, shown):
    since = "2025-12-28 08:59:56.5 +0000 UTC"
    over = data("resolved", CRITICAL, evidence=f"since {since};\n{evidence}")
    mail = html.unescape(render(f"email.{part}", over))

    assert "It lasted from 2025-12-28 08:59:56 UTC to 2025-12-31 09:59:58 UTC: 3 d 1 h 2 s." in mail
    assert "11:00:00" not in mail
    if shown is not None:
        assert f"What ended it: a fresh message with a better level{shown}." in mail
    assert render("sms", over).endswith(" It lasted 3 d 1 h 2 s.")


FOR = [
    ("2026-01-01 09:44:58.7 +0000 UTC", ", for more than 15 min 2 s"),
    ("2025-12-31 10:00:00 +0000 UTC", ", for more than 24 h"),
    ("2025-11-03 00:00:01 +0000 UTC", ", for more than 1425 h 59 min 59 s"),
    ("2025-01-03 00:00:01 +0000 UTC", ""),
    ("2026-01-01 10:00:01 +0000 UTC", ""),
]


@pytest.mark.parametrize(("since", "lasted"), FOR)
def test_an_escalation_says_how_long_it_has_lasted_and_what_is_known_now(
    render, part, since, lasted
):
    known = {"evidence": f"since {since};\nover current", "message": "drive  off\u2028"}
    mail = html.unescape(render(f"email.{part}", data("firing", escalation(FAULT), **known)))

    began = re.sub(r"(\.\d+)? \+0000", "", since)
    assert f"is CRITICAL since {began}{lasted}. Act now." in mail
    now, _, first = mail.partition("Details at the time of the first alert:")
    assert re.search(r"Its message now:.*drive  off\?", now, re.DOTALL)
    assert "over current" in first


def test_the_mail_about_a_downtime_names_its_robots_and_its_end(render, part):
    def mails(status: str, robots: str, until: str) -> tuple[str, str]:
        labels = {"alertname": "RosDiagnosticsMaintenance", "fleet": "f", "site": "hall"}
        labels |= {"downtime": "new battery", "severity": "info"}
        texts = {"description": "new battery, planned by ann.", "robots": robots, "until": until}
        known = data(status, labels, **texts)
        return render("email.subject", known), html.unescape(render(f"email.{part}", known))

    until = "2026-01-01 12:00:00.5 +0000 UTC"
    subject, mail = mails("firing", "robot_3", until)
    assert subject == "** MAINTENANCE ** f downtime new battery of robot_3 began"
    where = "(fleet f, site hall)"
    assert (
        f"robot_3 {where} is in maintenance since {BEGIN}, until 2026-01-01 12:00:00 UTC." in mail
    )
    assert "new battery, planned by ann." in mail
    subject, mail = mails("firing", "robot_1, robot_2", "+Inf")
    assert f"robot_2 {where} are in maintenance since {BEGIN}, without an end." in mail
    subject, mail = mails("resolved", "robot_3", until)
    assert subject == "** MAINTENANCE ** f downtime new battery of robot_3 ended"
    assert f"robot_3 {where} is no longer in maintenance." in mail
    subject, mail = mails("firing", "", "")  # while its exporter does not answer
    assert subject == "** MAINTENANCE ** f downtime new battery began"
    assert f"downtime new battery {where} is under way since {BEGIN}." in mail


def test_the_mail_about_an_uplink_says_what_to_check(render, part):
    labels = {**CRITICAL, "fault": "f0", "robot": "ap-1", "component": "uplink"}
    evidence = "it does not answer;\nrobots behind it: robot_3, robot_4"
    mail = render(f"email.{part}", data("firing", labels, evidence=evidence))

    assert "robots behind it: robot_3, robot_4" in mail
    assert "Robots behind it are UNREACHABLE, and cause no mails of their own." in mail
    assert "Check the power and the cable of the access point or router." in mail


def test_the_mail_of_a_test_says_that_it_is_one(render, part):
    labels = {**CRITICAL, "alertname": "RosDiagnosticsTest"}
    firing, over = data("firing", labels), data("resolved", labels)
    assert render("email.subject", firing) == "** TEST ** f/r1: this is only a test"
    assert render("email.subject", over) == "** TEST ** f/r1: the test has ended"
    assert "Nothing is wrong." in render(f"email.{part}", firing)
    assert "The test of the notifications about r1 has ended." in render(f"email.{part}", over)


def test_names_of_any_script_have_threads_of_their_own(render):
    names = ("电机 1", "电机 2", "Двигатель 1", "Motor <1>", "Motor 1")
    threads = [
        render("email.thread", data("firing", {**CRITICAL, "component": name})) for name in names
    ]

    assert len(set(threads)) == len(names)
    for thread in threads:
        assert re.fullmatch(r"<[A-Za-z0-9.%+_-]+@ros-diagnostics>", thread)
    long = {**CRITICAL, "robot": "机" * 128, "component": "x" * 300}
    assert len(render("email.thread", data("firing", long))) < 960


DURATIONS = [
    ("10:00:07", "7 s"),
    ("10:02:00", "2 min"),
    ("10:59:59", "59 min 59 s"),
    ("11:00:00", "1 h"),
    ("11:00:05", "1 h 5 s"),
    ("20:10:00", "10 h 10 min"),
]


@pytest.mark.parametrize(("end", "lasted"), DURATIONS)
def test_a_recovery_says_how_long_it_lasted(render, end, lasted):
    labels = {"alertname": "RosDiagnosticsRobotSilent", **SILENT}
    over = data("resolved", labels, summary="r1 is silent.")
    over["alerts"][0]["endsAt"] = f"2026-01-01T{end}Z"

    mail = render("email.text", over)
    message = render("sms", over)

    assert f" UTC, {lasted} after the alert." in mail
    assert message == f"RECOVERY f: r1 is no longer silent. It lasted {lasted}."


def test_text_message_has_at_most_160_characters(render):
    labels = {"alertname": "RosDiagnosticsComponentCritical", **MOTOR}
    long = data("firing", labels, summary="Motor 1 of r1 is CRITICAL.", evidence="ä" * 300)

    output = render("sms", long)

    assert output.startswith("PROBLEM 10:00 UTC f: Motor 1 of r1 is CRITICAL. ääää")
    assert len(output) == 160


OF_VALUE = {**VALUE, "state": "critical"}
BY_SMS = [
    ("firing", FAULT, "Motor 1 of r1 is CRITICAL and not acknowledged. hot"),
    ("firing", OF_VALUE, "Level of Motor 1 of r1 is low and not acknowledged. hot"),
    ("firing", CHECK, "check motors of r1 is CRITICAL and not acknowledged. hot"),
    ("firing", HALL, "hall is SILENT and not acknowledged. hot"),
    ("firing", COMMON, "Cam 1 of many robots is CRITICAL and not acknowledged. hot"),
    ("firing", DOWN, "Exporter Down is not acknowledged. hot"),
    ("resolved", FAULT, "Motor 1 of r1 is no longer CRITICAL, or in maintenance now."),
    ("resolved", HALL, "hall is no longer SILENT."),
    ("resolved", DOWN, "Exporter Down is over."),
]


@pytest.mark.parametrize(("status", "fault", "text"), BY_SMS)
def test_text_message_of_an_escalation_and_of_its_end(render, status, fault, text):
    since = "2025-12-31 09:44:50.123 +0000 UTC"
    output = render("sms", data(status, escalation(fault), evidence=f"since {since};\nhot"))

    assert output == f"ESCALATION 1{' ENDED' if status == 'resolved' else ' 09:44 UTC'} f: {text}"


OTHERS = [
    ("firing", {"summary": "The disk of db1 is full."}, "PROBLEM ** The disk of db1 is full."),
    ("resolved", {"summary": "The disk is full."}, "RECOVERY ** over: The disk is full."),
    ("firing", {}, "PROBLEM ** Disk Full"),
    ("firing", {"summary": "full\nBcc: x@example.org"}, "PROBLEM ** full?Bcc: x@example.org"),
]


@pytest.mark.parametrize(("status", "texts", "subject"), OTHERS)
def test_subject_of_an_alert_of_other_rules(render, status, texts, subject):
    alert = data(status, {"alertname": "DiskFull", "severity": "warning"}, **texts)

    assert render("email.subject", alert) == f"** {subject}"
    assert "RosDiagnostics" not in render("email.text", alert)


def test_an_alert_of_other_rules_has_its_own_runbook(render, part):
    url = "https://wiki.example.org/disk"
    alert = data("firing", {"alertname": "DiskFull"}, summary="It is full.", runbook_url=url)

    assert url in render(f"email.{part}", alert)


HOSTILE = "\x1b[2J\u202egnol\n\u2028{{ .ExternalURL }}<script>\x03" + "x" * 500


@pytest.mark.parametrize("kind", ["subject", *TWO])
def test_names_and_texts_of_a_robot_stay_text(render, kind):
    labels = {**CRITICAL, "robot": HOSTILE, "component": HOSTILE}
    output = render(f"email.{kind}", data("firing", labels, evidence=HOSTILE, description=HOSTILE))

    assert not [char for char in output if char in "\x1b\u202e\u2028\x03"]
    assert "{{ .ExternalURL }}" in html.unescape(output)
    if kind == "subject":
        assert len(output) < 300
        assert "\n" not in output
    else:
        assert ("<script>" in output) == (kind == "text")
        assert "--comment" not in output


@pytest.mark.parametrize(
    ("status", "labels", "shown"),
    [
        ("firing", {"severity": "critical", "state": "critical"}, "CRITICAL"),
        ("firing", {"severity": "warning", "state": "flapping"}, "FLAPPING"),
        ("firing", {"severity": "warning", "state": "stale"}, "STALE"),
        ("firing", {"severity": "critical", "state": "silent"}, "SILENT"),
        ("firing", {"severity": "warning", "state": "pending"}, "PENDING"),
        ("firing", {"severity": "critical"}, "CRITICAL"),  # about the monitoring itself
        ("resolved", {"severity": "critical", "state": "silent"}, "OK"),
    ],
)
def test_a_mail_has_the_colours_of_the_state_that_the_pages_have(render, status, labels, shown):
    alert = {"alertname": "RosDiagnosticsComponentCritical", **MOTOR, **labels}
    mail = render("email.html", data(status, alert))
    background, text = COLOURS[shown]

    assert f"color: {text}; background: {background}".lower() in mail


@pytest.mark.parametrize("ends_after", ["10m", "1h30m"])
def test_the_end_by_ends_after_says_that_nobody_knows_whether_it_works(render, part, ends_after):
    ended = data("resolved", CRITICAL)
    ended["alerts"][0]["annotations"] = ended["commonAnnotations"] = {
        "evidence": f"OK: not reported again for {ends_after};\nended {ENDED}",
        "summary": "Motor 1 of r1 is CRITICAL.",
    }
    text = html.unescape(render(f"email.{part}", ended))
    assert (
        "What ended it: it was not reported again for as long as `ends_after` in fleet.yml says; "
        "whether it works is not known." in text
    )
    assert "a fresh message with a better level" not in text
    for of_driver in (f"OK: not reported again for {ends_after}, it says", "OK: running"):
        ended["alerts"][0]["annotations"]["evidence"] = f"{of_driver};\nended {ENDED}"
        text = html.unescape(render(f"email.{part}", ended))
        assert f"a fresh message with a better level ({of_driver})." in text


def test_what_a_person_removed_is_no_recovery_and_a_recovery_says_what_ended_it(render):
    ended = data("resolved", CRITICAL)
    ended["alerts"][0]["annotations"] = ended["commonAnnotations"] = {
        "evidence": f"OK: running;\nended {ENDED}",
        "summary": "Motor 1 of r1 is CRITICAL.",
    }
    assert "(OK: running)." in render("email.text", ended)
    assert render("sms", ended).startswith("RECOVERY ")

    ended["commonAnnotations"].update(evidence=f"removed by a person;\nended {ENDED}")
    subject = render("email.subject", ended)
    assert subject == "** REMOVED ** f/r1 Motor 1 is no longer monitored"
    for kind in ("text", "html"):
        text = render(f"email.{kind}", ended)
        assert "What ended it: a person removed it; whether it works is not known." in text
    text = render("sms", ended)
    assert text.startswith("REMOVED f: Motor 1 of r1 is no longer monitored. It lasted ")
    ended["commonLabels"]["state"] = "flapping"
    assert render("email.subject", ended) == subject
