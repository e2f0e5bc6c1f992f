"""Silences of ros-diagnostics-ack as Alertmanager lists them."""

from __future__ import annotations

from datetime import datetime, timezone

from ros_diagnostics_exporter.alertmanager import Acknowledgement
from ros_diagnostics_exporter.cli.ack import silence

SINCE = "2026-01-01 10:00:00.123 +0000 UTC"
BEGAN = 1767261600.123
MADE = datetime(2026, 1, 1, 10, 5, tzinfo=timezone.utc)
MOTOR = Acknowledgement(
    "r",
    "/Motor",
    "Motor 1",
    "critical",
    BEGAN,
    "ann",
    "spare part ordered",
    1767261900.25,
    1769853900.25,
)


def listed(*, robot: str = "r", component: str | None = "Motor 1", since: str = SINCE, **changes):
    """A silence that the command made, as Alertmanager lists it."""
    labels = {"fleet": "f", "robot": robot}
    if component is not None:
        labels |= {"group": "/Motor", "component": component, "state": "critical"}
    labels |= changes.pop("labels", {})
    alert = {"labels": labels, "annotations": {"since": since}}
    made = silence(alert, "ann", "spare part ordered", MADE, 30)
    made |= {
        "id": "0",
        "status": {"state": "active"},
        "startsAt": "2026-01-01T10:05:00.250Z",
        "endsAt": "2026-01-31T10:05:00.250Z",
    }
    return made | changes
