"""A fleet that several exporters share, with what is behind them: none of its faults may be lost.

Real states, databases and counts of the exporters; a small model of Prometheus, which holds faults
and says what the exporters count, and of Alertmanager, of which they learn which faults fire.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import islice
from math import inf
from pathlib import Path
from random import Random
from typing import Any
from urllib.parse import parse_qs, urlsplit

from ros_diagnostics_exporter.config.fleet import Fleet, Source
from ros_diagnostics_exporter.config.fleet import Robot as Declared
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.events import EventLog
from ros_diagnostics_exporter.faults.model import Fault, Identity, Scope, State
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from ros_diagnostics_exporter.other_exporters import OtherExporters
from ros_diagnostics_exporter.storage.storage import Storage

WALL = 1_700_000_000.0
PERIOD = 4  # seconds between two arrays of a robot
SCRAPE = 2  # ... of scrapes and evaluations
LOOK = 60  # seconds between two looks of an exporter at which alerts fire
COMPONENTS = 1000  # of which a robot has one, so that few robots have the same
OK, ERROR = 0, 2
_ASKED = re.compile(r'shards="(\d+)", exporter!="([^"]*)"')
Mail = tuple[str, Identity, float]  # PROBLEM or RECOVERY, of what, at which second


def fleet_file(folder: Path, sites: int) -> Path:
    """A fleet.yml that finds robots of so many sites."""
    topic = '  - {topic: "/{robot}/diagnostics"'
    found = "\n".join(
        f'{topic}, include: ["s{site}_*"], labels: {{site: s{site}}}}}' for site in range(sites)
    )
    path = folder / "fleet.yml"
    path.write_text(
        "fleet: f\n"
        "limits: {robots: 20000, new_robots: 20000, series: 10000000}\n"
        f"profiles: {{default: {{stale_after: {3 * PERIOD}s}}}}\n"
        f"discovery:\n{found}\n"
    )
    return path


@dataclass
class Robot:
    """One robot: what may break of it, whether it is broken, and whether the robot publishes."""

    name: str
    component: str
    broken: bool = False
    speaks: bool = True

    @property
    def site(self) -> str:
        """Its site."""
        return self.name.partition("_")[0]

    def statuses(self) -> tuple[Status, ...]:
        """What it publishes."""
        level = ERROR if self.broken else OK
        return Status(OK, "Battery", "charged"), Status(level, self.component, "text")


class Process:
    """An exporter that runs, with its database."""

    def __init__(self, world: SharedFleet, shard: Shard, database: Path) -> None:
        self.shard = shard
        self._world = world
        now = world.now
        self.state = FleetState(world.fleet.part(shard), now)
        self.storage = Storage(database)
        self._log = EventLog(self.storage.load(self.state, now), self.storage.find_events)
        client: Any = world
        self.others = OtherExporters(self.state, shard, client, lambda: world.now)
        self._adopt_at = 0.0

    @property
    def name(self) -> str:
        """The exporter's name."""
        return self.state.fleet.exporter

    def second(self) -> None:
        """Let a second pass."""
        world, now, state = self._world, self._world.now, self.state
        if now.mono % SCRAPE == 0:
            state.update_graph(0, world.endpoints(), now)
        wanted = state.wanted_topics(0)
        for robot in world.speaking():
            if (topic := f"/{robot.name}/diagnostics") in wanted:
                state.receive(Topic(0, topic), Array(0.0, robot.statuses(), 100), now)
        for part in (0.0, 0.5):
            state.tick(Instant(now.mono + part, now.wall + part))
        if now.mono % SCRAPE == 0:
            self.others.turn()
        if now.mono >= self._adopt_at:
            self._adopt_at = now.mono + (LOOK if state.settled(now) else 5)
            state.adopt(world.held.values(), now)
        self.save()

    def save(self, *, at_once: bool = False) -> None:
        """Write what changed to the database; of events nothing is asked."""
        self.storage.save(self.state, self._log, self._world.now, at_once=at_once)


