"""Where Nagios saturates: the distribution's nagios4 with two services of each robot every minute.

Two ways to check: `subscriber`, as in the 2014 thesis, starts a ROS process for each check, which
waits for one message of the robot; `exporter` asks the exporter with check_ros_diagnostics. All
robots are well, so each service that is not OK is a false alarm. The exporter's own cost for the
same number of robots is that of `./run experiment scalability`.
"""

from __future__ import annotations

import os
import re
import statistics
import threading
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from bench.sim import cpu_seconds
from experiments import nagios_fleet, plots, results
from experiments.nagios_fleet import WAYS, NagiosFleet
from experiments.results import Results, numbers, table
from testbed.polling import until
from testbed.processes import Process

NAME = "nagios"
INTERVAL = 60  # seconds between two checks of a service
SERVICES = {"motors": "Motor", "batteries": "Battery"}
MEASURED = 60.0  # seconds: each service is due once
TICKS = os.sysconf("SC_CLK_TCK")
TITLES = {"subscriber": "a subscriber for each check", "exporter": "asking the exporter"}


class Case(NamedTuple):
    """One way to check so many robots."""

    way: str
    robots: int


def services(folder: Path) -> list[dict[str, str]]:
    """Return the services in Nagios' status file."""
    path = folder / "status.dat"
    text = path.read_text() if path.exists() else ""
    return [
        dict(line.strip().partition("=")[::2] for line in block.splitlines())
        for block in re.findall(r"servicestatus \{(.*?)\n\t\}", text, re.DOTALL)
    ]


def session_cpu(session: int) -> float:
    """Return CPU seconds of the processes of a session, and of their children that have ended."""
    ticks = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            fields = stat.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        if int(fields[3]) == session:
            ticks += sum(int(each) for each in fields[11:15])
    return ticks / TICKS


def measure(case: Case) -> Iterator[dict[str, float | str]]:
    """Run Nagios for two intervals; yield what it did in the second."""
    with nagios_fleet.running(case.robots, case.way) as fleet:
        nagios = nagios_fleet.nagios(fleet, case.robots, SERVICES, interval=INTERVAL)
        nagios.start()
        try:
            yield _observe(case, fleet, nagios)
        finally:
            nagios.stop()


def _observe(case: Case, fleet: NagiosFleet, nagios: Process) -> dict[str, float | str]:
    pause, folder = threading.Event(), fleet.folder / "nagios"
    until(lambda: services(folder), "Nagios' status file", 60)
    pause.wait(INTERVAL + 10)  # the first checks, spread over a minute
    began, clock = time.time(), time.monotonic()
    others = [each for each in (fleet.robots, fleet.exporter) if each is not None]
    used = [session_cpu(nagios.pid), *(cpu_seconds(each.pid) for each in others)]
    running, false = [], 0
    while time.monotonic() - clock < MEASURED:
        pause.wait(5.0)
        running.append(_checks_running(nagios.pid))
        false = max(false, sum(each["current_state"] != "0" for each in services(folder)))
    seconds = time.monotonic() - clock
    now = [session_cpu(nagios.pid), *(cpu_seconds(each.pid) for each in others)]
    cpu = [(after - before) / seconds for after, before in zip(now, used, strict=True)]
    found = services(folder)
    checked = [each for each in found if float(each["last_check"]) >= began]
    latencies = [float(each["check_latency"]) for each in checked] or [float("nan")]
    durations = [float(each["check_execution_time"]) for each in checked] or [float("nan")]
    return {
        **case._asdict(),
        "services": len(found),
        "checked": len(checked),
        "false_alarms": false,
        "nagios_cpu": round(cpu[0], 4),
        "robots_cpu": round(cpu[1], 4),
        "exporter_cpu": round(cpu[2], 4) if fleet.exporter else "",
        "check_cpu": round(cpu[0] * seconds / max(1, len(checked)), 4),
        "latency_median": round(statistics.median(latencies), 2),
        "latency_max": round(max(latencies), 2),
        "execution_median": round(statistics.median(durations), 2),
        "execution_max": round(max(durations), 2),
        "running_max": max(running),
    }


