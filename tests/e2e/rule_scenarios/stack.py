"""The site of the rule scenarios: robots, exporters and servers, and actions on them.

Everything is real and runs on this machine: virtual robots in a ROS domain, an exporter for each
fleet, blackbox_exporter, Prometheus and Alertmanager. Hosts are probed at a TCP port instead of by
ping, because a port can be closed.
"""

from __future__ import annotations

import signal
import socketserver
import threading
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import yaml
from rcl_interfaces.srv import SetParameters
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter

from e2e.rule_scenarios import fleets
from support import host_checks, prometheus_site, short_clocks
from testbed import domains, http, programs
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

SITE = "site"


class Orders:
    """Sets parameters of the virtual robots' node, many orders with one request."""

    def __init__(self, domain_id: int) -> None:
        self._context = Context()
        self._context.init(domain_id=domain_id)
        self._node = Node("rule_scenarios", context=self._context, enable_rosout=False)
        self._client = self._node.create_client(SetParameters, "/virtual_robots/set_parameters")
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def give(self, orders: Sequence[tuple[str, str]]) -> None:
        """Set each (target, order); all are carried out on return.

        Raises:
            AssertionError: One is rejected; the text says why.
        """
        assert self._client.wait_for_service(timeout_sec=30), "no virtual robots answer"
        parameters = [
            Parameter(target.replace("/", "."), Parameter.Type.STRING, order).to_parameter_msg()
            for target, order in orders
        ]
        future = self._client.call_async(SetParameters.Request(parameters=parameters))
        self._executor.spin_until_future_complete(future, timeout_sec=60)
        assert future.done(), f"the virtual robots did not answer to {orders}"
        rejected = [each.reason for each in future.result().results if not each.successful]
        assert not rejected, rejected

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()


class Host:
    """An address of this machine whose port is open or closed."""

    def __init__(self, address: str, port: int) -> None:
        self._where = (address, port)
        self._server: socketserver.TCPServer | None = None

    def open(self) -> None:
        socketserver.TCPServer.allow_reuse_address = True
        self._server = socketserver.TCPServer(self._where, socketserver.BaseRequestHandler)
        threading.Thread(target=self._server.serve_forever, daemon=True).start()

    def close(self) -> None:
        if self._server is not None:
            self._server.shutdown()
            self._server.server_close()
            self._server = None


class ScenarioSite:
    """The robots and exporters, and the actions that a scenario may name."""

    def __init__(self, folder: Path, domain_id: int) -> None:
        self.folder = folder
        self.domain_id = domain_id
        environment = domains.environment(domain_id) | {"ROS_LOG_DIR": str(folder / "ros-log")}
        for fleet in fleets.FLEETS:
            (folder / fleet).mkdir()
        self.configs = {
            "hall": fleets.write_hall(folder / "hall", domain_id),
            "shaft": fleets.write_shaft(folder / "shaft", domain_id),
            "yard": fleets.write_yard(folder / "yard", domain_id),
        }
        fleets.declare(folder / "hall", domain_id)
        self.addresses = {fleet: f"127.0.0.1:{free_port()}" for fleet in fleets.FLEETS}
        self.prometheus = f"127.0.0.1:{free_port()}"
        self.exporters = {
            fleet: Process(
                f"exporter of {fleet}",
                [
                    programs.own("ros-diagnostics-exporter"),
                    f"--config.file={config}",
                    f"--web.listen-address={self.addresses[fleet]}",
                    f"--storage.path={config.parent / 'state'}",
                    "--web.enable-lifecycle",
                    f"--prometheus.url=http://{self.prometheus}",
                ],
                environment,
                folder / f"exporter-{fleet}.log",
            )
            for fleet, config in self.configs.items()
        }
        scenario = fleets.write_scenario(folder)
        argv = programs.virtual_robots(0, 0, domain_id, scenario)
        self.robots = Process("virtual-robots", argv, environment, folder / "robots.log")
        self.probe_port, self.blackbox_port = free_port(), free_port()
        self.blackbox = Process("blackbox", self._blackbox_argv(), None, folder / "blackbox.log")
        self.uplink = Host(fleets.UPLINK, self.probe_port)
        self.wedged = Host(fleets.WEDGED, self.probe_port)
        self.dark = Host(fleets.DARK, self.probe_port)
        self.orders: Orders | None = None

    @property
    def processes(self) -> tuple[Process, ...]:
        """What has to be started before Prometheus."""
        return (self.blackbox, *self.exporters.values())

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
            {"target_label": "__address__", "replacement": f"127.0.0.1:{self.blackbox_port}"},
        ]
        common = {
            "metrics_path": "/probe",
            "params": {"module": ["port"]},
            "relabel_configs": relabel,
        }
        listed = {"url": f"http://{self.addresses['hall']}/sd/ping", "refresh_interval": "5s"}
        uplinks = {**listed, "url": f"http://{self.addresses['hall']}/sd/uplink"}
        return [
            {"job_name": "ros-diagnostics-ping", "http_sd_configs": [listed], **common},
            {"job_name": "ros-diagnostics-uplink", "http_sd_configs": [uplinks], **common},
        ]

    def _actions(self) -> dict[str, Callable[[], object]]:
        hall, shaft = self.folder / "hall", self.exporters["shaft"]
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
        request = urllib.request.Request(f"http://{self.addresses[fleet]}{path}", b"")
        with urllib.request.urlopen(request, timeout=30) as answer:
            assert answer.status == 200

    def _blackbox_argv(self) -> list[str]:
        config = self.folder / "blackbox.yml"
        config.write_text(yaml.safe_dump({"modules": {"port": {"prober": "tcp", "timeout": "1s"}}}))
        address = f"--web.listen-address=127.0.0.1:{self.blackbox_port}"
        return [programs.distributed(*host_checks.BLACKBOX), f"--config.file={config}", address]


@contextmanager
def running(folder: Path) -> Iterator[tuple[ScenarioSite, prometheus_site.Site]]:
    """Start everything; the robots last, so that all their states are recorded.

    Raises:
        programs.MissingProgram: A server is not installed.
        TimeoutError: One is not ready in time.
    """
    with ExitStack() as ending:
        site = ScenarioSite(folder, ending.enter_context(domains.lease()))
        for host in (site.uplink, site.wedged, site.dark):
            host.open()
            ending.callback(host.close)
        for process in (*site.processes, site.robots):
            ending.callback(process.stop)
        for process in site.processes:
            process.start()
        for address in (*site.addresses.values(), f"127.0.0.1:{site.blackbox_port}"):
            path = "/metrics" if address.endswith(str(site.blackbox_port)) else "/-/ready"
            until(lambda at=address, p=path: http.answers(at, p), f"{address}{path}", 90)
        servers = ending.enter_context(
            prometheus_site.running(
                folder,
                site.addresses,
                probes=site.probes(),
                interval=fleets.INTERVAL,
                prepare=lambda prometheus: short_clocks.scale(prometheus / "rules"),
                prometheus=site.prometheus,
            )
        )
        # Counters are compared with their first sample, and states recorded from the first on.
        scraped = f'count(up{{job=~"ros-diagnostics.*"}} == 1) >= {2 * len(fleets.FLEETS)}'
        until(lambda: servers.query(scraped), "every exporter is scraped", 60)
        site.robots.start()
        site.robots.wait_for_output("ready: ", 60)
        site.orders = Orders(site.domain_id)
        ending.callback(site.orders.close)
        yield site, servers
