"""The landing page: the fleet at a glance, readable on a phone, nothing loaded from elsewhere."""

from __future__ import annotations

from html import escape
from typing import Any

from ros_diagnostics_exporter import __version__


def landing(fleet: dict[str, Any], telemetry_path: str) -> str:
    """The page for ``fleet``, which is what /api/v1/fleet answers; all of it is escaped."""
    rows = "".join(f"<li>{escape(robot['robot'])}</li>" for robot in fleet["robots"])
    return (
        "<!doctype html><title>ROS diagnostics exporter</title>"
        f"<h1>{escape(fleet['fleet'])}</h1><p>ROS diagnostics exporter {__version__}</p>"
        f'<p><a href="{escape(telemetry_path)}">Metrics</a></p><ul>{rows}</ul>'
    )
