"""The running exporter: state, listener, texts and database wired together.

Owns no rule of its own: it connects the packages, and is the web server's Backend.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Collection, Iterable
from dataclasses import asdict, replace
from functools import partial
from itertools import chain
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.acknowledging import acknowledge, cancel_downtime, plan_downtime
from ros_diagnostics_exporter.alertmanager import Alertmanager, explained
from ros_diagnostics_exporter.api import fault_history, snapshot
from ros_diagnostics_exporter.api.capabilities import capability_tree
from ros_diagnostics_exporter.api.missions import missions
from ros_diagnostics_exporter.api.occurrences import history
from ros_diagnostics_exporter.api.week import Counting
from ros_diagnostics_exporter.canary import Canary
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.reloader import ConfigReader, Reloader
from ros_diagnostics_exporter.events import Event, EventLog, Wanted
from ros_diagnostics_exporter.faults.model import Fault, fault_id, fault_of
from ros_diagnostics_exporter.firing import read as read_firing
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.forgetting import Forgetting
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.joining import Joining
from ros_diagnostics_exporter.loops import Loop, end_watch, keep_watch, read_clocks
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.metrics.self_metrics import EOF, SelfMetrics
from ros_diagnostics_exporter.metrics.week import Week
from ros_diagnostics_exporter.model import Part, Person
from ros_diagnostics_exporter.notifications import parse, restored
from ros_diagnostics_exporter.other_exporters import OtherExporters
from ros_diagnostics_exporter.recordings.recordings import FaultRecordings
from ros_diagnostics_exporter.rejected_logins import RejectedLogins
from ros_diagnostics_exporter.self_check import SelfCheck
from ros_diagnostics_exporter.silences import Acknowledgement
from ros_diagnostics_exporter.sources.dds import describe_ros
from ros_diagnostics_exporter.sources.listener import Listener
from ros_diagnostics_exporter.sources.prometheus import Outcome, Prometheus
from ros_diagnostics_exporter.sources.source import ArraySource
from ros_diagnostics_exporter.storage.storage import Storage

log = logging.getLogger(__name__)


class Service:
    """One exporter: made, started, ticked, stopped.

    Raises:
        InUseError: another exporter has the database of ``storage`` open.
        ForeignError: the database is of another program.
    """

    CHECK = 1.0  # seconds between two judgements of the exporter itself
    TICK = 0.25  # seconds between two turns of the loop that lets time pass
    SAVE = 0.1  # ... of the one that saves, which writes less often
    RECORDINGS = 1.0  # ... of the one that compresses what was received
    FORGET = 60.0  # ... between two looks of that loop what is not received any more
    UNMATCHED = 60.0  # ... of the one that looks for entries of fleet.yml that match nothing
    WEEK = 60.0  # ... of the one that counts what the week had
    ADOPT = 60.0  # ... between two looks at which alerts fire, once it has settled
    HANGING = 30.0  # seconds after which a turn of a vital loop hangs
    UNREAD = 150.0  # seconds without a scrape of the faults: two that are a minute apart may fail
    ASKED = 5.0  # seconds that Alertmanager's first answer is waited for at the start
    GRACE = 5.0  # seconds that a write or a reload under way is waited for at the end

    def __init__(
        self,
        fleet: Fleet,
        config_file: Path,
        storage: Storage | None,
        ros_arguments: tuple[str, ...] = (),
        *,
        alertmanager: Alertmanager | None = None,
        prometheus: Client | None = None,
    ) -> None:
        now = read_clocks()
        self.state = FleetState(fleet, now)
        self._event_order = threading.Lock()
        self.storage = storage
        self.events = EventLog()
        if storage is not None:
            self.events = EventLog(storage.load(self.state, now), storage.find_events)
        self._week = Counting(lambda **wanted: self.events.find(Wanted(**wanted)))
        older = None if storage is None else storage.find_events
        self._notifications = restored(self.state.faults(), older, now.wall)
        self._recordings = (
            None if storage is None else self._make_recordings(storage.path, config_file)
        )
        self.canary = Canary(now)
        self.alertmanager = alertmanager
        self._forgetting = Forgetting(self.state, alertmanager)
        self._asked = threading.Event()  # Alertmanager, once
        self._tick_loop = Loop("tick", self.TICK, self.tick, vital=True)
        self._storage_loop = Loop("storage", self.SAVE, self._save)
        self._recordings_loop = Loop("recordings", self.RECORDINGS, self._keep_recordings)
        self._others = [
            Loop("unmatched", self.UNMATCHED, lambda: self.state.find_unmatched(read_clocks())),
            Loop("week", self.WEEK, self._count_week),
        ]
        if self._recordings is not None:
            self._others.append(self._recordings_loop)
        self.others: OtherExporters | None = None
        if fleet.shard is not None:
            self.others = OtherExporters(self.state, fleet.shard, prometheus, read_clocks)
            self._others.append(Loop("shards", self.others.INTERVAL, self.others.turn))
        if alertmanager is not None:
            read = partial(self._read_silences, alertmanager)
            self._others.append(Loop("alertmanager", alertmanager.INTERVAL, read))
        self._watched: list[Loop] = []  # that others made
        self._adopt_at = self._forget_at = self._check_at = now.mono
        self.exposition = Exposition(self.state, self._acknowledged, self._notifications.lasting)
        self.listener = Listener(self.state, ros_arguments=ros_arguments)
        self._prometheus = Prometheus(self.state, prometheus, read_clocks)
        self._sources: tuple[ArraySource, ...] = (self.listener, self._prometheus)
        self._joining = Joining(self.state, self.listener)
        self.reloader = Reloader(
            config_file,
            fleet,
            readers=self._readers(),
            record=self.events.record,
            clocks=read_clocks,
        )
        self.ros = describe_ros()
        self.scrapes, self.scrape_seconds = 0, 0.0
        self._faults_read_at = now
        self.rejected_logins = RejectedLogins()
        self.week: Week | None = None
        self._self_metrics = SelfMetrics(self)
        self._self_check = SelfCheck(self, now)

    def start(self) -> None:
        """Begin all loops: join the fleet's domains, listen, judge."""
        for loop in (*self._others, self._storage_loop):
            loop.start()
        if self.alertmanager is None:
            self.state.plan((), read_clocks())  # nobody could cancel those of the database
        elif not self._asked.wait(self.ASKED):  # so that downtimes are known at the first message
            log.warning("Alertmanager has not answered yet: starting without its downtimes")
        for source in self._sources:
            source.configure(self.state.fleet, read_clocks())
        self._joining.configure(self.state.fleet, read_clocks())
        keep_watch()
        for loop in (self._tick_loop, self._joining.loop):
            loop.start()
        self.reloader.start()

    def watch(self, loop: Loop) -> None:
        """Show a loop that somebody else starts and stops among those of the service."""
        self._watched.append(loop)

    def loops(self) -> list[Loop]:
        """All loops that there are now."""
        own = [self._tick_loop, self._storage_loop, self._joining.loop, self.reloader.loop]
        return [
            *own,
            *self._others,
            *self._watched,
            *chain(*(each.loops for each in self._sources)),
        ]

    def outcomes(self) -> list[Outcome]:
        """What the queries of fleet.yml have brought."""
        return self._prometheus.outcomes()

    def hanging_reason(self) -> str | None:
        """Which loop hangs without which the exporter is of no use; None if none does."""
        for loop in self.loops():
            if loop.vital and loop.hangs(self.HANGING):
                return f"loop {loop.name} has hung for more than {self.HANGING:.0f} s"
        return None

    def _save(self, *, at_once: bool = False) -> None:
        now = read_clocks()
        if self.storage is None:
            self.state.take_fault_rows(now)  # else they become many
        else:
            self._record_events()
            self.storage.save(self.state, self.events, now, at_once=at_once)

    def _read_silences(self, alertmanager: Alertmanager) -> None:
        """Read the silences; without an answer the downtimes of the database stay in force."""
        try:
            alertmanager.update(self.state.fleet.name, read_clocks())
            if alertmanager.downtimes is not None:
                self.state.plan(alertmanager.downtimes, read_clocks())
            self._forgetting.forget_passed_on(read_clocks())
            self._adopt(alertmanager)
        finally:
            self._asked.set()
        self._record_events()
        with self._event_order:
            self._record(*self._notifications.acknowledge(self._acknowledged()))

    def _keep_recordings(self) -> None:
        now = read_clocks()
        if self._recordings is None:
            return
        if now.mono >= self._forget_at:
            self._forget_at = now.mono + self.FORGET
            self._recordings.keep_only(*self.state.received())
        self._recordings.turn(now)

    @property
    def recording_dropped(self) -> int:
        """How many messages no recording has, because they were too many."""
        return 0 if self._recordings is None else self._recordings.rings.dropped

    def _make_recordings(self, database: Path, config_file: Path) -> FaultRecordings:
        folder = database.with_name(f"{database.stem}.recordings")
        settings = self.state.fleet.recordings
        state = self.state
        recordings = FaultRecordings(
            folder, config_file, state.topics_of, settings=settings, definition=state.definition
        )
        self.state.recorder = recordings.rings.receive
        return recordings

    def _count_week(self) -> None:
        """Count what the event log has of seven days."""
        self._record_events()
        lasting = self.faults()["faults"]
        self.week = self._week.count(lasting, read_clocks().wall)

    def _adopt(self, alertmanager: Alertmanager) -> None:
        """Go on with the faults that fire and that nobody here knows, as without the database.

        Asked often until the fleet is settled, because robots are found one by one.
        """
        now = read_clocks()
        if now.mono < self._adopt_at:
            return
        if self.state.settled(now):
            self._adopt_at = now.mono + self.ADOPT
        try:
            firing = alertmanager.firing(self.state.fleet.name)
        except UnreachableError as error:
            log.debug("the alerts that fire are not known: %s", error)  # `update` has logged it
            return
        faults = read_firing(firing, self.state.fleet)
        self.state.adopt(self._forgetting.without_forgotten(faults), read_clocks())

    def tick(self) -> None:
        """Let time pass; called every ``TICK`` seconds."""
        now = read_clocks()
        self.state.tick(now)
        if now.mono >= self._check_at:
            self._check_at = now.mono + self.CHECK
            reports = self._self_check.reports(now)
            self.state.judge(lambda of: of.own(reports, now))
        self.canary.tick(self.state.fleet.canary, now)
        self._record_events()
        self.reloader.tick()

    def _record_events(self) -> None:
        with self._event_order:  # so that they are recorded in order
            self._record(*self.state.take_events())

    def _record(self, *events: Event) -> None:
        for event in map(self._with_fault, events):
            self.events.record(event)
            self._notifications.note(event)
            if self._recordings is not None and event.kind == "fault_began" and event.robot:
                self._recordings.note(event.fault, event, read_clocks())
                self._recordings_loop.wake()

    def _with_fault(self, event: Event) -> Event:
        """An event with the id of the fault that it is of."""
        if event.since is None:
            return event
        return replace(event, fault=fault_of(self.state.fleet, asdict(event)))

    def reload(self, why: str = "POST /-/reload") -> None:
        """Read the config again and follow it; if it is invalid, keep the previous one.

        Both are logged, with ``why`` it was read.

        Raises:
            ConfigError: the config cannot be used, or it takes too long to read.
        """
        self.reloader.reload(why)

    def _readers(self) -> tuple[ConfigReader, ...]:
        """What follows fleet.yml: the state first, which the sources report to."""
        recordings = () if self._recordings is None else (self._recordings,)
        return (self.state, *recordings, *self._sources, self._joining)

    def stop(self) -> None:
        """Write the state, leave the domains, and write what they brought meanwhile."""
        end_watch()
        changing = (self.reloader.loop, self._joining.loop, self._tick_loop)
        for loop in (*self._others, *changing):
            loop.ask_to_stop()
        deadline = time.monotonic() + self.GRACE
        for loop in changing:
            loop.stop(max(0.0, deadline - time.monotonic()))
        hangs = not self._storage_loop.stop(self.GRACE)
        if hangs:
            log.error("could not save the state before the exit: the disk does not respond")
        else:
            self._save(at_once=True)  # leaving many subscriptions takes long, and we may be killed
        for source in self._sources:
            source.stop()
        if self.storage is not None and not hangs:
            self._save(at_once=True)
            self.storage.close()

    # -- the web server's Backend --------------------------------------------------------------

    def render_metrics(self, openmetrics: bool, parts: Collection[Part]) -> list[bytes]:
        """These parts of the exposition."""
        begin = time.perf_counter()
        pieces = self.exposition.pieces(openmetrics=openmetrics, parts=parts)
        own = self._self_metrics.render(openmetrics=openmetrics, parts=parts)
        if Part.FAULTS in parts:
            self._faults_read_at = read_clocks()
            self.state.note_served(self._faults_read_at)
        self.scrape_seconds = time.perf_counter() - begin
        return [*pieces, own, EOF if openmetrics else b""]

    def count_scrape(self) -> None:
        """Note that a scrape was answered: requests at one moment share what is rendered."""
        self.scrapes += 1

    def fleet_snapshot(self) -> dict[str, Any]:
        """The fleet as /api/v1/fleet returns it."""
        now, read_at = read_clocks(), self._faults_read_at
        fleet = snapshot.fleet_snapshot(self.state, now, self._care())
        unread_since = read_at.wall if now.mono - read_at.mono > self.UNREAD else None
        queries = snapshot.queries(self.outcomes())
        return {**fleet, "unread_since": unread_since, "queries": queries}

    def faults(self) -> dict[str, Any]:
        """The faults that last as /api/v1/faults returns them."""
        lasting = snapshot.faults(self.state, read_clocks(), self._care())
        return {**lasting, "events_since": self._events_since()}

    def _care(self) -> snapshot.Care:
        has = None if self._recordings is None else self._recordings.has
        return snapshot.Care(self._notifications.lasting(), self._acknowledged(), has)

    def recording(self, fault: str, so_far: bool = False) -> bytes:
        """The newest recording of a fault, ``so_far`` also one under way; LookupError if none."""
        if self._recordings is None:
            raise LookupError("no recordings are kept: the exporter runs with --storage.path=none")
        self._record_events()
        now = read_clocks()
        if not so_far:
            return self._recordings.read(fault, now)
        lasting = self._lasting().get(fault)
        since = None if lasting is None else lasting.since
        return self._recordings.read_so_far(fault, since, now)

    def _lasting(self) -> dict[str, Fault]:
        """The faults that last, by id."""
        fleet, lasting = self.state.fleet, self.state.faults()
        return {fault_id(fleet, each.identity): each for each in lasting}

    def last_event(self) -> int:
        """The id of the last event."""
        return self.events.last

    def find_events(self, wanted: Wanted) -> Iterable[dict[str, Any]]:
        """The events that match the filter, newest first."""
        self._record_events()
        return self.events.find(wanted)

    def _events_since(self) -> float | None:
        """From when on the events are known, Unix time; None without one."""
        written = None if self.storage is None else self.storage.first_event()
        return self.events.oldest() if written is None else written

    def _find(self, **wanted: Any) -> list[dict[str, Any]]:
        return list(self.events.find(Wanted(**wanted)))

    def fault_history(self, fault: str) -> dict[str, Any]:
        """Each time that a fault lasted as /api/v1/faults/ID returns it."""
        self._record_events()
        return {
            "fault": fault,
            "time": read_clocks().wall,
            "events_since": self._events_since(),
            "occurrences": history(self._find, fault),
        }

    def why(
        self, robot: str, component: str | None, at: float | None, *, ask: bool = True
    ) -> dict[str, Any]:
        """The history of a robot as /api/v1/why returns it; LookupError if there is none."""
        self._record_events()
        fleet, now = self.state.fleet.name, read_clocks()
        known = snapshot.robot_snapshot(self.state, robot, now, self._care())
        found = fault_history.fault_history(
            self._find, known, component, now.wall if at is None else at, now.wall
        )
        answer = explained(self.alertmanager, fleet, robot, component) if ask else []
        return {"fleet": fleet, **found, "now": [*found["now"], *answer]}

    def capabilities(self, robot: str | None) -> dict[str, Any]:
        """What a robot or the fleet can do, as /api/v1/capabilities; LookupError if none."""
        return capability_tree(self.state, robot, read_clocks())

    def missions(self, robot: str | None) -> dict[str, Any]:
        """How the goals of a robot, or of all, ended, as /api/v1/missions; LookupError if none."""
        return missions(self.state, robot, read_clocks())

    def notified(self, body: bytes) -> tuple[int, int]:
        """Record what Alertmanager sent; ValueError if ``body`` is no message of its webhook."""
        message, now = parse(body), read_clocks()
        fleet = self.state.fleet.name
        canaries = self.canary.receive(message, fleet, now)
        self._record_events()
        with self._event_order:
            events, ignored = self._notifications.receive(message, fleet, now.wall)
            self._record(*events)
        return len(events) + canaries, ignored - canaries

    def acknowledge(self, fault: str, person: Person) -> None:
        """Acknowledge a fault that lasts, as Backend says."""
        lasting = self._lasting()
        if fault not in lasting:
            raise LookupError("this fault has ended, or there never was one with this id")
        self._act(acknowledge, lasting[fault], person)

    def plan_downtime(
        self, robot: str, component: str, begin: float, seconds: float, person: Person
    ) -> None:
        """Plan a downtime, as Backend says."""
        known = self.state.components_of(robot)
        if known is None:
            raise LookupError(f"there is no robot {robot!r:.60}")
        if component and component not in known:
            raise LookupError(f"{robot} has no component {component!r:.60}")
        self._act(plan_downtime, (robot, component, begin, seconds), person)

    def cancel_downtime(self, robot: str, component: str, until: float, person: Person) -> None:
        """End a downtime that a person planned, as Backend says."""
        self._act(cancel_downtime, (robot, component, until), person)

    def _act(self, do: Callable[..., Event], about: Any, person: Person) -> None:
        """Do it, record it, and read the silences anew."""
        if self.alertmanager is None:
            raise ConnectionError("the exporter runs without --alertmanager.url")
        try:
            event = do(self.alertmanager, self.state.fleet.name, about, person, read_clocks().wall)
        except UnreachableError as error:
            raise ConnectionError(f"Alertmanager does not answer: {error}") from error
        log.info("%s by %s: %s", event.after, event.author, event.message)
        self._record_events()
        with self._event_order:
            self._record(event)
        for loop in self._others:
            if loop.name == "alertmanager":
                loop.wake()

    def targets(self, job: str, port: int | None) -> list[dict[str, Any]]:
        """Prometheus' http_sd list of a job; LookupError or ValueError as Backend says."""
        return snapshot.targets(self.state, job, port)

    def not_ready_reason(self) -> str | None:
        """Why the robots' messages are not subscribed to; None when they are."""
        return self.listener.not_ready_reason(self.state.fleet.domain_ids)

    def forget(self, robot: str, component: str | None) -> tuple[int, bool]:
        """Remove a robot or a component, as Backend says."""
        return self._forgetting.forget(robot, component, read_clocks())

    def accept_graph(self, robot: str) -> int:
        """Take what the ROS graph shows of a robot as expected; LookupError if that is nothing."""
        return self.state.accept_graph(robot, read_clocks())

    # -- for the metrics ------------------------------------------------------------------------

    def _acknowledged(self) -> list[Acknowledgement]:
        if self.alertmanager is None:
            return []
        return self.alertmanager.known(read_clocks().wall)
