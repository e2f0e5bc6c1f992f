"""The committed dashboards and their queries."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
GRAFANA = ROOT / "grafana"
BOARDS: dict[str, dict[str, Any]] = {
    path.stem: json.loads(path.read_text(encoding="utf-8"))
    for path in sorted((GRAFANA / "dashboards").glob("*.json"))
}


class Query(NamedTuple):
    """One expression, and the panel, annotation or variable that it belongs to."""

    board: str
    place: str  # title of the panel, name of the annotation, "$variable"
    ref: str
    expr: str
    instant: bool
    points: int | None = None  # at most, over the range; None: one per pixel

    def __str__(self) -> str:
        return f"{self.board} / {self.place} / {self.ref}"


def panels(board: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """All panels, also those inside of rows, without the rows."""
    for panel in board["panels"]:
        if panel["type"] == "row":
            yield from panel["panels"]
        else:
            yield panel


def queries() -> Iterator[Query]:
    """Every expression of every dashboard."""
    for uid, board in BOARDS.items():
        for panel in panels(board):
            for target in panel.get("targets", ()):
                yield Query(
                    uid,
                    panel["title"],
                    target["refId"],
                    target["expr"],
                    target["instant"],
                    panel.get("maxDataPoints"),
                )
        for annotation in board["annotations"].get("list", ()):
            yield Query(uid, annotation["name"], "annotation", annotation["expr"], False)
        for variable in board["templating"]["list"]:
            if variable["type"] == "query":
                selector, label = label_values(variable["query"])
                yield Query(
                    uid, f"${variable['name']}", label, f"group by ({label}) ({selector})", True
                )


def label_values(query: str) -> tuple[str, str]:
    """Return the selector and the label of Grafana's query ``label_values(...)``."""
    found = re.fullmatch(r"label_values\((.+), (\w+)\)", query)
    assert found, f"not a label_values() query: {query}"
    return found[1], found[2]


def filled(expr: str, selected: dict[str, str] | None = None) -> str:
    """The expression as Grafana sends it: with the variables' values, All unless ``selected``."""
    values = {
        "state:raw": ">= -1",
        "problems:raw": "== 0",
        "__range": "1h",
        "__rate_interval": "1m",
        "__interval": "15s",
        **(selected or {}),
    }
    return re.sub(
        r"\$\{([\w:]+)\}|\$(?!\d)(\w+)", lambda found: values.get(found[1] or found[2], ".*"), expr
    )
