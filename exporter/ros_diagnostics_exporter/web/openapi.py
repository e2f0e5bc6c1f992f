"""The description of the HTTP interface: openapi.yaml beside this file, with the metrics' path."""

from __future__ import annotations

from functools import cache
from importlib import resources
from typing import Any

import yaml

from ros_diagnostics_exporter import __version__


@cache
def describe(telemetry_path: str) -> dict[str, Any]:
    """The OpenAPI description of a server whose metrics are at ``telemetry_path``."""
    text = (resources.files(__package__) / "openapi.yaml").read_text("utf-8")
    description: dict[str, Any] = yaml.safe_load(text)
    description["info"]["version"] = __version__
    paths = description["paths"]
    metrics = paths.pop("/metrics")
    if telemetry_path == "/":
        paths.pop("/")  # the metrics stand in the landing page's place
    paths[telemetry_path] = metrics
    return description
