"""The faults whose alerts fire at Alertmanager, for an exporter that does not know them.

The labels and annotations are those of prometheus/rules/faults.yml. Anybody who reaches
Alertmanager may have made these alerts: what is no fault as the rules make them is skipped.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from types import MappingProxyType

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.faults.model import (
    Fault,
    Identity,
    Scope,
    State,
    exporter_of,
    severity_of,
)
from ros_diagnostics_exporter.silences import IDENTITY, Alert, clean, moment, since_text

EVIDENCE_LENGTH = 640
HALF = 0.0005  # seconds: of the thousandths in which rules write a time
# The evidence of a fault is one text, because rules expand each annotation at each evaluation: what
# was known, and last what the robot can no longer do. That of an end says when, or who removed it.
SEPARATOR = ";\n"
THE_ROBOT = "the robot "
REMOVED = "removed by a person"
_OF_END = re.compile(rf"{REMOVED}|ended [-0-9]+ [0-9:]+ UTC, after [0-9a-z]+")
_PREFIX = "Last received: "  # of the rules
# The others are the robot's own.
_OF_FAULT = {*IDENTITY, "alertname", "exporter", "fault"} - {"site"}


def read(alerts: Iterable[Alert], fleet: Fleet) -> list[Fault]:
    """The faults of a fleet that fire; of what is of no robot, those of this exporter's name."""
    found = (_one(alert, fleet) for alert in alerts)
    return [fault for fault in found if fault is not None]


def _one(alert: Alert, fleet: Fleet) -> Fault | None:
    labels, (_since, *known) = alert.labels, alert.annotations.get("evidence", "").split(SEPARATOR)
    try:
        identity, since = _identity(labels), moment(since_text(alert.annotations))
    except (KeyError, ValueError):
        return None  # no alert as the rules make them
    named = labels.get("exporter", "")
    is_ours = bool(identity.robot) or named == exporter_of(fleet, identity)
    is_over = bool(known) and _OF_END.fullmatch(known[-1].removeprefix(_PREFIX)) is not None
    is_wrong = severity_of(identity) != labels["severity"] or is_over
    if labels.get("fleet") != fleet.name or not is_ours or is_wrong or since is None:
        return None
    since += HALF  # as it is served, rules write the same text again: they cut off what follows
    own = {name: text for name, text in labels.items() if name not in _OF_FAULT}
    can = known.pop() if known and known[-1].startswith(THE_ROBOT) else ""
    lines = (clean(line, EVIDENCE_LENGTH) for line in SEPARATOR.join(known).split("\n"))
    texts = (
        "\n".join(lines).removeprefix(_PREFIX)[:EVIDENCE_LENGTH],
        clean(can.removeprefix(THE_ROBOT), EVIDENCE_LENGTH),
    )
    labels_of_robot = MappingProxyType(own if identity.robot else {})
    return Fault(identity, since, alert.starts_at, labels_of_robot, *texts)


def _identity(labels: Mapping[str, str]) -> Identity:
    scope, state = Scope(labels["scope"]), State(labels["state"])
    parts = ("robot", "group", "component", "check", "key", "bound")
    named = {name: labels.get(name, "") for name in parts}
    site = labels.get("site", "") if scope is Scope.SITE else ""
    severity = labels["severity"] if state is State.MANY else ""
    if (scope in (Scope.SITE, Scope.COMMON, Scope.EXPORTER)) is bool(named["robot"]):
        raise ValueError("a fault of a robot names one, and no other does")
    return Identity(scope, state, site=site, severity=severity, **named)
