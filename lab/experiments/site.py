"""Exporter, Prometheus and Alertmanager as shipped, with a fleet of any size, and what they use."""

from __future__ import annotations

import random
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median, quantiles
from typing import NamedTuple

import httpx

from bench.scraper import MESSAGE_BYTES, MESSAGES, SEQUENCE, Scraper, robots_up, total
from experiments import fleet
from experiments.usage import usage
from ros_diagnostics_exporter.sources.ros_environment import use_profiles
from testbed import configuration, domains, http
from testbed.polling import until
from testbed.processes import Process
from testbed.servers import Server
from testbed.site import Site

START_SECONDS = 240.0
SETTLE = 20.0  # seconds from when all is there: a scrape of all jobs, and some evaluations
SLICE = 10.0  # seconds; CPU is measured in such slices, so that its spread is known
AGES = 6  # random moments of a slice at which the age of what is shown is read
EVALUATION_INTERVAL = 5.0
CHECKOUT = configuration.CHECKOUT
FLEET_YML = """\
fleet: demo
limits: {{robots: 10000, series: 5000000, components: 2000}}
profiles: {{default: {{stale_after: 5s, confirm_after: 10s}}}}
discovery:
  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain_id}], labels: {{site: hall}}}}
"""


class Workload(NamedTuple):
    """What the fleet sends; ``rate`` in arrays a second of a robot, ``faults`` in components."""

    robots: int
    components: int = 16
    values: int = 4
    rate: float = 1.0
    faults: int = 0

    @property
    def messages(self) -> float:
        """Messages a second of the whole fleet."""
        return self.robots * self.rate


@contextmanager
def running(workload: Workload) -> Iterator[Site]:
    """Start everything, yield when Prometheus has every robot and fault, stop everything.

    A robot of which too little is received may be silent: that is for the result.

    Raises:
        TimeoutError: It was not ready in time.
    """
    with started() as site:
        # Hundreds of robots share a participant, and so a socket: as large as the exporter's.
        of_robots = site.environment() | {"PYTHONPATH": f"{CHECKOUT / 'lab'}:{CHECKOUT / 'tests'}"}
        use_profiles(of_robots, site.folder)
        for number, argv in enumerate(fleet.commands(*workload)):
            log = site.folder / f"fleet-{number}.log"
            site.start(Server(Process("fleet", argv, of_robots, log)))
        fleets = list(site.started)
        site.start_exporter(site.write("fleet.yml", FLEET_YML.format(domain_id=site.domain_id)))
        site.start_prometheus()
        site.start_alertmanager(recorder=site.exporter.address, links=True)
        for server in fleets:
            server.process.wait_for_output("ready", START_SECONDS)
        site.wait_until_ready()
        _wait_for_robots(site, workload)
        yield site


@contextmanager
def started() -> Iterator[Site]:
    """A site in a folder of its own whose programs speak as computers in a network do."""
    with (
        tempfile.TemporaryDirectory(prefix="experiment-") as folder,
        Site(Path(folder), environment=domains.BETWEEN_MACHINES) as site,
    ):
        yield site


def number(site: Site, promql: str) -> float:
    """The only value of an expression; NaN where there is none."""
    found = site.query(promql)
    return found[0].value if found else float("nan")


def measured(site: Site) -> dict[str, Server]:
    """The programs that are measured, by the names in the results."""
    return {
        "exporter": site.exporter,
        "prometheus": site.prometheus,
        "alertmanager": site.alertmanager,
    }


def _wait_for_robots(site: Site, workload: Workload) -> None:
    def there() -> bool:
        try:
            known = number(site, "count(ros_diagnostics_robot_up)")
            faults = number(site, 'count(ALERTS{alertstate="firing",component!=""})')
        except http.Unanswered:  # too busy
            return False
        return known == workload.robots and (workload.faults == 0 or faults >= workload.faults)

    until(there, f"{workload.robots} robots in Prometheus", START_SECONDS, every=1.0)
    with suppress(TimeoutError):  # how many are received stands in the result
        until(lambda: up(site.exporter.address) == workload.robots, "all", START_SECONDS, every=5.0)


def up(address: str) -> int:
    """Return how many robots the exporter there receives; 0 while it does not answer."""
    try:
        return robots_up(http.get(address, "/metrics?collect[]=faults", seconds=10.0))
    except http.Unanswered:
        return 0


@dataclass
class _Samples:
    """What is read while the measuring lasts."""

    cpu: dict[str, list[float]] = field(default_factory=dict)  # of one core, by slice
    evaluation: list[float] = field(default_factory=list)  # seconds of all rules, for 5 s
    age: list[float] = field(default_factory=list)  # seconds, of every robot at every moment