@dataclass
class SharedFleet:
    """The robots, the exporters that run, and what was sent; time passes by the second."""

    folder: Path
    sites: int
    robots: dict[str, Robot]
    declared: bool = False
    running: dict[int, Process] = field(default_factory=dict)  # by the number of the shard
    held: dict[Identity, Fault] = field(default_factory=dict)
    sent: list[Mail] = field(default_factory=list)
    now: Instant = field(default=Instant(0.0, WALL))

    def __post_init__(self) -> None:
        self.fleet: Fleet = load(fleet_file(self.folder, self.sites))
        if self.declared:
            robots = tuple(map(self._declared, self.robots.values()))
            self.fleet = replace(self.fleet, robots=robots, discoveries=())

    @classmethod
    def of(cls, folder: Path, sites: int, robots: int, *, declared: bool = False) -> SharedFleet:
        """A fleet of so many robots, spread over the sites, which fleet.yml names or finds."""
        found = (
            Robot(f"s{number % sites}_r{number}", f"Motor {number % COMPONENTS}")
            for number in range(robots)
        )
        return cls(folder, sites, {each.name: each for each in found}, declared)

    def _declared(self, robot: Robot) -> Declared:
        entry = Declared(
            robot.name,
            namespace=f"/{robot.name}",
            labels={"site": robot.site},
            profile=self.fleet.profiles["default"],
        )
        return entry.reading(Source.RAW)

    # -- people ------------------------------------------------------------------------------

    def start(self, number: int, count: int) -> None:
        """Start an exporter, or start it again with another shard, from its database."""
        self.stop(number)
        database = self.folder / f"{number}.db"
        self.running[number] = Process(self, Shard(number, count), database)

    def stop(self, number: int, *, kill: bool = False) -> None:
        """End an exporter, or ``kill`` it before it has written what is new."""
        process = self.running.pop(number, None)
        if process is not None:
            if not kill:
                process.save(at_once=True)
            process.storage.close()

    # -- time --------------------------------------------------------------------------------

    def pass_to(self, second: float) -> None:
        """Let time pass."""
        while self.now.mono < second:
            for process in self.running.values():
                process.second()
            mono = self.now.mono + 1
            self.now = Instant(mono, WALL + mono)
            if mono % SCRAPE == 0:
                self._evaluate()

    def speaking(self) -> Iterator[Robot]:
        """The robots that publish in this second."""
        turn = int(self.now.mono) % PERIOD
        robots = list(self.robots.values())
        return (each for each in robots[turn::PERIOD] if each.speaks)

    def endpoints(self) -> dict[str, Endpoint]:
        """What the ROS graph shows."""
        return {
            f"/{each.name}/diagnostics": Endpoint(1) for each in self.robots.values() if each.speaks
        }

    # -- Prometheus --------------------------------------------------------------------------

    def _evaluate(self) -> None:
        """Hold what is served until its end is served, as faults.yml does, and send mails."""
        served: dict[Identity, Fault] = {}
        ends: dict[Identity, float] = {}
        speakers = self._speakers()
        for process in self.running.values():
            faults, ended = process.state.served()
            process.state.note_served(self.now)
            for fault in faults:
                robot = fault.identity.robot
                if fault.identity.scope is not Scope.EXPORTER and (
                    not robot or speakers.get(robot) is process
                ):
                    served.setdefault(fault.identity, fault)
            for end in ended:
                if end.fault is not None:
                    ends[end.fault.identity] = max(end.at, ends.get(end.fault.identity, -inf))
        for identity, fault in list(self.held.items()):
            if identity not in served and fault.since <= ends.get(identity, -inf):
                del self.held[identity]
                self.sent.append(("RECOVERY", identity, self.now.mono))
        for identity in served.keys() - self.held.keys():
            self.held[identity] = served[identity]
            self.sent.append(("PROBLEM", identity, self.now.mono))

    def _speakers(self) -> dict[str, Process]:
        """Whose word counts of each robot: one that receives it, and of these most robots."""
        found: dict[str, tuple[tuple[bool, int], Process]] = {}
        for process in self.running.values():
            robots = process.state.robots
            received = sum(each.up for each in robots.values())
            for name, robot in robots.items():
                weight = robot.up, received
                if name not in found or weight > found[name][0]:
                    found[name] = weight, process
        return {name: process for name, (_weight, process) in found.items()}

    def get(self, path: str, **_limit: Any) -> Mapping[str, Any]:
        """The answer to what an exporter asks about the others."""
        [expr] = parse_qs(urlsplit(path).query)["query"]
        asked = _ASKED.search(expr)
        assert asked is not None, expr
        count, own = asked.groups()
        rows: list[Any] = [
            {"metric": labels | {"exporter": process.name}, "value": [0, str(number)]}
            for process in self.running.values()
            if process.name != own
            for labels, number in _samples(process.others, self.now)
            if labels["shards"] == count
        ]
        return {"data": {"resultType": "vector", "result": rows}}

    # -- what is to be -----------------------------------------------------------------------

    def expected(self, silent_sites: Iterable[str] = ()) -> set[Identity]:
        """The faults that there are to be, once all is confirmed."""
        sites = set(silent_sites)
        found = {Identity(Scope.SITE, State.SILENT, site=each) for each in sites}
        for robot in self.robots.values():
            if robot.broken:
                of = {"robot": robot.name, "component": robot.component}
                found.add(Identity(Scope.COMPONENT, State.CRITICAL, **of))
            if not robot.speaks and robot.site not in sites:
                found.add(Identity(Scope.ROBOT, State.SILENT, robot=robot.name))
        return found

    def check(self, expected: set[Identity]) -> None:
        """See that just these faults last, and that none was sent twice so far.

        Raises:
            AssertionError: It is not so.
        """
        missing, wrong = expected - self.held.keys(), self.held.keys() - expected
        assert not missing, f"at {self.now.mono:.0f} s {len(missing)} are lost: {min(missing)}"
        assert not wrong, f"at {self.now.mono:.0f} s {len(wrong)} too many: {min(wrong)}"
        twice = [each for each, number in self.begun().items() if number > 1]
        assert not twice, f"at {self.now.mono:.0f} s {len(twice)} were sent twice: {min(twice)}"

    def begun(self) -> Counter[Identity]:
        """How often each fault was sent."""
        return Counter(identity for what, identity, _at in self.sent if what == "PROBLEM")


