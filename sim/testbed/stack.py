"""The site of the demo: virtual robots and all servers, as shipped, with links between them.

With zenoh a bridge and a router stand between the robots and the exporter.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from testbed import configuration, grafana, http, zenoh
from testbed.mail import Inbox
from testbed.processes import Process
from testbed.servers import Server
from testbed.site import Site, free_address


@dataclass(frozen=True)
class Plan:
    """What to start: so many robots of one kind, or those of a scenario.

    ``robots`` is how many must become OK.
    """

    robots: int = 10
    seed: int = 1
    scenario: Path | None = None
    zenoh: bool = False  # the robots come through a bridge and a router
    clocks: configuration.Clocks = field(default_factory=configuration.Clocks)
    environment: Mapping[str, str] = field(default_factory=dict)  # more of it, for what uses ROS


@contextmanager
def running(folder: Path, plan: Plan, inbox: Inbox | None = None) -> Iterator[Site]:
    """Start everything in ``folder``; yield when all is ready; stop everything.

    Ready: every server answers, and Prometheus has every robot with the state OK.

    Raises:
        programs.MissingProgram: A program is not installed.
        RuntimeError: A program ended; the text has its last output.
        LookupError: The shipped configuration lacks what is edited here.
        OSError: The mail server's port is taken.
        TimeoutError: Not ready in time; the text says what is missing.
    """
    with Site(folder, inbox, plan.environment) as site:
        if grafana.command() is None:  # no mail links to it
            site.addresses = replace(site.addresses, grafana="")
        endpoint = f"tcp/{free_address()}" if plan.zenoh else ""
        fleet = configuration.fleet(folder, site.domain_id, plan.clocks, endpoint)
        exporter = site.addresses.exporter
        site.start_mail_server()
        site.start_robots(plan.robots, seed=plan.seed, scenario=plan.scenario)
        if plan.zenoh:
            _start_links(site, endpoint)
        site.start_exporter(fleet)
        site.start_prometheus()
        # As docs/notifications.md says: else one that is killed forgets what it sent.
        site.start_alertmanager("--data.maintenance-interval=10s", recorder=exporter, links=True)
        site.grafana = _start_grafana(site)
        site.wait_until_ready(lambda: _not_ok(site, plan.robots))
        yield site


def _start_links(site: Site, endpoint: str) -> None:
    """The router that listens at ``endpoint``, and the bridge that connects to it."""
    router = zenoh.router(site.folder / "zenohd.json5", endpoint)
    bridge = zenoh.bridge(
        site.folder / "bridge.json5", endpoint, site.domain_id, configuration.BRIDGED
    )
    for name, argv, environment in (
        ("zenohd", router, site.environment()),
        ("zenoh-bridge", bridge, zenoh.on_loopback(site.environment())),
    ):
        site.start(Server(Process(name, argv, environment, site.folder / f"{name}.log")))


def _start_grafana(site: Site) -> Server | None:
    """Grafana where it is installed; nothing waits for it."""
    argv = grafana.command()
    if argv is None:
        return None
    folder, address = site.folder / "grafana", site.addresses.grafana
    grafana.write_provisioning(folder / "provisioning", site.addresses)
    environment = grafana.environment(folder, address)
    process = Process("Grafana", argv, environment, site.folder / "grafana.log")
    return site.start(Server(process, address, "/api/health", ready=""))


def _not_ok(site: Site, robots: int) -> str:
    """Return what Prometheus lacks; empty when it has all robots."""
    try:
        states = site.query("robot:ros_diagnostics_state:rank")
    except http.Unanswered as error:  # the server has ended since
        return str(error)
    healthy = sum(each.value == 0 for each in states)
    if healthy < robots:
        return f"{robots} robots that are OK in Prometheus; {healthy} are"
    return ""
