"""Which runbook of docs/alerts is that of a fault."""

from __future__ import annotations

# (scope, state) -> the alert of such a fault, without its prefix; "" is any state of the scope.
_ALERTS = {
    ("component", "critical"): "ComponentCritical",
    ("component", "warning"): "ComponentWarning",
    ("component", "stale"): "ComponentStale",
    ("value", "critical"): "ValueCritical",
    ("value", "warning"): "ValueWarning",
    ("value", "falling"): "ValueFalling",
    ("check", ""): "CheckShort",
    ("capability", "lost"): "CapabilityLost",
    ("capability", "degraded"): "CapabilityDegraded",
    ("capability", "no_reserve"): "CapabilityNoReserve",
    ("flapping", "flapping"): "ComponentFlapping",
    ("flapping", "intermittent"): "ComponentIntermittent",
    ("robot", "many"): "ManyComponents",
    ("robot", "silent"): "RobotSilent",
    ("robot", "pending"): "RobotPending",
    ("robot", "flapping"): "RobotFlapping",
    ("robot", "clock"): "ClockOffset",
    ("site", ""): "FleetPartDown",
    ("common", ""): "CommonCause",
    ("exporter", ""): "ExporterFault",
}


def alert_of(scope: str, state: str) -> str:
    """The alert that fires for a fault, by whose name its runbook is; "" where none does."""
    name = _ALERTS.get((scope, state)) or _ALERTS.get((scope, ""))
    return f"RosDiagnostics{name}" if name else ""
