"""What the queries of a dashboard cost: a real Prometheus with 1,000 robots and hours of history.

The shipped configuration; one robot in twenty is faulty, and the recorded states of the last hours
are imported. Target: each query of the fleet dashboard within 1 s, over its own time range, as
Grafana sends it for a screen of 1,920 pixels. With --month instead the reports of *Alerts and
reports* about a month, which have no target.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from statistics import median
from typing import NamedTuple

from bench import month
from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Instant, Topic
from support.committed_dashboards import Query, filled, queries
from support.served_fleet import ServedFleet, serving
from testbed import servers
from testbed.polling import until
from testbed.site import Site

INTERVAL = 5  # seconds, of scrapes and evaluations, as shipped
RANKED = 10  # seconds, of rules/states.yml
PIXELS = 1800  # of a graph as wide as that screen: so many points it requests
FAULTY = 20  # every so many robots one is
SITES = 10


class Cost(NamedTuple):
    """Seconds that the rounds of one query took, and how much came back."""

    question: Query
    seconds: list[float]
    series: int


def history(robots: int, begin: float, end: float) -> Iterator[str]:
    """The states of ``robots`` robots as recorded at every evaluation; OpenMetrics."""
    name = "robot:ros_diagnostics_state:rank"
    yield f"# TYPE {name} gauge\n"
    for number in range(robots):
        rank = 0 if number % FAULTY else 6
        series = f'{name}{{fleet="bench",robot="robot_{number}"}} {rank}'
        yield "".join(f"{series} {each}\n" for each in range(int(begin), int(end), RANKED))
    times = range(int(begin), int(end), INTERVAL)
    name = "site_robot_group:ros_diagnostics_robots:count"
    yield f"# TYPE {name} gauge\n"
    for state in ("critical", "ok"):
        for site in range(SITES):
            series = f'{name}{{fleet="bench",site="site_{site}",state="{state}"}} {robots // SITES}'
            yield "".join(f"{series} {each}\n" for each in times)
    yield "# EOF\n"


def big_fleet(robots: int) -> ServedFleet:
    """Robots that publish twice, OK and then with the faults; they are never silent."""
    profile = Profile(stale_after=1e9, confirm_after=5.0)
    declared = [
        Robot(
            f"robot_{number}",
            topic_agg=f"/robot_{number}/diagnostics_agg",
            source=Source.AGG,
            profile=profile,
            labels={"site": f"site_{number % SITES}"},
        )
        for number in range(robots)
    ]
    turns = iter(range(1_000_000))

    def publish(state: FleetState, now: Instant) -> None:
        turn = next(turns)
        if turn > 1:
            return
        for number in range(robots):
            level = 2 if turn and number % FAULTY == 0 else 0
            topic = Topic(0, f"/robot_{number}/diagnostics_agg")
            state.receive(topic, aggregated_array(turn, level=level), now)

    return ServedFleet(Fleet("bench", tuple(declared)), publish)


def notify(fleet: ServedFleet, site: Site) -> None:
    """Have two receivers notified of all faults, as Alertmanager's webhook would."""
    alerts = [{"status": "firing", "labels": each["labels"]} for each in site.engine.alerts()]
    for receiver in ("email", "sms"):
        message = {"version": "4", "receiver": receiver, "alerts": alerts}
        fleet.notified(json.dumps(message).encode())
    sent = "ros_diagnostics_fault_notified_timestamp_seconds > 0"
    until(lambda: site.query(sent), "notifications", 60, every=1)


def measure(site: Site, question: Query, hours: float, rounds: int) -> Cost:
    """Send one query ``rounds`` times."""
    expr = filled(question.expr, {"__range": f"{hours:g}h"})
    seconds: list[float] = []
    series = 0
    for _ in range(rounds):
        now = time.time()
        if question.instant:
            series = len(site.engine.query(expr, now))
        else:
            step = max(INTERVAL, hours * 3600 / (question.points or PIXELS))
            series = len(site.engine.query_range(expr, now - hours * 3600, now, step))
        seconds.append(time.time() - now)
    return Cost(question, seconds, series)


def report(costs: list[Cost], limit: float) -> None:
    """One line for each query, the costliest first."""
    print(f"{'least':>8}{'median':>8}{'longest':>9}{'series':>8}   seconds; query")
    for cost in sorted(costs, key=lambda each: median(each.seconds), reverse=True):
        spread = f"{min(cost.seconds):>8.3f}{median(cost.seconds):>8.3f}{max(cost.seconds):>9.3f}"
        print(f"{spread}{cost.series:>8}   {cost.question.place} / {cost.question.ref}")
    over = [cost for cost in costs if median(cost.seconds) > limit]
    print(f"{len(costs)} queries, {len(over)} over {limit:g} s")


@contextmanager
def running(prefix: str, samples: Iterable[str], exporters: Sequence[str] = ()) -> Iterator[Site]:
    """Prometheus and Alertmanager with the shipped configuration, and a history."""
    with tempfile.TemporaryDirectory(prefix=prefix) as folder, Site(Path(folder)) as site:
        imported = site.folder / "history.txt"
        with imported.open("w") as file:
            file.writelines(samples)
        servers.import_history(imported, site.folder)
        imported.unlink()
        site.start_alertmanager()
        retention = "--storage.tsdb.retention.time=90d"
        site.start_prometheus(retention, exporters=exporters, interval=INTERVAL)
        site.wait_until_ready()
        yield site


def dashboard(options: argparse.Namespace) -> None:
    """Print what each query of one dashboard costs."""
    now = time.time()
    recorded = history(options.robots, now - options.hours * 3600, now)
    fleet = big_fleet(options.robots)
    with (
        serving(fleet.scrape) as address,
        running("bench-dashboards-", recorded, [address]) as site,
    ):
        faulty = -(-options.robots // FAULTY)
        for what, expr in {
            "faulty robots": f"count(robot:ros_diagnostics_state:rank == 6) == {faulty}",
            "confirmed faults": "fleet:ros_diagnostics_fault_start:held",
        }.items():
            until(partial(site.query, expr), what, 300, every=1)
        notify(fleet, site)
        series = site.engine.value("prometheus_tsdb_head_series")
        print(f"{options.robots} robots, {series:.0f} series, {options.hours:g} h")
        chosen = [each for each in queries() if each.board == options.dashboard]
        report([measure(site, each, options.hours, options.rounds) for each in chosen], 1.0)


def availability(options: argparse.Namespace) -> None:
    """Print what the reports about a month cost."""
    with running("bench-month-", month.text(options.robots, time.time())) as site:
        print(f"{options.robots} robots, {month.DAYS} days")
        chosen = [each for each in queries() if each.place.startswith("Availability ")]
        report([measure(site, each, month.DAYS * 24, options.rounds) for each in chosen], 10.0)


def main() -> None:
    """Print what the queries cost."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--robots", type=int, default=1000)
    parser.add_argument("--hours", type=float, default=6.0, help="time range, and history")
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--dashboard", default="ros-diagnostics-fleet", help="its uid")
    parser.add_argument("--month", action="store_true", help="the reports about a month instead")
    options = parser.parse_args()
    (availability if options.month else dashboard)(options)


if __name__ == "__main__":
    main()
