"""What one evaluation of all rules costs: a real Prometheus with 1,000 made-up robots.

The shipped configuration, with other addresses. Each case lasts some evaluations: all OK; all
components of 5 % of the robots CRITICAL; 5 % of all components; all; the most components that fire
one by one (with more there is a common cause). Every robot has two values with thresholds.

Printed are the seconds of all groups for five seconds (a group with another interval counts by
its share of them), and their ratio to one scrape of all of the same fleet by the same Prometheus,
which is independent of the machine's speed; the seconds of CPU that all of Prometheus used of
five, scrapes included; and the series that the rules add. The seconds of groups are of the clock:
on a machine that is used by others, they are mostly waiting, and CPU is not. Targets: 0.05 s
with no fault, 0.5 s with 800, 1.5 s with the most, 0.5 s with all components faulty, 8,000 series.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import NamedTuple

from bench.robots import COMPONENTS, GROUPS, aggregated_array
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    FaultSettings,
    Fleet,
    Limits,
    Profile,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import Instant, Part, Topic
from ros_diagnostics_exporter.regex import Pattern
from support.served_fleet import serving
from testbed import http
from testbed.engine import Engine
from testbed.polling import until
from testbed.site import Site

INTERVAL = 5.0
COMMON_CAUSE = 0.3  # of the fleet
ALL = range(GROUPS * COMPONENTS)
RECORDED = 'count({__name__=~".+:ros_diagnostics.*|ALERTS.*"})'
# Values that never cross their thresholds in this bench.
MONITORED = ValueRule(
    component=Pattern(r"node_[01]: part 0"),
    key=Pattern(r"Voltage 0 \(V\)"),
    thresholds=(Threshold("low", "critical", -1.0), Threshold("high", "warning", 1000.0)),
)


class Case(NamedTuple):
    """Which components are CRITICAL."""

    title: str
    components: float = 0.0  # share of all, spread over all robots
    robots: float = 0.0  # share of the robots, in all that they have

    def faulty(self, robot: int, robots: int) -> list[int]:
        """The numbers of one robot's faulty components."""
        if robot < round(robots * self.robots):
            return list(ALL)
        # Every component on the same share of the robots, and few of one robot.
        return [n for n in ALL if (robot * 37 + n * 61) % 100 < self.components * 100]


CASES = (
    Case("none"),
    Case("5 % of the robots", robots=0.05),
    Case("5 % of the components", components=0.05),
    Case("all", robots=1.0),
    Case("most one by one", components=COMMON_CAUSE - 0.01),
)


class Target:
    """What the exporter of a big fleet would serve; the text of each turn is made beforehand."""

    def __init__(self, robots: int) -> None:
        self.topics = [Topic(0, f"/robot_{n}/diagnostics_agg") for n in range(robots)]
        profile = Profile(values=(MONITORED,))
        declared = (
            Robot(
                f"robot_{n}",
                topic_agg=topic.name,
                source=Source.AGG,
                profile=profile,
                labels={"site": "hall"},
            )
            for n, topic in enumerate(self.topics)
        )
        faults = FaultSettings(common=CauseSettings(5, COMMON_CAUSE))
        limits = Limits(robots=robots, series=10_000_000)
        fleet = Fleet("bench", tuple(declared), faults=faults, limits=limits)
        self._state = FleetState(fleet, Instant(0.0, 1.7e9))
        self._exposition = Exposition(self._state)
        self.text = self.faults = b""
        self._turn = 0

    def breaks(self, case: Case) -> int:
        """Every robot sends until what is faulty is confirmed; how many faults come of it."""
        faulty = [case.faulty(robot, len(self.topics)) for robot in range(len(self.topics))]
        for _ in range(5):
            self._turn += 5
            now = Instant(float(self._turn), 1.7e9 + self._turn)  # the array's own stamp
            for topic, of in zip(self.topics, faulty, strict=True):
                self._state.receive(topic, aggregated_array(self._turn, level=2, of=of), now)
            self._state.tick(now)
        settled = b'ros_diagnostics_exporter_settled{fleet="bench"} 1\n'
        self.faults = self._exposition.render(parts={Part.FAULTS}) + settled
        self.text = self._exposition.render(parts={Part.ROBOTS})
        return len(self._state.faults())

    def scrape(self, parts: Collection[Part]) -> bytes:
        """The text of one of both scrapes."""
        return self.faults if parts == {Part.FAULTS} else self.text


def _without_alertmanager(prometheus: Path) -> None:
    (prometheus / "targets" / "alertmanager.yml").write_text("[]")


@contextmanager
def evaluating(exporter: str) -> Iterator[Site]:
    """A Prometheus that has scraped the target and evaluates the shipped rules."""
    with tempfile.TemporaryDirectory() as folder, Site(Path(folder)) as site:
        site.start_prometheus(exporters=[exporter], edit=_without_alertmanager)
        site.wait_until_ready()
        scraped = 'up{job="ros-diagnostics"} == 1 and on () prometheus_build_info'
        until(lambda: site.query(scraped), "the target and Prometheus itself are scraped", 60)
        yield site


