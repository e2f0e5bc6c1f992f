"""One publisher floods a real exporter over real DDS: the other robots stay up and fresh."""

from __future__ import annotations

import re
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Callable
from pathlib import Path

import pytest

from testbed import domains
from testbed.polling import until
from testbed.processes import Process

pytestmark = pytest.mark.integration

TESTS = Path(__file__).parents[2]
ROBOTS = 20
STALE_AFTER = 5.0
# 200 kB, 2.7 MB and 0.1 kB: each but the last costs more than a core at the rate it is sent.
LARGE = ["--rate", "60", "--statuses", "500", "--values", "16", "--text", "1"]
HUGE = ["--rate", "20", "--statuses", "2000", "--values", "28", "--text", "24"]
SMALL = ["--rate", "20000", "--statuses", "1", "--values", "2"]
SECONDS = 9
MEMORY = 400 << 20


class Exporter:
    """The exporter as a program, with robots r0 to r19 and one more, ``evil``."""

    def __init__(
        self, start: Callable[..., Process], folder: Path, port: int, good: int, evil: int
    ) -> None:
        names = [f"r{number}" for number in range(ROBOTS)]
        robots = "".join(
            f"  - {{name: {name}, domain_id: {domain_id}, topic: /{name}/diagnostics, "
            "source: raw}\n"
            for name, domain_id in [*((name, good) for name in names), ("evil", evil)]
        )
        fleet = folder / "fleet.yml"
        fleet.write_text(
            f"fleet: f\nprofiles: {{default: {{stale_after: {STALE_AFTER:.0f}s}}}}\n"
            f"robots:\n{robots}"
            f'discovery: [{{topic: "/x{{robot}}/diagnostics", domain_ids: [{evil}]}}]\n'
        )
        command = [Path(sys.executable).parent / "ros-diagnostics-exporter", "--config.file", fleet]
        self._url = f"http://127.0.0.1:{port}"
        address = ["--web.listen-address", f"127.0.0.1:{port}"]
        storage = ["--storage.path", folder / "exporter.db"]
        self._start, self._good, self._evil = start, good, evil
        self.process = start("exporter", [*command, *address, *storage], domains.environment(good))
        self.robots = self._load("robots", good, "/r{}/diagnostics", "--topics", str(ROBOTS))
        until(lambda: self._is_serving() and len(self.fresh()) == ROBOTS, "all robots up")

    def _load(self, name: str, domain_id: int, *arguments: str) -> Process:
        environment = domains.environment(domain_id) | {"PYTHONPATH": str(TESTS)}
        return self._start(
            name, [sys.executable, TESTS / "support/dds_load.py", *arguments], environment
        )

    def attack(self, *arguments: str) -> Process:
        """The flood, as it is under way."""
        attack = self._load("evil", self._evil, *arguments, "--matched", "--seconds", str(SECONDS))
        attack.wait_for_output("publishing", 60)
        return attack

    def get(self, path: str = "/metrics") -> str:
        with urllib.request.urlopen(self._url + path, timeout=30) as answer:
            return answer.read().decode()

    def _is_serving(self) -> bool:
        try:
            return bool(self.get("/-/healthy"))
        except OSError:
            return False

    def samples(self, name: str) -> dict[str, float]:
        """Labels as served -> value of ros_diagnostics_``name``."""
        found = re.findall(rf"^ros_diagnostics_{name}{{(.*)}} (\S+)$", self.get(), re.MULTILINE)
        return {labels: float(value) for labels, value in found}

    def fresh(self) -> set[str]:
        """The good robots that are up and whose last array is younger than ``STALE_AFTER``."""
        text = self.get()
        now = time.time()
        up = set(re.findall(r'robot_up{.*robot="(r\d+)".*} 1\.0$', text, re.MULTILINE))
        last = re.findall(
            r'robot_last_message_timestamp_seconds{.*robot="(r\d+)".*} (\S+)$', text, re.MULTILINE
        )
        return {robot for robot, at in last if robot in up and now - float(at) < STALE_AFTER}

    def memory(self) -> int:
        """The resident set of the exporter, in bytes, at its highest."""
        status = Path(f"/proc/{self.process.pid}/status").read_text()
        return int(re.search(r"VmHWM:\s+(\d+) kB", status)[1]) << 10


