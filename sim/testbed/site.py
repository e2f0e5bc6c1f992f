"""A site on this machine: robots, exporters, and the servers with the shipped configuration.

    with Site(folder) as site:
        site.start_robots(3)
        site.start_exporter(site.write("fleet.yml", FLEET.format(domain=site.domain_id)))
        site.start_mail_server()
        site.start_alertmanager()
        site.start_prometheus(interval=1)
        site.wait_until_ready()

Robots may be virtual ones (`start_robots`), or whatever is served at an address (``exporters`` of
`start_prometheus`). What is started is stopped at the end, the last first.
"""

from __future__ import annotations

import subprocess
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import TracebackType
from typing import Any, TypeVar

from testbed import configuration, domains, http, programs, servers, short_clocks
from testbed.engine import Engine, Sample
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process
from testbed.servers import Server

START_SECONDS = 120.0  # until all is ready; on two busy cores it takes a quarter of that
EXPORTER = "ros-diagnostics-exporter"
Started = TypeVar("Started", bound=Server)
Entered = TypeVar("Entered")


@dataclass(frozen=True)
class Exporter(Server):
    """An exporter, and its files."""

    config: Path = Path()
    database: Path = Path()

    def receives(self) -> list[str]:
        """The robots that it receives now; none while it does not answer."""
        try:
            robots = http.get_json(self.address, "/api/v1/fleet")["robots"]
        except http.Unanswered:
            return []
        return [each["robot"] for each in robots if each["up"]]


