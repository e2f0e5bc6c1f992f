"""The site of the rule scenarios: robots, exporters and servers, and actions on them.

Everything is real and runs on this machine: virtual robots in a ROS domain, an exporter for each
fleet, blackbox_exporter, Prometheus and Alertmanager. Hosts are probed at a TCP port instead of by
ping, because a port can be closed.
"""

import signal
import socketserver
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from e2e.rule_scenarios import fleets
from support import host_checks
from support.loopback import serving
from support.orders import Orders
from testbed.polling import until
from testbed.ports import free_port
from testbed.site import Site

SITE = "site"


class Host:
    """An address of this machine whose port is open or closed."""

    def __init__(self, site: Site, address: str, port: int) -> None:
        self._where = (address, port)
        self._open = ExitStack()
        site.use(self._open)
        self.open()

    def open(self) -> None:
        socketserver.TCPServer.allow_reuse_address = True
        server = socketserver.TCPServer(self._where, socketserver.BaseRequestHandler)
        self._open.enter_context(serving(server))

    def close(self) -> None:
        self._open.close()


class ScenarioSite:
    """The robots and exporters, and the actions that a scenario may name."""

    def __init__(self, site: Site) -> None:
        self.folder, self.domain_id = site.folder, site.domain_id
        self.engine = site.engine
        self.orders: Orders | None = None  # once there are robots
        self.probe_port = free_port()
        self.uplink, self.wedged, self.dark = (
            Host(site, address, self.probe_port)
            for address in (fleets.UPLINK, fleets.WEDGED, fleets.DARK)
        )
        configs = {}
        for fleet, write in (
            ("hall", fleets.write_hall),
            ("shaft", fleets.write_shaft),
            ("yard", fleets.write_yard),
        ):
            (site.folder / fleet).mkdir()
            configs[fleet] = write(site.folder / fleet, site.domain_id)
        fleets.declare(site.folder / "hall", site.domain_id)
        options = ("--web.enable-lifecycle", f"--prometheus.url=http://{site.addresses.prometheus}")
        self.exporters = {
            fleet: site.start_exporter(config, *options, name=f"exporter-{fleet}")
            for fleet, config in configs.items()
        }
        self._blackbox = host_checks.start_blackbox(site)

    def do(self, actions: Sequence[str]) -> None:
        """Carry out orders to robots and actions on the site, in order."""
        batch: list[tuple[str, str]] = []
        for action in actions:
            target, _, order = action.partition(": ")
            if target != SITE:
                batch.append((target, order))
                continue
            self._order(batch)
            batch = []
            self._actions()[order]()
        self._order(batch)

    def probes(self) -> list[dict[str, Any]]:
        """The scrape configurations of docs/alerts.md, with a TCP port instead of ICMP."""
        relabel = [
            {
                "source_labels": ["__address__"],
                "target_label": "__param_target",
                "replacement": f"$1:{self.probe_port}",
            },
            {"source_labels": ["__param_target"], "target_label": "instance"},
            {"target_label": "__address__", "replacement": self._blackbox},
        ]
        common = {
            "metrics_path": "/probe",
            "params": {"module": ["tcp_connect"]},
            "relabel_configs": relabel,
        }
        hall = self.exporters["hall"].address
        listed = {"url": f"http://{hall}/sd/ping", "refresh_interval": "5s"}
        uplinks = {**listed, "url": f"http://{hall}/sd/uplink"}
        return [
            {"job_name": "ros-diagnostics-ping", "http_sd_configs": [listed], **common},
            {"job_name": "ros-diagnostics-uplink", "http_sd_configs": [uplinks], **common},
        ]

    def _actions(self) -> dict[str, Callable[[], object]]:
        hall, shaft = self.folder / "hall", self.exporters["shaft"].process
        return {
            "complete short": lambda: fleets.equip(self.folder, "short", fleets.COMPLETE),
            "maintain serviced": lambda: fleets.plan_maintenance(hall, "serviced"),
            "finish serviced": (hall / "maintenance.d" / "serviced.yml").unlink,
            "sell": (hall / "robots.d" / "sold.yml").unlink,
            "forget scrapped": lambda: self._post("hall", "/-/forget?robot=scrapped"),
            "raise limit": lambda: fleets.write_hall(hall, self.domain_id, components=60),
            "cut uplink": self.uplink.close,
            "mend uplink": self.uplink.open,
            "switch off dark": self.dark.close,
            "switch on dark": self.dark.open,
            "stall exporter": lambda: shaft.signal(signal.SIGSTOP),
            "continue exporter": lambda: shaft.signal(signal.SIGCONT),
            "kill exporter": shaft.kill,
            "start exporter": shaft.start,
        }

    def _order(self, batch: Sequence[tuple[str, str]]) -> None:
        if batch:
            assert self.orders is not None
            self.orders.give(batch)

    def _post(self, fleet: str, path: str) -> None:
        request = urllib.request.Request(f"http://{self.exporters[fleet].address}{path}", b"")
        with urllib.request.urlopen(request, timeout=30) as answer:
            assert answer.status == 200


@contextmanager
def running(folder: Path) -> Iterator[ScenarioSite]:
    """Start everything; the robots last, so that all their states are recorded.

    Raises:
        programs.MissingProgram: A server is not installed.
        TimeoutError: One is not ready in time.
    """
    with Site(folder) as site:
        found = ScenarioSite(site)
        site.wait_until_ready()
        site.start_alertmanager()
        probes = found.probes()
        site.start_prometheus(interval=fleets.INTERVAL, tenth=True, probes=probes)
        site.wait_until_ready()
        # Counters are compared with their first sample, and states recorded from the first on.
        scraped = f'count(up{{job=~"ros-diagnostics.*"}} == 1) >= {2 * len(fleets.FLEETS)}'
        until(lambda: site.query(scraped), "every exporter is scraped", 60)
        robots = site.start_robots(scenario=fleets.write_scenario(folder))
        robots.process.wait_for_output("ready: ", 60)
        found.orders = site.use(Orders(site.domain_id))
        yield found
