"""The generated part of docs/dashboards.md: each panel and the question that it answers."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from grafana_foundation_sdk.models import dashboard

PAGE = Path(__file__).resolve().parents[3] / "docs" / "dashboards.md"
MARK = "<!-- from here on written by ./run dashboards -->\n"


def page(boards: Iterable[dashboard.Dashboard]) -> str:
    """The whole page: what is written by hand, up to the mark, and the tables."""
    by_hand, mark, _old = PAGE.read_text(encoding="utf-8").partition(MARK)
    if not mark:
        raise ValueError(f"{PAGE}: the line {MARK!r} is missing; put it where the tables begin")
    return by_hand + mark + "".join(map(_table, boards))


def _table(board: dashboard.Dashboard) -> str:
    rows = [f"\n### {board.title}\n\n{board.description}\n\n| Panel | Answers |\n|---|---|\n"]
    for panel in board.panels or ():
        if isinstance(panel, dashboard.RowPanel):
            continue
        text = (panel.description or "").replace("|", r"\|")
        rows.append(f"| {panel.title} | {text} |\n")
    return "".join(rows)
