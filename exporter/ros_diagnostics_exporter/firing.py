"""The faults whose alerts fire at Alertmanager, for an exporter that does not know them.

The labels and annotations are those of prometheus/rules/faults.yml. Anybody who reaches
Alertmanager may have made these alerts: what is no fault as the rules make them is skipped.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from types import MappingProxyType

from ros_diagnostics_exporter.faults.model import Fault, Identity, Scope, State, severity_of
from ros_diagnostics_exporter.silences import IDENTITY, Alert, clean, moment

EVIDENCE_LENGTH = 640
# The others are the robot's own.
_OF_FAULT = {*IDENTITY, "alertname", "exporter", "fault"} - {"site"}


def read(alerts: Iterable[Alert], fleet: str, exporter: str) -> list[Fault]:
    """The faults of a fleet that fire; of what is of no robot, those of this exporter's name."""
    found = (_one(alert, fleet, exporter) for alert in alerts)
    return [fault for fault in found if fault is not None]


def _one(alert: Alert, fleet: str, exporter: str) -> Fault | None:
    labels, notes = alert.labels, alert.annotations
    try:
        identity, since = _identity(labels), moment(notes["since"])
    except (KeyError, ValueError):
        return None  # no alert as the rules make them
    is_ours = bool(identity.robot) or labels.get("exporter", "") == exporter
    is_wrong = severity_of(identity) != labels["severity"] or notes.get("end")
    if labels.get("fleet") != fleet or not is_ours or is_wrong or since is None:
        return None
    own = {name: text for name, text in labels.items() if name not in _OF_FAULT}
    lines = (clean(each, EVIDENCE_LENGTH) for each in notes.get("evidence", "").split("\n"))
    known = (
        "\n".join(lines)[:EVIDENCE_LENGTH],
        clean(notes.get("capabilities", ""), EVIDENCE_LENGTH),
    )
    labels_of_robot = MappingProxyType(own if identity.robot else {})
    return Fault(identity, since, alert.starts_at, labels_of_robot, *known)


def _identity(labels: Mapping[str, str]) -> Identity:
    scope, state = Scope(labels["scope"]), State(labels["state"])
    parts = ("robot", "group", "component", "check", "key", "bound")
    named = {name: labels.get(name, "") for name in parts}
    site = labels.get("site", "") if scope is Scope.SITE else ""
    severity = labels["severity"] if state is State.MANY else ""
    if (scope in (Scope.SITE, Scope.COMMON, Scope.EXPORTER)) is bool(named["robot"]):
        raise ValueError("a fault of a robot names one, and no other does")
    return Identity(scope, state, site=site, severity=severity, **named)
