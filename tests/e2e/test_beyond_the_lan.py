"""docs/beyond-the-lan.md: robots with no route to the exporter, and a zenoh router between them.

Each robot has its bridge in a network of its own; the office has exporter, Prometheus,
Alertmanager and mail. Bridges and router are the real ones.
"""

import json
import mailbox
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack
from email import message_from_binary_file, policy
from email.message import EmailMessage
from pathlib import Path
from typing import IO

import pytest
from zenoh import Config

from support import subnets
from testbed import configuration, domains, programs, short_clocks, zenoh
from testbed.configuration import CHECKOUT, Addresses, Clocks
from testbed.polling import until
from testbed.processes import Process

pytestmark = [pytest.mark.slow, pytest.mark.timeout(1200)]

HOSTS = ("one", "two", "office")
ENDPOINT = "tcp/10.77.{}.1:7447"
SCENARIO = 'duration: 10\nevents: []\nrobots: [{{kind: thesis, count: 1, name: "{}_{{n}}"}}]\n'
PORTS = ("9877", "9090", "9093", "2525", "3000")  # each is free in a network of the test's own
SECONDS = 2  # between scrapes and between evaluations
PATIENCE = 180.0  # seconds for a mail: some wait a minute, and the machine may be busy
MOTOR = "Motor 2"
NO_ROUTER = (" exporter", "CRITICAL: zenoh")  # as mails name it


class Site:
    """Two robots, a router, and an office."""

    def __init__(self, stack: ExitStack, folder: Path) -> None:
        self._stack = stack
        self._folder = folder
        self.networks = subnets.Subnets(stack, folder, HOSTS, subnets.APART)
        self._domains = {host: stack.enter_context(domains.lease()) for host in HOSTS[:2]}
        self._addresses = Addresses(*(f"127.0.0.1:{port}" for port in PORTS))
        self._mails = folder / "mails"
        self.router = self._start("", zenoh.router(folder / "zenohd.json5", "tcp/0.0.0.0:7447"))
        self.bridges = {host: self._start_bridge(host) for host in self._domains}
        self.robots = {host: self._start_robot(host) for host in self._domains}
        self._start_office()

    def _environment(self, host: str) -> dict[str, str]:
        folder = {"ROS_LOG_DIR": str(self._folder / "ros-log")}
        return domains.environment(self._domains.get(host, 0)) | folder

    def _start(self, host: str, argv: list[str | Path]) -> Process:
        return self.networks.start(host, argv, self._environment(host))

    def _start_bridge(self, host: str) -> Process:
        """With the config of packaging/, but another router, without TLS and login."""
        config = Config.from_file(str(CHECKOUT / "packaging" / "zenoh" / "bridge.json5"))
        for key, value in {
            "connect/endpoints": [ENDPOINT.format(HOSTS.index(host) + 1)],
            "transport/link/tls/root_ca_certificate": None,
            "transport/auth/usrpwd/user": None,
            "transport/auth/usrpwd/password": None,
            "plugins/ros2dds/namespace": configuration.BRIDGED,
            "plugins/ros2dds/domain": self._domains[host],
            "scouting/multicast/enabled": False,
        }.items():
            config.insert_json5(key, json.dumps(value))
        path = self._folder / f"{host}.json5"
        path.write_text(str(config))
        environment = zenoh.on_loopback(self._environment(host))
        return self.networks.start(host, [zenoh.program("zenoh-bridge"), path], environment)

    def _start_robot(self, host: str) -> Process:
        path = self._folder / f"{host}.yaml"
        path.write_text(SCENARIO.format(host))
        return self._start(host, programs.virtual_robots(1, 1, self._domains[host], path))

    def _start_office(self) -> None:
        where, folder = self._addresses, self._folder
        clocks = Clocks(stale_after=4, confirm_after=10)  # together longer than zenoh's lease
        configs = configuration.write(folder, 0, where, clocks, ENDPOINT.format(3))
        short_clocks.set_interval(folder / "prometheus", SECONDS)
        mails = ["-c", "aiosmtpd.handlers.Mailbox", "-l", where.smtp, "-n", str(self._mails)]
        self._start("office", [sys.executable, "-m", "aiosmtpd", *mails])
        state, series, sent = (folder / each for each in ("state", "tsdb", "nflog"))
        argv = programs.exporter(configs.fleet, where.exporter, state, where.alertmanager)
        self._start("office", argv)
        self.becomes(one="", two="")
        argv = programs.alertmanager(configs.alertmanager, where.alertmanager, sent)
        self._start("office", argv)
        self._start("office", programs.prometheus(configs.prometheus, where.prometheus, series))

    def link(self, host: str, state: str) -> None:
        """Set the link between a host and the router ``up`` or ``down``."""
        number = HOSTS.index(host) + 1
        self.networks.run("", "ip", "link", "set", f"to{number}", state)

    def fault(self, host: str, level: str) -> None:
        """Give the motor of a host's robot a level."""
        argv = programs.fault(f"{host}_1", MOTOR, level, "", self._domains[host])
        self.networks.run(host, *argv)

    def silence(self) -> dict[str, str]:
        """Host -> why its robot is silent, "" if it is not."""
        url = f"http://{self._addresses.exporter}/api/v1/fleet"
        try:
            fleet = json.loads(self.networks.fetch("office", url))
        except OSError:
            return {}
        return {
            each["robot"].removesuffix("_1"): "" if each["up"] else str(each["silent_reason"])
            for each in fleet["robots"]
        }

    def becomes(self, **wanted: str) -> None:
        until(
            lambda: self.silence() == wanted,
            lambda: f"{wanted}; {self.silence()}\n{self.router.describe()}",
            PATIENCE,
            every=0.5,
        )

    def mails(self) -> list[tuple[str, str]]:
        """(subject, text) of all mails until now, sorted."""
        found = mailbox.Maildir(self._mails, read) if self._mails.exists() else ()
        return sorted((str(each["Subject"]), text_of(each)) for each in found)

    def subjects(self) -> list[str]:
        """Of all mails until now, sorted."""
        return [subject for subject, _text in self.mails()]

    def mailed(self, subject: str, text: str = "") -> None:
        """Wait for a mail with this subject, and this in its text."""

        def arrived() -> bool:
            return any(each == subject and text in body for each, body in self.mails())

        until(arrived, lambda: f"{subject}, {text}; {self.mails()}", PATIENCE, every=0.5)