def firing(engine: Engine) -> int:
    """How many alerts about faults fire."""
    return int(engine.value('count(ALERTS{alertstate="firing", scope!="", step=""})'))


def fires(engine: Engine, expected: int) -> bool:
    """Whether exactly so many alerts fire: those of the case before are resolved."""
    return firing(engine) == expected


class Costs(NamedTuple):
    """Seconds for one evaluation interval, one entry for each that was looked at."""

    groups: dict[str, list[float]]
    rules: dict[str, list[float]]
    scrapes: list[float]
    cpu: list[float]  # seconds of Prometheus since it began

    def totals(self) -> list[float]:
        """All groups together, evaluation by evaluation."""
        return [sum(each) for each in zip(*self.groups.values(), strict=True)]

    def cpu_of_interval(self) -> float:
        """Seconds of CPU for one evaluation interval, on average."""
        return (self.cpu[-1] - self.cpu[0]) / (len(self.cpu) - 1)


def watch(engine: Engine, rounds: int) -> Costs:
    """Look at each of the next evaluations; a longer interval counts by its share."""
    costs = Costs({}, {}, [], [used_cpu(engine)])
    for _ in range(rounds):
        look(engine, costs)
        time.sleep(INTERVAL)
        costs.cpu.append(used_cpu(engine))
    return costs


def used_cpu(engine: Engine) -> float:
    """The seconds of CPU that a Prometheus has used since it began."""
    own = http.get(engine.address, "/metrics").decode()
    return float(own.partition("\nprocess_cpu_seconds_total ")[2].partition("\n")[0])


def look(engine: Engine, costs: Costs) -> None:
    """Add what the last evaluation and scrape of a Prometheus took."""
    for group in http.get_json(engine.address, "/api/v1/rules")["data"]["groups"]:
        share = INTERVAL / group["interval"]
        costs.groups.setdefault(group["name"], []).append(group["evaluationTime"] * share)
        for rule in group["rules"]:
            costs.rules.setdefault(rule["name"], []).append(rule["evaluationTime"] * share)
    costs.scrapes.append(engine.value('scrape_duration_seconds{job="ros-diagnostics"}'))


def main() -> None:
    """Print the longest evaluation for each share of faulty robots."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--rounds", type=int, default=14, help="evaluations looked at per share")
    parser.add_argument(
        "--prometheus", default=os.environ.get("PROMETHEUS", ""), help="the binary to run"
    )
    parser.add_argument("--rules", type=int, default=0, help="also print the N costliest rules")
    parser.add_argument(
        "--case", action="append", choices=[each.title for each in CASES], help="only this one"
    )
    options = parser.parse_args()
    os.environ["PROMETHEUS"] = options.prometheus
    target = Target(options.robots)
    with ExitStack() as stack:
        exporter = stack.enter_context(serving(target.scrape))
        target.breaks(CASES[0])
        engine = stack.enter_context(evaluating(exporter)).engine
        version = engine.query("prometheus_build_info")[0].labels["version"]
        series = target.text.count(b"\n") - target.text.count(b"# ")
        print(f"Prometheus {version}, {options.robots} robots, {series} series")
        columns = "".join(
            f"{name:>9}" for name in ("median", "longest", "scrapes", "CPU", "series")
        )
        print(f"{'CRITICAL':<24}{'alerts':>7}{columns}   seconds by group")
        for case in CASES:
            if options.case and case.title not in options.case:
                continue
            before = target.breaks(CASES[0])
            until(partial(fires, engine, before), "the case before is over", 240)
            expected = target.breaks(case)
            until(partial(fires, engine, expected), f"{expected} alerts", 240)
            costs = watch(engine, options.rounds)
            report(case.title, (firing(engine), int(engine.value(RECORDED))), costs, options.rules)


def report(title: str, counted: tuple[int, int], costs: Costs, rules: int) -> None:
    """One line for a case with its alerts and recorded series, one for each costly rule."""
    alerts, recorded = counted
    totals = costs.totals()
    typical = {name: median(seconds) for name, seconds in costs.groups.items()}
    each = ", ".join(f"{name.split('.')[1]} {cost:.2f}" for name, cost in typical.items())
    ratio = median(totals) / median(costs.scrapes)
    seconds_and_ratio = (median(totals), max(totals), ratio, costs.cpu_of_interval())
    numbers = "".join(f"{each:>9.2f}" for each in seconds_and_ratio)
    print(f"{title:<24}{alerts:>7}{numbers}{recorded:>9}   {each}")
    by_cost = sorted(costs.rules.items(), key=lambda item: median(item[1]), reverse=True)
    for name, seconds in by_cost[:rules]:
        print(f"    {median(seconds):.3f} {name}")


if __name__ == "__main__":
    main()
