"""Exporter, Prometheus and Alertmanager as shipped, with a fleet of any size, and what they use."""

from __future__ import annotations

import random
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, field
from pathlib import Path
from statistics import median, quantiles
from typing import NamedTuple

import httpx

from bench.scraper import MESSAGE_BYTES, MESSAGES, SEQUENCE, Scraper, robots_up, total
from experiments import fleet
from experiments.usage import usage
from ros_diagnostics_exporter.sources.ros_environment import use_profiles
from testbed import configuration, domains, http, programs, servers
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process
from testbed.servers import Server

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


@dataclass(frozen=True)
class Site:
    """The processes of the fleet, the measured programs by name, and where they listen."""

    fleets: list[Server]
    programs: dict[str, Server]
    addresses: configuration.Addresses

    @property
    def exporter(self) -> str:
        """HOST:PORT."""
        return self.addresses.exporter

    def query(self, promql: str) -> list[http.Sample]:
        """Return the instant vector of an expression."""
        return http.query(self.addresses.prometheus, promql)

    def number(self, promql: str) -> float:
        """Return the only value of an expression; NaN where there is none."""
        found = self.query(promql)
        return found[0].value if found else float("nan")


@contextmanager
def running(workload: Workload) -> Iterator[Site]:
    """Start everything, yield when Prometheus has every robot and fault, stop everything.

    A robot of which too little is received may be silent: that is for the result.

    Raises:
        TimeoutError: It was not ready in time.
    """
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="experiment-")))
        domain_id = stack.enter_context(domains.lease())
        site = _prepare(folder, domain_id, workload)
        for server in (*site.fleets, *site.programs.values()):
            stack.callback(server.process.stop)
            server.process.start()
        for server in site.fleets:
            server.process.wait_for_output("ready", START_SECONDS)
        for server in site.programs.values():
            server.wait_until_ready()
        _wait_for_robots(site, workload)
        yield site


def environment(domain_id: int, folder: Path) -> dict[str, str]:
    """Return the variables of programs that speak to each other as computers in a network do."""
    between = domains.environment(domain_id) | domains.BETWEEN_MACHINES
    return between | {"ROS_LOG_DIR": str(folder / "ros-log")}


def _prepare(folder: Path, domain_id: int, workload: Workload) -> Site:
    own = environment(domain_id, folder) | {
        "PYTHONPATH": f"{CHECKOUT / 'lab'}:{CHECKOUT / 'tests'}"
    }
    addresses = configuration.Addresses(*(f"127.0.0.1:{free_port()}" for _ in range(5)))
    configs = configuration.write(folder, domain_id, addresses, configuration.Clocks())
    configs.fleet.write_text(FLEET_YML.format(domain_id=domain_id))
    exporter = programs.exporter(
        configs.fleet, addresses.exporter, folder / "exporter.db", addresses.alertmanager
    )
    # Hundreds of robots share a participant, and so a socket: it needs room as the exporter's.
    of_robots = dict(own)
    use_profiles(of_robots, folder)
    fleets = [
        Server(Process("fleet", argv, of_robots, folder / f"fleet-{number}.log"))
        for number, argv in enumerate(fleet.commands(*workload))
    ]
    return Site(
        fleets,
        {
            "exporter": Server(
                Process("exporter", exporter, own, folder / "exporter.log"),
                addresses.exporter,
            ),
            "prometheus": servers.prometheus(folder, configs.prometheus, addresses.prometheus),
            "alertmanager": servers.alertmanager(
                folder, configs.alertmanager, addresses.alertmanager
            ),
        },
        addresses,
    )


def _wait_for_robots(site: Site, workload: Workload) -> None:
    def there() -> bool:
        try:
            known = site.number("count(ros_diagnostics_robot_up)")
            faults = site.number('count(ALERTS{alertstate="firing",component!=""})')
        except http.Unanswered:  # too busy
            return False
        return known == workload.robots and (workload.faults == 0 or faults >= workload.faults)

    until(there, f"{workload.robots} robots in Prometheus", START_SECONDS, every=1.0)
    with suppress(TimeoutError):  # how many are received stands in the result
        until(lambda: up(site.exporter) == workload.robots, "all", START_SECONDS, every=5.0)


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
    scraper, samples = Scraper(site.exporter), _Samples()
    text, started = scraper.text(), time.monotonic()
    before, payload, dropped = _counts(text), total(MESSAGE_BYTES, text), _dropped()
    for _ in range(round(seconds / SLICE)):
        began = time.monotonic()
        used = {name: usage(server.process.pid).cpu for name, server in site.programs.items()}
        for _ in range(AGES):
            pause.wait(random.uniform(0, 2 * SLICE / AGES))
            _sample_age(site, samples)
        pause.wait(max(0.0, began + SLICE - time.monotonic()))
        elapsed = time.monotonic() - began
        for name, server in site.programs.items():
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
        "up": site.number("count(ros_diagnostics_robot_up == 1)"),
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
            f"{name}_memory": round(usage(site.programs[name].process.pid).memory, 1),
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
    since = f"[{seconds:.0f}s]"
    sizes = {"robots": "exclude[]=faults", "faults": "collect[]=faults"}
    zipped = {name: _transferred(site, query) for name, query in sizes.items()}
    return {
        "samples": site.number(f"scrape_samples_scraped{{{robots}}}"),
        "scrape_seconds": site.number(f"avg_over_time(scrape_duration_seconds{{{robots}}}{since})"),
        "scrape_seconds_max": site.number(
            f"max_over_time(scrape_duration_seconds{{{robots}}}{since})"
        ),
        "faults_scrape_seconds": site.number(
            f"avg_over_time(scrape_duration_seconds{{{faults}}}{since})"
        ),
        "scrapes_failed": site.number(
            f'sum(count_over_time(up{{instance="{site.exporter}"}}{since})'
            f' - sum_over_time(up{{instance="{site.exporter}"}}{since}))'
        ),
        # kB/s at the shipped intervals, 15 s and 2 s
        "scrape_rate": round((zipped["robots"] / 15 + zipped["faults"] / 2) / 1e3, 2),
    }


def _transferred(site: Site, query: str) -> int:
    """Return the bytes of one answer as they are sent, compressed."""
    url = f"http://{site.exporter}/metrics?{query}"
    headers = {"Accept-Encoding": "gzip"}
    with (
        httpx.Client(trust_env=False) as client,
        client.stream("GET", url, headers=headers, timeout=60.0) as response,
    ):
        return sum(len(each) for each in response.iter_raw())