@pytest.fixture
def make_exporter(start_process, free_port, tmp_path):
    def make(good: int, evil: int) -> Exporter:
        return Exporter(start_process, tmp_path, free_port(), good, evil)

    return make


def all_stay_fresh(exporter: Exporter, attack: Process) -> None:
    """Every robot is up and fresh at each scrape while the attack lasts."""
    everybody = {f"r{number}" for number in range(ROBOTS)}
    scrapes = 0
    while attack.alive:
        assert exporter.fresh() == everybody, attack.describe()
        scrapes += 1
    assert scrapes
    assert "sent" in attack.output()


def dropped(exporter: Exporter) -> float:
    return sum(
        value
        for labels, value in exporter.samples("robot_rejected_total").items()
        if 'robot="evil"' in labels and 'reason="rate"' in labels
    )


@pytest.mark.parametrize(
    "flood",
    [
        pytest.param(LARGE, id="large"),
        pytest.param(HUGE, id="huge", marks=pytest.mark.slow),
        pytest.param(SMALL, id="small", marks=pytest.mark.slow),
    ],
)
def test_a_flood_on_one_topic_harms_no_other_robot(make_exporter, ros_domain, flood):
    exporter = make_exporter(ros_domain, ros_domain)
    all_stay_fresh(exporter, exporter.attack("/evil/diagnostics", *flood))

    assert exporter.memory() < MEMORY
    assert exporter.samples("robot_up")['fleet="f",robot="evil"'] == 1
    assert exporter.get("/-/ready") == "ready\n"
    if flood is not SMALL:  # how many of these a publisher manages to send depends on the machine
        assert dropped(exporter)
        assert exporter.process.output().count("/evil/diagnostics: more arrives than") == 1


@pytest.mark.slow
def test_a_flood_in_another_domain_harms_no_robot(make_exporter, ros_domain):
    with domains.lease() as evil:
        exporter = make_exporter(ros_domain, evil)
        all_stay_fresh(exporter, exporter.attack("/evil/diagnostics", *LARGE))
        assert dropped(exporter)


@pytest.mark.slow
def test_floods_on_many_topics_harm_no_other_robot(make_exporter, ros_domain):
    """Together they may use the whole thread of the domain: who has cost little goes first."""
    exporter = make_exporter(ros_domain, ros_domain)
    attack = exporter.attack("/x{}/diagnostics", *LARGE, "--topics", "20", "--rate", "10")
    all_stay_fresh(exporter, attack)


def test_sigterm_ends_the_exporter_during_a_flood(make_exporter, ros_domain):
    exporter = make_exporter(ros_domain, ros_domain)
    attack = exporter.attack("/evil/diagnostics", *HUGE)
    until(lambda: dropped(exporter), "dropped messages")

    assert exporter.process.stop(grace=10) == 0
    assert attack.alive
    assert "is not left yet" not in exporter.process.output()


def test_fifty_drivers_at_10_hz_on_one_topic_lose_nothing(make_exporter, ros_domain):
    exporter = make_exporter(ros_domain, ros_domain)
    drivers = exporter.attack(
        "/evil/diagnostics", "--publishers", "50", "--rate", "10", "--arrays", "60",
        "--depth", "1000",
    )  # fmt: skip

    received = 'fleet="f",robot="evil"'
    until(lambda: exporter.samples("robot_messages_total")[received] == 50 * 60, "all arrays", 60)
    assert not dropped(exporter)
    assert "sent 3000 arrays" in drivers.wait_for_output("sent .*")[0]
