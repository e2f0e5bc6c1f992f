"""The dashboards as they are committed, and what they ask Prometheus."""

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


class Question(NamedTuple):
    """One expression, and where it stands: a panel, an annotation or a variable."""

    board: str
    place: str
    ref: str
    expr: str
    instant: bool
    points: int | None = None  # at most so many over the range; None: one a pixel

    def __str__(self) -> str:
        return f"{self.board} / {self.place} / {self.ref}"


def panels(board: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """All panels, those inside of rows too; not the rows."""
    for panel in board["panels"]:
        if panel["type"] == "row":
            yield from panel["panels"]
        else:
            yield panel


def questions() -> Iterator[Question]:
    """Every expression of every dashboard."""
    for uid, board in BOARDS.items():
        for panel in panels(board):
            for target in panel.get("targets", ()):
                yield Question(
                    uid,
                    panel["title"],
                    target["refId"],
                    target["expr"],
                    target["instant"],
                    panel.get("maxDataPoints"),
                )
        for annotation in board["annotations"].get("list", ()):
            yield Question(uid, annotation["name"], "annotation", annotation["expr"], False)
        for variable in board["templating"]["list"]:
            if variable["type"] == "query":
                selector, label = label_values(variable["query"])
                yield Question(
                    uid, f"${variable['name']}", label, f"group by ({label}) ({selector})", True
                )


def label_values(query: str) -> tuple[str, str]:
    """Split what Grafana calls a label_values query into its selector and its label."""
    found = re.fullmatch(r"label_values\((.+), (\w+)\)", query)
    assert found, f"a variable that is no label_values(): {query}"
    return found[1], found[2]


def filled(expr: str, chosen: dict[str, str] | None = None) -> str:
    """The expression as Grafana sends it: variables filled in, all chosen unless ``chosen``."""
    values = {
        "state:raw": ">= -1",
        "problems:raw": "== 0",
        "__range": "1h",
        "__rate_interval": "1m",
        "__interval": "15s",
        **(chosen or {}),
    }
    return re.sub(
        r"\$\{([\w:]+)\}|\$(?!\d)(\w+)", lambda found: values.get(found[1] or found[2], ".*"), expr
    )
