"""docs/reference/api.md, from web/openapi.yaml."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.web.app import openapi

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "api.md"
INTRODUCTION = """\
# What the port serves

`./run generate` writes this page; `/api/v1/openapi.json` has it for programs, with all answers. The
exporter's own pages and `ros-diagnostics` use some more paths
([deployment](../deployment.md#what-the-port-serves)).

| path | what | parameters |
|---|---|---|
"""


def files() -> dict[Path, str]:
    """The page."""
    rows = []
    for path, methods in openapi("/metrics")["paths"].items():
        method, described = next(iter(methods.items()))
        call = path if method == "get" else f"{method.upper()} {path}"
        named = [_parameter(each) for each in described.get("parameters", ())]
        cells = (f"`{call}`", described["summary"], "<br>".join(named))
        rows.append(f"| {' | '.join(' '.join(cell.split()) for cell in cells)} |\n")
    return {PAGE: INTRODUCTION + "".join(rows)}


def _parameter(parameter: dict[str, Any]) -> str:
    name = f"`{parameter['name']}`"
    return f"{name}: {parameter['description']}" if "description" in parameter else name
