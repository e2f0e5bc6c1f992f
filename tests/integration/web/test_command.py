"""The exporter as a command: its flags, its exit codes, and what it tells the system."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import urllib.error
import urllib.request
from collections.abc import Iterator
from pathlib import Path

import pytest

from fleet_demo import domains, ports
from fleet_demo.processes import Process
from fleet_demo.waiting import until

pytestmark = pytest.mark.integration

BIN = Path(sys.executable).parent


@pytest.fixture(scope="module")
def domain_id() -> Iterator[int]:
    with domains.lease() as leased:
        yield leased


@pytest.fixture
def fleet_file(tmp_path: Path, domain_id: int) -> Path:
    path = tmp_path / "fleet.yml"
    path.write_text(
        f"""
fleet: hall
profiles: {{default: {{stale_after: 5s, confirm_after: 5s}}}}
discovery: [{{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{domain_id}]}}]
"""
    )
    return path


def run(*arguments: str | Path) -> subprocess.CompletedProcess[str]:
    """The exporter, expected to end by itself."""
    command = [str(BIN / "ros-diagnostics-exporter"), *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)


def test_a_wrong_web_config_is_named_and_nothing_is_served(fleet_file, tmp_path):
    web = tmp_path / "web.yml"
    web.write_text("basic_auth_users: {alice: password}")
    for check in ([], ["--config.check"]):
        ended = run("--config.file", fleet_file, "--web.config.file", web, *check)
        assert ended.returncode == 2
        assert f"{web}: basic_auth_users.alice: is not a bcrypt hash" in ended.stderr


def test_a_taken_port_is_named(fleet_file, tmp_path):
    with socket.create_server(("127.0.0.1", 0)) as taken:
        address = f"127.0.0.1:{taken.getsockname()[1]}"
        events = tmp_path / "events.jsonl"  # its thread must not keep the process alive
        ended = run(
            "--config.file", fleet_file, "--web.listen-address", address, "--events.path", events
        )
    assert ended.returncode == 1
    assert f"cannot listen on {address}: Address already in use" in ended.stderr


def test_an_event_log_that_cannot_be_opened_is_named(fleet_file, tmp_path):
    ended = run("--config.file", fleet_file, "--events.path", tmp_path / "missing" / "events")
    assert ended.returncode == 2
    assert f"--events.path: {tmp_path}/missing/events: No such file" in ended.stderr


def test_config_check_says_what_was_understood(fleet_file):
    ended = run("--config.file", fleet_file, "--config.check")
    assert ended.returncode == 0
    assert "/{robot}/diagnostics_agg" in ended.stdout


@pytest.fixture
def notified(tmp_path: Path) -> Iterator[socket.socket]:
    """A socket in the place of systemd's."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(tmp_path / "notify"))
        sock.settimeout(30)
        yield sock


def test_a_whole_life_from_ready_to_sigterm(fleet_file, domain_id, notified, tmp_path):
    port, second = ports.free_port(), ports.free_port()
    environment = domains.environment(domain_id) | {"NOTIFY_SOCKET": str(tmp_path / "notify")}
    robots = Process(
        "virtual-robots",
        [BIN / "virtual-robots", "--robots", "2", "--domain-id", str(domain_id)],
        environment,
        tmp_path / "robots.log",
    )
    events = tmp_path / "events.jsonl"
    exporter = Process(
        "exporter",
        [
            *(BIN / "ros-diagnostics-exporter", "--config.file", fleet_file),
            *("--web.listen-address", f"127.0.0.1:{port}"),
            *("--web.listen-address", f"127.0.0.1:{second}"),
            *("--events.path", events, "--log.format", "json", "--web.enable-lifecycle"),
        ],
        environment,
        tmp_path / "exporter.log",
    )
    try:
        exporter.start()
        assert notified.recv(100) == b"READY=1"
        robots.start()
        until(lambda: all(up(each) == 2 for each in (port, second)), exporter.describe)
        fault(domain_id, "error")
        until(lambda: levels(events)[-1:] == [("OK", "ERROR")], exporter.describe)
        fault(domain_id, "ok")
        until(lambda: levels(events)[-1:] == [("ERROR", "OK")], exporter.describe)
        said = get(port, "/api/v1/events?component=Motor%202&robot=robot_1&limit=2")["events"]
        assert [event["after"] for event in said] == ["OK", "ERROR"]
        robots.stop()
        until(lambda: up(port) == 0, exporter.describe)
        forgotten = get(port, "/-/forget?robot=robot_1", "POST")
        assert forgotten["forgotten"] > 0
        assert [robot["robot"] for robot in get(port, "/api/v1/fleet")["robots"]] == ["robot_2"]
    finally:
        robots.stop()
        assert exporter.stop() == 0
    assert notified.recv(100) == b"STOPPING=1"
    assert all(json.loads(line)["logger"] for line in exporter.output().splitlines())


def get(port: int, path: str, method: str = "GET"):
    request = urllib.request.Request(f"http://127.0.0.1:{port}{path}", method=method)
    with urllib.request.urlopen(request, timeout=20) as answer:
        return json.load(answer)


def up(port: int) -> int:
    return sum(robot["up"] for robot in get(port, "/api/v1/fleet")["robots"])


def levels(path: Path) -> list[tuple[str, str]]:
    """Before and after of the changes of robot_1's second motor in the event log."""
    events = [json.loads(line) for line in path.read_text().splitlines()]
    return [
        (event["before"], event["after"])
        for event in events
        if event.get("component") == "Motor 2" and event["robot"] == "robot_1"
    ]


def fault(domain_id: int, level: str) -> None:
    command = [BIN / "virtual-robots", "fault", "robot_1", "Motor 2", level]
    subprocess.run(
        [*map(str, command), "--domain-id", str(domain_id)],
        check=True,
        timeout=60,
        env=os.environ | domains.environment(domain_id),
    )
