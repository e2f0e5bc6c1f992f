"""Three robots whose fleet.yml changes all the time, compared with an exporter that starts at last.

Conditions, thresholds, capabilities and larger faults come and go, while components fail, robots
are silent or in downtimes, people acknowledge and forget, and the exporter starts again, also
without its database. In the end both have to say the same of what is broken.

And in whatever order a file and an array name things, the same begins and ends at the same time.
"""

from __future__ import annotations

import json
from contextlib import suppress
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.model import Scope, as_texts, fault_of
from ros_diagnostics_exporter.model import Downtime, Endpoint, Instant, Status
from ros_diagnostics_exporter.silences import IDENTITY
from simulation.acknowledged import Alerts
from simulation.fleet_files import CHARGED, COMPONENTS, ROBOTS, random_document
from simulation.fresh_start import at_start, unsaid
from simulation.sources import Step
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver

TO_SETTLE, TO_REST = 1700, 2000  # seconds, of which every second one is played


@dataclass
class Site:
    """The robots, what they say, and the exporter with its fleet.yml."""

    folder: Path
    first: int  # the number of the first fleet.yml
    backwards: bool = False  # robots of a file and components of an array come in the other order
    said: dict[str, dict[str, int]] = field(init=False)
    charges: dict[str, int] = field(init=False)
    mode: str = field(init=False)
    received: set[str] = field(default_factory=lambda: set(ROBOTS))
    alerts: Alerts = field(default_factory=Alerts)
    lasting: set[str] = field(default_factory=set)  # the ids of faults that last
    ended: int = 0  # events that were checked
    history: list[tuple[float, str, str, str]] = field(default_factory=list)  # of all faults
    adopts_from: float = inf  # Unix time, without a database

    def __post_init__(self) -> None:
        self.repair()
        self.path = self.folder / "exporter.db"
        fleet, random = None, Random(self.first)
        while fleet is None:
            self.document = random_document(random, WALL, discovered=False)
            fleet = self._load(self.document)
        self.driver = StateDriver(fleet=fleet)
        self.driver.keep(self.path)

    def _load(self, document: dict[str, Any]) -> Fleet | None:
        path, robots = self.folder / "fleet.yml", document.get("robots", [])
        if self.backwards and robots:
            document = document | {"robots": robots[::-1]}
        path.write_text(json.dumps(document))
        try:
            return load(path)
        except ConfigError:
            return None

    # -- what happens ------------------------------------------------------------------------

    def repair(self) -> None:
        """All is well."""
        self.said = {name: dict.fromkeys(COMPONENTS, OK) for name in ROBOTS}
        self.charges, self.mode = dict.fromkeys(ROBOTS, CHARGED), "auto"

    def say(self, robots: tuple[str, ...], components: tuple[str, ...], level: int) -> None:
        """Components of robots change."""
        for robot in robots:
            self.said[robot] |= dict.fromkeys(components, level)

    def flash(self, robot: str, component: str, seconds: int) -> None:
        """A component is ERROR for a moment before it is STALE."""
        self.say((robot,), (component,), ERROR)
        self.wait(seconds)
        self.say((robot,), (component,), STALE)

    def charge(self, robot: str, number: int) -> None:
        """A battery has another charge."""
        self.charges[robot] = number

    def switch(self, mode: str) -> None:
        """All robots go on in another mode."""
        self.mode = mode

    def receive(self, robot: str, *, is_received: bool) -> None:
        """A robot falls silent, or is back."""
        (self.received.add if is_received else self.received.discard)(robot)

    def reload(self, number: int, *, part: bool, other: bool) -> None:
        """fleet.yml is another, or one of the settings in it; ``other``: robots are discovered."""
        discovered = ("discovery" in self.document) is not other
        new = random_document(Random(number), self.driver.now.wall, discovered=discovered)
        if part:
            profile = dict(self.document["profiles"]["default"])
            of = sorted(new["profiles"]["default"])
            changed = of[number % len(of)]
            profile[changed] = new["profiles"]["default"][changed]
            new = self.document | {"profiles": {"default": profile}}
            if "driving" not in profile["capabilities"]:
                new.pop("capabilities", None)
        if (fleet := self._load(new)) is not None:
            self.document = new
            self.driver.configure(fleet)

    def plan(self, robot: str, component: str, ahead: int, lasts: int) -> None:
        """A person plans a downtime."""
        begin = self.driver.now.wall + ahead
        downtime = Downtime(robot, component, begin, begin + lasts, "ann", "cleaning")
        self.driver.state.plan([downtime], self.driver.now)

    def forget(self, robot: str, component: str) -> None:
        """A person has a component forgotten, if it is known."""
        with suppress(LookupError):
            self.driver.state.forget(robot, component, self.driver.now)

    def acknowledge(self, number: int, lasts: int) -> None:
        """A person acknowledges a fault."""
        self.check()
        self.alerts.acknowledge(number, lasts, self.driver.now.wall)

    def remove(self, number: int) -> None:
        """A person removes an acknowledgement."""
        self.alerts.remove(number, self.driver.now.wall)

    def restart(self, away: int, *, without_database: bool = False, adopts_after: int = 0) -> None:
        """The exporter starts again; without its database it goes on with what fires."""
        self.check()
        former, self.ended = self.driver, 0
        if not without_database:
            self.driver = former.again(self.path, after=away)
            return
        self.driver = self._fresh(former.now.wall + away)
        former.close()
        for each in self.folder.glob(f"{self.path.name}*"):
            each.unlink()
        self.driver.keep(self.path)
        self.lasting, self.adopts_from = set(), self.driver.now.wall + adopts_after

    def _fresh(self, wall: float) -> StateDriver:
        driver = StateDriver(fleet=self.driver.state.fleet)
        driver.now = Instant(0.0, wall)
        return driver

    # -- time --------------------------------------------------------------------------------

    def wait(self, seconds: int, step: int = 1) -> None:
        """Let time pass, in which all goes on as it is."""
        for _ in range(0, seconds, step):
            graph = {f"/{name}/diagnostics": Endpoint(1) for name in self.received}
            self.driver.state.update_graph(0, graph, self.driver.now)
            self._publish(self.driver)
            self.driver.now = Instant(*(each + step for each in self.driver.now))
            self.driver.state.tick(self.driver.now)
            self._adopt()
            self._check_events()

    def _publish(self, driver: StateDriver) -> None:
        for name in sorted(self.received):
            charge, mode = ("Charge", f"{self.charges[name]} %"), ("mode", self.mode)
            texts = {"Battery": (charge,), "Mode": (mode,)}
            statuses = [
                Status(level, component, "it says so", "", texts.get(component, ()))
                for component, level in self.said[name].items()
            ]
            driver.receive(f"/{name}/diagnostics", *statuses[:: -1 if self.backwards else 1])

    def _adopt(self) -> None:
        state, now = self.driver.state, self.driver.now
        if now.wall < self.adopts_from:
            return
        state.adopt(self.alerts.faults(self.driver), now)
        is_settled = state.settled(now)
        self.alerts.keep(state.faults(), self.driver, is_settled=is_settled)
        if is_settled:
            self.adopts_from = inf

    # -- what holds --------------------------------------------------------------------------

    def check(self) -> None:
        """What is served is what was served before, and escalates as people want it."""
        self._check_events()
        fleet, faults = self.driver.state.fleet, self.driver.state.faults()
        found = {fault_of(fleet, as_texts(each.identity, each.labels)) for each in faults}
        assert found == self.lasting, f"of {self.lasting} there are {found}"
        if self.adopts_from == inf:
            self.alerts.scrape(self.driver)
            assert self.alerts.firing.keys() <= found, f"of {self.alerts.firing} there are {found}"

    def _check_events(self) -> None:
        events = self.driver.events
        for event in events[self.ended :]:
            if event.kind not in ("fault_began", "fault_ended"):
                continue
            texts = {name: getattr(event, name) for name in IDENTITY[1:]}
            fault = fault_of(self.driver.state.fleet, texts)
            self.history.append((event.time, event.kind, event.reason, fault))
            if event.kind == "fault_began":
                assert fault not in self.lasting, f"began twice: {event}"
                self.lasting.add(fault)
                continue
            assert fault in self.lasting, f"ended before it began: {event}"
            self.lasting.discard(fault)
            self.alerts.end(fault)
            assert event.reason != "recovered" or not self._is_error(event), event
        self.ended = len(events)

    def _is_error(self, event: Event) -> bool:
        """Whether a component says so, and fleet.yml makes nothing else of it."""
        if (event.scope, event.state) != ("component", "critical"):
            return False
        rules = self.document["profiles"]["default"]["components"]
        keys = {key for each in rules if each["match"] == event.component for key in each}
        is_error = self.said[event.robot][event.component] == ERROR
        return is_error and not keys & {"levels", "when", "unless"}

    def finish(self) -> None:
        """All is received, and judged as by an exporter that starts; then all is repaired."""
        self.received = set(ROBOTS)
        self.driver.state.plan([], self.driver.now)
        self.document.pop("maintenance", None)
        fleet = self._load(self.document)
        assert fleet is not None
        self.driver.configure(fleet)
        self.wait(TO_SETTLE, 2)
        self.check()
        lasting = {each.identity for each in self.driver.state.faults()}
        missing = unsaid(lasting, at_start(self._fresh(self.driver.now.wall), self._publish))
        assert not missing, f"{missing} are no faults beside {lasting}"
        of_components = [each for each in lasting if each.scope is Scope.COMPONENT]
        wrong = [each for each in of_components if self.said[each.robot][each.component] == OK]
        assert not wrong, wrong
        self.repair()
        self.wait(TO_REST, 2)
        self.check()
        left = {each.identity for each in self.driver.state.faults()}
        assert all(each.scope is Scope.CHECK for each in left), left


