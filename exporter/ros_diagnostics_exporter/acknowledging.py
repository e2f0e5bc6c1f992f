"""What can be acknowledged, and the silence of its escalation in Alertmanager that does.

An acknowledgement is a silence for the escalation and the reminders, never for the alert itself:
when it resolves, a notification is sent as usual. Nor is it for a step of the escalation that was
sent already: whoever was sent that is sent its end. For a fault the silence matches the time at
which it began, so it ends with the fault; a later fault of the same part, or one that gets worse,
escalates again.
"""

# It knows the labels that prometheus/rules/escalation.yml sets, and nothing of ROS.

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass, replace
from datetime import datetime, timedelta
from typing import Any

from ros_diagnostics_exporter import alertmanager
from ros_diagnostics_exporter.alertmanager import ESCALATION, IDENTITY
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
        return one_line(f"{self.labels.get('fleet', '')}/{self.part}")


def problems(alerts: Iterable[dict[str, Any]]) -> list[Acknowledgeable]:
    """What can be acknowledged, each once however many alerts there are for it, by name.

    A fault is what its own alert says; of other alerts their escalation counts as well, which may
    be for rules of the site. Alerts of severity info ask for nothing.
    """
    found: dict[frozenset[tuple[str, str]], Acknowledgeable] = {}
    for alert in alerts:
        labels = alert["labels"]
        is_fault = {"scope", "state"} <= labels.keys()
        problem = Acknowledgeable(labels, alert["annotations"].get("since", "") if is_fault else "")
        others = labels.get("alertname", "").startswith(PREFIX) and not is_fault
        if problem.since or (others and labels.get("severity") != "info"):
            known = found.setdefault(key := frozenset(problem.matchers.items()), problem)
            found[key] = replace(known, sent=known.sent | _sent_steps(alert))
    return sorted(found.values(), key=lambda each: (each.name, each.state))


def _sent_steps(alert: dict[str, Any]) -> frozenset[str]:
    """The step of an escalation that was sent; a reminder (0) has no end that would be."""
    labels = alert["labels"]
    step = labels.get("step", "0")
    is_sent = labels.get("alertname") == ESCALATION and alert["status"]["state"] == "active"
    return frozenset({step} - {"0"}) if is_sent else frozenset()


def silence(
    problem: Acknowledgeable, author: str, comment: str, start: datetime, lasts: float | None = None
) -> dict[str, Any]:
    """The silence that acknowledges ``problem``, as Alertmanager's API takes it."""
    lasts = lasts or (LASTS if problem.since else OTHERS_LAST)
    end = start + timedelta(seconds=lasts)
    made = alertmanager.silence(problem.matchers, start, end, author, comment)
    if problem.sent:
        steps = "|".join(sorted(map(re.escape, problem.sent)))
        of_steps = {"name": "step", "value": steps, "isRegex": True, "isEqual": False}
        made["matchers"].append(of_steps)
    return made


def acknowledged(
    problem: Acknowledgeable, silences: Iterable[dict[str, Any]]
) -> dict[str, Any] | None:
    """The active silence that acknowledges ``problem``; None without one."""
    wanted = {(name, value, False, True) for name, value in problem.matchers.items()}
    for each in silences:
        if each["status"]["state"] != "active":
            continue
        matchers = alertmanager.without_sent_steps(each["matchers"])
        if wanted == {
            (m["name"], m["value"], m["isRegex"], m.get("isEqual", True)) for m in matchers
        }:
            return each
    return None
