"""Silences of ros-diagnostics ack as Alertmanager lists them."""

from datetime import datetime, timezone

from ros_diagnostics_exporter.acknowledging import Acknowledgeable, silence
from ros_diagnostics_exporter.faults.model import Fault, Identity, Scope, State
from ros_diagnostics_exporter.silences import Acknowledgement, identity_of

SINCE = "2026-01-01 10:00:00.123 +0000 UTC"
BEGAN = 1767261600.123
MADE = datetime(2026, 1, 1, 10, 5, tzinfo=timezone.utc)
LABELS = {
    "fleet": "f",
    "scope": "component",
    "state": "critical",
    "severity": "critical",
    "robot": "r",
    "group": "/Motor",
    "component": "Motor 1",
}
MOTOR = Acknowledgement(
    identity_of(LABELS), BEGAN, "ann", "spare part ordered", 1767261900.25, 1769853900.25
)
FAULT = Fault(
    Identity(Scope.COMPONENT, State.CRITICAL, robot="r", group="/Motor", component="Motor 1"),
    BEGAN,
    BEGAN + 10,
    {},
    "hot",
)


def listed(*, since: str = SINCE, labels: dict[str, str] | None = None, **changes):
    """A silence that the command made, as Alertmanager lists it; empty labels are left out."""
    named = {name: text for name, text in (LABELS | (labels or {})).items() if text}
    problem = Acknowledgeable({"alertname": "Any", **named}, since)
    made = silence(problem, "ann", "spare part ordered", MADE, 30 * 86_400.0)
    made |= {
        "id": "0",
        "status": {"state": "active"},
        "startsAt": "2026-01-01T10:05:00.250Z",
        "endsAt": "2026-01-31T10:05:00.250Z",
    }
    return made | changes