class Site:
    """The programs of one run and their addresses; a context that stops them."""

    robots: Server  # those that were started first
    prometheus: Server
    alertmanager: Server
    grafana: Server | None = None

    def __init__(
        self, folder: Path, inbox: Inbox | None = None, environment: Mapping[str, str] | None = None
    ) -> None:
        """Start nothing yet.

        Args:
            folder: For configuration, data and logs.
            inbox: What the mail server fills.
            environment: Variables of all programs that use ROS, beside those of their domain.
        """
        self.folder = folder
        self.inbox = inbox or Inbox()
        self.addresses = configuration.Addresses(*(free_address() for _ in range(5)))
        self.mail_server = MailServer(self.addresses.smtp, self.inbox)
        self.started: list[Server] = []
        self.exporters: list[Exporter] = []  # started or not; the first is at the site's address
        self._environment = environment or {}
        self._ending = ExitStack()

    def __enter__(self) -> Site:  # noqa: PYI034 - Self is not in Python 3.10
        """Nothing to do."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Stop everything."""
        self._ending.close()

    # --- ROS -----------------------------------------------------------------------------------

    @cached_property
    def domain_id(self) -> int:
        """The site's first ROS domain."""
        return self.lease()

    def lease(self) -> int:
        """Another ROS domain."""
        return self.use(domains.lease())

    def environment(self, domain_id: int | None = None) -> dict[str, str]:
        """That of a program in a domain, by default the first."""
        domain = self.domain_id if domain_id is None else domain_id
        logs = {"ROS_LOG_DIR": str(self.folder / "ros-log")}
        return {**domains.environment(domain), **logs, **self._environment}

    def start_robots(
        self,
        number: int = 1,
        *,
        seed: int = 1,
        scenario: Path | None = None,
        domain_id: int | None = None,
        name: str = "virtual-robots",
    ) -> Server:
        """Start virtual robots, or those of a scenario."""
        domain = self.domain_id if domain_id is None else domain_id
        argv = programs.virtual_robots(number, seed, domain, scenario)
        server = self.start_program(name, argv, domain_id=domain)
        if not hasattr(self, "robots"):
            self.robots = server
        return server

    def fault(self, robot: str, component: str, level: str, message: str = "") -> None:
        """Give a robot's component a level (error, warn, stale; ok repairs it); done on return.

        Raises:
            RuntimeError: The robots reject it or do not answer; the text says why.
        """
        argv = programs.fault(robot, component, level, message, self.domain_id)
        done = subprocess.run(
            argv,
            env=self.environment(),
            check=False,
            capture_output=True,
            text=True,
            timeout=60,
        )
        if done.returncode != 0:
            raise RuntimeError(f"{component} of {robot} did not become {level}: {done.stderr}")

    # --- The servers -----------------------------------------------------------------------------

    def make_exporter(
        self,
        config: Path,
        *options: str,
        name: str = EXPORTER,
        domain_id: int | None = None,
        alertmanager: str | None = None,
    ) -> Exporter:
        """An exporter, to be started.

        Args:
            config: Its fleet.yml.
            options: Of its command line.
            name: Of its log and its database: each exporter needs another one.
            domain_id: Of its environment, by default the site's first.
            alertmanager: The address of the one that it asks, by default the site's; "" for none.
        """
        address = free_address() if self.exporters else self.addresses.exporter
        database = self.folder / f"{name}.db"
        asked = self.addresses.alertmanager if alertmanager is None else alertmanager
        argv = programs.exporter(config, address, database, asked)
        process = self._process(name, [*argv, *options], self.environment(domain_id))
        self.exporters.append(Exporter(process, address, config=config, database=database))
        return self.exporters[-1]

    def start_exporter(
        self, config: Path, *options: str, name: str = EXPORTER, domain_id: int | None = None
    ) -> Exporter:
        """Start what `make_exporter` returns."""
        return self.start(self.make_exporter(config, *options, name=name, domain_id=domain_id))

    @property
    def exporter(self) -> Exporter:
        """The first exporter."""
        return self.exporters[0]

    def start_mail_server(self) -> None:
        """Let mails arrive; without it they fail."""
        self._ending.callback(self.mail_server.stop)
        self.mail_server.start()

    def start_alertmanager(
        self,
        *options: str,
        recorder: str = "",
        links: bool = False,
        edit: Callable[[dict[str, Any]], object] = lambda _: None,
        cluster: str = "",
    ) -> Server:
        """Start Alertmanager; its mails go to the site's mail server.

        Args:
            options: Of its command line.
            recorder: The exporter to whose webhook it posts what was sent, "" for none.
            links: Whether the links in notifications lead to the site's servers.
            edit: Changes its configuration, before addresses are set.
            cluster: Its address in a cluster, "" for none.
        """
        config = configuration.alertmanager(
            self.folder, self.addresses, recorder=recorder, links=links, edit=edit
        )
        address = self.addresses.alertmanager
        server = servers.alertmanager(self.folder, config, address, *options, cluster=cluster)
        self.alertmanager = self.start(server)
        return server

    def start_prometheus(
        self,
        *options: str,
        exporters: Sequence[str] | None = None,
        interval: int | None = None,
        tenth: bool = False,
        probes: Sequence[Mapping[str, Any]] = (),
        edit: Callable[[Path], object] = lambda _: None,
    ) -> Server:
        """Start Prometheus.

        Args:
            options: Of its command line.
            exporters: Addresses, by default of all that were made.
            interval: Seconds between two scrapes and two evaluations, in place of those shipped.
            tenth: Whether ranges, offsets and holds of rules last a tenth of what is shipped.
            probes: Scrape configurations to add, such as those of a blackbox_exporter.
            edit: Changes the folder of its configuration.
        """
        if exporters is None:
            exporters = [each.address for each in self.exporters]
        config = configuration.prometheus(
            self.folder, exporters, self.addresses, interval=interval, tenth=tenth
        )
        short_clocks.edit(config, lambda content: content["scrape_configs"].extend(probes))
        edit(config.parent)
        server = servers.prometheus(self.folder, config, self.addresses.prometheus, *options)
        self.prometheus = self.start(server)
        return server

    @property
    def engine(self) -> Engine:
        """Prometheus' API."""
        return Engine(self.addresses.prometheus)

    def query(self, promql: str) -> list[Sample]:
        """Return the instant vector of ``promql`` from Prometheus."""
        return self.engine.query(promql)

    # --- Everything else -------------------------------------------------------------------------

    def write(self, name: str, text: str) -> Path:
        """Write a file of the folder."""
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def start_program(
        self,
        name: str,
        argv: Sequence[str | Path],
        address: str = "",
        ready: str = "/-/ready",
        *,
        domain_id: int | None = None,
    ) -> Server:
        """Start any program, with or without ROS; ``ready`` is the path that says it is."""
        environment = None if domain_id is None else self.environment(domain_id)
        return self.start(Server(self._process(name, argv, environment), address, ready=ready))

    def start(self, server: Started) -> Started:
        """Start a server, for the first time or again."""
        if server not in self.started:
            self._ending.callback(server.process.stop)
            self.started.append(server)
        server.process.start()
        return server

    def use(self, context: AbstractContextManager[Entered]) -> Entered:
        """Enter a context that ends with the site."""
        return self._ending.enter_context(context)

    def wait_until_ready(self, also: Callable[[], str] = lambda: "") -> None:
        """Wait for every server, and until ``also`` returns "" in place of what is missing.

        Raises:
            RuntimeError: A program ended; the text has its last output.
            TimeoutError: Not ready in time; the text says what is missing.
        """
        missing = "the servers"

        def ready() -> bool:
            nonlocal missing
            missing = self._missing() or also()
            return not missing

        until(ready, lambda: missing, START_SECONDS, every=0.2)

    def _missing(self) -> str:
        for each in self.started:
            if not each.process.alive:
                raise RuntimeError(each.process.describe())
            if each.address and each.ready and not each.answers(each.ready):
                return f"{each.name} at http://{each.address}{each.ready}"
        return ""

    def _process(
        self, name: str, argv: Sequence[str | Path], env: Mapping[str, str] | None
    ) -> Process:
        return Process(name, argv, env, self.folder / f"{name}.log")


def free_address() -> str:
    """A free port of this machine as HOST:PORT."""
    return f"127.0.0.1:{free_port()}"
