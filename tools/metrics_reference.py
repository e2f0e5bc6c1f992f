"""The tables of docs/metrics.md, from metrics/families.py.

They are between `<!-- families of robots -->` and `<!-- end -->`; the rest is written by hand.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from pathlib import Path

from ros_diagnostics_exporter.metrics.families import (
    COMPONENT,
    EXPORTER,
    FAULT_FAMILIES,
    FLEET_FAMILIES,
    ROBOT,
    Family,
)
from ros_diagnostics_exporter.metrics.self_metrics import EXPORTER_FAMILIES

PAGE = Path(__file__).resolve().parents[1] / "docs" / "metrics.md"
_BLOCK = re.compile(r"(<!-- families of (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)


def files() -> dict[Path, str]:
    """The page with up-to-date tables."""
    return {PAGE: updated(PAGE.read_text(encoding="utf-8"))}


def updated(document: str) -> str:
    """The document with up-to-date tables.

    Raises:
        ValueError: A table is missing, or there is one too many.
    """
    components = tuple(each for each in FLEET_FAMILIES if _starts(each, COMPONENT))
    robots = tuple(each for each in FLEET_FAMILIES if each not in components)
    tables = {
        "robots": _table(robots, ROBOT),
        "components": _table(components, COMPONENT),
        "faults": _table(FAULT_FAMILIES, EXPORTER),
        "exporter": _table(EXPORTER_FAMILIES, EXPORTER),
    }
    named = [match[2] for match in _BLOCK.finditer(document)]
    if sorted(named) != sorted(tables):
        raise ValueError(f"the document has tables for {sorted(named)}, not for {sorted(tables)}")
    return _BLOCK.sub(lambda match: match[1] + tables[match[2]] + match[3], document)


def _starts(family: Family, labels: tuple[str, ...]) -> bool:
    return family.labels[: len(labels)] == labels


def _table(families: Iterable[Family], common: Sequence[str]) -> str:
    rows = ["| family | type | further labels | meaning |", "|---|---|---|---|"]
    for family in families:
        labels = [f"`{label}`" for label in family.labels if label not in common]
        labels += ["those of fleet.yml"] if family.open else []
        cells = (f"`{family.name}`", family.type, ", ".join(labels), family.help)
        rows.append("| " + " | ".join(cell.replace("|", r"\|") for cell in cells) + " |")
    return "\n".join(rows) + "\n"
