"""A fleet's exposition on a port of this machine: arrays in, text out, without DDS.

The state, the exposition and the exporter's own metrics are the real ones; only what ROS
would bring comes from a function that is called with the clocks at each scrape.
"""

import threading
import time
from collections.abc import Callable, Collection
from contextlib import AbstractContextManager
from types import SimpleNamespace
from urllib.parse import urlsplit

from ros_diagnostics_exporter.alertmanager import Alertmanager
from ros_diagnostics_exporter.canary import Canary
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.metrics.self_metrics import Exporter, SelfMetrics
from ros_diagnostics_exporter.model import ALL_PARTS, Instant, Part
from ros_diagnostics_exporter.notifications import Notifications, parse
from ros_diagnostics_exporter.silences import Acknowledgement
from ros_diagnostics_exporter.web.scrape import wanted_parts
from support.loopback import Request, replying

Speak = Callable[[FleetState, Instant], None]


class ServedFleet:
    """A state that ``speak`` feeds, and the text of a scrape."""

    def __init__(self, fleet: Fleet, speak: Speak) -> None:
        self.started = _read_clocks()
        self.state = FleetState(fleet, self.started)
        self._speak = speak
        self.alertmanager: Alertmanager | None = None  # asked for acknowledgements at each scrape
        self._notifications = Notifications()
        self._exposition = Exposition(self.state, self._acknowledged, self._notifications.lasting)
        self.canary = Canary(self.started)
        self.exporter = self._exporter(fleet)
        self._self_metrics = SelfMetrics(self.exporter)
        self._lock = threading.Lock()

    def scrape(self, parts: Collection[Part] = ALL_PARTS) -> bytes:
        """Let the robots speak and time pass, and return these parts of the exposition."""
        with self._lock:
            now = _read_clocks()
            self._speak(self.state, now)
            self.state.tick(now)
            for event in self.state.take_events():
                self._notifications.note(event)
            self.exporter.scrapes += 1
            self.exporter.alertmanager = self.alertmanager
            if self.alertmanager is not None:
                self.alertmanager.update(self.state.fleet.name, now)
            return self._exposition.render(parts=parts) + self._self_metrics.render(parts=parts)

    def notified(self, body: bytes) -> None:
        """Take a message of Alertmanager's webhook."""
        message, wall = parse(body), _read_clocks().wall
        with self._lock:
            for event in self._notifications.receive(message, self.state.fleet.name, wall).events:
                self._notifications.note(event)

    def _acknowledged(self) -> list[Acknowledgement]:
        alertmanager = self.alertmanager
        return [] if alertmanager is None else alertmanager.known(_read_clocks().wall)

    def _exporter(self, fleet: Fleet) -> SimpleNamespace:
        """What the exporter's own metrics are read from; what is not here is a stand-in."""
        at = self.started.wall
        listener = SimpleNamespace(
            domain_ids=fleet.domain_ids,
            errors={},
            last_looks=dict.fromkeys(fleet.domain_ids, at),
            decode_seconds=0.0,
            ingest_seconds=0.0,
        )
        reloader = SimpleNamespace(successful=True, time=at)
        storage = SimpleNamespace(successful=True, written_at=at, early=SimpleNamespace(counts={}))
        stand_in = SimpleNamespace(
            state=self.state,
            exposition=self._exposition,
            listener=listener,
            reloader=reloader,
            storage=storage,
            alertmanager=None,
            canary=self.canary,
            rejected_logins=SimpleNamespace(total=0),
            recording_dropped=0,
            ros=("jazzy", "none"),
            loops=list,
            outcomes=list,
            scrapes=0,
            scrape_seconds=0.0,
            week=None,
            others=None,
        )
        needed = {name for name in {*Exporter.__annotations__, *vars(Exporter)} if name[0] != "_"}
        assert needed <= vars(stand_in).keys(), needed - vars(stand_in).keys()
        return stand_in


def _read_clocks() -> Instant:
    return Instant(time.monotonic(), time.time())


def serving(
    scrape: Callable[[Collection[Part]], bytes], notified: Callable[[bytes], None] | None = None
) -> AbstractContextManager[str]:
    """Answer scrapes with the parts asked for while the context lasts; it gives HOST:PORT.

    ``notified`` gets what is posted.
    """

    def reply(request: Request) -> bytes:
        if not request.body:
            return scrape(wanted_parts(urlsplit(request.path).query.encode()))
        assert notified is not None
        notified(request.body)
        return b""

    return replying(reply)
