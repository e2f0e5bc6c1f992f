"""What is measured beside the scrapes of `bench.hostile`, in threads of their own."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import TracebackType

from testbed import http

FAULTS = "/metrics?collect[]=faults"
FAULTS_INTERVAL = 2.0  # seconds, as Prometheus is configured
FAULTS_TIMEOUT = 10.0
MEMORY_INTERVAL = 0.1


class Beside:
    """The memory of an exporter and the times of its most urgent scrape, while it is a context.

    Memory is that which belongs to the process alone. What it shares with others by DDS has a size
    that nobody on the network can change.
    """

    def __init__(self, pid: int, address: str) -> None:
        self.memory = 0.0  # MB at most
        self.faults: list[float] = []  # seconds of each scrape
        self._pid, self._address = pid, address
        self._stop = threading.Event()
        self._threads = [
            threading.Thread(target=self._repeat, args=(MEMORY_INTERVAL, self._weigh)),
            threading.Thread(target=self._repeat, args=(FAULTS_INTERVAL, self._scrape)),
        ]

    def __enter__(self) -> Beside:  # noqa: PYI034 - Self is not in Python 3.10
        """Begin."""
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """End."""
        self._stop.set()
        for thread in self._threads:
            thread.join()

    def _repeat(self, interval: float, work: Callable[[], None]) -> None:
        while not self._stop.wait(interval):
            work()

    def _weigh(self) -> None:
        with suppress(OSError):  # it has ended
            self.memory = max(self.memory, private_megabytes(self._pid))

    def _scrape(self) -> None:
        begin = time.monotonic()
        with suppress(http.Unanswered):
            http.get(self._address, FAULTS, FAULTS_TIMEOUT)
        self.faults.append(time.monotonic() - begin)


def private_megabytes(pid: int) -> float:
    """The memory that is the process' own now."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("RssAnon:")[1].split()[0]) / 1024
