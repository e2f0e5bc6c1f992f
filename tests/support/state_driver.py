"""A state whose time the test sets: arrays in, levels and texts out."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

from prometheus_client.parser import text_string_to_metric_families

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.events import Event, EventLog
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from ros_diagnostics_exporter.storage.storage import Storage

OK, WARN, ERROR, STALE = range(4)
WALL = 1_700_000_000.0
SETTLED = 40.0  # seconds after which restart_grace is over
MOTOR, HOT = Status(OK, "Motor 1", "OK", "mc-01"), Status(ERROR, "Motor 1", "Hot", "mc-01")
LASER = Status(OK, "Laser 1", "OK")
OPENED: set[Storage] = set()  # with a database that may be open; conftest.py closes them


def tree(**groups: Iterable[Status]) -> tuple[Status, ...]:
    """An aggregator's array: for each group its header, then its components."""
    rows: list[Status] = []
    for group, statuses in groups.items():
        keys = tuple((status.name, status.message) for status in statuses)
        rows.append(Status(OK, f"/{group}", "OK", "", keys))
        rows.extend(
            status._replace(name=f"/{group}/{status.name.replace('/', ' ')}") for status in statuses
        )
    return tuple(rows)


def raw_robot(name: str, **settings: Any) -> Robot:
    """A robot of this name with its raw topic."""
    return Robot(name, topic_raw=f"/{name}/diagnostics", source=Source.RAW, **settings)


def raw_fleet(*names: str, **settings: Any) -> Fleet:
    """A fleet of robots of these names and settings, each with its raw topic."""
    return Fleet("f", tuple(raw_robot(name, **settings) for name in names))


