"""The fleet that is in every state at once, watched by a real Prometheus and Alertmanager."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from e2e.dashboards import every_state
from e2e.dashboards import history as past
from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.cli import ack
from support import host_checks, prometheus_site
from support.served_fleet import ServedFleet, serving
from testbed.polling import until
from testbed.ports import free_port

# What must have come about before anything is asked; each names a robot or more.
COME_ABOUT = {
    "every state": "count(count by (state) (robot:ros_diagnostics_state:info)) == 7",
    "confirmed faults": (
        'count(component:ros_diagnostics_fault:confirmed{robot!="flapping"}) == 5'
    ),
    "a confirmed silence": 'robot:ros_diagnostics_silent:confirmed{robot="silent"}',
    "a short check": "check:ros_diagnostics_short:confirmed",
    "flapping": "component:ros_diagnostics_flapping:start",
    "low values": (
        'count(ALERTS{alertname="RosDiagnosticsValueWarning", alertstate="firing"}) == 2'
    ),
    "the thinned past": (
        "count(robot:ros_diagnostics_state:max1m == robot:ros_diagnostics_state:rank) == 13"
    ),
    "planned maintenance": "robot:ros_diagnostics_maintenance:start",
    "the components of silent robots": (
        'count(component:ros_diagnostics_state:rank{robot=~"silent|cut_off"} == 4) == 4'
    ),
    "scraped servers": 'count(up{job=~"prometheus|alertmanager"} == 1) == 2',
    "a ping": "count(probe_success) == 2",
    "a computer": "rate(node_cpu_seconds_total[1m])",
    "a notification that failed": (
        'increase(alertmanager_notifications_failed_total{integration="email"}[1m]) > 0'
    ),
}


class Watched(NamedTuple):
    """The servers, and when the past with known answers ends."""

    site: prometheus_site.Site
    past_end: float


@contextmanager
def watching(folder: Path) -> Iterator[Watched]:
    """All states are there, and told, when this yields."""
    hall, annex = every_state.every_state(folder), every_state.all_well(folder)
    annex.exporter.listener.domain_ids = tuple(set(annex.exporter.listener.domain_ids) - {7})
    past_end = past.write(folder / "past.txt", hall.started.wall)
    with ExitStack() as open_:
        serve = {
            "hall": open_.enter_context(serving(hall.scrape)),
            "annex": open_.enter_context(serving(annex.scrape)),
        }
        node, blackbox = open_.enter_context(host_checks.running(folder))
        probes = [
            _job("node", node, robot="well"),
            _probe("ping", serve["hall"], blackbox, robot="well"),
            _probe("uplink", f"127.0.0.1:{free_port()}", blackbox, uplink="ap_9"),
        ]
        site = open_.enter_context(
            prometheus_site.running(
                folder,
                serve,
                {"restart_grace": 1},
                probes=probes,
                history=folder / "past.txt",
            )
        )
        for what, expr in COME_ABOUT.items():
            until(lambda expr=expr: site.query(expr), what, 90, every=0.5)
        _acknowledge(site, hall)
        yield Watched(site, past_end)


def _acknowledge(site: prometheus_site.Site, hall: ServedFleet) -> None:
    """Somebody takes care of a fault and of a silent robot, and Prometheus knows."""
    url = f"http://{site.alertmanager}"
    hall.alertmanager = Alertmanager([url])
    for words in (
        ("broken", "Motor 1", "--author", "ann", "--comment", "spare part ordered"),
        ("silent", "--author", "bob", "--comment", "carried to the workshop"),
    ):
        until(lambda words=words: ack.main([*words, "--url", url]) == 0, f"{words[0]} is told", 30)
    until(
        lambda: (
            site.query("component:ros_diagnostics_fault:acknowledged")
            and site.query("robot:ros_diagnostics_fault:acknowledged")
            and site.query('sum(alertmanager_silences{state="active"}) == 2')
        ),
        "acknowledged faults",
        30,
    )


def _job(kind: str, address: str, **labels: str) -> dict[str, Any]:
    target = {"targets": [address], "labels": {"fleet": "hall", **labels}}
    return {"job_name": f"ros-diagnostics-{kind}", "static_configs": [target]}


def _probe(kind: str, address: str, blackbox: str, **labels: str) -> dict[str, Any]:
    """A port is asked instead of a ping: nobody needs a right for that."""
    return _job(kind, address, **labels) | {
        "metrics_path": "/probe",
        "params": {"module": ["tcp_connect"]},
        "relabel_configs": [
            {"source_labels": ["__address__"], "target_label": "__param_target"},
            {"source_labels": ["__param_target"], "target_label": "instance"},
            {"target_label": "__address__", "replacement": blackbox},
        ],
    }
