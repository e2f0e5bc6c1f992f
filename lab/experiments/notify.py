"""How long a fault takes to reach the operator, here and with Nagios.

`here`: the exporter, Prometheus and Alertmanager as shipped (confirm_after 10 s); each fault is
timed on DDS, in the exporter, in Prometheus, at Alertmanager and in the mail server, as in
`./run bench notify`. `nagios`: nagios4 with check_ros_diagnostics, 4 attempts, the same interval
between checks and between attempts; timed from the fault to Nagios' notification command. Its
delay is computed too: evenly distributed between 3 and 4 intervals.
"""

from __future__ import annotations

import itertools
import random
import subprocess
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from operator import itemgetter
from pathlib import Path
from statistics import median, quantiles
from typing import NamedTuple

from bench.notify import MOTOR, STEPS
from bench.notify import measure as measure_faults
from experiments import nagios_fleet, plots, results
from experiments.results import Results, table
from testbed import domains, programs
from testbed.polling import until
from testbed.stack import Plan, running

NAME = "notify"
ATTEMPTS = 4
COMPUTED = (300, 60, 10)  # seconds between two checks
COLUMNS = [step.replace("'", "").replace(" ", "_") for step in STEPS]
SHOWN = ("confirmed by the exporter", "scraped", "alert fires", "email received")
CHECKS_SETTLE = 20.0  # seconds in which Nagios checks everything for the first time


class Case(NamedTuple):
    """Some faults of a fleet; ``interval`` is that of Nagios, 0 for here."""

    robots: int
    faults: int  # at a time
    rounds: int
    interval: int = 0


def measure(case: Case, seed: int) -> Iterator[dict[str, float | str]]:
    """Yield a row for each fault: seconds from the fault to each step."""
    random.seed(seed)
    yield from _nagios(case) if case.interval else _here(case)


def _here(case: Case) -> Iterator[dict[str, float | str]]:
    numbers = itertools.cycle(range(1, case.robots + 1))
    plan = Plan(robots=case.robots, environment=domains.BETWEEN_MACHINES)
    with (
        tempfile.TemporaryDirectory() as folder,
        running(Path(folder), plan) as stack,
    ):
        for _ in range(case.rounds):
            broken = [f"robot_{next(numbers)}" for _ in range(case.faults)]
            for robot, row in zip(broken, measure_faults(stack, broken), strict=True):
                since = {name: round(at - row[0], 3) for name, at in zip(COLUMNS, row, strict=True)}
                yield {"way": "here", "robots": case.robots, "interval": 0, "robot": robot, **since}


def _nagios(case: Case) -> Iterator[dict[str, float | str]]:
    with nagios_fleet.running(case.robots, "exporter") as fleet:
        log = fleet.folder / "notifications"
        log.touch()
        notify = f"/bin/sh -c 'echo $HOSTNAME$ $SERVICESTATE$ $(date +%s.%N) >>{log}'"
        nagios = nagios_fleet.nagios(
            fleet,
            case.robots,
            {"motors": "Motor"},
            interval=case.interval,
            attempts=ATTEMPTS,
            notify=notify,
        )
        nagios.start()
        try:
            threading.Event().wait(case.interval + CHECKS_SETTLE)
            for first in range(0, case.rounds * case.faults, case.faults):
                robots = [f"robot_{(first + n) % case.robots + 1}" for n in range(case.faults)]
                for robot, seconds in _notified(case, fleet, log, robots).items():
                    yield {
                        "way": "nagios",
                        "robots": case.robots,
                        "interval": case.interval,
                        "robot": robot,
                        COLUMNS[-1]: round(seconds, 3),
                    }
        finally:
            nagios.stop()


def _notified(
    case: Case, fleet: nagios_fleet.NagiosFleet, log: Path, robots: Sequence[str]
) -> dict[str, float]:
    """Break the robots at random moments of an interval; return when each was notified of."""
    broken: dict[str, float] = {}

    def fault(robot: str, level: str) -> None:
        argv = programs.fault(robot, MOTOR, level, "", fleet.domain_id)
        subprocess.run(argv, env=fleet.environment, check=True, capture_output=True)
        broken.setdefault(robot, time.time())

    began = time.time()
    timers = [
        threading.Timer(random.uniform(0, case.interval), fault, (robot, "error"))
        for robot in robots
    ]
    for each in timers:
        each.start()
    seconds = case.interval * (ATTEMPTS + 2) + 60.0

    def critical() -> dict[str, float]:
        rows = [line.split() for line in log.read_text().splitlines()]
        return {
            name: float(at) for name, state, at in rows if state == "CRITICAL" and float(at) > began
        }

    until(lambda: len(critical()) == len(robots), "Nagios' notifications", seconds, every=0.5)
    for robot in robots:
        fault(robot, "ok")
    until(
        lambda: log.read_text().count(" OK ") == log.read_text().count(" CRITICAL "),
        "Nagios' recoveries",
        seconds,
        every=0.5,
    )
    return {robot: at - broken[robot] for robot, at in critical().items()}


