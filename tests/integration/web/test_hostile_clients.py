"""Hundreds of clients that send requests and do not read, against the real exporter.

They reconnect when they are closed. Each process stays below 1,024 open files.
"""

import base64
import gzip
import re
import sys
import time
import urllib.request
from collections.abc import Callable
from itertools import cycle
from pathlib import Path

import bcrypt
import pytest

from ros_diagnostics_exporter.model import Level, Status
from support import hostile_clients
from support.ros_publisher import publisher
from testbed.polling import until
from testbed.processes import Process

ROBOTS = 1_000  # declared: some megabytes of metrics without a publisher
CLIENTS = 520
SCRAPES = 20
EVENTS = 10_000
MEGABYTE = 1_000_000


@pytest.fixture
def attack(site) -> Callable[..., Process]:
    """Starts a number of clients at an address that request a path and do not read."""

    def start(number: int, source: str, path: str) -> Process:
        options = map(str, (site.port, number, source, path))
        command = [sys.executable, hostile_clients.__file__, *options]
        clients = site.start_program("clients", command).process
        clients.wait_for_output("ready", seconds=60)
        return clients

    return start


def scrape(port: int, authorization: str = "") -> bytes:
    """The exposition, scraped as by Prometheus."""
    headers = {"Accept-Encoding": "gzip", "Authorization": authorization}
    request = urllib.request.Request(f"http://127.0.0.1:{port}/metrics", headers=headers)
    with urllib.request.urlopen(request, timeout=30) as answer:
        return gzip.decompress(answer.read())


def memory(process: Process) -> int:
    """The most bytes of RAM that the process has held so far."""
    status = Path(f"/proc/{process.pid}/status").read_text()
    return int(status.partition("VmHWM:")[2].split()[0]) * 1_024


def changes(exposition: bytes) -> float:
    """How often levels have changed."""
    lines = exposition.decode().splitlines()
    return sum(
        float(line.rpartition(" ")[2])
        for line in lines
        if line.startswith("ros_diagnostics_component_changes_total{")
    )


def declare(site, robots: int) -> None:
    """Write a fleet.yml with robots that are never received."""
    robot = "  - {name: robot_%d, namespace: /robot_%d, domain_id: %d}\n"
    names = "".join(robot % (number, number, site.domain_id) for number in range(robots))
    site.fleet_file.write_text(f"fleet: hall\nrobots:\n{names}")


@pytest.mark.parametrize(
    ("path", "source"),
    [
        ("/metrics", "127.0.0.1"),
        ("/api/v1/fleet", "127.0.0.2"),
        pytest.param("/metrics", "127.0.0.2", marks=pytest.mark.slow),
        pytest.param("/api/v1/fleet", "127.0.0.1", marks=pytest.mark.slow),
    ],
)
def test_clients_that_do_not_read_do_not_block_prometheus(site, attack, source, path):
    declare(site, ROBOTS)
    exporter = site.serve()
    size, before = len(scrape(site.port)), memory(exporter)
    assert size > MEGABYTE
    attack(CLIENTS, source, path)
    for _ in range(SCRAPES):
        assert abs(len(scrape(site.port)) - size) < size / 10
    assert memory(exporter) - before < 800 * MEGABYTE
    assert "Traceback" not in exporter.output()


def test_clients_without_a_password_do_not_block_prometheus(site, attack, tmp_path):
    web, login = tmp_path / "web.yml", base64.b64encode(b"prometheus:x").decode()
    hashed = bcrypt.hashpw(b"x", bcrypt.gensalt(rounds=10)).decode()
    web.write_text(f"basic_auth_users: {{prometheus: {hashed}}}")
    site.serve("--web.config.file", web)
    attack(CLIENTS, "127.0.0.1", "/metrics?" + "x" * 2_000)
    for _ in range(SCRAPES):
        assert b"ros_diagnostics_exporter_robots" in scrape(site.port, f"Basic {login}")


def test_the_memory_of_unread_events_is_limited(site, attack):
    exporter = site.serve()
    with publisher(site.domain_id) as robot:
        topics = [f"/robot_{number}/diagnostics_agg" for number in range(10)]
        for topic in topics:
            robot.offer(topic)
        robot.wait_for_listeners()

        levels = cycle((Level.ERROR, Level.OK))

        def change() -> bool:
            """Whether there were as many changes as events are kept."""
            level, message = next(levels), f"{time.monotonic()} " + "\N{ROBOT FACE}" * 200
            arms = [Status(level, f"/Arm/Arm {number}", message) for number in range(100)]
            for topic in topics:
                robot.send(topic, Status(level, "/Arm", ""), *arms)
            return changes(scrape(site.port)) >= EVENTS

        until(change, exporter.describe, seconds=120)
    before = memory(exporter)
    attack(8, "127.0.0.1", "/api/v1/events?limit=10000")
    for _ in range(SCRAPES):
        assert scrape(site.port)
    assert memory(exporter) - before < 300 * MEGABYTE


def test_a_low_limit_of_open_files_is_logged_and_survived(site, attack):
    exporter = site.process()
    exporter.argv = ["prlimit", "--nofile=38:38", *exporter.argv]  # it has 22 before any client
    site.serve(process=exporter)
    assert "only 38 files may be open" in exporter.output()
    assert "LimitNOFILE" in exporter.output()
    # Joining a domain imports modules, which takes files too.
    until(lambda: re.search(rb"exporter_domain_up{.*} 1", scrape(site.port)), exporter.describe)
    attack(300, "127.0.0.2", "/metrics")
    until(lambda: "no connection can be accepted" in exporter.output(), exporter.describe)
    for _ in range(SCRAPES):
        assert b'exporter_domain_up{domain_id="' in scrape(site.port)
    assert len(exporter.output().splitlines()) < 100
    assert "Traceback" not in exporter.output()
