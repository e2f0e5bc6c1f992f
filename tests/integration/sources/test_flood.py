"""One publisher floods a real exporter over real DDS: the other robots stay up and fresh."""

import re
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest

from support.exposition import samples, value
from testbed import domains, http, programs
from testbed.polling import until
from testbed.processes import Process

TESTS = Path(__file__).parents[2]
ROBOTS = 20
EVERYBODY = {f"r{number}" for number in range(ROBOTS)}
STALE_AFTER = 5.0
# 200 kB, 2.7 MB and 0.1 kB: each but the last costs more than a core at the rate it is sent.
LARGE = ["--rate", "150", "--statuses", "500", "--values", "16", "--text", "1"]
HUGE = ["--rate", "20", "--statuses", "2000", "--values", "28", "--text", "24"]
SMALL = ["--rate", "20000", "--statuses", "1", "--values", "2"]
SECONDS = 9
MEMORY = 400 << 20


class Exporter:
    """The exporter as a program, with robots r0 to r19 and one more, ``evil``."""

    def __init__(self, start: Callable[..., Process], folder: Path, port: int, domain: int) -> None:
        robots = "".join(
            f"  - {{name: {name}, domain_id: {domain}, topic: /{name}/diagnostics, source: raw}}\n"
            for name in (*EVERYBODY, "evil")
        )
        fleet = folder / "fleet.yml"
        fleet.write_text(
            f"fleet: f\nprofiles: {{default: {{stale_after: {STALE_AFTER:.0f}s}}}}\n"
            f"limits: {{message_bytes: {4 << 20}}}\n"
            f"robots:\n{robots}"
            f'discovery: [{{topic: "/x{{robot}}/diagnostics", domain_ids: [{domain}]}}]\n'
        )
        self.address = f"127.0.0.1:{port}"
        self._start, self._environment = start, domains.environment(domain)
        argv = programs.exporter(fleet, self.address, folder / "exporter.db")
        self.process = start("exporter", argv, self._environment)
        self._load("robots", "/r{}/diagnostics", "--topics", str(ROBOTS))
        healthy = partial(http.answers, self.address, "/-/healthy")
        until(lambda: healthy() and len(self.fresh()) == ROBOTS, "all robots up")

    def _load(self, name: str, *arguments: str) -> Process:
        environment = self._environment | {"PYTHONPATH": str(TESTS)}
        argv = [sys.executable, TESTS / "support/dds_load.py", *arguments]
        return self._start(name, argv, environment)

    def attack(self, *arguments: str) -> Process:
        """The flood, as it is under way."""
        attack = self._load("evil", *arguments, "--matched", "--seconds", str(SECONDS))
        attack.wait_for_output("publishing", 60)
        return attack

    def of_evil(self, name: str, **labels: str) -> float:
        return value(self.address, name, robot="evil", **labels) or 0.0

    def dropped(self) -> float:
        return self.of_evil("robot_rejected_total", reason="rate")

    def fresh(self) -> set[str]:
        """The good robots that are up and whose last array is younger than ``STALE_AFTER``."""
        found, now = samples(self.address), time.time()

        def robots(name: str, *, later: float = 0.0) -> set[str]:
            named = (each for each in found if each.name == f"ros_diagnostics_robot_{name}")
            return {each.labels["robot"] for each in named if each.value > later}

        last = robots("last_message_timestamp_seconds", later=now - STALE_AFTER)
        return robots("up") & last & EVERYBODY

    def memory(self) -> int:
        """The resident set of the exporter, in bytes, at its highest."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) << 10


@pytest.fixture
def exporter(start_process, free_port, tmp_path, ros_domain) -> Exporter:
    return Exporter(start_process, tmp_path, free_port(), ros_domain)


def all_stay_fresh(exporter: Exporter, attack: Process) -> None:
    """Every robot is up and fresh at each scrape while the attack lasts."""
    scrapes = 0
    while attack.alive:
        assert exporter.fresh() == EVERYBODY, attack.describe()
        scrapes += 1
    assert scrapes
    assert "sent" in attack.output()


@pytest.mark.parametrize(
    "flood",
    [
        pytest.param(LARGE, id="large"),
        pytest.param(HUGE, id="huge", marks=pytest.mark.slow),
        pytest.param(SMALL, id="small", marks=pytest.mark.slow),
    ],
)
def test_a_flood_on_one_topic_harms_no_other_robot(exporter, flood):
    all_stay_fresh(exporter, exporter.attack("/evil/diagnostics", *flood))

    assert exporter.memory() < MEMORY
    assert exporter.of_evil("robot_up") == 1
    assert http.get(exporter.address, "/-/ready") == b"ready\n"
    if flood is not SMALL:  # how many of these a publisher manages to send depends on the machine
        assert exporter.dropped()
        assert exporter.process.output().count("/evil/diagnostics: more arrives than") == 1


@pytest.mark.slow
def test_floods_on_many_topics_harm_no_other_robot(exporter):
    """Together they may use the whole thread of the domain: who has cost little goes first."""
    attack = exporter.attack("/x{}/diagnostics", *LARGE, "--topics", "5", "--rate", "40")
    all_stay_fresh(exporter, attack)


def test_sigterm_ends_the_exporter_during_a_flood(exporter):
    attack = exporter.attack("/evil/diagnostics", *HUGE)
    until(exporter.dropped, "dropped messages")

    assert exporter.process.stop(grace=10) == 0
    assert attack.alive
    assert "is not left yet" not in exporter.process.output()


def test_fifty_drivers_at_10_hz_on_one_topic_lose_nothing(exporter):
    drivers = exporter.attack(
        "/evil/diagnostics", "--publishers", "50", "--rate", "10", "--arrays", "60",
        "--depth", "1000",
    )  # fmt: skip

    received = partial(exporter.of_evil, "robot_messages_total")
    until(lambda: received() == 50 * 60, "all arrays", 60)
    assert not exporter.dropped()
    assert "sent 3000 arrays" in drivers.wait_for_output("sent .*")[0]
