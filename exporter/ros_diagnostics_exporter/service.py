"""The running exporter: state, listener, texts and state file wired together.

Owns no rule of its own: it hands each room the functions of the others. Together with cli.py the
only file that knows both ROS and the web's doors.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.acknowledgement import Acknowledgement
from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.reloader import Reloader
from ros_diagnostics_exporter.events import EventLog, Wanted
from ros_diagnostics_exporter.ingest import ros
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.metrics.self_metrics import Facts, SelfMetrics
from ros_diagnostics_exporter.state import snapshot
from ros_diagnostics_exporter.state.state import State
from ros_diagnostics_exporter.state.storage import Storage
from ros_diagnostics_exporter.web.backend import Doors

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
        self._keeper = threading.Thread(target=self._keep, name="state-file", daemon=True)
        self._alertmanager = alertmanager
        self._asker = threading.Thread(target=self._ask, name="alertmanager", daemon=True)
        self._join_at = now.mono
        self._distribution, self._rmw = ros.describe_ros()
        self._exposition = Exposition(self.state, self._acknowledged)
        self._own = SelfMetrics(self._facts)
        self._scrapes = 0
        self._scrape_seconds = 0.0
        self._listener = ros.Listener(self.state, ros_arguments=ros_arguments)
        if self.storage is not None:
            self.storage.load(self.state, now)

    def start(self) -> None:
        """Join the fleet's domains and listen."""
        self.join()
        self._keeper.start()
        self._asker.start()
        self._reloader.start()

    def _keep(self) -> None:
        """Write the state file again and again; in a thread, for a disk may hang."""
        while self.storage is not None and not self._stopping.wait(self.TICK):
            self.storage.save(self.state, ros.read_clocks())

    def _ask(self) -> None:
        """Ask Alertmanager again and again; in a thread, for it may hang."""
        while self._alertmanager is not None and not self._stopping.is_set():
            self._alertmanager.look(self.state.fleet.name, ros.read_clocks())
            self._stopping.wait(self._alertmanager.INTERVAL)

    def join(self) -> None:
        """Be in the fleet's domains; what cannot be joined is tried again every half minute.

        It waits for none that is joined, and for those that are left at most some seconds.
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
        """Read the config again and follow it; a bad one is refused and the old one goes on.

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
        if self._keeper.is_alive():
            self._keeper.join(self.GRACE)
        if self._keeper.is_alive():
            log.error("the state file is not written a last time: its disk does not answer")
        elif self.storage is not None:
            self.storage.save(self.state, ros.read_clocks(), at_once=True)

    def doors(self) -> Doors:
        """What the web is handed."""
        return Doors(
            metrics=self.render,
            fleet=lambda: snapshot.fleet_snapshot(self.state, ros.read_clocks()),
            events=self._find_events,
            targets=lambda job, port: snapshot.targets(self.state, job, port),
            ready=self._ready,
            reload=self.reload,
            forget=self._forget,
        )

    def _find_events(self, wanted: Wanted) -> Iterator[dict[str, Any]]:
        self._record_events()
        return self.events.find(wanted)

    def render(self, openmetrics: bool) -> bytes:
        """The whole exposition."""
        begin = time.perf_counter()
        text = self._exposition.render(openmetrics=openmetrics)
        own = self._own.render(openmetrics=openmetrics)
        self._scrapes += 1
        self._scrape_seconds = time.perf_counter() - begin
        return text + own

    # -- handed to the web -----------------------------------------------------------------------

    def _ready(self) -> str | None:
        looks = self._listener.last_looks
        if self._listener.joining or not looks or not all(looks.values()):
            return "the ROS graph has not been looked at yet"
        stalled = self._listener.stalled(self.STALLED)
        if stalled:
            domains = ", ".join(map(str, stalled))
            return f"no message was taken for {self.STALLED:.0f} s in DDS domain {domains}"
        return None

    def _forget(self, robot: str, component: str | None) -> int:
        return self.state.forget(robot, component, ros.read_clocks())

    def _acknowledged(self) -> list[Acknowledgement]:
        if self._alertmanager is None:
            return []
        return self._alertmanager.known(ros.read_clocks().wall)

    def _facts(self) -> Facts:
        joined = self._listener.domain_ids
        domains = {domain_id: domain_id in joined for domain_id in self.state.fleet.domain_ids}
        storage, alertmanager = self.storage, self._alertmanager
        return Facts(
            fleet=self.state.fleet.name,
            ros_distro=self._distribution,
            rmw=self._rmw,
            config_successful=self._reloader.successful,
            config_time=self._reloader.time,
            robots=len(self.state.robots),
            series=dict(self._exposition.series),
            series_limit=self.state.fleet.limits.series,
            rejected=dict(self.state.rejected),
            settled=self.state.settled(ros.read_clocks()),
            decode_seconds=self._listener.decode_seconds,
            ingest_seconds=self._listener.ingest_seconds,
            scrapes=self._scrapes,
            scrape_seconds=self._scrape_seconds,
            domains=domains,
            discovery_times=self._listener.last_looks,
            storage_successful=None if storage is None else storage.successful,
            storage_time=0.0 if storage is None else storage.written_at,
            alertmanager_up=None
            if alertmanager is None
            else alertmanager.answers(ros.read_clocks()),
        )
