"""What can be acknowledged, and the silences in Alertmanager by which people act: also downtimes.

An acknowledgement is a silence for the escalation and the reminders, never for the alert itself:
when it resolves, a notification is sent as usual. Nor is it for a step of the escalation that was
sent already: whoever was sent that is sent its end. For a fault the silence matches the time at
which it began, so it ends with the fault; a later fault of the same part, or one that gets worse,
escalates again. What a person does by a form of a page is an event, with who did it and from which
address.
"""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta, timezone
from typing import Any

from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.model import Fault, as_texts
from ros_diagnostics_exporter.fleet_texts import clock
from ros_diagnostics_exporter.model import Person
from ros_diagnostics_exporter.silences import (
    AUTHOR_LENGTH,
    COMMENT_LENGTH,
    ESCALATION,
    IDENTITY,
    SAME,
    Alert,
    Silence,
    clean,
    downtime_matchers,
    downtime_of,
    identity_of,
    moment,
    since_text,
)
from ros_diagnostics_exporter.silences import silence as plain_silence
from ros_diagnostics_exporter.texts import one_line

DAY = 86_400.0
# A fault's acknowledgement, which ends with the fault: what it outlives escalates at once.
LASTS = 365 * DAY
OTHERS_LAST = DAY  # that of an alert that does not say since when
PREFIX = "RosDiagnostics"  # of the names of all alerts of the rules


@dataclass(frozen=True)
class Acknowledgeable:
    """What can be acknowledged: a fault, or what another alert is about.

    ``labels`` are the alert's; ``since`` as it says when the fault began, "" for other alerts;
    ``sent`` are the steps of its escalation that were sent.
    """

    labels: dict[str, str]
    since: str
    sent: frozenset[str] = frozenset()

    @property
    def matchers(self) -> dict[str, str]:
        """What its escalation matches, and no other: label -> value."""
        if self.since:
            named = {name: self.labels[name] for name in IDENTITY if name in self.labels}
            return {"alertname": ESCALATION, "since": self.since, **named}
        named = {name: text for name, text in self.labels.items() if name != "step"}
        return {**named, "alertname": ESCALATION, "of": self.alert}

    @property
    def alert(self) -> str:
        """The alert's name; of an escalation that of the alert that it is for."""
        return self.labels.get("of", self.labels["alertname"])

    @property
    def state(self) -> str:
        """The fault's state, or the alert's name."""
        return self.labels["state"].upper() if self.since else self.alert.removeprefix(PREFIX)

    @property
    def part(self) -> str:
        """What has it, as the command's arguments name it."""
        labels = self.labels
        if self.since and labels["scope"] == "site":
            return f"site {labels.get('site', '')}"
        if self.since and labels["scope"] == "common":
            return f"{labels.get('component', '')} on many robots"
        if self.since and labels["scope"] == "capability" and not labels.get("robot"):
            return f"{labels['check']} of the fleet"
        if self.since and labels["scope"] == "exporter":
            name = f"exporter {labels.get('exporter', '')}".rstrip()
            return f"{labels.get('component', '')} of the {name}"
        fault = ("robot", "component", "check", "key", "bound")
        names = fault if self.since else ("robot", "exporter", "instance", "domain_id")
        return " ".join(labels[name] for name in names if labels.get(name))

    @property
    def name(self) -> str:
        """Fleet and part, safe to print."""
        return one_line(f"{self.labels.get('fleet', '')}/{self.part}".removesuffix("/"))


def problems(alerts: Iterable[Alert]) -> list[Acknowledgeable]:
    """What can be acknowledged, each once however many alerts there are for it, by name.

    A fault is what its own alert says; of other alerts their escalation counts as well, which may
    be for rules of the site. Alerts of severity info ask for nothing.
    """
    found: dict[frozenset[tuple[str, str]], Acknowledgeable] = {}
    for alert in alerts:
        labels = alert.labels
        is_fault = {"scope", "state"} <= labels.keys()
        problem = Acknowledgeable(labels, since_text(alert.annotations) if is_fault else "")
        others = labels.get("alertname", "").startswith(PREFIX) and not is_fault
        if problem.since or (others and labels.get("severity") != "info"):
            known = found.setdefault(key := frozenset(problem.matchers.items()), problem)
            found[key] = replace(known, sent=known.sent | _sent_steps(alert))
    return sorted(found.values(), key=lambda each: (each.name, each.state))


def _sent_steps(alert: Alert) -> frozenset[str]:
    """The step of an escalation that was sent; a reminder (0) has no end that would be."""
    step = alert.labels.get("step", "0")
    is_sent = alert.labels.get("alertname") == ESCALATION and alert.status.state == "active"
    return frozenset({step} - {"0"}) if is_sent else frozenset()


