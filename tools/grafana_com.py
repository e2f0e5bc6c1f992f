"""The dashboards as grafana.com takes them: with what they require, as in an export for others.

python tools/grafana_com.py FOLDER writes them there; packaging/release does. They need no input:
which Prometheus is asked is a variable of each dashboard.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

DASHBOARDS = Path(__file__).parents[1] / "grafana" / "dashboards"
GRAFANA = "9.5.0"  # the oldest that shows them: docs/dashboards.md


def shared(dashboard: dict[str, Any]) -> dict[str, Any]:
    """A dashboard with what it requires, as the export `for sharing externally` writes it."""
    required = [
        {"type": "grafana", "id": "grafana", "name": "Grafana", "version": GRAFANA},
        {"type": "datasource", "id": "prometheus", "name": "Prometheus", "version": "1.0.0"},
        *(
            {"type": "panel", "id": kind, "name": kind, "version": ""}
            for kind in sorted(set(_panel_types(dashboard["panels"])))
        ),
    ]
    return {"__inputs": [], "__elements": {}, "__requires": required, "id": None, **dashboard}


def _panel_types(panels: list[dict[str, Any]]) -> Iterator[str]:
    for each in panels:
        if each["type"] != "row":
            yield each["type"]
        yield from _panel_types(each.get("panels", []))


def main(folder: Path) -> None:
    """Write all of them."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(DASHBOARDS.glob("*.json")):
        dashboard = shared(json.loads(path.read_text(encoding="utf-8")))
        text = json.dumps(dashboard, indent=2, ensure_ascii=False)
        (folder / path.name).write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
