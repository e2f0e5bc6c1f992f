"""Every kind of alert through a real Alertmanager: the mail, its HTML, and the text message.

docs/reference/mails.md shows some of them: `pytest --update` on this file rewrites them there, and
the HTML of which tools/mail_pictures.py makes pictures.
"""

import html
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from support import sns
from support.alerts import post_alerts
from support.every_alert import ENDED, ESCALATION, SINCE, every_alert
from support.notification_samples import updated
from testbed import configuration, http
from testbed.configuration import CHECKOUT
from testbed.mail import Mail
from testbed.polling import until
from testbed.programs import alertmanager
from testbed.site import Site

PICTURED = CHECKOUT / "tests" / "data" / "mails"
DOCUMENT = CHECKOUT / "docs" / "reference" / "mails.md"
# Words of configuration files, of Prometheus and of the exporter that an operator need not know.
JARGON = re.compile(r"RosDiagnostics|confirm_after|scope|evidence|publisher_gone|mute|\$labels")
OWN_END = "ended 2026-01-12 04:16:28 UTC, after 1h12m23s"  # of a fault, in its evidence
NUMBER = "+49000000"  # and that of the alert
LINK_OR_COMMAND = re.compile(r"^(Runbook|Fault): .*|^ros-diagnostics ack .*", re.MULTILINE)


def name_of(alert: dict[str, Any]) -> str:
    """RobotSilent; of escalation also the step, and of what it is."""
    labels = alert["labels"]
    of = [labels.get(key, "") for key in ("step", "of", "scope", "state")]
    return " ".join([labels["alertname"], *(of if labels["alertname"] == ESCALATION else ())])


# Without those that are sent to nobody.
ALERTS = {
    name_of(each): each
    for each in every_alert()
    if each["labels"]["alertname"] not in {"RosDiagnosticsWatchdog", "RosDiagnosticsCanary"}
}
# All but reminders, whose receivers are sent the recovery of what they remind of.
RECOVERING = {name: each for name, each in ALERTS.items() if each["labels"].get("step") != "0"}
BY_TEXT = {
    name: each
    for name, each in ALERTS.items()
    if each["labels"]["severity"] == "critical" and each["labels"].get("step") != "0"
}
BY_TEXT_RECOVERING = {name: each for name, each in BY_TEXT.items() if name in RECOVERING}


@dataclass(frozen=True)
class Sent:
    """What Alertmanager sent, by the name of the alert."""

    problems: dict[str, Mail]
    recoveries: dict[str, Mail]
    texts: dict[str, str]
    text_recoveries: dict[str, str]


class Sender:
    """An Alertmanager with the shipped configuration and templates, and what it sent.

    The alerts are numbered: each has its own address and telephone number.
    """

    def __init__(self, site: Site) -> None:
        self.address, self.inbox = site.addresses.alertmanager, site.inbox
        self.sns = sns.start_server(site)
        site.start_mail_server()
        config = configuration.alertmanager(
            site.folder, site.addresses, edit=lambda content: _number(content, self.sns)
        )
        argv = alertmanager(config, self.address, site.folder / "data")
        own, external = f"http://{self.address}/", "http://alertmanager.example.org:9093/"
        argv = [each.replace(f"url={own}", f"url={external}") for each in argv]
        site.start_program("Alertmanager", argv, self.address)
        site.wait_until_ready()

    def post(self, alerts: dict[str, dict[str, Any]], **more: str) -> None:
        """Send the alerts, with more fields."""
        numbers = {name: str(number) for number, name in enumerate(ALERTS)}
        numbered = [
            {**each, **more, "labels": {**each["labels"], "number": numbers[name]}}
            for name, each in alerts.items()
        ]
        post_alerts(self.address, *numbered)

    def mails(self) -> list[tuple[str, Mail]]:
        """All mails, each with the name of its alert."""
        names = list(ALERTS)
        return [
            (names[int(each.recipients[0].partition("@")[0])], each) for each in self.inbox.mails()
        ]

    def texts(self) -> list[tuple[str, str]]:
        """All text messages, each with the name of its alert."""
        names = list(ALERTS)
        return [(names[int(number)], text) for number, text in sent_to(self.sns)]


def sent_to(address: str) -> list[tuple[str, str]]:
    services = http.get_json(address, sns.SENT)
    return [
        (each["phone_number"].removeprefix(NUMBER), each["message"])
        for each in services.get("sns", {}).get("SMS", [])
    ]


def _number(config: dict[str, Any], sns_server: str) -> None:
    config.update(sns.with_text_messages(sns_server))
    config["route"]["group_interval"] = "1s"
    for receiver in config["receivers"]:
        for each in receiver.get("email_configs", ()):
            each["to"] = "{{ .CommonLabels.number }}@localhost"
        for each in receiver.get("sns_configs", ()):
            each["phone_number"] = f"{NUMBER}{{{{ .CommonLabels.number }}}}"


