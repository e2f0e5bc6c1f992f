"""What Alertmanager posts: which fault it is of, what is recorded, and what is served of it."""

import json
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter import notifications
from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.events import Event, Wanted
from ros_diagnostics_exporter.faults.model import as_texts
from ros_diagnostics_exporter.notifications import ENDED, Notifications, key_of, parse, restored
from ros_diagnostics_exporter.severity import notice
from support.silences import BEGAN, FAULT, LABELS, MOTOR
from support.web_server import broken, problem

KEY = key_of(as_texts(FAULT.identity, FAULT.labels))


def body(*alerts: dict[str, Any], receiver: str = "email", **changed: Any) -> bytes:
    """A message as Alertmanager posts it."""
    message = {
        "version": "4",
        "groupKey": "{}",
        "truncatedAlerts": 0,
        "status": "firing",
        "receiver": receiver,
        "alerts": list(alerts or [alert()]),
    }
    return json.dumps(message | changed).encode()


def alert(status: str = "firing", **labels: str) -> dict[str, Any]:
    named = {"alertname": "RosDiagnosticsComponentCritical", "team": "blue", **LABELS, **labels}
    return {"status": status, "labels": named, "startsAt": "2026-01-01T10:00:10Z"}


def of_fault(kind: str, since: float = BEGAN, time: float = BEGAN + 60) -> Event:
    named = {name: text for name, text in LABELS.items() if name != "fleet"}
    return Event(time, kind, **named, since=since)


def post(known: Notifications, *alerts: dict[str, Any], at: float = BEGAN + 12, **more: str):
    """Receive a message and record its events, as the service does."""
    found = known.receive(parse(body(*alerts, **more)), "f", at)
    for event in found.events:
        known.note(event)
    return found.events


def test_a_notification_is_an_event_of_its_fault():
    known = Notifications([FAULT])

    [event] = post(known)

    assert (event.kind, event.time, event.since) == ("notified", BEGAN + 12, BEGAN)
    assert (event.receiver, event.after, event.step) == ("email", "firing", "")
    assert (event.robot, event.component, event.state) == ("r", "Motor 1", "critical")
    assert known.lasting() == {KEY: {"email": BEGAN + 12}}


def test_escalations_and_reminders_have_their_step():
    known = Notifications([FAULT])
    named = {"alertname": "RosDiagnosticsUnacknowledged", "since": "2026-01-01 10:00:00 +0000 UTC"}
    [first] = post(known, alert(step="1", **named), receiver="escalation-1")
    [reminder] = post(known, alert(step="0", **named), receiver="reminder")

    assert (first.step, reminder.step) == ("1", "0")
    assert set((known.lasting() or {})[KEY]) == {"escalation-1", "reminder"}


@pytest.mark.parametrize(
    "other",
    [
        {"fleet": "g"},
        {"robot": "r2"},
        {"state": "warning"},
        {"component": "Motor 2"},
        {"scope": ""},
    ],
    ids=str,
)
def test_alerts_that_are_of_no_known_fault_are_ignored(other):
    known = Notifications([FAULT])
    found = known.receive(parse(body(alert(**other), alert())), "f", BEGAN)
    assert (len(found.events), found.ignored) == (1, 1)


def test_a_recovery_is_of_the_fault_that_ended_even_if_the_next_one_has_begun():
    known = Notifications([FAULT])
    post(known)
    known.note(of_fault("fault_ended"))
    known.note(of_fault("fault_began", since=BEGAN + 70))

    [recovery] = post(known, alert("resolved"), at=BEGAN + 80)
    [problem] = post(known, at=BEGAN + 90)
    assert (recovery.since, problem.since) == (BEGAN, BEGAN + 70)
    assert known.lasting() == {KEY: {"email": BEGAN + 90}}


def two_faults(*, first_recovered: bool = False, second_notified: bool = True) -> Notifications:
    """One that email was notified of and that ended, and the next one of the same component."""
    known = Notifications([FAULT])
    post(known)
    known.note(of_fault("fault_ended"))
    if first_recovered:
        post(known, alert("resolved"))
    known.note(of_fault("fault_began", since=BEGAN + 70))
    if second_notified:
        post(known, at=BEGAN + 75)
    return known


def test_a_recovery_is_of_the_fault_that_ended_also_if_the_next_one_was_notified():
    [recovery] = post(two_faults(), alert("resolved"))
    assert recovery.since == BEGAN


def test_a_recovery_is_of_the_fault_that_this_receiver_was_notified_of():
    known = two_faults(second_notified=False)
    known.note(of_fault("fault_ended", since=BEGAN + 70))
    [recovery] = post(known, alert("resolved"))
    assert recovery.since == BEGAN


def test_a_recovery_is_not_of_a_fault_whose_recovery_this_receiver_has_had():
    [recovery] = post(two_faults(first_recovered=True), alert("resolved"))
    assert recovery.since == BEGAN + 70