class StateDriver:
    """One robot "r" in the fleet "f"; time passes only as the test says, in seconds from 0.

    What lets time pass, or sends something, gives the driver again: to look at what came of it.
    """

    def __init__(self, source: Source = Source.RAW, *, fleet: Fleet | None = None, **profile):
        if fleet is None:
            robot = Robot(
                "r",
                topic_agg="/r/diagnostics_agg",
                topic_raw="/r/diagnostics",
                source=source,
                profile=Profile(**profile),
            )
            fleet = Fleet("f", (robot,))
        self.now = Instant(0.0, WALL)
        self.state = FleetState(fleet, self.now)
        self._events: list[Event] = []
        self.log = EventLog()
        self.storage: Storage | None = None
        self._rows: dict[tuple[str, tuple[str, ...]], Row] = {}
        self.exposition = Exposition(self.state)

    @property
    def events(self) -> list[Event]:
        """All events since the start."""
        new = self.state.take_events()
        for event in new:
            self.log.record(event)
        self._events += new
        return self._events

    def fault_rows(self) -> list[Row]:
        """All rows of the faults."""
        for row in self.state.take_fault_rows(self.now):
            self._rows[row.kind, row.key] = row
        return [row for row in self._rows.values() if row.fields is not None]

    def restore_faults(self, rows: list[Row]) -> None:
        """Go on from the rows of another one."""
        self._rows = {(row.kind, row.key): row for row in rows}
        self.state.restore_faults(rows, self.now)

    def keep(self, path: Path) -> Storage:
        """Write what changed to the database at ``path``, for the first or the last time."""
        self.storage = self.storage or Storage(path)
        self.save(at_once=True)
        return self.storage

    def save(self, *, at_once: bool = False) -> None:
        """Write what changed, as the exporter does."""
        assert self.storage is not None
        OPENED.add(self.storage)
        assert self.events is not None  # they are in the log now
        self.storage.save(self.state, self.log, self.now, at_once=at_once)

    def close(self) -> None:
        """Let another one have the database."""
        if self.storage is not None:
            self.storage.close()

    def restart(self, path: Path, *, after: float = 5.0, fleet: Fleet | None = None) -> StateDriver:
        """What a new process has that starts ``after`` seconds later, with the database at path."""
        self.close()
        driver = StateDriver(fleet=fleet or self.state.fleet)
        # The monotonic clock of the new process is another one.
        driver.now = Instant(0.0, self.now.wall + after)
        driver.storage = Storage(path)
        OPENED.add(driver.storage)
        last = driver.storage.load(driver.state, driver.now)
        driver.log = EventLog(last, driver.storage.find_events)
        return driver

    def again(self, path: Path, **how: Any) -> StateDriver:
        """Write what changed to the database at path, and start again from it as `restart` does."""
        self.keep(path)
        return self.restart(path, **how)

    @property
    def robot(self):
        return self.state.robots["r"]

    def at(self, seconds: float) -> StateDriver:
        """Let time pass up to ``seconds``, ticking as often as the exporter does."""
        while self.now.mono < seconds:
            step = min(seconds, self.now.mono + 0.25)
            self.now = Instant(step, WALL + step)
            self.state.tick(self.now)
            if step % 60 == 0:
                self.state.find_unmatched(self.now)
        return self

    def wait(self, seconds: float) -> StateDriver:
        """Let so many seconds pass."""
        return self.at(self.now.mono + seconds)

    def seconds(self, number: float) -> Iterator[None]:
        """So many turns, after each of which a second passes."""
        end = self.now.mono + number
        while self.now.mono < end:
            yield
            self.wait(1)

    def configure(self, fleet: Fleet | None = None, **changed: Any) -> StateDriver:
        """Follow another config, or this one with some of its settings changed."""
        self.state.configure(fleet or replace(self.state.fleet, **changed), self.now)
        return self

    def follow_profile(self, profile: Profile) -> StateDriver:
        """Follow a config in which all robots have this profile."""
        robots = (replace(each, profile=profile) for each in self.state.fleet.robots)
        return self.configure(robots=tuple(robots))

    def receive(
        self, topic: str, *statuses: Status, stamp: float = 0.0, publisher: str = ""
    ) -> StateDriver:
        array = Array(stamp, statuses, 100, publisher=publisher)
        self.state.receive(Topic(0, topic), array, self.now)
        return self

    def raw(self, *statuses: Status, stamp: float = 0.0, publisher: str = "") -> StateDriver:
        return self.receive("/r/diagnostics", *statuses, stamp=stamp, publisher=publisher)

    def graph(self, *writers: str) -> StateDriver:
        """Have the graph show who publishes the raw topic."""
        endpoint = Endpoint(len(writers), writers=frozenset(writers))
        self.state.update_graph(0, {"/r/diagnostics": endpoint}, self.now)
        return self

    def agg(self, *statuses: Status) -> StateDriver:
        return self.receive("/r/diagnostics_agg", *statuses)

    def raw_every(self, period: float, until: float, *statuses: Status) -> StateDriver:
        """Send the same statuses now and every ``period`` seconds, up to ``until`` exclusive."""
        while self.now.mono < until:
            self.raw(*statuses)
            self.at(min(until, self.now.mono + period))
        return self

    def agg_every(self, period: float, until: float, *statuses: Status) -> StateDriver:
        """As `raw_every`, from the aggregator; see `tree`."""
        while self.now.mono < until:
            self.agg(*statuses)
            self.at(min(until, self.now.mono + period))
        return self

    def stand(self, seconds: float, *statuses: Status) -> StateDriver:
        """Send the same statuses once a second for some seconds."""
        return self.raw_every(1, self.now.mono + seconds, *statuses)

    def fault_names(self) -> set[tuple[str, ...]]:
        """Scope, state and what it is about of each fault."""
        found = (each.identity for each in self.state.faults())
        return {(each.scope.value, each.state.value, *filter(None, each[2:])) for each in found}

    def faults(self) -> list[tuple[str, str]]:
        """Component and state of each fault, in their order."""
        found = (each.identity for each in self.state.faults())
        return sorted((each.component, each.state.value) for each in found)

    def component(self, name: str):
        (found,) = (each for each in self.robot.components if each.name == name)
        return found

    def level(self, name: str) -> int:
        return self.component(name).level

    def problem_since(self, name: str) -> float | None:
        return self.sample("component_problem_since_timestamp_seconds", component=name)

    def samples(self) -> dict[str, dict[tuple[tuple[str, str], ...], float]]:
        """What a scrape shows: family's sample name -> sorted labels -> value."""
        found: dict[str, dict[tuple[tuple[str, str], ...], float]] = {}
        text = self.exposition.render().decode()
        for family in text_string_to_metric_families(text):
            for sample in family.samples:
                labels = tuple(sorted(sample.labels.items()))
                series = found.setdefault(sample.name.removeprefix("ros_diagnostics_"), {})
                assert labels not in series, f"{sample.name}{labels} twice"
                series[labels] = sample.value
        return found

    def sample(self, name: str, **labels: str) -> float | None:
        """The one sample of ``name`` with these labels among its own; None if there is none."""
        found = [
            value
            for have, value in self.samples().get(name, {}).items()
            if labels.items() <= dict(have).items()
        ]
        assert len(found) <= 1
        return found[0] if found else None
