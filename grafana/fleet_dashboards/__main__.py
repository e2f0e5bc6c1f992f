"""Write grafana/dashboards/*.json: `./run dashboards`."""

from __future__ import annotations

import argparse
import json
from pathlib import Path

from grafana_foundation_sdk.cog.encoder import JSONEncoder

from fleet_dashboards import alerts, component, fleet, monitoring, robot

FOLDER = Path(__file__).resolve().parents[1] / "dashboards"
BOARDS = (fleet.build, robot.build, component.build, alerts.build, monitoring.build)


def built() -> dict[str, str]:
    """Every dashboard's JSON by the name of its file, which is its uid."""
    boards = [build().build() for build in BOARDS]
    for board in boards:
        # Numbered from the top, so that links to one panel hold until the order changes.
        for number, panel in enumerate(board.panels or (), start=1):
            panel.id_val = number
    return {
        f"{board.uid}.json": json.dumps(
            board, cls=JSONEncoder, indent=2, sort_keys=True, ensure_ascii=False
        )
        + "\n"
        for board in boards
    }


def main() -> None:
    """Write what is not as it should be, and remove what is no longer built."""
    argparse.ArgumentParser(prog="./run dashboards", description=__doc__).parse_args()
    FOLDER.mkdir(exist_ok=True)
    files = built()
    for name, text in files.items():
        (FOLDER / name).write_text(text, encoding="utf-8")
    for path in FOLDER.glob("*.json"):
        if path.name not in files:
            path.unlink()
    print(f"{len(files)} dashboards in {FOLDER}")


if __name__ == "__main__":
    main()
