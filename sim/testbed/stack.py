"""All programs on this machine: virtual robots, exporter, Prometheus, Alertmanager, mail, Grafana.

With zenoh a bridge and a router stand between the robots and the exporter.

Starts them with the shipped configuration, waits until all are ready, and stops them.
"""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from testbed import configuration, domains, grafana, http, programs, servers, zenoh
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process
from testbed.servers import Server

START_SECONDS = 90.0  # until all is ready; on two busy cores it takes a third of that


@dataclass(frozen=True)
class Plan:
    """What to start: a number of robots, or a scenario, of which one robot must become OK."""

    robots: int = 10
    seed: int = 1
    scenario: Path | None = None
    zenoh: bool = False  # the robots come through a bridge and a router
    clocks: configuration.Clocks = field(default_factory=configuration.Clocks)
    environment: Mapping[str, str] = field(default_factory=dict)  # more of it, for all programs


@dataclass(frozen=True)
class Stack:
    """The programs of one run, all started."""

    domain_id: int
    environment: dict[str, str]
    addresses: configuration.Addresses
    inbox: Inbox
    mail_server: MailServer
    robots: Server
    links: tuple[Server, ...]  # zenoh's router and bridge, where they are used
    exporter: Server
    prometheus: Server
    alertmanager: Server
    grafana: Server | None  # only where it is installed

    @property
    def servers(self) -> tuple[Server, ...]:
        """The programs that every run needs."""
        return (self.robots, *self.links, self.exporter, self.prometheus, self.alertmanager)

    @property
    def programs(self) -> tuple[Server, ...]:
        """All programs that were started, including Grafana, which no run waits for."""
        return self.servers if self.grafana is None else (*self.servers, self.grafana)

    def fault(self, robot: str, component: str, level: str, message: str = "") -> None:
        """Give a robot's component a level (error, warn, stale; ok repairs it); done on return.

        Raises:
            RuntimeError: The robots reject it or do not answer; the text says why.
        """
        argv = programs.fault(robot, component, level, message, self.domain_id)
        done = subprocess.run(
            argv, env=self.environment, check=False, capture_output=True, text=True, timeout=60
        )
        if done.returncode != 0:
            raise RuntimeError(f"{component} of {robot} did not become {level}: {done.stderr}")

    def query(self, promql: str) -> list[http.Sample]:
        """Return the instant vector of ``promql`` from Prometheus."""
        return http.query(self.addresses.prometheus, promql)


@contextmanager
def running(folder: Path, plan: Plan, inbox: Inbox) -> Iterator[Stack]:
    """Start everything in ``folder``; yield when all is ready; stop everything.

    Ready: every server answers, and Prometheus has every robot with the state OK.

    Raises:
        programs.MissingProgram: A program is not installed.
        RuntimeError: A program ended; the text has its last output.
        LookupError: The shipped configuration lacks what is edited here.
        OSError: The mail server's port is taken.
        TimeoutError: Not ready in time; the text says what is missing.
    """
    with ExitStack() as ending:
        domain_id = ending.enter_context(domains.lease())
        stack = _prepare(folder, domain_id, plan, inbox)
        ending.callback(stack.mail_server.stop)
        stack.mail_server.start()
        for server in stack.programs:
            ending.callback(server.process.stop)
            server.process.start()
        _wait_until_ready(stack, plan.robots if plan.scenario is None else 1)
        yield stack


def _prepare(folder: Path, domain_id: int, plan: Plan, inbox: Inbox) -> Stack:
    """Write the configuration and find the programs; nothing is started yet."""
    environment = domains.environment(domain_id) | {"ROS_LOG_DIR": str(folder / "ros-log")}
    environment |= plan.environment
    addresses = configuration.Addresses(*(f"127.0.0.1:{free_port()}" for _ in range(5)))
    endpoint = f"tcp/127.0.0.1:{free_port()}" if plan.zenoh else ""
    configs = configuration.write(folder, domain_id, addresses, plan.clocks, endpoint)

    def server(name: str, argv: list[str], address: str = "") -> Server:
        log = folder / f"{name.replace(' ', '-')}.log"
        return Server(Process(name, argv, environment, log), address)

    return Stack(
        domain_id,
        environment,
        addresses,
        inbox,
        MailServer(addresses.smtp, inbox),
        server(
            "virtual-robots",
            programs.virtual_robots(plan.robots, plan.seed, domain_id, plan.scenario),
        ),
        _links(folder, endpoint, domain_id, environment) if plan.zenoh else (),
        server(
            "ros-diagnostics-exporter",
            [
                *programs.exporter(
                    *(configs.fleet, addresses.exporter, folder / "exporter.db"),
                    addresses.alertmanager,
                ),
                f"--web.runbooks-url=http://{addresses.prometheus}/user/alerts",
            ],
            addresses.exporter,
        ),
        servers.prometheus(
            folder, configs.prometheus, addresses.prometheus, environment=environment
        ),
        servers.alertmanager(
            folder, configs.alertmanager, addresses.alertmanager, environment=environment
        ),
        _grafana(folder / "grafana", addresses),
    )


def _links(
    folder: Path, endpoint: str, domain_id: int, environment: Mapping[str, str]
) -> tuple[Server, Server]:
    """The router that listens at ``endpoint``, and the bridge that connects to it."""
    router = zenoh.router(folder / "zenohd.json5", endpoint)
    bridge = zenoh.bridge(folder / "bridge.json5", endpoint, domain_id, configuration.BRIDGED)
    local = zenoh.on_loopback(environment)
    return (
        Server(Process("zenohd", router, environment, folder / "zenohd.log")),
        Server(Process("zenoh-bridge", bridge, local, folder / "zenoh-bridge.log")),
    )


def _grafana(folder: Path, addresses: configuration.Addresses) -> Server | None:
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
    """Return what is not ready yet; empty when all is."""
    for server in stack.servers:
        if server.address and not server.answers("/-/ready"):
            return f"{server.name} at http://{server.address}/-/ready"
    try:
        states = stack.query("robot:ros_diagnostics_state:rank")
    except http.Unanswered as error:  # the server has ended since
        return str(error)
    healthy = sum(each.value == 0 for each in states)
    if healthy < robots:
        return f"{robots} robots that are OK in Prometheus; {healthy} are"
    return ""