def test_a_fault_that_ended_is_not_served_and_its_late_notification_is_still_recorded():
    known = Notifications([FAULT])
    known.note(of_fault("fault_ended"))
    [event] = post(known, at=BEGAN + 65)
    assert event.since == BEGAN
    assert known.lasting() == {}


def test_what_is_noted_after_a_restart_is_what_was_recorded_before():
    before = Notifications([FAULT])
    events = [*post(before), *post(before, receiver="sms", at=BEGAN + 13)]
    after = Notifications([FAULT])
    assert after.lasting() is None
    for event in events:
        after.note(event)
    assert after.lasting() == before.lasting() != {}


@pytest.mark.parametrize("lasting", [[FAULT], []])
def test_after_a_restart_what_ended_an_hour_ago_is_known_and_all_of_what_lasts(lasting):
    """Notifications are looked for since the oldest fault that one of these may be about."""
    now, asked = BEGAN + 2 * ENDED, {}

    def find(wanted: Wanted):
        asked[wanted.kind] = wanted.since
        events = [of_fault("fault_ended", time=now - 60)] if wanted.kind == "fault_ended" else []
        return [(1, each) for each in events if each.time >= wanted.since]

    known = restored(lasting, find, now)
    since = BEGAN if lasting else now - ENDED
    assert asked == {"fault_ended": now - ENDED, "acknowledged": since, "notified": since}
    [recovery] = post(known, alert("resolved"), at=now)
    assert recovery.since == BEGAN


def test_hostile_senders_add_a_bounded_number_of_events(monkeypatch):
    monkeypatch.setattr(notifications, "MAX_NOTIFIED", 5)
    monkeypatch.setattr(notifications, "MAX_RECEIVERS", 3)
    known = Notifications([FAULT])
    events = [event for n in range(20) for event in post(known, receiver=f"r{n}\n\x1b[31m" * 50)]
    assert len(events) == 5
    assert len((known.lasting() or {})[KEY]) == 3
    assert all(each.receiver.isprintable() and len(each.receiver) <= 64 for each in events)


def test_of_faults_that_ended_a_bounded_number_is_kept(monkeypatch):
    monkeypatch.setattr(notifications, "MAX_ENDED", 2)
    known = Notifications([FAULT])
    for number in range(5):
        known.note(of_fault("fault_ended", since=BEGAN + number))
    recoveries = [post(known, alert("resolved"), at=BEGAN + 99) for _ in range(2)]
    assert [event.since for [event] in recoveries] == [BEGAN + 4, BEGAN + 4]


@pytest.mark.parametrize(
    ("wrong", "why"),
    [
        (b"", "the body"),
        (b"[" * 100_000, "the body"),
        (body(version="3"), "version"),
        (body(receiver=""), "receiver"),
        (body(alerts=[{"status": "on", "labels": {}}]), "alerts.0.status"),
        (body(*[alert()] * 1_001), "alerts"),
        (body(alert(robot="r" * 2_000)), "alerts.0.labels"),
        (body(alert(**{f"l{n}": "" for n in range(200)})), "alerts.0.labels"),
    ],
    ids=lambda each: repr(each)[:30],
)
def test_what_is_no_message_is_rejected_with_the_reason(wrong, why):
    with pytest.raises(ValueError, match=f"webhook, version 4: {why}"):
        parse(wrong)


@given(st.binary() | st.recursive(st.none() | st.text(), st.lists).map(json.dumps).map(str.encode))
def test_any_bytes_are_a_message_or_an_error(raw):
    with pytest.raises(ValueError, match="not a message"):
        parse(raw)


def test_an_acknowledgement_is_one_event_of_the_fault_that_it_names():
    known = Notifications([FAULT])
    of_another = MOTOR._replace(since=BEGAN - 100)

    [event] = known.acknowledge([of_another, MOTOR])
    assert (event.time, event.author, event.message) == (MOTOR.at, "ann", "spare part ordered")
    known.note(event)
    assert known.acknowledge([MOTOR]) == []


@pytest.mark.parametrize(
    ("shown", "words"),
    [
        (broken(notified={"sms": 880.0, "email": 875.0}), "notified 3 min ago: email, sms"),
        (broken(notified={}), "not notified yet"),
        (broken(notified=None), ""),
        (problem("component", "critical", suppressed="maintenance"), "nobody is notified"),
        (problem("component", "critical"), ""),
    ],
)
def test_problems_say_who_was_notified(shown, words):
    assert notice(shown, 1_060.0) == words


@pytest.mark.parametrize(
    ("event", "words"),
    [
        ({"receiver": "email", "after": "firing"}, "notification sent to email"),
        ({"receiver": "on-call", "after": "firing", "step": "2"}, "escalation sent to on-call"),
        ({"receiver": "reminder", "after": "firing", "step": "0"}, "reminder sent to reminder"),
        ({"receiver": "email", "after": "resolved"}, "recovery sent to email"),
    ],
)
def test_the_events_in_words(event, words):
    of = {name: text for name, text in LABELS.items() if name != "fleet"}
    text = event_text({"kind": "notified", **of, **event})
    assert text == f"{words}: CRITICAL /Motor/Motor 1"