def _groups(result: Results) -> list[tuple[str, list[dict[str, str]]]]:
    """Return the rows by case, each with its title; ours first."""

    def key(row: Mapping[str, str]) -> tuple[int, int]:
        return int(row["interval"]), int(row["robots"])

    groups = itertools.groupby(sorted(result.rows(), key=key), key=key)
    return [(_title(*case), list(rows)) for case, rows in groups]


def _title(interval: int, robots: int) -> str:
    if interval == 0:
        return f"here, {robots:,} robots"
    return f"Nagios every {interval} s"


def _seconds(rows: Sequence[Mapping[str, str]], step: str) -> list[float]:
    return [float(row[COLUMNS[STEPS.index(step)]]) for row in rows]


def _spread(found: Sequence[float]) -> str:
    if len(found) == 1:
        return f"{found[0]:.1f} s"
    p95 = quantiles(found, n=20, method="inclusive")[-1]
    return f"{median(found):.1f}, {p95:.1f}, {max(found):.1f} s"


def render(result: Results) -> str:
    """Write the tables and the plot."""
    groups = _groups(result)
    _plot(result, groups)
    return result.write_markdown(_table(groups), _steps(groups))


def _table(groups: list[tuple[str, list[dict[str, str]]]]) -> list[str]:
    rows = []
    for title, found in groups:
        row = {"what": title, "faults": str(len(found))}
        for step in SHOWN:
            known = found[0].get(COLUMNS[STEPS.index(step)], "") != ""
            row[step] = _spread(_seconds(found, step)) if known else ""
        rows.append(row)
    for interval in COMPUTED:
        low, high = (ATTEMPTS - 1) * interval, ATTEMPTS * interval
        computed = [low + share * (high - low) for share in (0.5, 0.95, 1.0)]
        row = dict.fromkeys(SHOWN, "") | {"what": f"Nagios every {interval} s, computed"}
        row[SHOWN[-1]] = ", ".join(f"{each:.1f}" for each in computed) + " s"
        rows.append({"faults": "", **row})
    titles = ("metric (confirmed)", "scraped by Prometheus", "alert fires", "notification received")
    columns = [("p50, p95, max since the fault", "what"), ("faults", "faults")]
    columns += zip(titles, SHOWN, strict=True)
    return table(rows, [(name, itemgetter(key)) for name, key in columns])


def _steps(groups: list[tuple[str, list[dict[str, str]]]]) -> list[str]:
    """Return a table of the time from step to step, medians, of ours."""
    ours = [(title, rows) for title, rows in groups if title.startswith("here")]
    lines = []
    for before, step in itertools.pairwise(STEPS):
        line = {"step": f"{before} to {step}"}
        for title, rows in ours:
            pairs = zip(_seconds(rows, before), _seconds(rows, step), strict=True)
            line[title] = f"{median(after - first for first, after in pairs):.2f} s"
        lines.append(line)
    columns = [("median", "step"), *((title, title) for title, _ in ours)]
    return table(lines, [(name, itemgetter(key)) for name, key in columns])


def _plot(result: Results, groups: list[tuple[str, list[dict[str, str]]]]) -> None:
    with plots.figure(result.path(".png"), width=1.7) as axes:
        for (title, rows), color in zip(groups, plots.COLORS, strict=False):
            found = sorted(_seconds(rows, STEPS[-1]))
            share = [(number + 1) / len(found) for number in range(len(found))]
            axes.step([found[0], *found], [0, *share], color=color, label=title, where="post")
        low, high = (ATTEMPTS - 1) * COMPUTED[0], ATTEMPTS * COMPUTED[0]
        title = f"Nagios every {COMPUTED[0]} s, computed"
        axes.plot([low, high], [0, 1], "--", color=plots.TEXT, label=title)
        plots.label(
            axes, "seconds from the fault to the notification", "share of faults", logx=True
        )
        axes.legend(loc="upper left", bbox_to_anchor=(1, 1))


def main() -> None:
    """Measure the cases; write the result."""
    parser = results.parser(NAME, __doc__ or "")
    parser.add_argument("--robots", type=int, default=10)
    parser.add_argument("--faults", type=int, default=4, help="at a time: no common cause")
    parser.add_argument("--rounds", type=int, default=13)
    parser.add_argument("--nagios", type=int, default=0, metavar="SECONDS", help="Nagios instead")
    options = parser.parse_args()
    case = Case(options.robots, options.faults, options.rounds, options.nagios)
    results.run(
        Results(options.out, NAME),
        options,
        [case],
        lambda each: measure(each, options.seed),
        render,
    )


if __name__ == "__main__":
    main()
