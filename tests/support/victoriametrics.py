"""VictoriaMetrics, and vmalert that evaluates rules with it."""

from typing import NamedTuple

from testbed import programs
from testbed.engine import Engine
from testbed.processes import Process
from testbed.site import Site, free_address


class Engines(NamedTuple):
    """Both, which answer as Prometheus does."""

    metrics: Engine
    alerts: Engine


def start(site: Site, rules: str, *options: str) -> Engines:
    """Start both in a site; ``rules`` is a pattern of files, ``options`` are VictoriaMetrics'."""
    metrics, alerts = free_address(), free_address()
    start_program(
        site,
        "victoria-metrics",
        metrics,
        f"-storageDataPath={site.folder / 'victoria'}",
        "-search.latencyOffset=0s",
        *options,
    )
    url = f"http://{metrics}"
    start_program(
        site,
        "vmalert",
        alerts,
        f"-rule={rules}",
        f"-datasource.url={url}",
        f"-remoteWrite.url={url}",
        f"-remoteRead.url={url}",
        "-remoteWrite.flushInterval=200ms",
        "-notifier.url=http://127.0.0.1:1",
    )
    return Engines(Engine(metrics), Engine(alerts))


def start_program(site: Site, name: str, address: str, *options: str) -> Process:
    """Start one of VictoriaMetrics' programs and wait until all of the site answers."""
    argv = [programs.distributed(name), f"-httpListenAddr={address}", *options]
    server = site.start_program(name, argv, address, "/health")
    server.wait_until_ready()
    return server.process
