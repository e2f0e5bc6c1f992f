"""soak.png from soak.csv: memory, files and threads over the hours."""

from __future__ import annotations

from pathlib import Path

from experiments import plots, soak_report
from experiments.trend import trend


def draw(folder: Path) -> None:
    """Write soak.png beside soak.csv; the dashed line is the exporter's slope after the warm-up."""
    rows = soak_report.read(folder)
    hours = [row["seconds"] / 3600 for row in rows]
    warm = [n for n, at in enumerate(hours) if at >= soak_report.WARM_UP * hours[-1]]
    programs = ("exporter", "prometheus", "alertmanager")
    with plots.figure(folder / "soak.png", 1, 2) as (memory, files):
        for program, color in zip(programs, plots.COLORS, strict=False):
            used = [row[f"{program}_memory"] for row in rows]
            memory.plot(hours, used, color=color, label=program.capitalize())
        used = [rows[n]["exporter_memory"] for n in warm]
        slope = trend([hours[n] for n in warm], used).slope
        middle = sum(hours[n] for n in warm) / len(warm)
        ends = [hours[warm[0]], hours[-1]]
        level = sum(used) / len(used)
        memory.plot(ends, [level + slope * (at - middle) for at in ends], "--", color=plots.TEXT)
        for column, title, color in (
            ("exporter_files", "open files", plots.COLORS[0]),
            ("exporter_threads", "threads", plots.COLORS[3]),
        ):
            files.plot(hours, [row[column] for row in rows], color=color, label=title)
        plots.label(memory, "hours", "resident memory, MB")
        plots.label(files, "hours", "of the exporter")
        memory.set_ylim(bottom=0)
        files.set_ylim(bottom=0)
