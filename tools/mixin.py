"""What packaging/mixin has beside its jsonnet: rules and dashboards, so that it stands alone."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import yaml

CHECKOUT = Path(__file__).resolve().parents[1]
FOLDER = CHECKOUT / "packaging" / "mixin"
RULES = CHECKOUT / "prometheus" / "rules"


def files() -> dict[Path, str | None]:
    """Each file, in one line; raises ModuleNotFoundError without the dashboards' SDK."""
    from fleet_dashboards import files as dashboards  # noqa: PLC0415 - needs Python 3.11

    boards = FOLDER / "dashboards"
    made = {
        boards / path.name: json.dumps(json.loads(text)) + "\n"
        for path, text in dashboards.files().items()
        if path.suffix == ".json" and text is not None
    }
    former = dict.fromkeys(boards.glob("*.json"))
    return {**former, **made, FOLDER / "rules.json": json.dumps(dict(groups())) + "\n"}


def groups() -> Iterator[tuple[str, list[dict[str, Any]]]]:
    """The groups of each file of rules, by the file's name."""
    for path in sorted(RULES.glob("*.yml")):
        yield path.stem, yaml.safe_load(path.read_text(encoding="utf-8"))["groups"]
