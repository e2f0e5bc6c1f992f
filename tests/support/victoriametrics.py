"""VictoriaMetrics, and vmalert that evaluates rules with it."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from testbed import http, programs
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process


class Addresses(NamedTuple):
    """Where both answer, as HOST:PORT."""

    metrics: str
    alerts: str


def start(stack: ExitStack, folder: Path, rules: str, *options: str) -> Addresses:
    """Start both until ``stack`` is closed; data and logs are in ``folder``.

    Args:
        stack: Stops them.
        folder: For data and logs.
        rules: The files of rules, as a pattern.
        options: More of VictoriaMetrics'.
    """
    found = Addresses(*(f"127.0.0.1:{free_port()}" for _ in range(2)))
    storage = [
        f"-httpListenAddr={found.metrics}",
        f"-storageDataPath={folder / 'victoria'}",
        "-search.latencyOffset=0s",
        *options,
    ]
    start_program(stack, folder, found.metrics, "victoria-metrics", *storage)
    url = f"http://{found.metrics}"
    evaluation = [
        f"-httpListenAddr={found.alerts}",
        f"-rule={rules}",
        f"-datasource.url={url}",
        f"-remoteWrite.url={url}",
        f"-remoteRead.url={url}",
        "-remoteWrite.flushInterval=200ms",
        "-notifier.url=http://127.0.0.1:1",
    ]
    start_program(stack, folder, found.alerts, "vmalert", *evaluation)
    return found


def start_program(
    stack: ExitStack, folder: Path, address: str, name: str, *options: str
) -> Process:
    """Start one of VictoriaMetrics' programs and wait until it answers at its address."""
    argv = [programs.distributed(name), *options]
    process = Process(name, argv, None, folder / f"{name}.log")
    stack.callback(process.stop)
    process.start()
    until(lambda: http.answers(address, "/health"), process.describe, 60)
    return process
