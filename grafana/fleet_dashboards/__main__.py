"""Write grafana/dashboards/*.json and the tables of docs/dashboards.md: `./run dashboards`."""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable
from pathlib import Path

from grafana_foundation_sdk.cog.encoder import JSONEncoder
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.dashboards import alerts, component, fleet, monitoring, robot
from fleet_dashboards.lib import listing

FOLDER = Path(__file__).resolve().parents[1] / "dashboards"
BOARDS = (fleet.build, robot.build, component.build, alerts.build, monitoring.build)


def built() -> list[dashboard.Dashboard]:
    """Every dashboard, its panels numbered from the top: links to one hold until that changes."""
    boards = [build().build() for build in BOARDS]
    for board in boards:
        for number, panel in enumerate(board.panels or (), start=1):
            panel.id_val = number
    return boards


def as_json(boards: Iterable[dashboard.Dashboard]) -> dict[str, str]:
    """The text of every file by its name, which is the dashboard's uid."""
    return {
        f"{board.uid}.json": json.dumps(
            board, cls=JSONEncoder, indent=2, sort_keys=True, ensure_ascii=False
        )
        + "\n"
        for board in boards
    }


def main() -> None:
    """Write every file, and remove what is no longer built."""
    argparse.ArgumentParser(prog="./run dashboards", description=__doc__).parse_args()
    boards = built()
    FOLDER.mkdir(exist_ok=True)
    files = as_json(boards)
    for name, text in files.items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    for path in FOLDER.glob("*.json"):
        if path.name not in files:
            path.unlink()
    listing.PAGE.write_text(listing.page(boards), encoding="utf-8")
    print(f"{len(files)} dashboards in {FOLDER}, listed in {listing.PAGE}")


if __name__ == "__main__":
    main()
