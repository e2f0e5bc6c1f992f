"""The tables of docs/scaling.md: what `bench.scale` measured, and what follows from it."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

CHECKOUT = Path(__file__).resolve().parents[2]
RESULTS = CHECKOUT / "docs" / "experiments" / "scale.json"
PAGE = CHECKOUT / "docs" / "scaling.md"
FLEETS = (10_000, 30_000, 100_000)
Numbers = dict[str, Any]  # as RESULTS has them

CORE = 0.7  # of a core, in an exporter: above it nothing is left for a scrape and a burst
SLOW = 2.0  # seconds of a scrape, RosDiagnosticsExporterSlow
FAULTS_INTERVAL = 2.0  # seconds, of rules/faults.yml
ALL_INTERVAL = 5.0  # seconds to which all groups' evaluations are converted
QUEUE = 10_000  # alerts: --alertmanager.notification-queue-capacity of Prometheus
SERIES_LIMIT = 1_000_000  # `limits.series` of fleet.yml, by default
REST_INTERVAL = 15.0  # seconds, of the job ros-diagnostics


class Line(NamedTuple):
    """A cost over the number of robots: ``fixed`` and ``each``."""

    fixed: float
    each: float

    def at(self, robots: float) -> float:
        """The cost of so many robots."""
        return self.fixed + self.each * robots

    def reaches(self, limit: float) -> float:
        """How many robots cost ``limit``."""
        return (limit - self.fixed) / self.each


def line(measured: dict[str, Any], cost: Callable[[Any], float]) -> Line:
    """The line through the smallest and the largest fleet; through 0 where it starts below."""
    sizes = sorted(map(int, measured))
    low, high = sizes[0], sizes[-1]
    first, last = cost(measured[str(low)]), cost(measured[str(high)])
    each = (last - first) / (high - low) if high > low else first / low
    fixed = first - each * low
    return Line(fixed, each) if fixed >= 0 else Line(0.0, last / high)


def of_one(measured: dict[str, Any], cost: Callable[[Any], float]) -> Line:
    """That of each robot of the smallest fleet; with a larger one an exporter may be overloaded."""
    low = min(map(int, measured))
    return Line(0.0, cost(measured[str(low)]) / low)


def tables(numbers: Numbers) -> str:
    """All tables, with headings, for a terminal."""
    return "\n\n".join(f"{name}\n\n{make(numbers)}" for name, make in _makers().items())


def files() -> dict[Path, str]:
    """docs/scaling.md with the tables of RESULTS."""
    numbers = json.loads(RESULTS.read_text())
    text = PAGE.read_text()
    for name, make in _makers().items():
        between = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
        text, replaced = between.subn(rf"\g<1>{make(numbers)}\n\g<2>", text)
        if replaced != 1:
            raise ValueError(
                f"{PAGE}: {replaced} places for the table {name!r}; there is to be one"
            )
    return {PAGE: text}


def _makers() -> dict[str, Callable[[Numbers], str]]:
    return {"measured": measured, "alerts": alerts, "limits": limits, "computed": computed}


def measured(numbers: Numbers) -> str:
    """What each fleet cost."""
    exporter, prometheus = numbers["exporter"], numbers["prometheus"]
    sizes = sorted(exporter, key=int)

    def of(what: dict[str, Any], *keys: str) -> list[float]:
        found = [what[size] for size in sizes]
        for key in keys:
            found = [each[key] for each in found]
        return [float(each) for each in found]

    rows: list[tuple[str, Iterable[str]]] = [
        ("exporter: robots that are up", map("{:.1%}".format, of(exporter, "up"))),
        ("exporter: CPU, cores", map("{:.2f}".format, of(exporter, "cpu"))),
        (
            "exporter: received of one message a robot and second",
            map("{:.1%}".format, of(exporter, "received")),
        ),
        ("publishers: late at most, s", map("{:.2f}".format, of(exporter, "late"))),
        ("exporter: memory, MB", map("{:.0f}".format, of(exporter, "memory_mb"))),
        (
            "exporter: until all were received (at most 75), s",
            map("{:.0f}".format, of(exporter, "discovery_seconds")),
        ),
        ("scrape of the faults, ms", map("{:.0f}".format, of(exporter, "scrape_faults_ms"))),
        ("scrape of the rest, ms", map("{:.0f}".format, of(exporter, "scrape_ms"))),
        ("scrape of the rest, MB", map("{:.1f}".format, of(exporter, "scrape_mb"))),
        ("scrape of the rest, samples", map("{:,.0f}".format, of(exporter, "samples"))),
    ]
    for case, title in (("none", "no fault"), ("faulty", "5 % of the components")):
        rows += [
            (f"Prometheus, {title}: alerts", map("{:,.0f}".format, of(prometheus, case, "alerts"))),
            (f"Prometheus, {title}: series", map("{:,.0f}".format, of(prometheus, case, "series"))),
            (f"Prometheus, {title}: CPU, cores", map("{:.2f}".format, of(prometheus, case, "cpu"))),
            (
                f"Prometheus, {title}: memory, MB",
                map("{:.0f}".format, of(prometheus, case, "memory_mb")),
            ),
            (
                f"Prometheus, {title}: rules, s of each 5 s",
                map("{:.2f}".format, of(prometheus, case, "rules")),
            ),
            (
                f"Prometheus, {title}: rules/faults.yml, s of each 2 s",
                map("{:.2f}".format, of(prometheus, case, "faults_group")),
            ),
            (
                f"Prometheus, {title}: rules, scrapes of the rest",
                (
                    f"{a / b:.1f}"
                    for a, b in zip(
                        of(prometheus, case, "rules"), of(prometheus, case, "scrape"), strict=True
                    )
                ),
            ),
        ]
    rows += [
        ("database: CPU of a write, ms", map("{:.0f}".format, of(numbers["database"], "cpu_ms"))),
        ("database: written, kB", map("{:,.0f}".format, of(numbers["database"], "kb"))),
    ]
    titles = ["", *(f"{int(size):,} robots" for size in sizes), "ratio"]
    return table(
        titles, [(what, *cells, ratio(cells)) for what, found in rows for cells in [[*found]]]
    )


def ratio(cells: list[str]) -> str:
    """The last cell by the first, where that says something."""
    first, last = (float(re.sub("[,%]", "", cell)) for cell in (cells[0], cells[-1]))
    return f"{last / first:.1f}" if first else ""


def alerts(numbers: Numbers) -> str:
    """What Alertmanager needed for alerts that came at once."""
    found = numbers["alertmanager"]
    return table(
        [
            "alerts at once",
            "all notified after, s",
            "CPU, s",
            "CPU to receive them again, s",
            "memory, MB",
        ],
        [
            (
                f"{int(number):,}",
                f"{each['seconds']:.1f}",
                f"{each['cpu']:.2f}",
                f"{each['again_cpu']:.2f}",
                f"{each['memory_mb']:.0f}",
            )
            for number, each in found.items()
        ],
    )


class Costs(NamedTuple):
    """Lines of everything that limits."""

    cpu: Line
    memory: Line
    scrape: Line
    megabytes: Line
    samples: Line
    series: Line
    prometheus_memory: Line
    rules: Line
    faults_group: Line
    alerts: Line
    database: Line


def costs(numbers: Numbers) -> Costs:
    """The lines through what was measured."""
    exporter, prometheus = numbers["exporter"], numbers["prometheus"]
    return Costs(
        cpu=of_one(exporter, lambda each: each["cpu"] / each["received"]),
        memory=of_one(exporter, lambda each: each["memory_mb"]),
        scrape=of_one(exporter, lambda each: each["scrape_ms"] / 1e3),
        megabytes=of_one(exporter, lambda each: each["scrape_mb"]),
        samples=of_one(exporter, lambda each: each["samples"]),
        series=line(prometheus, lambda each: each["faulty"]["series"]),
        prometheus_memory=line(prometheus, lambda each: each["faulty"]["memory_mb"]),
        rules=line(prometheus, lambda each: each["faulty"]["rules"]),
        faults_group=line(prometheus, lambda each: each["faulty"]["faults_group"]),
        alerts=line(prometheus, lambda each: each["faulty"]["alerts"]),
        database=line(numbers["database"], lambda each: each["kb"]),
    )


def limits(numbers: Numbers) -> str:
    """At how many robots each limit is reached, the first one first."""
    cost = costs(numbers)
    found = {
        f"exporter: {CORE:.0%} of a core": cost.cpu.reaches(CORE),
        f"exporter: a scrape of the rest takes {SLOW:g} s": cost.scrape.reaches(SLOW),
        f"exporter: {SERIES_LIMIT:,} series (`limits.series`)": cost.samples.reaches(SERIES_LIMIT),
        "Prometheus: `rules/faults.yml` takes its 2 s, with 5 % of the components CRITICAL": (
            cost.faults_group.reaches(FAULTS_INTERVAL)
        ),
        "Prometheus: all rules take the whole time, with 5 % of the components CRITICAL": (
            cost.rules.reaches(ALL_INTERVAL)
        ),
        f"Prometheus: its queue of {QUEUE:,} alerts, with 5 % of the components CRITICAL": (
            cost.alerts.reaches(QUEUE)
        ),
    }
    rows = sorted(found.items(), key=lambda item: item[1])
    return table(["limit", "at about so many robots"], [(what, rounded(at)) for what, at in rows])


def computed(numbers: Numbers) -> str:
    """What larger fleets need, all in one place, so that it can be divided."""
    cost = costs(numbers)
    each = cost.cpu.reaches(CORE)
    rows: list[tuple[str, Callable[[int], str]]] = [
        (f"exporters of {rounded(each)} robots", lambda n: f"{math.ceil(n / each):,}"),
        ("cores of all exporters", lambda n: f"{cost.cpu.at(n):.1f}"),
        ("memory of all exporters, GB", lambda n: f"{cost.memory.at(n) / 1e3:.1f}"),
        ("scraped, MB a second", lambda n: f"{cost.megabytes.at(n) / REST_INTERVAL:.1f}"),
        ("series in Prometheus", lambda n: rounded(cost.series.at(n))),
        ("memory of Prometheus, GB", lambda n: f"{cost.prometheus_memory.at(n) / 1e3:.1f}"),
        (
            "cores of rules, 5 % of the components CRITICAL",
            lambda n: f"{cost.rules.at(n) / ALL_INTERVAL:.1f}",
        ),
        ("alerts, 5 % of the components CRITICAL", lambda n: rounded(cost.alerts.at(n))),
        ("databases, MB a second at 5 % changes", lambda n: f"{cost.database.at(n) / 1e3:.1f}"),
    ]
    titles = ["", *(f"{n:,} robots" for n in FLEETS)]
    return table(titles, [(what, *(make(n) for n in FLEETS)) for what, make in rows])


def rounded(number: float) -> str:
    """Two digits that count: 12,000."""
    digits = 1 - math.floor(math.log10(number))
    return f"{round(number, digits):,.0f}"


def table(titles: list[str], rows: Iterable[tuple[str, ...]]) -> str:
    """A table of Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