def read(file: IO[bytes]) -> EmailMessage:
    return message_from_binary_file(file, policy=policy.default)


def text_of(mail: EmailMessage) -> str:
    """The plain text, each of its white space a blank."""
    return " ".join(mail.get_body(("plain",)).get_content().split())


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    if why := subnets.missing():
        pytest.skip(why)
    try:
        zenoh.program("zenohd")
    except programs.MissingProgram as error:
        pytest.skip(str(error))
    with ExitStack() as stack:
        yield Site(stack, tmp_path)


def problem(what: str) -> str:
    return f"** PROBLEM ** demo{what}"


def recovery(what: str, state: str) -> str:
    return f"** RECOVERY ** demo{what} is no longer {state}"


def test_each_silence_has_its_reason_and_every_problem_one_recovery(site):
    with pytest.raises(subprocess.CalledProcessError):
        site.networks.run("office", "ip", "route", "get", "10.77.1.2")

    site.fault("one", "error")
    site.mailed(problem(f"/one_1 {MOTOR} is CRITICAL"))
    site.fault("one", "ok")
    site.mailed(recovery(f"/one_1 {MOTOR}", "CRITICAL"))

    cut = time.monotonic()
    site.link("one", "down")
    site.becomes(one="unreachable", two="")
    site.mailed(problem("/one_1 is SILENT"), "what connected it by zenoh is gone")
    until(lambda: time.monotonic() >= cut + 30, "30 s without the link", 60)
    site.link("one", "up")
    site.becomes(one="", two="")
    site.mailed(recovery("/one_1", "SILENT"))

    site.robots["two"].kill()
    site.becomes(one="", two="mute")
    site.mailed(problem("/two_1 is SILENT"), "its publisher sends nothing")
    site.becomes(one="", two="publisher_gone")
    site.robots["two"].start()
    site.becomes(one="", two="")
    site.mailed(recovery("/two_1", "SILENT"))

    site.bridges["two"].kill()
    site.becomes(one="", two="unreachable")
    site.mailed(problem("/two_1 is SILENT"), "what connected it by zenoh is gone")
    site.bridges["two"].start()
    site.becomes(one="", two="")
    until(
        lambda: site.subjects().count(recovery("/two_1", "SILENT")) == 2,
        "its second return",
        PATIENCE,
    )

    site.router.kill()
    site.becomes(one="domain_unreachable", two="domain_unreachable")
    site.mailed(problem(" is ".join(NO_ROUTER)))
    site.router.start()
    site.becomes(one="", two="")
    site.mailed(recovery(*NO_ROUTER))

    fired = [
        (f"/one_1 {MOTOR}", "CRITICAL"),
        ("/one_1", "SILENT"),
        ("/two_1", "SILENT"),
        ("/two_1", "SILENT"),
        NO_ROUTER,
    ]
    sent = [problem(f"{what} is {state}") for what, state in fired]
    assert site.subjects() == sorted(sent + [recovery(*each) for each in fired])
