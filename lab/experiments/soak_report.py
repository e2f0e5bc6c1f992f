"""soak.md from soak.csv: the slope of each quantity, what was lost."""

from __future__ import annotations

import csv
import json
from pathlib import Path

from experiments.trend import trend

WARM_UP = 0.25  # of the time
QUANTITIES = (  # column, what it is, unit
    ("exporter_memory", "exporter, resident memory", "MB"),
    ("exporter_files", "exporter, open files", ""),
    ("exporter_threads", "exporter, threads", ""),
    ("exporter_database", "exporter, database", "MB"),
    ("exporter_wal", "exporter, write-ahead log", "MB"),
    ("prometheus_memory", "Prometheus, resident memory", "MB"),
    ("prometheus_files", "Prometheus, open files", ""),
    ("alertmanager_memory", "Alertmanager, resident memory", "MB"),
    ("alertmanager_files", "Alertmanager, open files", ""),
    ("robots_memory", "virtual robots, resident memory", "MB"),
)


def read(folder: Path) -> list[dict[str, float]]:
    """Return the rows of soak.csv."""
    with (folder / "soak.csv").open(newline="") as file:
        return [{name: float(value) for name, value in row.items()} for row in csv.DictReader(file)]


def write(folder: Path) -> str:
    """Write soak.md beside soak.csv; return its text."""
    rows = read(folder)
    about = json.loads((folder / "soak.json").read_text())
    text = "\n".join([*_slopes(rows), "", *_counts(rows), "", *_about(about), ""])
    (folder / "soak.md").write_text(text)
    return text


def _slopes(rows: list[dict[str, float]]) -> list[str]:
    end = rows[-1]["seconds"]
    warm = [row for row in rows if row["seconds"] >= WARM_UP * end]
    hours = [row["seconds"] / 3600 for row in warm]
    lines = [
        f"| | after {WARM_UP * end / 3600:.2f} h | at {end / 3600:.2f} h | most | slope an hour |",
        "|---|---|---|---|---|",
    ]
    for column, what, unit in QUANTITIES:
        values = [row[column] for row in warm]
        found = trend(hours, values)
        digits = ".1f" if unit else ".0f"
        numbers = " | ".join(
            f"{each:{digits}} {unit}".rstrip() for each in (values[0], values[-1], max(values))
        )
        lines.append(
            f"| {what} | {numbers} | {found.slope:+.2f} ± {found.margin:.2f} {unit}".rstrip() + " |"
        )
    return lines


def _counts(rows: list[dict[str, float]]) -> list[str]:
    first, last = rows[0], rows[-1]
    seconds = last["seconds"] - first["seconds"]
    shares = ", ".join(
        f"{name} {(last[f'{name}_cpu'] - first[f'{name}_cpu']) / seconds:.1%}"
        for name in ("exporter", "prometheus", "alertmanager", "robots")
    )
    messages = (
        f"- {last['messages']:,.0f} messages received, {last['rejected']:.0f} rejected;"
        f" {last['lost']:.0f} lost of the robots that never stop publishing"
    )
    scrapes = (
        f"- {last['scrapes']:,.0f} scrapes by the client, {last['scrapes_failed']:.0f} failed, the"
        f" longest {last['scrape_longest']:.2f} s; {last['prometheus_scrapes']:,.0f} by Prometheus,"
        f" {last['prometheus_failed']:.0f} failed"
    )
    mails = (
        f"- {last['mails_problem']:.0f} mails about problems, {last['mails_recovery']:.0f} about"
        f" recoveries; {last['faults']:.0f} faults at the end; {last['reloads']:.0f} reloads"
    )
    return [messages, scrapes, mails, f"- CPU, of one core: {shares}"]


def _about(about: dict[str, object]) -> list[str]:
    return ["Measured on: " + "; ".join(f"{name} {value}" for name, value in about.items()) + "."]
