"""The running exporter: state, listener, texts and state file wired together.

Owns no rule of its own: it connects the packages, and is the web server's Backend.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.alertmanager import Acknowledgement, Alertmanager
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.reloader import Reloader
from ros_diagnostics_exporter.events import EventLog, Wanted
from ros_diagnostics_exporter.ingest import ros
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.metrics.self_metrics import Exporter, SelfMetrics
from ros_diagnostics_exporter.state import snapshot
from ros_diagnostics_exporter.state.state import State
from ros_diagnostics_exporter.state.storage import Storage

log = logging.getLogger(__name__)


class Service:
    """One exporter: made, started, ticked, stopped."""

    TICK = 0.25  # seconds between two calls of tick
    JOIN = 30.0  # seconds until a domain that could not be joined is tried again
    GRACE = 5.0  # seconds that a write or a reload under way is waited for at the end
    STALLED = 10.0  # seconds without a turn of a domain's thread after which it is not ready

    def __init__(
        self,
        fleet: Fleet,
        config_file: Path,
        storage_path: Path | None,
        events: EventLog | None = None,
        ros_arguments: tuple[str, ...] = (),
        *,
        alertmanager: Alertmanager | None = None,
    ) -> None:
        now = ros.read_clocks()
        self.events = events or EventLog()
        self.state = State(fleet, now)
        self._recording = threading.Lock()
        self.storage = None if storage_path is None else Storage(storage_path)
        self._reloader = Reloader(
            config_file,
            fleet,
            apply=self._configure,
            record=self.events.record,
            clocks=ros.read_clocks,
        )
        self._stopping = threading.Event()
        self._storage_thread = threading.Thread(
            target=self._save_state, name="state-file", daemon=True
        )
        self._alertmanager = alertmanager
        self._alertmanager_thread = threading.Thread(
            target=self._read_silences, name="alertmanager", daemon=True
        )
        self._join_at = now.mono
        self._exposition = Exposition(self.state, self._acknowledged)
        self._listener = ros.Listener(self.state, ros_arguments=ros_arguments)
        self._exporter = Exporter(
            self.state,
            self._exposition,
            self._listener,
            self._reloader,
            self.storage,
            alertmanager,
            ros.describe_ros(),
        )
        self._self_metrics = SelfMetrics(self._exporter)
        if self.storage is not None:
            self.storage.load(self.state, now)

    def start(self) -> None:
        """Join the fleet's domains and listen."""
        self.join()
        self._storage_thread.start()
        self._alertmanager_thread.start()
        self._reloader.start()

    def _save_state(self) -> None:
        """Write the state file regularly; in its own thread, because a disk may hang."""
        while self.storage is not None and not self._stopping.wait(self.TICK):
            self.storage.save(self.state, ros.read_clocks())

    def _read_silences(self) -> None:
        """Read the silences regularly; in its own thread, because Alertmanager may hang."""
        while self._alertmanager is not None and not self._stopping.is_set():
            self._alertmanager.update(self.state.fleet.name, ros.read_clocks())
            self._stopping.wait(self._alertmanager.INTERVAL)

    def join(self) -> None:
        """Join the fleet's domains; one that cannot be joined is retried every half minute.

        Does not wait until they are joined, and at most some seconds until others are left.
        """
        self._join_at = ros.read_clocks().mono + self.JOIN
        self._listener.join(self.state.fleet.domain_ids)
        for domain_id in self._listener.domain_ids:
            self.state.domain_joined(domain_id)

    def tick(self) -> None:
        """Let time pass; to be called every ``TICK`` seconds."""
        now = ros.read_clocks()
        self.state.tick(now)
        self._record_events()
        self._reloader.tick()
        if now.mono >= self._join_at and self._listener.domain_ids != self.state.fleet.domain_ids:
            for domain_id in self._listener.joining:
                log.warning("DDS domain %d is still being joined", domain_id)
                self.state.domain_failed(domain_id, "it is still being joined", now)
            self.join()

    def _record_events(self) -> None:
        with self._recording:  # so that they are recorded in order
            for event in self.state.take_events():
                self.events.record(event)

    def reload(self, why: str = "POST /-/reload") -> None:
        """Read the config again and follow it; if it is invalid, keep the previous one.

        Both are logged, with ``why`` it was read.

        Raises:
            ConfigError: the config cannot be used, or it takes too long to read.
        """
        self._reloader.reload(why)

    def request_reload(self, why: str) -> None:
        """Have the config read again soon; the log says how that ends."""
        self._reloader.request(why)

    def _configure(self, fleet: Fleet) -> None:
        self.state.configure(fleet, ros.read_clocks())
        self.join()

    def stop(self) -> None:
        """Leave the domains, and write the state a last time."""
        self._reloader.stop(self.GRACE)
        self._listener.stop()
        self._record_events()
        self._stopping.set()
        if self._storage_thread.is_alive():
            self._storage_thread.join(self.GRACE)
        if self._storage_thread.is_alive():
            log.error("the state file is not written a last time: its disk hangs")
        elif self.storage is not None:
            self.storage.save(self.state, ros.read_clocks(), at_once=True)

    # -- the web server's Backend --------------------------------------------------------------

    def render_metrics(self, openmetrics: bool) -> bytes:
        """The whole exposition."""
        begin = time.perf_counter()
        text = self._exposition.render(openmetrics=openmetrics)
        own = self._self_metrics.render(openmetrics=openmetrics)
        self._exporter.scrapes += 1
        self._exporter.scrape_seconds = time.perf_counter() - begin
        return text + own

    def fleet_snapshot(self) -> dict[str, Any]:
        """The fleet as /api/v1/fleet returns it."""
        return snapshot.fleet_snapshot(self.state, ros.read_clocks())

    def find_events(self, wanted: Wanted) -> Iterable[dict[str, Any]]:
        """The events that match the filter, newest first."""
        self._record_events()
        return self.events.find(wanted)

    def targets(self, job: str, port: int | None) -> list[dict[str, Any]]:
        """Prometheus' http_sd list of a job; LookupError or ValueError as Backend says."""
        return snapshot.targets(self.state, job, port)

    def not_ready_reason(self) -> str | None:
        """Why the robots' messages are not subscribed to; None when they are."""
        looks = self._listener.last_looks
        if self._listener.joining or not looks or not all(looks.values()):
            return "the ROS graph has not been looked at yet"
        stalled = self._listener.stalled(self.STALLED)
        if stalled:
            domains = ", ".join(map(str, stalled))
            return f"no message was taken for {self.STALLED:.0f} s in DDS domain {domains}"
        return None

    def forget(self, robot: str, component: str | None) -> int:
        """Remove a robot or a component; LookupError if there is none of that name."""
        return self.state.forget(robot, component, ros.read_clocks())

    # -- handed to the metrics -----------------------------------------------------------------

    def _acknowledged(self) -> list[Acknowledgement]:
        if self._alertmanager is None:
            return []
        return self._alertmanager.known(ros.read_clocks().wall)


def _thread(name: str, target: Callable[[], None]) -> threading.Thread:
    return threading.Thread(target=target, name=name, daemon=True)