@pytest.fixture(scope="module")
def received(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Sent]:
    """All alerts of ALERTS as firing, then all as resolved."""
    with Site(tmp_path_factory.mktemp("site")) as site:
        sender = Sender(site)
        sender.post(ALERTS)
        problems = _all(sender.mails, ALERTS)
        texts = _all(sender.texts, BY_TEXT)
        sender.post({name: _ended(each) for name, each in ALERTS.items()}, endsAt=ENDED)
        recoveries = _all(sender.mails, [*problems, *RECOVERING])[len(problems) :]
        text_recoveries = _all(sender.texts, [*texts, *BY_TEXT_RECOVERING])[len(texts) :]
        yield Sent(dict(problems), dict(recoveries), dict(texts), dict(text_recoveries))


def _is_fault(alert: dict[str, Any]) -> bool:
    return bool(alert["labels"].get("fault")) and "step" not in alert["labels"]


def _ended(alert: dict[str, Any]) -> dict[str, Any]:
    """As the rules have a fault that has ended: with what the exporter knows of its end."""
    if not _is_fault(alert):
        return alert
    of_end = {"evidence": f"since {SINCE};\nOK: running;\n{OWN_END}"}
    return {**alert, "annotations": {**alert["annotations"], **of_end}}


def _all(sent: Callable[[], list[tuple[str, Any]]], names: Any) -> list[tuple[str, Any]]:
    """Wait until something was sent for each of the names."""

    def count() -> bool:
        return len(sent()) >= len(names)

    until(count, lambda: f"{len(sent())} of {len(names)}: {[name for name, _ in sent()]}", 120)
    return sent()


def said(mail: Mail) -> str:
    """The text without links and commands."""
    return LINK_OR_COMMAND.sub("", mail.text)


@pytest.mark.parametrize("name", ALERTS)
def test_a_mail_about_a_fault(received: Sent, name: str):
    alert, mail = ALERTS[name], received.problems[name]
    texts, labels = alert["annotations"], alert["labels"]
    lead = mail.text.splitlines()[0]

    assert " since 2026-01-12 03:04:" in lead
    urgency = {"critical": "UTC. Act now.", "warning": "next working hours.", "info": "UTC."}
    known = [
        line
        for line in texts.get("evidence", "").split(";\n")
        if line and not line.startswith("since ")
    ]
    can = known.pop() if known and known[-1].startswith("the robot ") else ""
    ending = urgency[labels["severity"]]
    if "step" in labels:
        ending = ending.replace("UTC", "UTC, for more than 15 min 10 s")
    assert lead.endswith(ending + (f" T{can[1:]}." if can else ""))
    for key in ("fleet", "robot", "component", "check", "key", "uplink"):
        assert labels.get(key, "") in lead
    for line in known:
        assert f"  {line}\n" in mail.text
    assert texts.get("description", "") in mail.text
    assert re.search(r"^First step: .*\.$", mail.text, re.MULTILINE)
    [runbook] = re.findall(r"^Runbook: .*/(\w+)\.html", mail.text, re.MULTILINE)
    assert (CHECKOUT / "docs" / "alerts" / f"{runbook}.md").exists()
    assert "Unacknowledged" not in runbook
    assert (f"/faults/{labels.get('fault')}" in mail.text) == ("fault" in labels)
    assert "ashboard" not in mail.text + mail.html
    assert not JARGON.findall(said(mail) + mail.subject)
    assert not re.search(r"\n\n\n|[ \t]$", mail.text, re.MULTILINE)


@pytest.mark.parametrize("name", ALERTS)
def test_its_html_says_the_same(received: Sent, name: str):
    mail = received.problems[name]
    text = html.unescape(re.sub(r"<[^>]*>", "", mail.html))

    for line in said(mail).splitlines():
        assert re.sub(r"^(Path|Group|Team): +", "", line).strip() in text
    assert '<meta name="color-scheme" content="light dark">' in mail.html
    assert "width=device-width" in mail.html


@pytest.mark.parametrize("name", RECOVERING)
def test_a_mail_about_a_recovery_has_three_lines(received: Sent, name: str):
    mail = received.recoveries[name]
    lead, lasted, ended = mail.text.strip().splitlines()

    assert " is no longer " in lead
    assert lasted.startswith("It lasted from 2026-01-12 03:04:")
    if _is_fault(RECOVERING[name]):
        assert lasted.endswith(" to 2026-01-12 04:16:28 UTC: 1 h 12 min 23 s.")
        assert ended.endswith(" (OK: running).")
    else:
        is_step = "step" in RECOVERING[name]["labels"]
        after = (
            "57 min 15 s after it was escalated" if is_step else "1 h 12 min 15 s after the alert"
        )
        assert lasted.endswith(f" to 2026-01-12 04:16:30 UTC, {after}.")
    assert re.fullmatch("What ended it: .+[.]", ended)
    assert not JARGON.findall(mail.text + mail.subject)
    for line in (lead, lasted, ended):
        assert line in html.unescape(mail.html)
    assert "<a " not in mail.html


