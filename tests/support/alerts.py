"""Alerts sent to an Alertmanager, as Prometheus sends them."""

import json
import urllib.request
from typing import Any

LONG_AGO = "2026-01-01T00:00:00Z"


def fault(component: str, state: str = "critical", **more: str) -> dict[str, Any]:
    """The alert of a component of the robot r1, as the rules make it, with more labels."""
    name = f"RosDiagnosticsComponent{state.title()}"
    of = {"fleet": "f", "robot": "r1", "component": component, "scope": "component"}
    return {"labels": {"alertname": name, **of, "state": state, "severity": state, **more}}


def post_alerts(address: str, *alerts: dict[str, Any], resolved: bool = False) -> None:
    """Send the alerts, firing or resolved."""
    end = {"endsAt": LONG_AGO} if resolved else {}
    body = json.dumps([{**alert, **end} for alert in alerts]).encode()
    header = {"Content-Type": "application/json"}
    request = urllib.request.Request(f"http://{address}/api/v2/alerts", body, header)
    urllib.request.urlopen(request, timeout=10).close()


def reload(address: str) -> None:
    """Reload the configuration of a server."""
    request = urllib.request.Request(f"http://{address}/-/reload", b"")
    urllib.request.urlopen(request, timeout=10).close()
