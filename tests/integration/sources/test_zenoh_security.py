"""Routers with TLS and with clients' certificates; that of docs/beyond-the-lan.md, without TLS."""

import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import trustme
import zenoh

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Zenoh
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.model import Status
from support.zenoh_robots import Bridge, Router, session
from testbed import programs
from testbed.polling import until

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
    access = {"user": user, "password": PASSWORDS[user]}
    return Bridge(locator, **{f"transport/auth/usrpwd/{key}": of for key, of in access.items()})


def exporter_of(locator: str, **more) -> Fleet:
    robots = tuple(
        validated(Robot, {"name": name, "zenoh": f"customer_b/{name}", "source": "agg"}, PROFILES)
        for name in ("agv_7", "agv_8")
    )
    return Fleet("f", robots, zenoh=Zenoh((locator,), **more))


def login(tmp_path, password: str) -> dict[str, object]:
    file = tmp_path / "password"
    file.write_text(f"{password}\n")
    return {"user": "exporter", "password_file": file}


def test_the_exporter_reads_what_a_robot_may_write(locator, tmp_path, run_exporter):
    running = run_exporter(exporter_of(locator, **login(tmp_path, "e")))
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
    running = run_exporter(exporter_of(locator, **login(tmp_path, "wrong")))

    running.wait_for("robot_silent_reason", 1, robot="agv_7", reason="domain_unreachable")

    assert "and accepts this exporter" in running.service.not_ready_reason()


class Site:
    """Certificates in files, and a router that has one and asks its clients for theirs."""

    def __init__(self, folder: Path, port: int, *, mutual: bool) -> None:
        self._folder = folder
        self.authority = trustme.CA()
        self.ca_file = self.write("ca.pem", self.authority.cert_pem)
        certificate, key = self.issue("router", self.authority)
        self.router = Router(
            f"tls/localhost:{port}",
            **{
                "transport/link/tls/listen_certificate": str(certificate),
                "transport/link/tls/listen_private_key": str(key),
                "transport/link/tls/root_ca_certificate": str(self.ca_file),
                "transport/link/tls/enable_mtls": mutual,
            },
        )

    def issue(self, name: str, authority: trustme.CA) -> tuple[Path, Path]:
        """The files of a certificate and its key."""
        made = authority.issue_cert("localhost")
        certificate = self.write(f"{name}.pem", *made.cert_chain_pems)
        return certificate, self.write(f"{name}.key", made.private_key_pem)

    def write(self, name: str, *blobs: trustme.Blob) -> Path:
        path = self._folder / name
        path.write_bytes(b"".join(each.bytes() for each in blobs))
        return path

    def robot(self) -> Bridge:
        certificate, key = self.issue("robot", self.authority)
        files = {
            "root_ca_certificate": self.ca_file,
            "connect_certificate": certificate,
            "connect_private_key": key,
        }
        more = {f"transport/link/tls/{name}": str(path) for name, path in files.items()}
        made = Bridge(self.router.locator, **more, **{"transport/link/tls/enable_mtls": True})
        made.offer(OWN)
        return made


@pytest.fixture
def make_site(free_port, tmp_path) -> Iterator[Callable[..., Site]]:
    made = []

    def make(*, mutual: bool) -> Site:
        made.append(Site(tmp_path, free_port(), mutual=mutual))
        return made[-1]

    yield make
    for each in made:
        each.router.stop()


def is_received(running, robot: Bridge) -> None:
    def up() -> bool:
        robot.send(OWN, HOT)
        return running.sample("robot_up", robot="agv_7") == 1

    until(up, "agv_7 is up")


@pytest.mark.parametrize("mutual", [False, True])
def test_over_tls_robots_are_received_with_the_certificates_that_the_router_asks_for(
    make_site, run_exporter, mutual
):
    site = make_site(mutual=mutual)
    certificate, key = site.issue("exporter", site.authority)
    own = {"cert_file": certificate, "key_file": key} if mutual else {}
    running = run_exporter(exporter_of(site.router.locator, ca_file=site.ca_file, **own))
    robot = site.robot()
    is_received(running, robot)
    robot.close()


@pytest.mark.parametrize("case", ["foreign router", "no certificate", "foreign certificate"])
def test_who_cannot_show_whose_they_are_is_not_connected(make_site, run_exporter, case):
    site = make_site(mutual=case != "foreign router")
    foreign = trustme.CA()
    files = {"ca_file": site.ca_file}
    if case == "foreign router":
        files = {"ca_file": site.write("other.pem", foreign.cert_pem)}
    elif case == "foreign certificate":
        files["cert_file"], files["key_file"] = site.issue("exporter", foreign)
    running = run_exporter(exporter_of(site.router.locator, **files))
    robot = site.robot()

    running.wait_for("robot_silent_reason", 1, robot="agv_7", reason="domain_unreachable")

    assert not robot.listeners(OWN)
    assert running.sample("exporter_domain_up", domain_id="zenoh") == 0
    assert (
        "with RUST_LOG=warn the log says why, except for a wrong user or password"
        in running.service.not_ready_reason()
    )
    robot.close()


def test_a_file_that_is_missing_is_named(make_site, run_exporter, tmp_path):
    site = make_site(mutual=False)

    running = run_exporter(exporter_of(site.router.locator, ca_file=tmp_path / "absent.pem"))

    running.wait_for("robot_silent_reason", 1, robot="agv_7", reason="domain_unreachable")
    assert "absent.pem" in running.service.not_ready_reason()


def test_zenoh_logs_why_there_is_no_connection_where_it_is_asked_to(
    make_site, tmp_path, free_port, start_process
):
    site = make_site(mutual=False)
    foreign = site.write("other.pem", trustme.CA().cert_pem)
    config = tmp_path / "fleet.yml"
    config.write_text(
        f"fleet: f\nzenoh: {{routers: [{site.router.locator}], ca_file: {foreign}}}\n"
        "robots: [{name: r, zenoh: /, namespace: /r}]\n"
    )
    argv = programs.exporter(config, f"127.0.0.1:{free_port()}", tmp_path / "exporter.db")
    exporter = start_process("exporter", argv, os.environ | {"RUST_LOG": "warn"})
    exporter.wait_for_output("invalid peer certificate")
