"""grafana/dashboards/*.json and docs/reference/panels.md, for `./run generate`."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path

from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.dashboards import (
    alerts,
    component,
    fleet,
    missions,
    monitoring,
    robot,
    week,
)

FOLDER = Path(__file__).resolve().parents[1] / "dashboards"
PAGE = Path(__file__).resolve().parents[2] / "docs" / "reference" / "panels.md"
INTRODUCTION = """\
# Panels

The question that each panel of the [dashboards](../dashboards.md) answers; one that several have is
listed once. `./run generate` writes this page.
"""
BUILDERS = (
    fleet.build,
    robot.build,
    component.build,
    alerts.build,
    week.build,
    missions.build,
    monitoring.build,
)


def files() -> dict[Path, str | None]:
    """Return what each file is to hold; those of dashboards that no longer exist: None."""
    boards = build_all()
    built = {FOLDER / name: text for name, text in as_json(boards).items()}
    return {**dict.fromkeys(FOLDER.glob("*.json")), **built, PAGE: docs_page(boards)}


def build_all() -> list[dashboard.Dashboard]:
    """Return all dashboards, with their panels numbered from the top."""
    boards = [build().build() for build in BUILDERS]
    for board in boards:
        for number, panel in enumerate(_with_rows(board), start=1):
            panel.id_val = number
    return boards


def _with_rows(board: dashboard.Dashboard) -> Iterator[dashboard.Panel | dashboard.RowPanel]:
    """Return rows and panels from the top; those of a collapsed row are inside of it."""
    for panel in board.panels or ():
        yield panel
        if isinstance(panel, dashboard.RowPanel):
            yield from panel.panels


def as_json(boards: Iterable[dashboard.Dashboard]) -> dict[str, str]:
    """Return the text of each JSON file by its name, which is the dashboard's uid."""
    return {
        f"{board.uid}.json": json.dumps(
            {**board.to_json(), "__requires": _required(board)},
            cls=JSONEncoder,
            indent=2,
            sort_keys=True,
            ensure_ascii=False,
        )
        + "\n"
        for board in boards
    }


LEAST_GRAFANA = "9.5.0"


def _required(board: dashboard.Dashboard) -> list[dict[str, str]]:
    """Return what Grafana tells who imports a dashboard by hand: the parts that it needs."""
    types = {
        panel.type_val for panel in _with_rows(board) if not isinstance(panel, dashboard.RowPanel)
    }
    parts = [("grafana", "grafana", LEAST_GRAFANA), ("datasource", "prometheus", "1.0.0")]
    parts += [("panel", each, "") for each in sorted(types)]
    return [
        {"type": kind, "id": identity, "name": identity.capitalize(), "version": version}
        for kind, identity, version in parts
    ]


def docs_page(boards: Iterable[dashboard.Dashboard]) -> str:
    """Return docs/reference/panels.md."""
    seen: set[str] = set()
    return INTRODUCTION + "".join(_panel_table(board, seen) for board in boards)


def _panel_table(board: dashboard.Dashboard, seen: set[str]) -> str:
    """The question of each panel, but of those that a dashboard before has, too."""
    rows = [f"\n## {board.title}\n\n{board.description}\n\n| Panel | Answers |\n|---|---|\n"]
    for panel in _with_rows(board):
        if isinstance(panel, dashboard.RowPanel):
            continue
        description = (panel.description or "").replace("|", r"\|")
        if description not in seen:
            seen.add(description)
            rows.append(f"| {panel.title} | {description.partition('?')[0]}? |\n")
    return "".join(rows)
