"""Events in sentences: what the history, the pages and `ros-diagnostics history` say of one."""

from __future__ import annotations

from typing import Any

from ros_diagnostics_exporter.severity import component_path, problem_state, subject

_AFTER = {
    "received": "is received",
    "silent": "is silent",
    "known": "was found",
    "forgotten": "removed",
    "read": "was read",
    "rejected": "was rejected",
}
_BY_FORM = {
    "acknowledged": "acknowledged by a form",
    "downtime": "downtime planned by a form",
    "cancelled": "downtime cancelled by a form",
}


def event_text(event: dict[str, Any]) -> str:
    """An event of /api/v1/events in one sentence, without its time and robot."""
    kind, message = event["kind"], event.get("message", "")
    after = _AFTER.get(event.get("after", ""), event.get("after", ""))
    if kind == "level":
        words = f"{component_path(event)} {event.get('before', 'new')} → {after}"
    elif kind in {"fault_began", "fault_ended"}:
        about = _complete(event)
        how = {"fault_began": "began", "fault_ended": event.get("reason", "ended")}[kind]
        words = f"fault {how}: {problem_state(about)} {subject(about)}"
    elif kind == "condition":
        about = _complete(event)
        how = "suppressed" if after == "suppressed" else "no longer suppressed"
        words = f"{how} by its condition: {problem_state(about)} {subject(about)}"
    elif kind == "action":
        what = _BY_FORM.get(after, f"{after} by a form")
        of = subject(_complete(event)) if event.get("scope") else event.get("component", "")
        words = f"{what} by {event.get('author', '?')}{of and f', {of}'}"
    elif kind == "goal":
        words = f"a goal of {event['component']} was {after}"
    elif kind == "intervention":
        words = "intervention"
    elif kind in {"notified", "acknowledged"}:
        words = f"{_done(event)}: {problem_state(event)} {subject(_complete(event))}"
    else:
        words = f"{kind} {after}".strip()
    return ": ".join(filter(None, (words, message)))


def _complete(event: dict[str, Any]) -> dict[str, Any]:
    """An event of a fault with the fields that do not apply."""
    return dict.fromkeys(("group", "component", "check", "key", "site"), "") | event


def _done(event: dict[str, Any]) -> str:
    """What was done about a fault."""
    if event["kind"] == "acknowledged":
        return f"acknowledged by {event.get('author', '?')}"
    return notified_text(event)


def notified_text(event: dict[str, Any]) -> str:
    """What was sent to which receiver, as "escalation sent to on-call"."""
    receiver, step = event.get("receiver", "?"), event.get("step", "")
    if event.get("after") == "resolved":
        return f"recovery sent to {receiver}"
    what = {"": "notification", "0": "reminder"}.get(step, "escalation")
    return f"{what} sent to {receiver}"
