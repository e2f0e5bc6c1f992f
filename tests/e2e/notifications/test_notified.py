"""What the exporter records of notifications equals the mailbox, line by line."""

from __future__ import annotations

import json
import urllib.request
from pathlib import Path
from typing import Any

import pytest

from ros_diagnostics_tools.main import main
from testbed import http, short_clocks
from testbed.polling import until

WITHIN = 10.0  # seconds between a mail and its record; machines are noisy
METRIC = "ros_diagnostics_fault_notified_timestamp_seconds"


def get(stack: Any, path: str) -> Any:
    url = f"http://{stack.addresses.exporter}{path}"
    with urllib.request.urlopen(url, timeout=10) as answer:
        return json.load(answer)


def recorded(stack: Any) -> list[dict[str, Any]]:
    """The notifications that the exporter has recorded, the oldest first."""
    return get(stack, "/api/v1/events?kind=notified&limit=1000")["events"][::-1]


@pytest.mark.slow
def test_the_record_equals_the_mailbox_with_an_escalation_silenced_and_alertmanager_killed(
    stack, wait_for_mails, wait_for_scrapes, tmp_path
):
    hurry(stack, tmp_path / "prometheus")
    stack.fault("robot_2", "Motor 2", "error", "winding at 131 C")
    wait_for_mails(1)
    until(lambda: len(recorded(stack)) == 1, "the record of the problem", 30)
    [problem] = get(stack, "/api/v1/fleet?robot=robot_2")["robots"][0]["problems"]
    assert list(problem["notified"]) == ["email"]
    until(lambda: stack.query(f"{METRIC} > 0"), f"{METRIC} in Prometheus", 30)
    url = f"http://{stack.addresses.alertmanager}"
    assert (
        main(["ack", "robot_2", "--author", "ann", "--comment", "on it", "--alertmanager", url])
        == 0
    )
    until(
        lambda: get(stack, "/api/v1/events?kind=acknowledged")["events"], "the acknowledgement", 30
    )

    known = get(stack, "/api/v1/why?robot=robot_2&component=Motor%202")
    assert known["now"][-1] == (
        "alert RosDiagnosticsComponentCritical robot_2 Motor 2: active, for email"
    )

    silenced = "RosDiagnosticsUnacknowledged robot_2 Motor 2 1: silenced by ann until "
    until(lambda: silenced in now(stack), lambda: f"the silence: {now(stack)}", 120)
    stack.alertmanager.process.kill()
    stack.fault("robot_1", "Motor 1", "error", "winding at 140 C")
    until(
        lambda: stack.query('ALERTS{robot="robot_1",alertstate="firing"}'),
        "the alert of the second fault",
        60,
    )
    stack.alertmanager.process.start()
    until(lambda: http.answers(stack.addresses.alertmanager, "/-/ready"), "Alertmanager", 30)
    until(lambda: "PROBLEM ** demo/robot_1" in subjects(stack), "the mail of the second fault", 90)
    until(
        lambda: len(recorded(stack)) == len(mails_of(stack)),
        lambda: f"its record: {subjects(stack)}",
        30,
    )
    until(lambda: "ESCALATION" in subjects(stack), "the escalation", 120)
    until(
        lambda: len(recorded(stack)) == len(mails_of(stack)),
        lambda: f"its record: {subjects(stack)}",
        30,
    )
    stack.exporter.process.stop()
    stack.exporter.process.start()
    until(lambda: stack.exporter.answers("/-/ready"), "the exporter is ready", 60)
    repair(stack, "robot_2", "Motor 2")
    repair(stack, "robot_1", "Motor 1")
    until(lambda: "ESCALATION 1 ENDED ** demo/robot_1" in subjects(stack), "its end", 60)
    wait_for_scrapes(3)

    mails = mails_of(stack)
    until(lambda: len(recorded(stack)) >= len(mails), lambda: f"records: {recorded(stack)}", 30)
    # Robot by robot, as two mails may come at the same time. Each has its problem a second time, at
    # most: a killed Alertmanager has forgotten what it sent.
    lines = sorted(((*_line_of_mail(each), each.received) for each in mails), key=_robot)
    events = sorted(((*_line_of_event(each), each["time"]) for each in recorded(stack)), key=_robot)
    assert [each[:2] for each in lines] == [each[:2] for each in events]
    for (*line, received), (*_, at) in zip(lines, events, strict=True):
        assert abs(received - at) < WITHIN, line
    ledger = get(stack, "/api/v1/why?robot=robot_2")["entries"]
    texts = [each["text"] for each in ledger]
    steps = (
        *("Motor 2 OK → ERROR", "fault began", "notification sent to email", "acknowledged by ann"),
        *("Motor 2 ERROR → OK", "fault recovered", "recovery sent to email"),
    )
    assert first_of_each(steps, texts) == list(steps), texts
    [acknowledged] = get(stack, "/api/v1/events?kind=acknowledged")["events"]
    assert (acknowledged["author"], acknowledged["message"]) == ("ann", "on it")


def first_of_each(steps: tuple[str, ...], texts: list[str]) -> list[str]:
    """Those of the steps that a text has, in the order of the first text of each."""
    first = {
        step: next((i for i, text in enumerate(texts) if step in text), None) for step in steps
    }
    found = {step: place for step, place in first.items() if place is not None}
    return sorted(found, key=lambda step: found[step])


def _line_of_mail(mail: Any) -> tuple[str, str]:
    robot = next(name for name in ("robot_1", "robot_2") if name in mail.subject)
    if "ESCALATION" in mail.subject:
        return robot, f"escalation-1 {'resolved' if 'ENDED' in mail.subject else 'firing'}"
    return robot, f"email {'resolved' if 'RECOVERY' in mail.subject else 'firing'}"


def _line_of_event(event: dict[str, Any]) -> tuple[str, str]:
    return event["robot"], f"{event['receiver']} {event['after']}"


def hurry(stack: Any, prometheus: Path) -> None:
    """Escalate, and repeat alerts to an Alertmanager that was away, after seconds, not minutes."""
    short_clocks.set_interval(prometheus, 2)
    short_clocks.set_escalation(prometheus / "rules", {"1": "10s"})
    process = stack.prometheus.process
    process.stop()
    delay = "--rules.alert.resend-delay="
    others = [each for each in process.argv if not each.startswith(delay)]
    process.argv = [*others, f"{delay}15s"]
    process.start()
    stack.prometheus.wait_until_ready()


def now(stack: Any) -> str:
    """What holds now of the acknowledged fault."""
    return "\n".join(get(stack, "/api/v1/why?robot=robot_2")["now"])


def subjects(stack: Any) -> str:
    """All subjects in the mailbox."""
    return "\n".join(mail.subject for mail in mails_of(stack))


def mails_of(stack: Any) -> list[Any]:
    """The mails about faults; others are about the servers that are killed here."""
    return [mail for mail in stack.inbox.mails() if "demo/robot_" in mail.subject]


def repair(stack: Any, robot: str, component: str) -> None:
    """Repair a component; returns when the mail about it has come."""
    stack.fault(robot, component, "ok")
    until(lambda: f"RECOVERY ** demo/{robot}" in subjects(stack), f"the recovery of {robot}", 60)


def _robot(line: tuple[str, str, float]) -> str:
    return line[0]
