"""The router of docs/beyond-the-lan.md, with its users and its access control, without TLS."""

from __future__ import annotations

import json
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Zenoh
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.model import Status
from support.zenoh_robots import Bridge, session
from testbed.polling import until

pytestmark = pytest.mark.integration

PAGE = Path(__file__).parents[3] / "docs" / "beyond-the-lan.md"
PASSWORDS = {"exporter": "e", "agv_7": "a"}
OWN, FOREIGN = "/customer_b/agv_7/diagnostics_agg", "/customer_b/agv_8/diagnostics_agg"
PROFILES = {"default": Profile(stale_after=1.0)}
HOT = Status(2, "Motor", "Hot")


@pytest.fixture
def locator(free_port, tmp_path) -> Iterator[str]:
    """Where a router listens that has the page's config."""
    [text] = [
        each
        for each in re.findall(r"```json5\n(.*?)```", PAGE.read_text(), re.DOTALL)
        if "access_control" in each
    ]
    users = tmp_path / "users"
    users.write_text("".join(f"{user}:{word}\n" for user, word in PASSWORDS.items()))
    base = zenoh.Config.from_json5(text)
    base.insert_json5("transport/link/tls/listen_certificate", "null")
    base.insert_json5("transport/link/tls/listen_private_key", "null")
    base.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(str(users)))
    found = f"tcp/127.0.0.1:{free_port()}"
    router = session("router", base=base, listen=[found])
    yield found
    router.close()


def bridge(locator: str, user: str) -> Bridge:
    return Bridge(locator, user, PASSWORDS[user])


def exporter_of(locator: str, tmp_path, password: str) -> Fleet:
    file = tmp_path / "password"
    file.write_text(f"{password}\n")
    robots = tuple(
        validated(Robot, {"name": name, "zenoh": f"customer_b/{name}", "source": "agg"}, PROFILES)
        for name in ("agv_7", "agv_8")
    )
    return Fleet("f", robots, zenoh=Zenoh((locator,), user="exporter", password_file=file))


def test_the_exporter_reads_what_a_robot_may_write(locator, tmp_path, run_exporter):
    running = run_exporter(exporter_of(locator, tmp_path, "e"))
    robot = bridge(locator, "agv_7")
    other = bridge(locator, "exporter")
    robot.offer(OWN)
    robot.offer(FOREIGN)
    spy = bridge(locator, "agv_7")
    spied = spy.receive("**")
    forged = other.receive(FOREIGN.removeprefix("/"))
    other.offer(OWN)

    until(lambda: robot.listeners(OWN), "the robot is asked for its own")
    for number in (1, 2):
        other.send(OWN, HOT)  # as the exporter's user
        robot.send(FOREIGN, HOT)
        robot.send(OWN, HOT)
        running.wait_for("robot_messages_total", number, robot="agv_7")
    assert running.sample("robot_messages_total", robot="agv_8") == 0
    assert (spied, forged) == ([], [])
    for each in (robot, other, spy):
        each.close()


def test_a_wrong_password_is_a_router_that_lets_nobody_in(locator, tmp_path, run_exporter):
    running = run_exporter(exporter_of(locator, tmp_path, "wrong"))

    running.wait_for("robot_silent_reason", 1, robot="agv_7", reason="domain_unreachable")

    assert "and accepts this exporter" in running.service.not_ready_reason()
