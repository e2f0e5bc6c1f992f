"""Servers: a program, its HTTP address, and whether it is ready; Prometheus and Alertmanager."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from testbed import http, programs
from testbed.polling import until
from testbed.processes import Process


@dataclass(frozen=True)
class Server:
    """A program and, where it serves HTTP, its address."""

    process: Process
    address: str = ""
    health: str = "/-/healthy"  # the path that answers 2xx while it is up
    ready: str = "/-/ready"  # and once it is ready; "" where nobody waits for it

    @property
    def name(self) -> str:
        """The name of its process, for messages."""
        return self.process.name

    def is_up(self) -> bool:
        """Whether it runs: as our child, or started again by hand at the same address."""
        return self.process.alive or (self.address != "" and self.answers(self.health))

    def answers(self, path: str) -> bool:
        """Whether it answers 2xx there."""
        return http.answers(self.address, path)

    def restart(self) -> None:
        """Stop it, start it again and wait until it is ready; raises as `wait_until_ready`."""
        self.process.stop()
        self.process.start()
        self.wait_until_ready()

    def wait_until_ready(self, seconds: float = 60.0) -> None:
        """Wait until it is ready.

        Raises:
            TimeoutError: Not ready in time; the text has its last output.
        """
        until(lambda: self.answers(self.ready), self.process.describe, seconds)


def prometheus(
    folder: Path,
    config: Path,
    address: str,
    *options: str,
    environment: Mapping[str, str] | None = None,
) -> Server:
    """Return a Prometheus, not yet started, with its data and log in ``folder``.

    Args:
        folder: For ``tsdb/`` and ``Prometheus.log``.
        config: Its prometheus.yml.
        address: HOST:PORT.
        options: More command line options, such as "--storage.tsdb.retention.time=90d".
        environment: Of the process; None: this process' own.

    Raises:
        programs.MissingProgram: It is not installed.
    """
    argv = [*programs.prometheus(config, address, folder / "tsdb"), *options]
    return Server(Process("Prometheus", argv, environment, folder / "Prometheus.log"), address)


def alertmanager(
    folder: Path,
    config: Path,
    address: str,
    *options: str,
    cluster: str = "",
    environment: Mapping[str, str] | None = None,
) -> Server:
    """Return an Alertmanager, not yet started, with ``nflog/`` and its log in ``folder``.

    Arguments and errors as `prometheus`; ``cluster`` is its address in a cluster, "" for none.
    """
    argv = [*programs.alertmanager(config, address, folder / "nflog", cluster), *options]
    return Server(Process("Alertmanager", argv, environment, folder / "Alertmanager.log"), address)


def import_history(samples: Path, folder: Path) -> None:
    """Give a Prometheus that has not run yet the samples of an OpenMetrics file."""
    # Blocks as long as those of compaction: promtool reads the whole text for each.
    argv = ["promtool", "tsdb", "create-blocks-from", "--max-block-duration=744h"]
    argv += ["openmetrics", "--quiet", str(samples), str(folder / "tsdb")]
    subprocess.run(argv, check=True, capture_output=True, timeout=1800)


@contextmanager
def running(*servers: Server, seconds: float = 60.0) -> Iterator[None]:
    """Start servers, wait until all are ready, and stop them at the end.

    Raises:
        TimeoutError: One is not ready within ``seconds``.
    """
    with ExitStack() as stack:
        for server in servers:
            stack.callback(server.process.stop)
            server.process.start()
        for server in servers:
            server.wait_until_ready(seconds)
        yield
