"""The committed dashboards and their queries."""

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
                ref, expr = of_variable(variable)
                yield Query(uid, f"${variable['name']}", ref, expr, True)


def of_variable(variable: dict[str, Any]) -> tuple[str, str]:
    """Return the label and the PromQL of Grafana's query ``label_values(...)`` or another."""
    if found := re.fullmatch(r"label_values\((.+), (\w+)\)", variable["query"]):
        return found[2], f"group by ({found[2]}) ({found[1]})"
    found = re.fullmatch(r"query_result\((.+)\)", variable["query"])  # as Grafana: on one line
    assert found, f"not a query that Grafana knows: {variable['query']}"
    return variable["name"], found[1]


def filled(expr: str, selected: dict[str, str] | None = None) -> str:
    """The expression as Grafana sends it: with the variables' values, All unless ``selected``."""
    values = {
        "state": ">= -1",
        "wall": "no site",
        "problems": "== 0",
        "target": "99",
        "__range": "1h",
        "__rate_interval": "1m",
        "__interval": "15s",
        **(selected or {}),
    }
    formatted = r"\$\{(?!\d)(\w+)(?::(\w+))?\}|\$(?!\d)(\w+)"  # $1 and ${1} are label_replace()'s

    def value(found: re.Match[str]) -> str:
        name = found[1] or found[3]
        return escape(values[name], found[2]) if name in values else ".*"

    return re.sub(formatted, value, expr)


def escape(text: str, style: str | None) -> str:
    """A value in one of Grafana's formats: "regex" is a literal in a regular expression."""
    return re.sub(r"[\\^$*+?.()|\[\]{}/]", r"\\\g<0>", text) if style == "regex" else text
