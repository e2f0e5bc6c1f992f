"""Each time that a fault lasted, from events as /api/v1/events returns them. Pure."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any, NamedTuple

WEEK = 7 * 86_400.0  # seconds
# The labels of a fault, in the order in which they are shown.
LABELS = (
    *("scope", "state", "severity", "site"),
    *("robot", "group", "component", "check", "key", "bound"),
)
SEARCHED = 10_000  # events of each kind that are looked through
KINDS = ("fault_began", "fault_ended", "notified", "acknowledged")  # of the events that count


class Spell(NamedTuple):
    """A time in which a part was faulty; ``until`` is None while it is."""

    since: float
    until: float | None


def fault_key(fault: dict[str, Any]) -> tuple[Any, ...]:
    """What tells one time that a fault lasted from all others."""
    return tuple(fault[name] for name in (*LABELS, "since"))


def history(find: Callable[..., list[dict[str, Any]]], fault: str) -> list[dict[str, Any]]:
    """Each time that one fault, by its id, lasted, as `occurrences`.

    ``find`` returns the events that match, newest first; its arguments are those of `Wanted`.
    """
    return occurrences(find(fault=fault, limit=SEARCHED))


def occurrences(
    events: Iterable[dict[str, Any]], earlier: Iterable[dict[str, Any]] = ()
) -> list[dict[str, Any]]:
    """Each fault that these events are of, the one that began last first; times are Unix time.

    ``earlier`` are those of events before, to which these are added. Of each its labels, ``since``,
    ``confirmed`` (None where only its end is known), ``until`` and ``reason`` (None while no end is
    known), the evidence of its begin and of its end, and who acknowledged it and was notified, in
    order.
    """
    found = {fault_key(each): each for each in earlier}
    for event in sorted(events, key=lambda each: (each["time"], each["id"])):
        if event["kind"] not in KINDS or event.get("since") is None:
            continue
        labels = {name: event.get(name, "") for name in LABELS}
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


def spells(faults: Iterable[dict[str, Any]]) -> list[Spell]:
    """The times in which any of these faults lasted, in order: those that overlap are one."""
    found: list[Spell] = []
    for each in sorted(faults, key=lambda fault: fault["since"]):
        last = found[-1] if found else None
        if last is None or (last.until is not None and last.until < each["since"]):
            found.append(Spell(each["since"], each["until"]))
        elif last.until is not None:
            until = each["until"]
            found[-1] = Spell(last.since, None if until is None else max(last.until, until))
    return found
