"""What the monitoring of 1 to 3,000 robots costs its server, and how old what it shows is.

Real DDS on this machine; each robot sends 16 components with 4 values each once a second, and every
value changes. The exporter, Prometheus with the shipped rules and intervals, and Alertmanager.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from math import nan
from operator import itemgetter

from experiments import plots, results, site
from experiments.results import Results, numbers, table

NAME = "scalability"
SIZES = (1, 30, 60, 100, 300, 1000, 3000)
PROGRAMS = ("exporter", "prometheus", "alertmanager")
NEVER = 1e8  # seconds: the age of what was last received in 1970
TARGETS = (  # robots, column, what, unit, at most
    (1000, "exporter_cpu", "exporter's CPU", "cores", 0.30),
    (1000, "exporter_memory", "exporter's memory", "MB", 250.0),
    (1000, "lost", "messages lost", "", 0.0),
    (3000, "exporter_cpu", "exporter's CPU", "cores", 1.25),
    (3000, "lost", "messages lost", "", 0.0),
)


def measure(workload: site.Workload, seconds: float) -> Iterator[dict[str, float]]:
    """Yield the one row of a size."""
    with site.running(workload) as running:
        yield site.measure(running, workload, seconds)


def render(result: Results) -> str:
    """Write the tables and the plot."""
    last = {int(row["robots"]): row for row in result.rows()}  # of each size
    rows = [last[robots] for robots in sorted(last)]
    _plot(result, rows)
    goals = targets(rows)
    Results(result.folder, "targets").path(".md").write_text("\n".join([*goals, ""]))
    return result.write_markdown(_usage_table(rows), _latency_table(rows))


def targets(rows: list[dict[str, str]]) -> list[str]:
    """Return a table of the targets, and by how much each is missed."""
    by_size = {int(row["robots"]): row for row in rows}
    lines = []
    for robots, column, what, unit, most in TARGETS:
        if robots not in by_size:
            continue
        value = float(by_size[robots][column])
        if value <= most:
            lost = float(by_size[robots]["lost"]) > 0 and column != "lost"
            verdict = "met, of what was received" if lost else "met"
        else:
            verdict = f"missed: {value / most:.2f} times it" if most else f"missed by {value:,.0f}"
        lines.append(
            {
                "what": f"{what}, {robots:,} robots",
                "target": f"{most:g} {unit}".rstrip(),
                "measured": f"{value:,.6g} {unit}".rstrip(),
                "verdict": verdict,
            }
        )
    columns = [
        ("", "what"),
        ("target, at most", "target"),
        ("measured", "measured"),
        ("", "verdict"),
    ]
    return table(lines, [(name, itemgetter(key)) for name, key in columns])


def _cpu(name: str, row: Mapping[str, str]) -> str:
    mean, low, high = (100 * float(row[f"{name}_cpu{end}"]) for end in ("", "_low", "_high"))
    return f"{mean:.1f} % ({low:.1f} to {high:.1f})"


def _usage_table(rows: list[dict[str, str]]) -> list[str]:
    return table(
        rows,
        [
            ("robots", lambda row: f"{int(row['robots']):,}"),
            ("exporter, CPU", lambda row: _cpu("exporter", row)),
            ("memory", lambda row: f"{float(row['exporter_memory']):.0f} MB"),
            ("Prometheus, CPU", lambda row: _cpu("prometheus", row)),
            ("memory", lambda row: f"{float(row['prometheus_memory']):.0f} MB"),
            ("Alertmanager, CPU", lambda row: _cpu("alertmanager", row)),
            ("memory", lambda row: f"{float(row['alertmanager_memory']):.0f} MB"),
            ("DDS payload", lambda row: f"{float(row['payload_rate']):,.0f} kB/s"),
            ("scrapes", lambda row: f"{float(row['scrape_rate']):,.1f} kB/s"),
        ],
    )


def _latency_table(rows: list[dict[str, str]]) -> list[str]:
    return table(
        rows,
        [
            ("robots", lambda row: f"{int(row['robots']):,}"),
            ("received", lambda row: f"{float(row['up']):,.0f}"),
            ("samples", lambda row: f"{float(row['samples']):,.0f}"),
            ("scrape", lambda row: _milliseconds(row["scrape_seconds"])),
            ("longest", lambda row: _milliseconds(row["scrape_seconds_max"])),
            ("scrape of faults", lambda row: _milliseconds(row["faults_scrape_seconds"])),
            ("evaluation of all rules", lambda row: _milliseconds(row["evaluation_seconds"])),
            (
                "age of what is shown, p50, p95, max",
                lambda row: ", ".join(_age(row[f"age_{end}"]) for end in ("p50", "p95", "max")),
            ),
            ("messages", lambda row: f"{int(row['messages']):,}"),
            ("lost", lambda row: row["lost"]),
            ("scrapes failed", lambda row: f"{float(row['scrapes_failed']):.0f}"),
        ],
    )


def _age(seconds: str) -> str:
    return "never received" if float(seconds) > NEVER else f"{float(seconds):.1f} s"


def _milliseconds(seconds: str) -> str:
    return f"{1e3 * float(seconds):,.0f} ms"


def _plot(result: Results, rows: list[dict[str, str]]) -> None:
    robots = numbers(rows, "robots")
    with plots.figure(result.path(".png"), 2, 2) as ((cpu, memory), (latency, age)):
        for program, color in zip(PROGRAMS, plots.COLORS, strict=False):
            shares = numbers(rows, f"{program}_cpu")
            low, high = (numbers(rows, f"{program}_cpu_{end}") for end in ("low", "high"))
            plots.line(cpu, robots, shares, program.capitalize(), color, spread=(low, high))
            plots.line(
                memory, robots, numbers(rows, f"{program}_memory"), program.capitalize(), color
            )
        for column, label, color in (
            ("scrape_seconds", "scrape", plots.COLORS[0]),
            ("evaluation_seconds", "evaluation of all rules", plots.COLORS[1]),
        ):
            plots.line(latency, robots, numbers(rows, column), label, color)
        for end, color in zip(("p50", "p95", "max"), plots.COLORS, strict=False):
            ages = [each if each < NEVER else nan for each in numbers(rows, f"age_{end}")]
            plots.line(age, robots, ages, end, color)
        plots.label(cpu, "robots", "CPU, cores", log=True)
        cpu.set_ylim(bottom=1e-3)
        plots.label(memory, "robots", "resident memory, MB", logx=True)
        memory.set_ylim(bottom=0)
        plots.label(latency, "robots", "duration, s", log=True)
        plots.label(age, "robots", "age of what is shown, s", logx=True)
        age.set_ylim(bottom=0)


def main() -> None:
    """Measure the sizes; write the result."""
    parser = results.parser(NAME, __doc__ or "")
    parser.add_argument("--sizes", type=int, nargs="+", default=SIZES, help="numbers of robots")
    parser.add_argument("--seconds", type=float, default=60.0, help="measured of each size")
    options = parser.parse_args()
    cases = [site.Workload(robots) for robots in options.sizes]
    results.run(
        Results(options.out, NAME),
        options,
        cases,
        lambda case: measure(case, options.seconds),
        render,
    )


if __name__ == "__main__":
    main()
