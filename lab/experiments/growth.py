"""How the cost grows with components, values, message rate and faults, one at a time.

From 50 robots with 16 components of 4 values each, once a second, no fault, every value changing.
The growth with the number of robots is `./run experiment scalability`. The exporter, Prometheus
with the shipped rules, and Alertmanager run; real DDS.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from experiments import plots, results, site
from experiments.results import Results, numbers, table

NAME = "growth"
BASE = site.Workload(50)
SERIES = {  # what grows -> to what
    "components": (4, 16, 64, 256),
    "values": (1, 4, 16, 64),
    "rate": (1, 5, 10, 20, 50),
    "faults": (0, 15, 50, 150),
}
TITLES = {
    "components": "components of a robot",
    "values": "values of a component",
    "rate": "messages a second of a robot",
    "faults": "faults of the fleet",
}
PROGRAMS = ("exporter", "prometheus", "alertmanager")


def cases(names: list[str], at: list[float] | None) -> list[site.Workload]:
    """Return the workloads of some series, each once; ``at``: only those with these values."""
    found = [
        BASE._replace(**{name: value})
        for name in names
        for value in SERIES[name]
        if at is None or value in at
    ]
    return list(dict.fromkeys(found))


def measure(workload: site.Workload, seconds: float) -> Iterator[dict[str, float]]:
    """Yield the one row of a workload."""
    with site.running(workload) as running:
        yield site.measure(running, workload, seconds)


def render(result: Results) -> str:
    """Write the tables and the plot."""
    series = {name: _rows(result, name) for name in SERIES}
    measured = {name: rows for name, rows in series.items() if len(rows) > 1}
    _plot(result, measured)
    return result.write_markdown(*(_table(name, rows) for name, rows in measured.items()))


def _rows(result: Results, name: str) -> list[dict[str, str]]:
    """Return the rows in which only ``name`` differs from the base; the last of each value."""
    others = [each for each in BASE._fields if each != name]
    rows = {
        float(row[name]): row
        for row in result.rows()
        if all(float(row[each]) == getattr(BASE, each) for each in others)
    }
    return [rows[value] for value in sorted(rows)]


def _table(name: str, rows: list[dict[str, str]]) -> list[str]:
    return table(
        rows,
        [
            (TITLES[name], lambda row: f"{float(row[name]):g}"),
            ("DDS payload", lambda row: f"{float(row['payload_rate']):,.0f} kB/s"),
            ("samples", lambda row: f"{float(row['samples']):,.0f}"),
            ("exporter, CPU", lambda row: f"{100 * float(row['exporter_cpu']):.1f} %"),
            ("memory", lambda row: f"{float(row['exporter_memory']):.0f} MB"),
            ("Prometheus, CPU", lambda row: f"{100 * float(row['prometheus_cpu']):.1f} %"),
            ("memory", lambda row: f"{float(row['prometheus_memory']):.0f} MB"),
            ("scrape", lambda row: f"{1e3 * float(row['scrape_seconds']):.0f} ms"),
            ("evaluation", lambda row: f"{1e3 * float(row['evaluation_seconds']):.0f} ms"),
            ("lost", lambda row: f"{row['lost']} of {int(row['messages']):,}"),
        ],
    )


def _plot(result: Results, series: dict[str, list[dict[str, str]]]) -> None:
    with plots.figure(result.path(".png"), 2, 2) as panels:
        for axes, (name, rows) in zip(panels.flat, series.items(), strict=False):
            x = numbers(rows, name)
            for program, color in zip(PROGRAMS, plots.COLORS, strict=False):
                low, high = (numbers(rows, f"{program}_cpu_{end}") for end in ("low", "high"))
                cpu = numbers(rows, f"{program}_cpu")
                plots.line(axes, x, cpu, program.capitalize(), color, spread=(low, high))
            plots.label(axes, TITLES[name], "CPU, cores")
            axes.set_ylim(bottom=0)


def main() -> None:
    """Measure the workloads; write the result."""
    parser = results.parser(NAME, __doc__ or "")
    parser.add_argument("--series", nargs="+", choices=SERIES, default=list(SERIES))
    parser.add_argument("--seconds", type=float, default=30.0, help="measured of each")
    parser.add_argument("--at", type=float, nargs="+", help="only these values of the series")
    options = parser.parse_args()
    work = partial(measure, seconds=options.seconds)
    results.run(
        Results(options.out, NAME), options, cases(options.series, options.at), work, render
    )


if __name__ == "__main__":
    main()
