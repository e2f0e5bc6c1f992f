"""docs/reference/metrics.md: every family, from metrics/families.py and self_metrics.py."""

from __future__ import annotations

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

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "metrics.md"
_HEAD = """# Families of metrics

Every family that `/metrics` serves, but `process_*`, `python_*` and each `metric` of fleet.yml.
What components, reasons and kinds of faults are: [Metrics](../metrics.md).
`./run generate` writes this page.
"""


def files() -> dict[Path, str]:
    """The page."""
    components = tuple(each for each in FLEET_FAMILIES if _starts(each, COMPONENT))
    robots = tuple(each for each in FLEET_FAMILIES if each not in components)
    tables = (
        _section("Robots", robots, ROBOT),
        _section("Components", components, COMPONENT),
        _section("Faults", FAULT_FAMILIES, EXPORTER),
        _section("The exporter itself", EXPORTER_FAMILIES, EXPORTER),
    )
    return {PAGE: "\n".join((_HEAD, *tables))}


def _section(title: str, families: Sequence[Family], common: Sequence[str]) -> str:
    labels = ", ".join(f"`{label}`" for label in common)
    return f"## {title}\n\nLabels of every family: {labels}.\n\n{_table(families, common)}"


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
