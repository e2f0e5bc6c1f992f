"""All programs of the road on this machine: robots, exporter, Prometheus, Alertmanager, mail.

It starts them with the shipped configuration, says when all are ready and whether all live, and
ends them. What happens to the robots meanwhile is the caller's business.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from testbed import configuration as site
from testbed import domains, grafana, programs
from testbed import http as asking
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

START_SECONDS = 90.0  # until all is ready; on two busy cores it takes a third of that


@dataclass(frozen=True)
class Server:
    """One program of the road and, where it serves HTTP, its address."""

    process: Process
    address: str = ""
    health: str = "/-/healthy"  # the path that answers 200 while it lives

    @property
    def name(self) -> str:
        """What people call it."""
        return self.process.name

    def lives(self) -> bool:
        """Whether it runs: as our child, or started again by hand at the same address."""
        return self.process.alive or (self.address != "" and self.answers(self.health))

    def answers(self, path: str) -> bool:
        """Whether it answers 200 there."""
        return asking.answers(self.address, path)


@dataclass(frozen=True)
class Plan:
    """What to start: so many robots, or those of a scenario, of which one must become OK."""

    robots: int = 10
    seed: int = 1
    scenario: Path | None = None
    clocks: site.Clocks = field(default_factory=site.Clocks)


@dataclass(frozen=True)
class Stack:
    """The programs of one run, all started."""

    domain_id: int
    environment: dict[str, str]
    addresses: site.Addresses
    inbox: Inbox
    robots: Server
    exporter: Server
    prometheus: Server
    alertmanager: Server
    grafana: Server | None  # only where it is installed

    @property
    def servers(self) -> tuple[Server, ...]:
        """Every program that has to live for the road to work."""
        return (self.robots, self.exporter, self.prometheus, self.alertmanager)

    @property
    def programs(self) -> tuple[Server, ...]:
        """Every program that was started; Grafana, which nothing waits for, included."""
        return self.servers if self.grafana is None else (*self.servers, self.grafana)

    def fault(self, robot: str, component: str, level: str, message: str = "") -> None:
        """Give a robot's component a level (error, warn, stale; ok repairs it); done on return.

        Raises:
            RuntimeError: The robots refuse it or do not answer; the text says why.
        """
        argv = programs.fault(robot, component, level, message, self.domain_id)
        done = subprocess.run(
            argv, env=self.environment, check=False, capture_output=True, text=True, timeout=60
        )
        if done.returncode != 0:
            raise RuntimeError(f"{component} of {robot} did not become {level}: {done.stderr}")

    def query(self, promql: str) -> list[asking.Sample]:
        """Return the instant vector of ``promql`` from Prometheus."""
        return asking.query(self.addresses.prometheus, promql)


@contextmanager
def running(folder: Path, plan: Plan, inbox: Inbox) -> Iterator[Stack]:
    """Start everything in ``folder``; yield when all is ready; end everything.

    Ready: every server answers, and Prometheus has judged every robot to be well.

    Raises:
        programs.MissingProgram: A program is not installed.
        RuntimeError: A program ended; the text has its last output.
        LookupError: The shipped configuration is not what is edited here.
        OSError: The mail server's port is taken.
        TimeoutError: Not ready in time; the text says what is missing.
    """
    with ExitStack() as ending:
        domain_id = ending.enter_context(domains.lease())
        stack = _prepare(folder, domain_id, plan, inbox)
        mail_server = MailServer(stack.addresses.smtp, inbox)
        ending.callback(mail_server.stop)
        mail_server.start()
        for server in stack.programs:
            ending.callback(server.process.stop)
            server.process.start()
        _wait_until_ready(stack, plan.robots if plan.scenario is None else 1)
        yield stack


def _prepare(folder: Path, domain_id: int, plan: Plan, inbox: Inbox) -> Stack:
    """Write the configuration and find the programs; nothing is started yet."""
    environment = domains.environment(domain_id) | {"ROS_LOG_DIR": str(folder / "ros-log")}
    addresses = site.Addresses(*(f"127.0.0.1:{free_port()}" for _ in range(5)))
    configs = site.write(folder, domain_id, addresses, plan.clocks)

    def server(name: str, argv: list[str], address: str = "") -> Server:
        log = folder / f"{name.replace(' ', '-')}.log"
        return Server(Process(name, argv, environment, log), address)

    return Stack(
        domain_id,
        environment,
        addresses,
        inbox,
        server(
            "virtual-robots",
            programs.virtual_robots(plan.robots, plan.seed, domain_id, plan.scenario),
        ),
        server(
            "ros-diagnostics-exporter",
            programs.exporter(
                configs.fleet, addresses.exporter, folder / "state.json", addresses.alertmanager
            ),
            addresses.exporter,
        ),
        server(
            "Prometheus",
            programs.prometheus(configs.prometheus, addresses.prometheus, folder / "tsdb"),
            addresses.prometheus,
        ),
        server(
            "Alertmanager",
            programs.alertmanager(configs.alertmanager, addresses.alertmanager, folder / "nflog"),
            addresses.alertmanager,
        ),
        _grafana(folder / "grafana", addresses),
    )


def _grafana(folder: Path, addresses: site.Addresses) -> Server | None:
    argv = grafana.command()
    if argv is None:
        return None
    grafana.write_provisioning(folder / "provisioning", addresses)
    environment = grafana.environment(folder, addresses.grafana)
    log = folder / "grafana.log"
    return Server(Process("Grafana", argv, environment, log), addresses.grafana, "/api/health")


def _wait_until_ready(stack: Stack, robots: int) -> None:
    missing = "the servers"

    def ready() -> bool:
        nonlocal missing
        _raise_if_ended(stack)
        missing = _not_ready(stack, robots)
        return not missing

    until(ready, lambda: missing, START_SECONDS, every=0.2)


def _raise_if_ended(stack: Stack) -> None:
    for server in stack.programs:
        if not server.process.alive:
            raise RuntimeError(server.process.describe())


def _not_ready(stack: Stack, robots: int) -> str:
    """Say what is not ready yet; empty when all is."""
    for server in stack.servers:
        if server.address and not server.answers("/-/ready"):
            return f"{server.name} at http://{server.address}/-/ready"
    try:
        states = stack.query("robot:ros_diagnostics_state:rank")
    except asking.Unanswered as error:  # the server has ended since it was asked
        return str(error)
    well = [each for each in states if each.value == 0]
    if len(well) < robots:
        return f"{robots} robots that Prometheus calls OK; there are {len(well)}"
    return ""
