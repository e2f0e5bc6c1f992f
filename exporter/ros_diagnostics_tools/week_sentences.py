"""What failed of a robot in a week, in sentences that follow from the event log. Pure."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Any, NamedTuple

from ros_diagnostics_exporter.api.occurrences import (
    WEEK,
    Spell,
    fault_key,
    occurrences,
    spells,
)
from ros_diagnostics_exporter.fleet_texts import clock, span
from ros_diagnostics_exporter.severity import STATE_OF_LEVEL, component_path, subject
from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.aborted import aborted_texts

MOST = 10  # parts that are named
AGAIN = 3  # times that something has to precede a fault before it is mentioned
BEFORE = 900.0  # seconds before a fault in which it does
AT_ONCE = 1.0  # seconds within which two things happened at the same time
LONG = 30 * 86_400.0  # seconds: an acknowledgement that lasts longer ends with its fault

Event = dict[str, Any]
_OF_ROBOT = {
    "silent": "The robot was silent",
    "pending": "The robot was expected and not received",
    "flapping": "The robot was flapping",
    "many": "Many of its components were faulty together",
    "clock": "The robot's clock was wrong",
}


class _Part(NamedTuple):
    """What failed: its name, how a sentence about it begins, and its faults, the newest first."""

    name: str
    begins: str
    faults: list[dict[str, Any]]

    @property
    def spells(self) -> list[Spell]:
        return spells(self.faults)


def sentences(
    events: Iterable[Event], robot: dict[str, Any], now: float, since: float
) -> list[dict[str, str]]:
    """What happened to a robot, as sentences: ``about`` which part ("" all of it) and ``text``.

    Args:
        events: The robot's since ``since``; of faults that ended since then, older ones too.
        robot: As /api/v1/fleet has it.
        now: Unix time.
        since: From when on the events are known, Unix time.
    """
    known = list(events)
    parts = _parts(_faults(known, robot, since))
    recent = [each for each in known if each["time"] >= since]
    when = in_time(since, now)
    goals = [_sentence(*each) for each in aborted_texts(recent, when)]
    if not parts:
        return [_sentence("", f"No fault {when}."), *goals]
    named = sorted(parts, key=lambda each: _worst_first(each, now))[:MOST]
    found = [
        _sentence(part.name, text)
        for part in named
        for text in _of_part(part, recent, robot, now, when)
    ]
    left = len(parts) - len(named)
    more = [_sentence("", f"{left} more parts were faulty {when}.")] if left else []
    return [*found, *more, *goals]


def in_time(since: float, now: float) -> str:
    """The time that the sentences are of, in words; a shorter one where the log has no more."""
    if now - since >= WEEK:
        return "in the last 7 days"
    return f"since {clock(since, now, local=False)}, where the event log begins"


def _faults(events: list[Event], robot: dict[str, Any], since: float) -> Iterator[dict[str, Any]]:
    """The faults that lasted since then; of those whose end is not known the ones that last now."""
    lasting = {fault_key(each): each for each in robot["problems"] if each["confirmed"] is not None}
    for fault in occurrences(events):
        is_lasting = lasting.pop(fault_key(fault), None) is not None
        ended = fault["until"] is not None and fault["until"] >= since
        if ended or (is_lasting and fault["until"] is None):
            yield fault
    for problem in lasting.values():  # its begin is not in the event log
        yield {**problem, "until": None, "notified": []}


def _parts(faults: Iterable[dict[str, Any]]) -> list[_Part]:
    found: dict[str, _Part] = {}
    for fault in faults:
        name, begins = _named(fault)
        found.setdefault(begins, _Part(name, begins, [])).faults.append(fault)
    return list(found.values())


def _named(fault: dict[str, Any]) -> tuple[str, str]:
    """The name of what a fault is of, and how a sentence of it begins."""
    if fault["scope"] == "robot":
        return "", _OF_ROBOT.get(fault["state"], "The robot was faulty")
    name = fault["check"] if fault["scope"] == "capability" else subject(fault)
    return name, f"{name} was {'impaired' if fault['scope'] == 'capability' else 'faulty'}"


def _worst_first(part: _Part, now: float) -> tuple[Any, ...]:
    found = part.spells
    return found[-1].until is not None, -len(found), -(found[-1].until or now), part.begins


def _of_part(
    part: _Part, events: list[Event], robot: dict[str, Any], now: float, when: str
) -> Iterator[str]:
    found = part.spells
    yield f"{part.begins} {_times(len(found))} {when}, {_lasted(found, now)}."
    if (before := preceding(part, found, events)) is not None:
        yield before
    if (well := _well(found, now)) is not None:
        yield well
    yield from _cared_for(part, robot, now)
    if (sent := _sent(part)) is not None:
        yield sent


def _times(number: int) -> str:
    return "once" if number == 1 else f"{number} times"


def _lasted(lasted: list[Spell], now: float) -> str:
    """How long each time was, or the shortest, the longest and the sum; and whether it goes on."""
    lengths = [(now if each.until is None else each.until) - each.since for each in lasted]
    if len(lengths) == 1:
        words = f"for {span(lengths[0])}"
    else:
        low, high = span(min(lengths)), span(max(lengths))
        each = low if low == high else f"{low} to {high}"
        words = f"for {each} each, {span(sum(lengths))} in all"
    last = lasted[-1]
    return words if last.until is not None else f"{words}, and it goes on"


def preceding(part: _Part, lasted: list[Spell], events: Iterable[Event]) -> str | None:
    """What happened before each time that a part failed, if it hardly ever did otherwise."""
    if len(lasted) < AGAIN:
        return None
    own = {(fault["group"], fault["component"]) for fault in part.faults}
    moments: dict[str, list[float]] = {}
    for event in events:
        words = _happened(event, own)
        if words:
            moments.setdefault(words, []).append(event["time"])
    candidates = []
    for words, times in moments.items():
        delays = [_delay(each.since, times) for each in lasted]
        known = [each for each in delays if each is not None]
        if len(known) == len(lasted) and len(times) <= 2 * len(lasted):
            candidates.append((len(times), max(known) - min(known), words, known))
    if not candidates:
        return None
    number, _spread, words, delays_known = min(candidates)
    low, high = span(min(delays_known)), span(max(delays_known))
    delay = low if low == high else f"{low} to {high}"
    each = f"Each of the {len(lasted)} times it began {delay} after {words}"
    return f"{each}, which happened {_times(number)}."


def _delay(since: float, times: Iterable[float]) -> float | None:
    """The seconds since the last of these moments before ``since``, if it was not long before."""
    before = [since - each for each in times if AT_ONCE <= since - each <= BEFORE]
    return min(before, default=None)


def _happened(event: Event, own: set[tuple[str, str]]) -> str:
    """What an event says that may come before a fault; "" where it is of the part itself."""
    kind, after = event["kind"], event.get("after", "")
    if kind == "robot" and after in {"silent", "received"}:
        return "the robot was silent" if after == "silent" else "the robot was back"
    is_own = (event.get("group", ""), event.get("component", "")) in own
    if kind == "level" and event.get("before") and not is_own:
        return f"{component_path(event)} turned {STATE_OF_LEVEL.get(after, after)}"
    return ""


def _well(found: list[Spell], now: float) -> str | None:
    """For how long there has been no fault of it, and how long the recovery before that held."""
    words = []
    last = found[-1]
    if last.until is not None:
        at = clock(last.until, now, local=False)
        words.append(f"it has had no fault since {at}, for {span(now - last.until)}")
    if len(found) > 1:
        held = last.since - (found[-2].until or last.since)
        words.append(f"the recovery before the last fault held {span(held)}")
    text = "; ".join(words)
    return f"{text[0].upper()}{text[1:]}." if text else None


def _cared_for(part: _Part, robot: dict[str, Any], now: float) -> Iterator[str]:
    """Who has acknowledged what lasts, and who planned a downtime of it."""
    faults = {fault_key(fault) for fault in part.faults}
    for problem in robot["problems"]:
        taken = problem["acknowledged"]
        if taken and fault_key(problem) in faults:
            until = clock(taken["until"], now, local=False, seconds=False)
            when = "" if taken["until"] - taken["at"] > LONG else f" until {until}"
            yield f"{taken['author']} has it{when}: {taken['comment']}."
    names = {fault["component"] for fault in part.faults}
    for each in robot["downtimes"]:
        if each["component"] in names:
            until = clock(each["until"], now, local=False, seconds=False)
            of = "it" if each["component"] else "the robot"
            yield f"{each['author']} planned a downtime of {of} until {until}: {each['comment']}."


def _sent(part: _Part) -> str | None:
    """How many notifications of it were sent, recoveries apart, and to whom."""
    receivers = Counter(
        each["receiver"]
        for fault in part.faults
        for each in fault["notified"]
        if each["after"] == "firing"
    )
    if not receivers:
        return None
    named = ", ".join(f"{name} {number}" for name, number in sorted(receivers.items()))
    number = receivers.total()
    noun = "notification was" if number == 1 else "notifications were"
    return f"{number} {noun} sent: {named}."


def _sentence(about: str, text: str) -> dict[str, str]:
    return {"about": one_line(about), "text": one_line(text)}
