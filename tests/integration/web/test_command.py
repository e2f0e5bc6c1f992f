"""The exporter as a command: its flags, exit codes and notifications to systemd."""

import json
import socket
import urllib.request
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from testbed import ports
from testbed.polling import until

# Of levels only: an ERROR that lasts for confirm_after is a fault, which has events of its own.
CHANGES = "/api/v1/events?kind=level&component=Motor%202&robot=robot_1"


def test_an_invalid_web_config_is_an_error_at_the_start(site, tmp_path):
    web = tmp_path / "web.yml"
    web.write_text("basic_auth_users: {alice: password}")
    for check in ([], ["--config.check"]):
        ended = site.run("--web.config.file", web, *check, code=2)
        assert f"{web}:1: basic_auth_users.alice: is not a bcrypt hash" in ended.stderr


def test_the_database_of_another_exporter_is_not_used(site):
    exporter = site.serve()
    ended = site.run("--web.listen-address", f"127.0.0.1:{ports.free_port()}", code=1)
    database = site.folder / "exporter.db"
    assert f"{database} is in use by another exporter (pid {exporter.pid})" in ended.stderr
    assert "give this one another --storage.path" in ended.stderr
    assert exporter.stop() == 0


def test_a_folder_that_is_missing_is_no_reason_not_to_start(site, tmp_path):
    exporter = site.serve("--storage.path", tmp_path / "missing" / "data" / "exporter.db")
    exporter.wait_for_output("exporter.db cannot be written: .* No such file or directory")
    assert site.ask("/api/v1/fleet")["robots"] == []
    assert exporter.stop() == 0


@pytest.fixture
def notified(tmp_path: Path) -> Iterator[socket.socket]:
    """A socket in place of systemd's."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
        sock.bind(str(tmp_path / "notify"))
        sock.settimeout(30)
        yield sock


def test_from_ready_to_sigterm(site, notified):
    second = ports.free_port()
    exporter = site.serve(
        *("--web.listen-address", f"127.0.0.1:{second}", "--web.enable-lifecycle"),
        *("--log.format", "json"),
    )
    assert notified.recv(100) == b"READY=1"
    robots = site.start_robots(2).process
    until(lambda: site.up() == site.up(second) == 2, exporter.describe)

    site.fault("robot_1", "Motor 2", "error")
    until(lambda: levels(site)[:1] == [("OK", "ERROR")], exporter.describe)
    site.fault("robot_1", "Motor 2", "ok")
    until(lambda: levels(site)[:1] == [("ERROR", "OK")], exporter.describe)
    found = site.ask(f"{CHANGES}&limit=2")["events"]
    assert [event["after"] for event in found] == ["OK", "ERROR"]

    robots.stop()
    until(lambda: site.up() == 0, exporter.describe)
    assert site.ask("/-/forget?robot=robot_1", "POST")["forgotten"] > 0
    assert [each["robot"] for each in site.ask("/api/v1/fleet")["robots"]] == ["robot_2"]

    assert exporter.stop() == 0
    assert notified.recv(100) == b"STOPPING=1"
    assert all(json.loads(line)["logger"] for line in exporter.output().splitlines())


def test_the_json_log_wraps_the_lines_of_the_middleware(site, tmp_path):
    profiles = tmp_path / "profiles.xml"
    profiles.write_text("<nonsense")
    exporter = site.process("--log.format", "json")
    exporter.env = {**exporter.env, "FASTRTPS_DEFAULT_PROFILES_FILE": str(profiles)}
    site.serve(process=exporter)
    exporter.wait_for_output("XMLPARSER")  # from Fast DDS
    assert exporter.stop() == 0
    records = [json.loads(line) for line in exporter.output().splitlines()]
    assert {each["logger"] for each in records if "XMLPARSER" in each["msg"]} == {"output"}


def levels(site) -> list[tuple[str, str]]:
    """Before and after of the changes of robot_1's second motor, the last one first."""
    return [(event["before"], event["after"]) for event in site.ask(CHANGES)["events"]]


@pytest.mark.parametrize("home", [{}, {"HOME": "/dev/null"}, {"ROS_LOG_DIR": "/proc/none"}])
def test_without_a_folder_for_ros_logs_the_domain_is_joined_all_the_same(site, home):
    exporter = site.process()
    taken = ("HOME", "ROS_HOME", "ROS_LOG_DIR")
    exporter.env = {**exporter.env, **dict.fromkeys(taken, ""), **home}
    site.begin(exporter)
    until(lambda: ready(site), exporter.describe)
    assert "ROS logs to " in exporter.describe()


def ready(site) -> bool:
    with (
        suppress(OSError),
        urllib.request.urlopen(f"http://127.0.0.1:{site.port}/-/ready") as answer,
    ):
        return answer.status == 200
    return False
