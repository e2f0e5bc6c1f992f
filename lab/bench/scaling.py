"""What `bench.scale` measured, docs/experiments/scale.md, and what follows, in docs/scaling.md."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any, NamedTuple

CHECKOUT = Path(__file__).resolve().parents[2]
RESULTS = CHECKOUT / "docs" / "experiments" / "scale.json"
MEASURED = RESULTS.with_suffix(".md")
PAGE = CHECKOUT / "docs" / "scaling.md"
INTRODUCTION = """\
`./run bench scale` measured this on two cores of a shared machine. Prometheus has the shipped
rules, and Alertmanager the shipped routes. In the exporter's database, 5 % of the robots change.
Each robot has as many CRITICAL components as any other: this is the worst case, because each of
them has an alert.
"""
Numbers = dict[str, Any]  # as RESULTS has them

FAULTS_INTERVAL = 2.0  # seconds, of rules/faults.yml
ALL_INTERVAL = 5.0  # seconds to which all groups' evaluations are converted
QUEUE = 10_000  # alerts: --alertmanager.notification-queue-capacity of Prometheus
SERIES_LIMIT = 1_000_000  # `limits.series` of fleet.yml, by default


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


class Power(NamedTuple):
    """A cost that grows faster than the number of robots."""

    factor: float
    exponent: float

    def at(self, robots: float) -> float:
        """The cost of so many robots."""
        return self.factor * float(robots**self.exponent)

    def reaches(self, limit: float) -> float:
        """How many robots cost ``limit``."""
        return float((limit / self.factor) ** (1 / self.exponent))


def line(measured: dict[str, Any], cost: Callable[[Any], float]) -> Line | Power:
    """The line through the smallest and the largest fleet, or the power where that is below 0."""
    sizes = sorted(map(int, measured))
    low, high = sizes[0], sizes[-1]
    first, last = cost(measured[str(low)]), cost(measured[str(high)])
    each = (last - first) / (high - low) if high > low else first / low
    fixed = first - each * low
    if fixed >= 0:
        return Line(fixed, each)
    exponent = math.log(last / first) / math.log(high / low)
    return Power(first / low**exponent, exponent)


def of_one(measured: dict[str, Any], cost: Callable[[Any], float]) -> Line:
    """That of each robot of the smallest fleet; with a larger one an exporter may be overloaded."""
    low = min(map(int, measured))
    return Line(0.0, cost(measured[str(low)]) / low)


def tables(numbers: Numbers) -> str:
    """All tables, with headings, for a terminal."""
    made = {"exporter": exporters, "measured": measured, "alerts": alerts, "limits": limits}
    return "\n\n".join(f"{name}\n\n{make(numbers)}" for name, make in made.items())


def files() -> dict[Path, str]:
    """The tables of RESULTS, and docs/scaling.md with the limits that follow."""
    numbers = json.loads(RESULTS.read_text())
    between = re.compile(r"(<!-- limits -->\n).*?(<!-- end -->)", re.DOTALL)
    text, replaced = between.subn(rf"\g<1>{limits(numbers)}\n\g<2>", PAGE.read_text())
    if replaced != 1:
        raise ValueError(f"{PAGE}: {replaced} places for the table of limits; there is to be one")
    return {
        MEASURED: f"{INTRODUCTION}\n{measured(numbers)}\n\n{alerts(numbers)}\n",
        PAGE: text,
    }


def exporters(numbers: Numbers) -> str:
    """What each fleet cost its exporter. Experiments measure more, so the page has theirs."""
    exporter = numbers["exporter"]
    sizes = sorted(exporter, key=int)
    formats = {
        "robots that are up": ("up", "{:.1%}"),
        "CPU, cores": ("cpu", "{:.2f}"),
        "received of one message a robot and second": ("received", "{:.1%}"),
        "publishers: late at most, s": ("late", "{:.2f}"),
        "memory, MB": ("memory_mb", "{:.0f}"),
        "until all were received (at most 75), s": ("discovery_seconds", "{:.0f}"),
        "scrape of the faults, ms": ("scrape_faults_ms", "{:.0f}"),
        "scrape of the rest, ms": ("scrape_ms", "{:.0f}"),
        "scrape of the rest, MB": ("scrape_mb", "{:.1f}"),
        "scrape of the rest, samples": ("samples", "{:,.0f}"),
    }
    return _compared(
        sizes,
        [
            (what, [form.format(exporter[size][key]) for size in sizes])
            for what, (key, form) in formats.items()
        ],
    )


def _compared(sizes: list[str], rows: list[tuple[str, list[str]]]) -> str:
    titles = ["", *(f"{int(size):,} robots" for size in sizes), "ratio"]
    return table(titles, [(what, *cells, ratio(cells)) for what, cells in rows])


def measured(numbers: Numbers) -> str:
    """What each fleet cost the servers."""
    prometheus = numbers["prometheus"]
    sizes = sorted(prometheus, key=int)

    def of(what: dict[str, Any], *keys: str) -> list[float]:
        found = [what[size] for size in sizes]
        for key in keys:
            found = [each[key] for each in found]
        return [float(each) for each in found]

    rows: list[tuple[str, Iterable[str]]] = []
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
    return _compared(sizes, [(what, [*cells]) for what, cells in rows])


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

    samples: Line | Power
    rules: Line | Power
    faults_group: Line | Power
    alerts: Line | Power


def costs(numbers: Numbers) -> Costs:
    """The lines through what was measured."""
    exporter, prometheus = numbers["exporter"], numbers["prometheus"]
    return Costs(
        samples=of_one(exporter, lambda each: each["samples"]),
        rules=line(prometheus, lambda each: each["faulty"]["rules"]),
        faults_group=line(prometheus, lambda each: each["faulty"]["faults_group"]),
        alerts=line(prometheus, lambda each: each["faulty"]["alerts"]),
    )


def limits(numbers: Numbers) -> str:
    """At how many robots each limit is reached, the first one first."""
    cost = costs(numbers)
    found = {
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


def rounded(number: float) -> str:
    """Two digits that count: 12,000."""
    digits = 1 - math.floor(math.log10(number))
    return f"{round(number, digits):,.0f}"


def table(titles: list[str], rows: Iterable[tuple[str, ...]]) -> str:
    """A table of Markdown."""
    lines = [titles, ["---"] * len(titles), *rows]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)