def silence(
    problem: Acknowledgeable, author: str, comment: str, start: datetime, lasts: float | None = None
) -> dict[str, Any]:
    """The silence that acknowledges ``problem``, as Alertmanager's API takes it."""
    lasts = lasts or (LASTS if problem.since else OTHERS_LAST)
    end = start + timedelta(seconds=lasts)
    made = plain_silence(problem.matchers, start, end, author, comment)
    if problem.sent:
        steps = "|".join(sorted(map(re.escape, problem.sent)))
        of_steps = {"name": "step", "value": steps, "isRegex": True, "isEqual": False}
        made["matchers"].append(of_steps)
    return made


def acknowledged(problem: Acknowledgeable, silences: Iterable[Silence]) -> Silence | None:
    """The active silence that acknowledges ``problem``; None without one."""
    for each in silences:
        if each.status.state == "active" and each.exact(but_steps=True) == problem.matchers:
            return each
    return None


def acknowledge(
    alertmanager: Alertmanager, fleet: str, fault: Fault, person: Person, now: float
) -> Event:
    """Acknowledge a fault of a fleet that lasts; what was done, as an event.

    Raises:
        LookupError: No alert of it fires, or somebody has acknowledged it.
        UnreachableError: No Alertmanager answers.
    """
    texts = {"fleet": fleet, **as_texts(fault.identity, fault.labels)}
    known = [
        each
        for each in problems(alertmanager.alerts(fleet))
        if identity_of(each.labels) == identity_of(texts)
        and (since := moment(each.since)) is not None  # anybody may have posted another text
        and abs(since - fault.since) <= SAME
    ]
    if not known:
        raise LookupError("no alert about it is firing, so there is nothing to acknowledge yet")
    before = acknowledged(known[0], alertmanager.silences(fleet))
    if before is not None:
        raise LookupError(f"it is already acknowledged by {before.author}")
    begin = datetime.fromtimestamp(now, timezone.utc)
    alertmanager.add(silence(known[0], *_words(person), begin))
    of = as_texts(fault.identity, fault.labels)
    return _action(now, "acknowledged", "", person, **of, since=fault.since)


def plan_downtime(
    alertmanager: Alertmanager,
    fleet: str,
    downtime: tuple[str, str, float, float],
    person: Person,
    now: float,
) -> Event:
    """Plan a ``downtime``: a robot, its component ("" for all), its begin and its seconds.

    Returns what was done, as an event.

    Raises:
        LookupError: One that is planned already covers it.
        UnreachableError: No Alertmanager answers.
    """
    robot, component, begin, seconds = downtime
    end = begin + seconds
    for each in alertmanager.silences(fleet):
        known = downtime_of(each, fleet)
        if known is None or known[:2] not in {(robot, ""), (robot, component)}:
            continue
        if known.start <= begin and known.end >= end:
            raise LookupError(f"a downtime of {known.author} covers it already")
    first, last = (datetime.fromtimestamp(each, timezone.utc) for each in (begin, end))
    matchers = downtime_matchers(fleet, robot, component)
    alertmanager.add(plain_silence(matchers, first, last, *_words(person)))
    ahead = f"from {clock(begin, now, local=False)} " if begin > now else ""
    until = f"{ahead}until {clock(end, now, local=False)}: "
    return _action(now, "downtime", until, person, robot=robot, component=component)


def cancel_downtime(
    alertmanager: Alertmanager,
    fleet: str,
    downtime: tuple[str, str, float],
    person: Person,
    now: float,
) -> Event:
    """End a ``downtime``: of a robot and its component, until then; what was done.

    Raises:
        LookupError: There is none (any more).
        UnreachableError: No Alertmanager answers.
    """
    robot, component, until = downtime
    known = [
        each.id
        for each in alertmanager.silences(fleet)
        if (planned := downtime_of(each, fleet)) is not None
        and planned[:2] == (robot, component)
        and abs(planned.end - until) <= SAME
    ]
    if not known:
        raise LookupError("there is no such downtime any more")
    for name in known:
        alertmanager.end(name)
    end = f"it was until {clock(until, now, local=False)}: "
    return _action(now, "cancelled", end, person, robot=robot, component=component)


def _action(now: float, after: str, what: str, person: Person, **about: Any) -> Event:
    """What a person did by a form, as an event: ``what`` precedes the comment."""
    author, comment = _words(person)
    message = f"{what}{comment} (from {person.address})"
    return Event(now, "action", **about, after=after, message=message, author=author)


def _words(person: Person) -> tuple[str, str]:
    """Author and comment as others will see them."""
    return clean(person.user, AUTHOR_LENGTH), clean(person.comment, COMMENT_LENGTH)
