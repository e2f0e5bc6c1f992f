"""The fleet of every_state.py with a real Prometheus and Alertmanager."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from e2e.dashboards import every_state, history
from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_tools.main import main
from support import host_checks
from support.served_fleet import ServedFleet, serving
from testbed import servers
from testbed.polling import until
from testbed.site import Site, free_address

ACKNOWLEDGED = "ros_diagnostics_fault_acknowledged_timestamp_seconds"
# Conditions before the first query of a test: each expression must return something.
READY = {
    "every state": "count(count by (state) (robot:ros_diagnostics_state:info)) == 8",
    "confirmed faults": 'count(fleet:ros_diagnostics_fault_start:held{scope="component"}) == 6',
    "what a robot can do": 'fleet:ros_diagnostics_fault_start:held{scope="capability"}',
    "what the fleet can do": 'capability:ros_diagnostics_capability_state:max{robot=""}',
    "low values": 'count(fleet:ros_diagnostics_fault_start:held{scope="value"}) == 2',
    "a confirmed silence": (
        'fleet:ros_diagnostics_fault_start:held{scope="robot", robot="silent", state="silent"}'
    ),
    "a short check": 'fleet:ros_diagnostics_fault_start:held{scope="check"}',
    "flapping": 'fleet:ros_diagnostics_fault_start:held{scope="flapping"}',
    "firing alerts": (
        'count(ALERTS{alertname="RosDiagnosticsValueWarning", alertstate="firing"}) == 2'
    ),
    "an alert about a level that is none": (
        'ALERTS{alertname="RosDiagnosticsLimitHit", alertstate="firing", robot="broken"}'
    ),
    "the state of a robot with a short check": (
        'robot:ros_diagnostics_state:rank{robot="short"} == 6'
    ),
    "scraped servers": 'count(up{job=~"prometheus|alertmanager"} == 1) == 2',
    "a ping": "count(probe_success) == 3",
    "a computer": "rate(node_cpu_seconds_total[1m])",
    "notifications of every fault": (
        "count(count without (receiver)"
        " (ros_diagnostics_fault_notified_timestamp_seconds > 0)) == 12"
    ),
    "a notification of the uplink": (
        'ros_diagnostics_fault_notified_timestamp_seconds{component="uplink"} > 0'
    ),
    "a notification that failed": (
        'increase(alertmanager_notifications_failed_total{integration="email"}[1m]) > 0'
    ),
}


class WatchedFleet(NamedTuple):
    """The servers, the end of the recorded history as Unix time, exporters' addresses -> fleets."""

    site: Site
    history_end: float
    fleets: dict[str, str]


@contextmanager
def running(folder: Path) -> Iterator[WatchedFleet]:
    """Yield when all robots are in their states and the alerts fire."""
    hall, annex = every_state.every_state(folder), every_state.all_well(folder)
    annex.exporter.listener.domain_ids = (0,)  # domain 7 could not be joined
    history_end = history.write(folder / "history.txt", hall.started.wall)
    with Site(folder) as site:
        serve = {
            "hall": site.use(serving(hall.scrape, hall.notified)),
            "annex": site.use(serving(annex.scrape)),
        }
        node, blackbox = host_checks.start(site)
        probes = [
            _job("node", node, robot="well"),
            _probe("ping", serve["hall"], blackbox, robot="well"),
            _probe("uplink", free_address(), blackbox, robot="ap_9"),
            _probe("http", free_address(), blackbox, robot="warned", site="north"),
        ]
        servers.import_history(folder / "history.txt", folder)
        site.start_alertmanager(
            "--cluster.advertise-address=127.0.0.1:1",
            cluster=free_address(),
            recorder=serve["hall"],
            edit=_notify_team,
        )
        site.start_prometheus(
            "--storage.tsdb.retention.time=90d",
            exporters=[*serve.values()],
            interval=1,
            probes=probes,
        )
        site.wait_until_ready()
        for what, expr in READY.items():
            until(lambda expr=expr: site.query(expr), what, 90, every=0.5)
        _acknowledge(site, hall)
        fleets = {address: fleet for fleet, address in serve.items()}
        yield WatchedFleet(site, history_end, fleets)


def _notify_team(config: dict[str, Any]) -> None:
    """Send the notifications of one robot to two receivers."""
    route = {"matchers": ["robot = broken", "severity = critical"], "receiver": "team"}
    config["route"]["routes"].insert(0, {**route, "continue": True})


def _acknowledge(site: Site, hall: ServedFleet) -> None:
    """Acknowledge a fault and a silent robot, and wait until Prometheus has both."""
    url = f"http://{site.addresses.alertmanager}"
    hall.alertmanager = Alertmanager([url])
    for arguments in (
        ("broken", "Motor 1", "--author", "ann", "--comment", "spare part ordered"),
        ("silent", "--author", "bob", "--comment", "carried to the workshop"),
    ):
        until(
            lambda arguments=arguments: main(["ack", *arguments, "--alertmanager", url]) == 0,
            f"an alert of {arguments[0]}",
            30,
        )
    for expr in (
        f"count({ACKNOWLEDGED}) == 2",
        f'ros_diagnostics_exporter_series{{family="{ACKNOWLEDGED}"}} == 2',
        'sum(alertmanager_silences{state="active"}) == 2',
        "ros_diagnostics_exporter_alertmanager_up == 1",
    ):
        until(lambda expr=expr: site.query(expr), expr, 30)


def _job(kind: str, address: str, **labels: str) -> dict[str, Any]:
    target = {"targets": [address], "labels": {"fleet": "hall", **labels}}
    return {"job_name": f"ros-diagnostics-{kind}", "static_configs": [target]}


def _probe(kind: str, address: str, blackbox: str, **labels: str) -> dict[str, Any]:
    """Probe a TCP port instead of a ping, which would need a privilege."""
    return _job(kind, address, **labels) | {
        "metrics_path": "/probe",
        "params": {"module": ["tcp_connect"]},
        "relabel_configs": [
            {"source_labels": ["__address__"], "target_label": "__param_target"},
            {"source_labels": ["__param_target"], "target_label": "instance"},
            {"target_label": "__address__", "replacement": blackbox},
        ],
    }
