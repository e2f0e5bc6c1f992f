"""The dashboards as grafana.com takes them: with the keys of an export for others.

python tools/grafana_com.py FOLDER writes them there; packaging/release does. They need no input:
which Prometheus is asked is a variable of each dashboard.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

DASHBOARDS = Path(__file__).parents[1] / "grafana" / "dashboards"


def shared(dashboard: dict[str, Any]) -> dict[str, Any]:
    """A dashboard as the export `for sharing externally` writes it; it says what it requires."""
    return {"__inputs": [], "__elements": {}, "id": None, **dashboard}


def main(folder: Path) -> None:
    """Write all of them."""
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(DASHBOARDS.glob("*.json")):
        dashboard = shared(json.loads(path.read_text(encoding="utf-8")))
        text = json.dumps(dashboard, indent=2, ensure_ascii=False)
        (folder / path.name).write_text(f"{text}\n", encoding="utf-8")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