def random_steps(seed: int) -> list[Step]:
    """A history of up to 30 steps."""
    random = Random(seed)
    return [_random_step(random) for _ in range(random.randrange(5, 30))]


def _random_step(random: Random) -> Step:
    robot, component = random.choice(ROBOTS), random.choice(COMPONENTS[:6])
    level, number = random.choice((OK, WARN, ERROR, ERROR, STALE)), random.randrange(1_000_000)
    away, later = random.choice((0, 1, 5, 30)), random.choice((1, 6, 50))
    part, other = random.random() < 0.5, random.random() < 0.2
    lost = {"away": away, "without_database": True, "adopts_after": later}
    planned = {"ahead": random.choice((0, 5)), "lasts": random.choice((20, 60))}
    what, how = random.choice(
        (
            *(("say", {"robots": (robot,), "components": (component,), "level": level}),) * 4,
            ("say", {"robots": (robot,), "components": COMPONENTS[:5], "level": level}),
            ("say", {"robots": ROBOTS, "components": (component,), "level": level}),
            ("flash", {"robot": robot, "component": component, "seconds": random.choice((2, 5))}),
            ("charge", {"robot": robot, "number": random.choice((50, 25, 18, 12, 5))}),
            ("switch", {"mode": random.choice(("auto", "manual"))}),
            ("receive", {"robot": robot, "is_received": False}),
            ("receive", {"robot": robot, "is_received": True}),
            *(("reload", {"number": number, "part": part, "other": other}),) * 2,
            ("restart", {"away": away}),
            ("restart", lost),
            ("plan", {"robot": robot, "component": random.choice(("", "", component)), **planned}),
            ("forget", {"robot": robot, "component": component}),
            *(("acknowledge", {"number": number, "lasts": random.choice((20, 90, 100_000))}),) * 2,
            ("remove", {"number": number}),
        )
    )
    return what, how, random.choice((0, 0, 1, 2, 5, 9, 10, 11, 15, 40, 90))


def play(seed: int, steps: list[Step] | None = None) -> None:
    """Play the history of a seed, or these steps with its first fleet.yml, in both orders.

    Raises:
        AssertionError: Something is judged wrongly, or differs from what a start makes of it.
    """
    steps = random_steps(seed) if steps is None else steps
    found = [_history(seed, steps, backwards=backwards) for backwards in (False, True)]
    other = set(found[0]) ^ set(found[1])
    assert not other, f"not in both orders: {sorted(other)}"


def _history(seed: int, steps: list[Step], *, backwards: bool) -> list[tuple[float, str, str, str]]:
    with TemporaryDirectory() as folder:
        site = Site(Path(folder), seed, backwards)
        try:
            site.wait(45)
            for what, how, seconds in steps:
                getattr(site, what)(**how)
                site.wait(seconds)
                site.check()
            history = [*site.history]
            if not backwards:
                site.finish()
        finally:
            site.driver.close()
    return history