def _checks_running(session: int) -> int:
    """Return how many processes of the session are checks: neither Nagios nor its workers."""
    found = 0
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, _, rest = stat.read_text().partition("(")[2].rpartition(")")
        except OSError:
            continue
        found += int(rest.split()[3]) == session and not name.startswith("nagios")
    return found


def render(result: Results) -> str:
    """Write the table and the plot."""
    rows = sorted(result.rows(), key=lambda row: (row["way"], int(row["robots"])), reverse=False)
    rows.sort(key=lambda row: WAYS.index(row["way"]))
    _plot(result, rows)
    return result.write_markdown(_table(rows))


def _table(rows: list[dict[str, str]]) -> list[str]:
    def on_time(row: Mapping[str, str]) -> str:
        return f"{row['checked']} of {row['services']}"

    return table(
        rows,
        [
            ("Nagios", lambda row: TITLES[row["way"]]),
            ("robots", lambda row: row["robots"]),
            ("services checked in a minute", on_time),
            ("not OK at the worst moment", lambda row: row["false_alarms"]),
            (
                "CPU of Nagios and its checks",
                lambda row: f"{float(row['nagios_cpu']):.2f} cores",
            ),
            ("of one check", _check_cpu),
            ("CPU of the robots", lambda row: f"{float(row['robots_cpu']):.2f} cores"),
            (
                "a check takes, median and most",
                lambda row: _two(row["execution_median"], row["execution_max"]),
            ),
            (
                "begins late by, median and most",
                lambda row: _two(row["latency_median"], row["latency_max"]),
            ),
            ("checks at once", lambda row: row["running_max"]),
        ],
    )


def _check_cpu(row: Mapping[str, str]) -> str:
    return f"{1e3 * float(row['check_cpu']):.0f} ms" if int(row["checked"]) else "none ended"


def _two(median: str, most: str) -> str:
    return "" if median == "nan" else f"{median}, {most} s"


def _plot(result: Results, rows: list[dict[str, str]]) -> None:
    with plots.figure(result.path(".png"), 1, 2) as (cpu, checked):
        for way, color in zip(WAYS, plots.COLORS, strict=False):
            of_way = [row for row in rows if row["way"] == way]
            if not of_way:
                continue
            title = f"Nagios, {TITLES[way]}"
            robots, ended = numbers(of_way, "robots"), numbers(of_way, "checked")
            share = [100 * a / b for a, b in zip(ended, numbers(of_way, "services"), strict=True)]
            plots.line(cpu, robots, numbers(of_way, "nagios_cpu"), title, color)
            plots.line(checked, robots, share, title, color)
        _plot_exporter(result, cpu)
        plots.label(cpu, "robots, two services each, every minute", "CPU, cores")
        plots.label(checked, "robots", "services checked in a minute, %")
        cpu.set_ylim(bottom=0)
        checked.set_ylim(0, 105)


def _plot_exporter(result: Results, axes: object) -> None:
    """Add what the exporter, Prometheus and Alertmanager use, where that was measured."""
    other = Results(result.folder, "scalability")
    most = max(numbers(result.rows(), "robots"))
    rows = sorted(other.rows(), key=lambda row: int(row["robots"]))
    rows = [row for row in rows if int(row["robots"]) <= most]
    if not rows:
        return
    parts = ("exporter_cpu", "prometheus_cpu", "alertmanager_cpu")
    total = [sum(float(row[part]) for part in parts) for row in rows]
    plots.line(
        axes, numbers(rows, "robots"), total, "exporter, Prometheus, Alertmanager", plots.COLORS[2]
    )


def main() -> None:
    """Measure the cases; write the result."""
    parser = results.parser(NAME, __doc__ or "")
    parser.add_argument("--sizes", type=int, nargs="+", default=(10, 30, 60, 100, 200))
    parser.add_argument("--ways", nargs="+", choices=WAYS, default=WAYS)
    options = parser.parse_args()
    cases = [Case(way, robots) for way in options.ways for robots in options.sizes]
    results.run(Results(options.out, NAME), options, cases, measure, render)


if __name__ == "__main__":
    main()