def play(folder: Path, robots: int, seed: int) -> SharedFleet:
    """A history in which an exporter is added to two, and one dies and comes back.

    One robot in a hundred breaks before, and as many while an exporter is dead. A site is silent
    all the time. Returns the fleet after all was repaired.

    Raises:
        AssertionError: A fault is lost, comes twice, or is none.
    """
    random, sites = Random(seed), 20
    fleet = SharedFleet.of(folder, sites, robots, declared=True)
    some = iter(
        random.sample([each for each in fleet.robots.values() if each.site != "s5"], robots // 50)
    )

    def break_some() -> None:
        for robot in islice(some, robots // 100):
            robot.broken = True

    def start(number: int, count: int, *, until: float) -> None:
        fleet.start(number, count)
        fleet.pass_to(until)

    start(1, 2, until=0)
    start(2, 2, until=45)  # settled
    break_some()
    for robot in fleet.robots.values():
        robot.speaks = robot.site != "s5"
    fleet.pass_to(80)
    fleet.check(fleet.expected({"s5"}))
    start(3, 3, until=125)
    start(1, 3, until=140)
    start(2, 3, until=200)
    fleet.check(fleet.expected({"s5"}))
    fleet.stop(3, kill=True)
    break_some()  # some of these are of the one that is dead
    fleet.pass_to(225)
    start(3, 3, until=275)
    expected = fleet.expected({"s5"})
    fleet.check(expected)
    for robot in fleet.robots.values():
        robot.broken, robot.speaks = False, True
    fleet.pass_to(340)
    fleet.check(set())
    assert fleet.begun().keys() == expected
    for number in list(fleet.running):
        fleet.stop(number)
    return fleet


def _samples(others: OtherExporters, now: Instant) -> Iterator[tuple[dict[str, str], float]]:
    names = ("shards", "scope", "site", "component", "state")
    for labels, number in others.samples(now):
        yield {n: text for n, text in zip(names, labels, strict=True) if text}, number