@pytest.mark.parametrize("name", BY_TEXT)
def test_a_text_message(received: Sent, name: str):
    message, labels = received.texts[name], ALERTS[name]["labels"]

    assert re.match(r"(PROBLEM|ESCALATION \d) 03:04 UTC( f)?: \S", message)
    assert len(message) <= 160
    assert not JARGON.findall(message)
    for key in ("robot", "component", "check", "key", "uplink"):
        assert labels.get(key, "") in message


@pytest.mark.parametrize("name", BY_TEXT_RECOVERING)
def test_a_text_message_about_a_recovery(received: Sent, name: str):
    message = received.text_recoveries[name]

    assert re.match(r"(RECOVERY|ESCALATION \d ENDED)( f)?: .*(no longer|again|over)", message)
    lasted = "23" if _is_fault(BY_TEXT_RECOVERING[name]) else "15"
    assert message.endswith(f" It lasted 1 h 12 min {lasted} s.") or "ENDED" in message
    assert len(message) <= 160


def test_what_the_robot_can_no_longer_do_is_in_the_first_line_and_in_the_text_message(
    received: Sent,
):
    name = "RosDiagnosticsComponentCritical"
    work = "obot has lost driving, still has lifting and charging."
    mail = received.problems[name]
    assert mail.text.splitlines()[0].endswith(f"Act now. The r{work}")
    assert mail.text.count("work: ") == mail.html.count("work: ") == 0
    details = "Details at the time of the alert:\n  over current\n  values: Current: 12.5 A\n"
    assert details in mail.text
    assert f" is CRITICAL. R{work} over current; values" in received.texts[name]


def test_the_samples_in_the_documentation_are_what_is_sent(
    received: Sent, expect_text: Callable[[str, Path], None]
):
    """If not, run this file with --update."""
    fault, of_fault = "RosDiagnosticsComponentCritical", f"{ESCALATION} 1  component critical"
    mails = {
        "The mail about a fault": received.problems[fault],
        "If nobody acknowledges it, the next person gets this": received.problems[of_fault],
        "Its recovery": received.recoveries[fault],
        "The mail about a downtime": received.problems["RosDiagnosticsMaintenance"],
    }
    samples = {
        what: f"Subject: {mail.subject}\n\n{mail.text.strip()}" for what, mail in mails.items()
    }
    texts = (received.texts[fault], received.texts[of_fault], received.text_recoveries[fault])
    samples["Text messages"] = "\n\n".join(texts)
    expect_text(updated(DOCUMENT.read_text("utf-8"), samples), DOCUMENT)


def test_the_pictures_are_of_what_is_sent(received: Sent, expect_text: Callable[[str, Path], None]):
    """If not, run this file with --update, then `./run generate`."""
    fault = "RosDiagnosticsComponentCritical"
    expect_text(received.problems[fault].html, PICTURED / "fault.html")
    expect_text(received.recoveries[fault].html, PICTURED / "recovery.html")


HOSTILE = (
    "a\r\nBcc: all@example.org\r\n\r\n<b>\u202e{{ .ExternalURL }}\x1b[2J$(reboot)" + "x" * 2000
)


def test_what_a_robot_publishes_neither_adds_a_header_nor_breaks_a_mail(site: Site):
    sender = Sender(site)
    names = {"fleet": "f", "robot": HOSTILE, "component": HOSTILE}
    labels = {**ALERTS["RosDiagnosticsComponentCritical"]["labels"], **names}
    texts = dict.fromkeys(("summary", "evidence", "description"), HOSTILE)
    other = {"alertname": "SomebodyElses", "severity": "critical", "number": "1"}

    post_alerts(
        sender.address,
        {"labels": {**labels, "number": "0"}, "annotations": texts},
        {"labels": other, "annotations": texts},
    )

    until(lambda: len(sender.inbox.mails()) == 2, lambda: f"{sender.inbox.mails()}", 60)
    for mail in sender.inbox.mails():
        assert mail.recipients in (("0@localhost",), ("1@localhost",))
        assert "a??Bcc: all@example.org????<b>?{{ .ExternalURL }}?[2J$(reboot)x" in mail.subject
        assert len(mail.subject) < 300
        assert not set("\u202e\x1b") & set(mail.text + mail.html + mail.subject)
        assert "<b>" not in mail.html.replace("<b>First step:", "")
    until(lambda: len(sent_to(sender.sns)) == 2, lambda: f"{sent_to(sender.sns)}", 60)
    assert all(len(text) == 160 for _, text in sent_to(sender.sns))
