"""What happens to the robots of `./run soak --chaos`, and which of the mails about it are wrong.

A robot fails in one component at a time, or falls silent, for longer than it takes to a mail. So
each incident is a fault that has to be mailed once, and whose end has to be mailed once. What the
documentation names as possible is counted beside it, with its page.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field
from random import Random
from typing import Any, NamedTuple

KIND = "thesis"  # of the robots
COMPONENTS = ("Motor 1", "Motor 2", "Motor 3", "Sensor 1", "Sensor 2", "Laser 1", "Cam 1")
FIRST, EVERY, LAST = 60.0, 12.0, 150.0  # seconds: the first one, each next, and none at the end
SHORTEST, LONGEST = 50.0, 110.0  # seconds of an incident
ABSENT = 3  # robots that fall silent; of the others components fail
ABSENT_EVERY = 12  # incidents of which one is a silence: a robot that is away often is flapping
ROBOT_EVENTS = ("hang", "network_loss", "crash")
STATES = {"error": "CRITICAL", "warn": "WARNING"}
# Seconds without an outage in which a fault is seen, confirmed and mailed; and so late is a mail.
NEEDED = 45.0
LATE = 30.0
# An Alertmanager that is killed may have forgotten what it sent in these seconds before.
FORGOTTEN = 20.0
LONG = 60.0  # seconds without Prometheus after which Alertmanager ends alerts by itself
OF_ROBOTS = re.compile(r"\*\* (PROBLEM|RECOVERY) \*\* (.+?) is (?:no longer )?([A-Z]+)\b")
FLAPS = re.compile(r"\*\* FLAPPING \*\* (.+) (started|stopped) flapping")
PAGES = {
    "begins and ends beside an outage": "docs/alerts.md#while-an-exporter-is-away",
    "Alertmanager was killed": "docs/notifications.md#pairs",
    "Prometheus was down for a minute": "docs/notifications.md#pairs",
}
WRONG = ("false PROBLEM", "false RECOVERY", "missed", "endless")


class Incident(NamedTuple):
    """Something is wrong from ``begin`` to ``end``, Unix time; ``about`` as in mails' subjects.

    ``must``: it has to be mailed if nothing is out of order; else it may be.
    """

    about: str
    state: str
    begin: float
    end: float
    must: bool = True


class Outage(NamedTuple):
    """A server was killed, stopped or paused, until it was ready again."""

    server: str
    how: str
    begin: float
    end: float


class Mail(NamedTuple):
    """A mail about a fault: ``kind`` is PROBLEM or RECOVERY."""

    received: float
    kind: str
    about: str
    state: str


@dataclass
class Counts:
    """How often each thing went wrong, and an example of each; and what is possible."""

    wrong: Counter[str] = field(default_factory=Counter)
    possible: Counter[str] = field(default_factory=Counter)
    lines: list[str] = field(default_factory=list)

    def add(self, what: str, about: object, possible: str = "") -> None:
        """Count it, as possible by the documentation or as wrong."""
        (self.possible if possible else self.wrong)[possible or what] += 1
        self.lines.append(f"{what}: {about}" + (f" ({possible})" if possible else ""))


# -- what happens ------------------------------------------------------------------------------


def scenario(robots: int, seconds: float, seed: int) -> dict[str, Any]:
    """A scenario of `virtual-robots`: the incidents, each of a component that was long well."""
    random = Random(seed)
    names = [f"robot_{number}" for number in range(1, robots + 1)]
    parts = [(robot, each) for robot in names[ABSENT:] for each in COMPONENTS]
    random.shuffle(parts)
    absent = names[:ABSENT]
    events = []
    for number in range(max(0, int((seconds - FIRST - LAST) / EVERY))):
        lasts = round(random.uniform(SHORTEST, LONGEST), 1)
        event: dict[str, Any] = {"at": FIRST + number * EVERY, "for": lasts}
        if number % ABSENT_EVERY == ABSENT_EVERY - 1:
            robot = absent.pop(0)
            absent.append(robot)
            events.append({**event, "robot": robot, "what": random.choice(ROBOT_EVENTS)})
            continue
        robot, component = parts.pop(0)
        parts.append((robot, component))
        what = random.choice(tuple(STATES))
        events.append({**event, "robot": robot, "component": component, "what": what})
    kind = {"kind": KIND, "count": robots}
    return {"description": "chaos", "seed": seed, "robots": [kind], "events": events}


def incidents(
    content: dict[str, Any], fleet: str, began: float, pauses: Iterable[Outage]
) -> list[Incident]:
    """What robots know of a scenario that began then; while they were paused, nothing changed."""
    pauses = list(pauses)
    found = []
    for event in content["events"]:
        about, state = f"{fleet}/{event['robot']}", "SILENT"
        if "component" in event:
            about, state = f"{about} {event['component']}", STATES[event["what"]]
        first = began + event["at"]
        begin, end = _played(first, pauses), _played(first + event["for"], pauses)
        found.append(Incident(about, state, begin, end))
    return found


def _played(at: float, pauses: Iterable[Outage]) -> float:
    return max([at, *(each.end for each in pauses if each.begin <= at < each.end)])


# -- what was mailed ---------------------------------------------------------------------------


def read(received: float, subject: str) -> Mail | None:
    """What a subject says of a fault; None: it is about something else, such as a downtime."""
    if found := OF_ROBOTS.match(subject):
        return Mail(received, *found.groups())
    if found := FLAPS.match(subject):
        kind = "PROBLEM" if found[2] == "started" else "RECOVERY"
        return Mail(received, kind, found[1], "FLAPPING")
    return None


def count(
    known: Sequence[Incident],
    outages: Sequence[Outage],
    mails: Sequence[Mail],
    lasting: Sequence[str],
) -> Counts:
    """Compare the mails with what the robots know; ``lasting`` are faults when all is repaired."""
    counts = Counts()
    for fault in lasting:
        counts.add("endless", fault)
    open_since: dict[tuple[str, str], float] = {}
    for mail in mails:
        key = mail.about, mail.state
        same = [each for each in known if (each.about, each.state) == key]
        if mail.kind == "PROBLEM":
            _count_problem(counts, mail, same, outages, open_since.get(key))
            open_since[key] = mail.received
            continue
        open_since.pop(key, None)
        if any(each.begin < mail.received < each.end - 1 for each in same if each.must):
            gone = _is_away(outages, mail.received)
            counts.add("false RECOVERY", mail, "Prometheus was down for a minute" if gone else "")
    for (about, state), since in open_since.items():
        killed = _was_killed(outages, since)
        counts.add("endless", (about, state), "Alertmanager was killed" if killed else "")
    for each in known:
        if each.must and not any(_is_about(mail, each, outages) for mail in mails):
            seen = _longest_calm(each, outages) >= NEEDED
            counts.add("missed", each, "" if seen else "begins and ends beside an outage")
    return counts


def _count_problem(
    counts: Counts,
    mail: Mail,
    same: Iterable[Incident],
    outages: Sequence[Outage],
    open_since: float | None,
) -> None:
    """A PROBLEM is wrong where nothing is, and where one was sent before and no RECOVERY."""
    if not any(_is_about(mail, each, outages) for each in same):
        counts.add("false PROBLEM", mail)
    elif open_since is not None:
        killed = _was_killed(outages, open_since)
        counts.add("false PROBLEM", mail, "Alertmanager was killed" if killed else "")


def _is_about(mail: Mail, incident: Incident, outages: Sequence[Outage]) -> bool:
    """Whether it says that an incident began, as late as outages make it."""
    if mail.kind != "PROBLEM" or (mail.about, mail.state) != (incident.about, incident.state):
        return False
    late = sum(
        min(each.end, mail.received) - max(each.begin, incident.begin)
        for each in outages
        if each.begin < mail.received and each.end > incident.begin
    )
    return incident.begin <= mail.received <= incident.end + LATE + late


def _was_killed(outages: Iterable[Outage], after: float) -> bool:
    """Whether Alertmanager may have forgotten what it sent then."""
    return any(
        (each.server, each.how) == ("Alertmanager", "kill")
        and each.begin - FORGOTTEN <= after <= each.end
        for each in outages
    )


def _is_away(outages: Iterable[Outage], at: float) -> bool:
    return any(
        each.server == "Prometheus" and each.end - each.begin > LONG
        and each.begin <= at <= each.end + LATE
        for each in outages
    )  # fmt: skip


def _longest_calm(incident: Incident, outages: Iterable[Outage]) -> float:
    """The longest time of an incident in which all servers were there."""
    longest, at = 0.0, incident.begin
    for each in sorted(outages, key=lambda each: each.begin):
        if each.end > at and each.begin < incident.end:
            longest, at = max(longest, each.begin - at), max(at, each.end)
    return max(longest, incident.end - at)


def report(counts: Counts) -> Iterator[str]:
    """The lines of the result."""
    yield from counts.lines
    yield ", ".join(f"{counts.wrong[what]} {what}" for what in WRONG)
    for what, number in counts.possible.items():
        yield f"possible: {number} because {what}, see {PAGES[what]}"
