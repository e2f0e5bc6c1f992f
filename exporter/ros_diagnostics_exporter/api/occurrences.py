"""The faults of the event log: each time that one lasted, with its end and who took care of it.

Events are given as /api/v1/events returns them.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

# The labels of a fault, in the order in which they are shown.
LABELS = (
    *("scope", "state", "severity", "site"),
    *("robot", "group", "component", "check", "key", "bound"),
)
KINDS = ("fault_began", "fault_ended", "notified", "acknowledged")  # of the events that count


def labels_of(event: dict[str, Any]) -> dict[str, str]:
    """The labels of an event's fault; those that do not apply are ""."""
    return {name: event.get(name, "") for name in LABELS}


def occurrences(events: Iterable[dict[str, Any]]) -> list[dict[str, Any]]:
    """Each fault that these events are of, the one that began last first; times are Unix time.

    Of each its labels, ``since``, ``confirmed`` (None where only its end is known), ``until`` and
    ``reason`` (None while no end is known), the evidence of its begin and of its end, and who
    acknowledged it and was notified, in order.
    """
    found: dict[tuple[Any, ...], dict[str, Any]] = {}
    for event in sorted(events, key=lambda each: (each["time"], each["id"])):
        if event["kind"] not in KINDS or event.get("since") is None:
            continue
        labels = labels_of(event)
        fault = found.setdefault((*labels.values(), event["since"]), _new(labels, event["since"]))
        _add(fault, event)
    return sorted(found.values(), key=lambda each: -each["since"])


def _new(labels: dict[str, str], since: float) -> dict[str, Any]:
    return {
        **labels,
        "since": since,
        "confirmed": None,
        "until": None,
        "reason": None,
        "evidence": "",
        "end": "",
        "acknowledged": [],
        "notified": [],
    }


def _add(fault: dict[str, Any], event: dict[str, Any]) -> None:
    kind, message, at = event["kind"], event.get("message", ""), event["time"]
    if kind == "fault_began":
        fault |= {"confirmed": at, "evidence": message}
    elif kind == "fault_ended":
        fault |= {"until": at, "reason": event["reason"], "end": message}
    elif kind == "acknowledged":
        author = event.get("author", "")
        fault["acknowledged"].append({"at": at, "author": author, "comment": message})
    else:
        fault["notified"].append(
            {
                "at": at,
                "receiver": event.get("receiver", ""),
                "step": event.get("step", ""),
                "after": event.get("after", ""),
            }
        )
