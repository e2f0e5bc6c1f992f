"""What 1,000 and 3,000 robots cost at each step, and by arithmetic 10,000 to 100,000.

Each robot has 16 components with 64 values, and sends once a second over real DDS on this machine,
every value changed; the exporter is scraped as prometheus.yml says. A real Prometheus with the
shipped rules scrapes the same fleet with no fault, and with 5 % of all components CRITICAL. The
database gets a change of 5 % of the robots a second. A real Alertmanager with the shipped routes
gets alerts at once, and notifies a webhook. `--write` keeps the numbers in
docs/experiments/scale.json; `./run generate` then renews docs/experiments/scale.md and the table of
docs/scaling.md.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
import tempfile
import threading
import time
import urllib.request
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from statistics import median
from typing import Any

import yaml

from bench import rules, scaling, storage
from bench.scraper import MESSAGES, robots_up, total
from bench.sim import cpu_seconds, resident_megabytes
from support.loopback import answering
from support.served_fleet import serving
from support.shipped_rules import ALERTMANAGER
from testbed import http, servers
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process
from testbed.site import Site

Numbers = dict[str, float]
CONFIG = """
fleet: bench
limits: {{robots: 10000, series: 10000000}}
discovery:
  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: {domains}}}
"""
LATE = re.compile(r"late at worst (\S+) s")
OF_DOMAIN = 250  # robots
DISCOVERY = 75.0  # seconds
FAULTS, REST = "/metrics?collect[]=faults", "/metrics?exclude[]=faults"
FAULTY = 0.05
STEPS = ["exporter", "prometheus", "database", "alertmanager"]
BATCH = 64  # alerts of one request of Prometheus
ALERTS = (50, 150, 1000, 5000)


# --- The exporter, over DDS ---


def measure_exporter(robots: int, seconds: float) -> Numbers:
    """CPU and memory of the exporter, what it received of what was sent, and its scrapes."""
    with tempfile.TemporaryDirectory() as folder, Site(Path(folder)) as site:
        leased = [site.lease() for _ in range(0, robots, OF_DOMAIN)]
        config = site.write("fleet.yml", CONFIG.format(domains=leased))
        server = site.make_exporter(config, domain_id=leased[0], alertmanager="")
        exporter, address = site.start(server).process, server.address
        fleets = [
            _start_fleet(site, domain, first, min(OF_DOMAIN, robots - first))
            for domain, first in zip(leased, range(0, robots, OF_DOMAIN), strict=True)
        ]
        site.wait_until_ready()
        begin = time.monotonic()
        # Too many for this machine are never all received; how many are, is in the table.
        end = begin + DISCOVERY
        until(lambda: _up(address) == robots or time.monotonic() > end, "the robots", 300, every=2)
        found = {"discovery_seconds": time.monotonic() - begin}
        time.sleep(5)
        begin, spent = time.monotonic(), cpu_seconds(exporter.pid)
        received = _received(address)
        found |= _scrape(address, begin + seconds)
        elapsed = time.monotonic() - begin
        found["cpu"] = (cpu_seconds(exporter.pid) - spent) / elapsed
        found["received"] = (_received(address) - received) / (elapsed * robots)
        found["memory_mb"] = resident_megabytes(exporter.pid)
        found["up"] = _up(address) / robots
        found["late"] = max(float(LATE.findall(each.output())[-1]) for each in fleets)
    return found


def _start_fleet(site: Site, domain: int, first: int, robots: int) -> Process:
    """Robots in one domain: what participants send each other grows with both."""
    argv = [sys.executable, "-m", "bench.actors", "fleet", str(domain), str(robots), "600"]
    argv += ["--first", str(first)]
    return site.start_program(f"fleet-{domain}", argv, domain_id=domain).process


def _up(address: str) -> int:
    """How many robots are received."""
    return robots_up(http.get(address, FAULTS, 30))


def _received(address: str) -> int:
    return total(MESSAGES, http.get(address, REST, 30))


def _scrape(address: str, end: float) -> Numbers:
    """Scrape as prometheus.yml says until ``end``; medians of both scrapes."""
    costs: dict[str, list[float]] = {FAULTS: [], REST: []}
    size = samples = 0
    turn = 0
    while time.monotonic() < end:
        due = time.monotonic() + 2
        for path in (FAULTS, REST) if turn % 7 == 0 else (FAULTS,):  # every 2 and 14 s
            begin = time.monotonic()
            text = http.get(address, path, 30)
            costs[path].append(time.monotonic() - begin)
            if path == REST:
                size, samples = len(text), text.count(b"\n") - text.count(b"\n#") - 1
        turn += 1
        time.sleep(max(0.0, due - time.monotonic()))
    return {
        "scrape_faults_ms": 1e3 * median(costs[FAULTS]),
        "scrape_ms": 1e3 * median(costs[REST]),
        "scrape_mb": size / 1e6,
        "samples": samples,
    }


# --- Prometheus, with the shipped rules ---


def measure_prometheus(robots: int, rounds: int) -> dict[str, Numbers]:
    """Its series, CPU and memory, and seconds of rules, by case."""
    target = rules.Target(robots)
    found: dict[str, Numbers] = {}
    target.breaks(rules.CASES[0])
    with serving(target.scrape) as exporter, rules.evaluating(exporter) as site:
        prometheus, engine = site.prometheus.process, site.engine
        for name, case in (("none", rules.CASES[0]), ("faulty", rules.Case("", components=FAULTY))):
            expected = target.breaks(case)
            until(partial(rules.fires, engine, expected), f"{expected} alerts", 240)
            spent, begin = cpu_seconds(prometheus.pid), time.monotonic()
            costs = rules.watch(engine, rounds)
            cpu = (cpu_seconds(prometheus.pid) - spent) / (time.monotonic() - begin)
            share = 2 / rules.INTERVAL  # of the group's interval
            found[name] = {
                "alerts": expected,
                "series": engine.value("prometheus_tsdb_head_series"),
                "recorded": engine.value(rules.RECORDED),
                "cpu": cpu,
                "memory_mb": resident_megabytes(prometheus.pid),
                "rules": median(costs.totals()),
                "faults_group": median(costs.groups["ros-diagnostics.faults"]) * share,
                "scrape": median(costs.scrapes),
            }
    return found


# --- The database ---


def measure_database(robots: int) -> Numbers:
    """CPU and kB of a write in which 5 % of the robots changed the level of a component."""
    with tempfile.TemporaryDirectory() as folder:
        site = storage.Site(Path(folder, "exporter.db"), robots)
        site.pass_second((), ())
        few = round(robots * FAULTY)
        costs = [
            site.pass_second(range(turn * few % robots, turn * few % robots + few), (turn % 16,))
            for turn in range(20)
        ]
    return {
        "cpu_ms": median(each.cpu for each in costs),
        "kb": sum(each.written for each in costs) / len(costs),
    }


# --- Alertmanager, with the shipped routes ---


def measure_alertmanager(number: int) -> Numbers:
    """From as many alerts at once to all notifications; then what receiving all again costs."""
    notified = threading.Semaphore(0)

    class Receiver(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            notified.release()
            self.send_response(200)
            self.end_headers()

    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        webhook = stack.enter_context(answering(Receiver))
        server = _alertmanager(folder, f"http://{webhook}/")
        stack.enter_context(servers.running(server))
        empty = resident_megabytes(server.process.pid)
        spent, begin = cpu_seconds(server.process.pid), time.monotonic()
        _post(server.address, number)
        for _ in range(number):
            assert notified.acquire(timeout=120), "a notification is missing"
        seconds = time.monotonic() - begin
        cpu = cpu_seconds(server.process.pid) - spent
        spent = cpu_seconds(server.process.pid)
        _post(server.address, number)
        return {
            "seconds": seconds,
            "cpu": cpu,
            "again_cpu": cpu_seconds(server.process.pid) - spent,
            "memory_mb": resident_megabytes(server.process.pid) - empty,
        }


def _alertmanager(folder: Path, webhook: str) -> servers.Server:
    config = yaml.safe_load((ALERTMANAGER / "alertmanager.yml").read_text())
    config["templates"] = [str(ALERTMANAGER / "templates" / "*.tmpl")]
    config["receivers"] = [
        {"name": each["name"], "webhook_configs": [{"url": webhook}]}
        for each in config["receivers"]
    ]
    (folder / "alertmanager.yml").write_text(yaml.safe_dump(config))
    return servers.alertmanager(folder, folder / "alertmanager.yml", f"127.0.0.1:{free_port()}")


def _post(address: str, number: int) -> None:
    """Send the alerts as Prometheus does."""
    alerts = [
        {
            "labels": {
                "alertname": "RosDiagnosticsComponentCritical",
                "severity": "critical",
                "fleet": "bench",
                "scope": "component",
                "state": "critical",
                "robot": f"robot_{n}",
                "group": "/Motor",
                "component": "Motor 1",
            },
            "annotations": {"evidence": "winding at 131 C; values: Temperature: 131 degC"},
        }
        for n in range(number)
    ]
    for first in range(0, number, BATCH):
        body = json.dumps(alerts[first : first + BATCH]).encode()
        url = f"http://{address}/api/v2/alerts"
        request = urllib.request.Request(url, body, {"Content-Type": "application/json"})
        urllib.request.urlopen(request, timeout=30).close()


# --- All of it ---


def measure(options: argparse.Namespace) -> dict[str, Any]:
    """The numbers that are asked for, as scaling.RESULTS has them; prints how far it is."""
    steps: dict[str, tuple[Callable[[int], Any], list[int], str]] = {
        "exporter": (partial(measure_exporter, seconds=options.seconds), options.robots, "robots"),
        "prometheus": (
            partial(measure_prometheus, rounds=options.rounds),
            options.robots,
            "robots",
        ),
        "database": (measure_database, options.robots, "robots"),
        "alertmanager": (measure_alertmanager, [*ALERTS], "alerts"),
    }
    return {
        name: {str(number): _step(name, step, number, unit) for number in numbers}
        for name, (step, numbers, unit) in steps.items()
        if name in options.only
    }


def _step(name: str, step: Callable[[int], Any], number: int, unit: str) -> Any:
    begin = time.monotonic()
    found = step(number)
    took = f"{name}, {number} {unit}: {time.monotonic() - begin:.0f} s"
    print(took, json.dumps(found), file=sys.stderr, flush=True)
    return found


def main() -> None:
    """Measure, print the tables, and keep them where that is asked for."""
    parser = argparse.ArgumentParser("./run bench scale", description=__doc__)
    parser.add_argument("--robots", type=int, nargs="+", default=[1000, 3000])
    parser.add_argument("--seconds", type=float, default=30.0, help="of DDS")
    parser.add_argument("--rounds", type=int, default=6, help="evaluations of rules looked at")
    parser.add_argument("--only", nargs="+", choices=STEPS, default=STEPS, help="keep the others")
    parser.add_argument("--write", action="store_true", help="keep the numbers")
    options = parser.parse_args()
    numbers = measure(options)
    if scaling.RESULTS.exists():
        numbers = {**json.loads(scaling.RESULTS.read_text()), **numbers}
    if options.write:
        scaling.RESULTS.write_text(json.dumps(numbers, indent=1) + "\n")
    if numbers.keys() >= {*STEPS}:  # else the first of several calls, each with `--only`
        print(scaling.tables(numbers))


if __name__ == "__main__":
    main()