def measure(site: Site, workload: Workload, seconds: float) -> dict[str, float]:
    """Measure for so many seconds.

    CPU in cores (mean, and the lowest and highest of slices of 10 s), memory in MB at the end,
    ages and durations in seconds, network in kB/s.
    """
    pause = threading.Event()
    pause.wait(SETTLE)
    scraper, samples = Scraper(site.exporter.address), _Samples()
    text, started = scraper.text(), time.monotonic()
    before, payload, dropped = _counts(text), total(MESSAGE_BYTES, text), _dropped()
    for _ in range(round(seconds / SLICE)):
        began = time.monotonic()
        used = {name: usage(server.process.pid).cpu for name, server in measured(site).items()}
        for _ in range(AGES):
            pause.wait(random.uniform(0, 2 * SLICE / AGES))
            _sample_age(site, samples)
        pause.wait(max(0.0, began + SLICE - time.monotonic()))
        elapsed = time.monotonic() - began
        for name, server in measured(site).items():
            share = (usage(server.process.pid).cpu - used[name]) / elapsed
            samples.cpu.setdefault(name, []).append(share)
        _sample_evaluation(site, samples)
    text, elapsed = scraper.text(), time.monotonic() - started
    after, payload = _counts(text), total(MESSAGE_BYTES, text) - payload
    received = sum(after[robot].received - before[robot].received for robot in before)
    lost = sum(_lost(before[robot], after[robot], elapsed * workload.rate) for robot in before)
    return {
        **workload._asdict(),
        **_usage(site, samples),
        "up": number(site, "count(ros_diagnostics_robot_up == 1)"),
        "messages": received,
        "lost": lost,
        "dropped": _dropped() - dropped,
        "payload_rate": round(payload / elapsed / 1e3, 1),
        **_scrapes(site, seconds),
        "evaluation_seconds": round(median(samples.evaluation), 4),
        **_ages(samples.age),
    }


def _sample_evaluation(site: Site, samples: _Samples) -> None:
    groups = http.get_json(site.addresses.prometheus, "/api/v1/rules")["data"]["groups"]
    shares = (group["evaluationTime"] * EVALUATION_INTERVAL / group["interval"] for group in groups)
    samples.evaluation.append(sum(shares))


def _sample_age(site: Site, samples: _Samples) -> None:
    """Read how old the last message of each robot is, as Prometheus shows it now."""
    age = "time() - ros_diagnostics_robot_last_message_timestamp_seconds"
    samples.age.extend(each.value for each in site.query(age))


def _usage(site: Site, samples: _Samples) -> dict[str, float]:
    row: dict[str, float] = {}
    for name, shares in samples.cpu.items():
        row |= {
            f"{name}_cpu": round(sum(shares) / len(shares), 4),
            f"{name}_cpu_low": round(min(shares), 4),
            f"{name}_cpu_high": round(max(shares), 4),
            f"{name}_memory": round(usage(measured(site)[name].process.pid).memory, 1),
        }
    return row


def _ages(found: list[float]) -> dict[str, float]:
    """Return p50, p95 and maximum; NaN where no scrape succeeded."""
    if len(found) < 2:
        return dict.fromkeys(("age_p50", "age_p95", "age_max"), float("nan"))
    p95 = quantiles(found, n=20, method="inclusive")[-1]
    ages = {"age_p50": median(found), "age_p95": p95, "age_max": max(found)}
    return {name: round(age, 2) for name, age in ages.items()}


class _Count(NamedTuple):
    """Of one robot: messages received, and the number of the last; None while it is silent."""

    received: int
    number: int | None


def _counts(text: bytes) -> dict[str, _Count]:
    numbers = {robot: int(float(value)) for robot, value in SEQUENCE.findall(text)}
    return {
        robot.decode(): _Count(int(float(value)), numbers.get(robot))
        for robot, value in MESSAGES.findall(text)
    }


def _lost(before: _Count, after: _Count, sent: float) -> int:
    """Return how many messages of a robot were lost: by their numbers, or of so many sent."""
    received = after.received - before.received
    if before.number is None or after.number is None:
        return max(0, round(sent) - received)
    return after.number - before.number - received


def _dropped() -> int:
    """Return how many datagrams this machine has dropped so far for want of a socket's buffer."""
    lines = [line.split() for line in Path("/proc/net/snmp").read_text().splitlines()]
    names, values = (line for line in lines if line[0] == "Udp:")
    return int(values[names.index("RcvbufErrors")])


def _scrapes(site: Site, seconds: float) -> dict[str, float]:
    """Return how long Prometheus' scrapes took, how many failed, and how much they transfer."""
    robots, faults = ('job="ros-diagnostics"', 'job="ros-diagnostics-faults"')
    since, took = f"[{seconds:.0f}s]", "scrape_duration_seconds"
    sizes = {"robots": "exclude[]=faults", "faults": "collect[]=faults"}
    zipped = {name: _transferred(site, query) for name, query in sizes.items()}
    return {
        "samples": number(site, f"scrape_samples_scraped{{{robots}}}"),
        "scrape_seconds": number(site, f"avg_over_time({took}{{{robots}}}{since})"),
        "scrape_seconds_max": number(site, f"max_over_time({took}{{{robots}}}{since})"),
        "faults_scrape_seconds": number(site, f"avg_over_time({took}{{{faults}}}{since})"),
        "scrapes_failed": number(
            site,
            f'sum(count_over_time(up{{instance="{site.exporter.address}"}}{since})'
            f' - sum_over_time(up{{instance="{site.exporter.address}"}}{since}))',
        ),
        # kB/s at the shipped intervals, 15 s and 2 s
        "scrape_rate": round((zipped["robots"] / 15 + zipped["faults"] / 2) / 1e3, 2),
    }


def _transferred(site: Site, query: str) -> int:
    """Return the bytes of one answer as they are sent, compressed."""
    url = f"http://{site.exporter.address}/metrics?{query}"
    headers = {"Accept-Encoding": "gzip"}
    with (
        httpx.Client(trust_env=False) as client,
        client.stream("GET", url, headers=headers, timeout=60.0) as response,
    ):
        return sum(len(each) for each in response.iter_raw())
