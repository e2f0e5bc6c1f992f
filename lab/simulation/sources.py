"""A robot with drivers, topics, a latched one, goals, nodes and a query, in random histories.

All of it is taken as the exporter takes it, but for the middleware: what is not asked for is not
sent, and what is kept for late joiners is sent again when it is. What is broken is noted here.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from random import Random
from struct import pack
from tempfile import TemporaryDirectory
from typing import Any

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.decode.goals import ABORTED, EXECUTING, SUCCEEDED, Goal
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Downtime, Endpoint, Instant, Status
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from support.goal_lists import encode_goals
from support.state_driver import ERROR, OK, StateDriver

FLEET = """\
fleet: f
robots: [{name: r, namespace: /r, source: SOURCE}]
queries:
  - {expr: up, component: disk, robot: robot, thresholds: {high: {critical: 5}},
     confirm_after: 10s, stale_after: 60s}
profiles:
  default:
    flap_interval: INTERVAL
    graph: {mode: "on", learn_after: 1m, expect: [amcl, diag]}
    actions: [{match: dock, aborted: {critical: 1, within: 2m}}]
    topics:
      - {topic: battery, component: Battery, fields: {data: Charge}}
      - {topic: e_stop, component: E-stop, field: data, error_when: true}
    components: [{match: E-stop, reports: on_change}]
    values: [{component: Battery, key: Charge, thresholds: {low: {critical: 0.15}}}]
"""
SOURCES = ("raw", "none", "auto")
DRIVERS = ("Motor", "Laser")
PARTS = (*DRIVERS, "E-stop", "Battery", "node amcl", "disk")  # each may be broken
DOCK, BATTERY, E_STOP = f"/r/dock{STATUS}", "/r/battery", "/r/e_stop"
TYPES = {BATTERY: ["std_msgs/msg/Float32"], E_STOP: ["std_msgs/msg/Bool"], DOCK: [GOALS_TYPE]}
WITHIN = 120  # seconds in which one aborted goal is a fault
ASKED = 15  # seconds between two answers of the query
TO_FAIL, TO_REST = 200, 1200  # seconds after which what is broken is a fault, and what is well none


@dataclass
class Site:
    """The robot, what is broken of it, and the exporter."""

    folder: Path
    source: str
    interval: int = 20
    broken: dict[str, bool] = field(default_factory=lambda: dict.fromkeys(PARTS, False))
    is_on: bool = True
    shows_nodes: bool = True
    answers: bool = True  # Prometheus does
    time: int = 0  # seconds played
    goals: list[Goal] = field(default_factory=list)
    number: int = 0  # of goals
    aborted_at: float | None = None  # the last goal, if it was
    asked: set[str] = field(default_factory=set)  # the topics that are subscribed
    # What was received of each part last, in this second and before it: whether it is broken.
    said: dict[str, bool] = field(default_factory=dict)
    said_before: dict[str, bool] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.driver = StateDriver(fleet=self.fleet())
        self.driver.keep(self.path)

    @property
    def path(self) -> Path:
        """The exporter's database."""
        return self.folder / "exporter.db"

    def fleet(self) -> Fleet:
        """The config as it is now."""
        path = self.folder / "fleet.yml"
        text = FLEET.replace("SOURCE", self.source).replace("INTERVAL", f"{self.interval}s")
        path.write_text(text)
        return load(path)

    # -- what happens ------------------------------------------------------------------------

    def breaks(self, part: str) -> None:
        """A part fails, or is repaired."""
        self.broken[part] = not self.broken[part]

    def goal(self, *, succeeds: bool) -> None:
        """The robot is sent to its dock."""
        if not self.is_on:
            return
        self.number += 1
        goal = Goal(self.number.to_bytes(16, "big"), float(self.number), EXECUTING)
        self.goals = [goal]
        self._send_goals()
        self.wait(3)
        self.goals = [goal._replace(status=SUCCEEDED if succeeds else ABORTED)]
        self._send_goals()
        if succeeds or DOCK in self.asked:
            self.aborted_at = None if succeeds else self.time

    def switch(self) -> None:
        """The robot is switched off, or on."""
        self.is_on, self.goals = not self.is_on, []
        self.asked &= self._offered().keys()

    def hide_nodes(self) -> None:
        """The ROS graph shows no node any more, or all again."""
        self.shows_nodes = not self.shows_nodes

    def stop_answers(self) -> None:
        """Prometheus answers no more, or again."""
        self.answers = not self.answers

    def reload(self) -> None:
        """fleet.yml is another."""
        self.interval = 50 - self.interval
        self.driver.configure(self.fleet())

    def plan(self) -> None:
        """A person plans a minute of downtime."""
        wall = self.driver.now.wall
        downtime = Downtime("r", "", wall, wall + 60, "ann", "cleaning")
        self.driver.state.plan([downtime], self.driver.now)

    def set_clock(self, by: float, seconds: float = 0.0) -> None:
        """The wall clock is set, or (both) so many seconds pass."""
        mono, wall = self.driver.now
        self.driver.now = Instant(mono + seconds, wall + by)

    def restart(self, away: int, *, without_database: bool) -> None:
        """The exporter starts again; without its database it goes on with the faults that fire."""
        firing, former = self.driver.state.faults(), self.driver
        if not without_database:
            self.driver = former.again(self.path, after=away)
        else:
            former.close()
            for each in self.folder.glob(f"{self.path.name}*"):
                each.unlink()
            self.driver = StateDriver(fleet=self.fleet())
            self.driver.now = Instant(0.0, former.now.wall + away)
            self.driver.keep(self.path)
            self.driver.state.adopt(firing, self.driver.now)
        self.asked = set()

    # -- time --------------------------------------------------------------------------------

    def wait(self, seconds: int) -> None:
        """Let time pass, in which all goes on as it is."""
        for _ in range(seconds):
            self.said_before = dict(self.said)
            self._look()
            self._publish()
            for _tick in range(4):
                self.set_clock(0.25, 0.25)
                self.driver.state.tick(self.driver.now)
            self.time += 1
            self._check_ends()

    def _offered(self) -> dict[str, list[str]]:
        return TYPES if self.is_on else {}

    def _look(self) -> None:
        """What the exporter asks for, by the ROS graph; late joiners get what is kept for them."""
        state, now, seen = self.driver.state, self.driver.now, self.is_on and self.shows_nodes
        nodes = [] if self.broken["node amcl"] else [("amcl", "/r")]
        state.update_nodes(0, [("diag", "/r"), *nodes] if seen else [], now)
        if seen:
            self.said["node amcl"] = self.broken["node amcl"]
        asked = set(state.watched_topics(0, self._offered(), now))
        publishers = int(self.is_on and self.source != "none")
        state.update_graph(0, {"/r/diagnostics": Endpoint(publishers)}, now)
        new, self.asked = asked - self.asked, asked
        if E_STOP in new:
            self._send_e_stop()
        if DOCK in new:
            self._send_goals()

    def _publish(self) -> None:
        state, now, broken = self.driver.state, self.driver.now, self.broken
        if self.is_on and self.source != "none":
            found = ((name, ERROR if broken[name] else OK) for name in DRIVERS)
            self.driver.raw(*(Status(level, name, "it says so") for name, level in found))
            self.said |= {name: broken[name] for name in DRIVERS}
        self._send("Battery", BATTERY, pack("<f", 0.1 if broken["Battery"] else 0.8))
        if self.said.get("E-stop") != broken["E-stop"]:
            self._send_e_stop()
        if self.answers and self.time % ASKED == 0:
            disk = Status(ERROR if broken["disk"] else OK, "disk", "10" if broken["disk"] else "1")
            state.receive_answer(state.fleet.queries[0].feed, {"r": [disk]}, now)
            self.said["disk"] = broken["disk"]

    def _send_e_stop(self) -> None:
        self._send("E-stop", E_STOP, bytes([self.broken["E-stop"]]))

    def _send(self, part: str, topic: str, content: bytes) -> None:
        if self.is_on and topic in self.asked:
            self.said[part] = self.broken[part]
            data, now = b"\0\1\0\0" + content, self.driver.now
            self.driver.state.receive_fields(0, topic, TYPES[topic][0], data, now)

    def _send_goals(self) -> None:
        if self.is_on and DOCK in self.asked:
            self.driver.state.receive_goals(0, DOCK, encode_goals(self.goals), self.driver.now)

    # -- what holds --------------------------------------------------------------------------

    def _check_ends(self) -> None:
        """Nothing recovers that is broken by what was received last, before this second, too."""
        events = self.driver.state.take_events()
        for event in events:
            self.driver.log.record(event)
            if event.kind == "fault_ended" and event.reason == "recovered":
                assert not self._is_broken(event), f"at {self.time} s: {event}"

    def _is_broken(self, event: Event) -> bool:
        if event.state in ("flapping", "intermittent", "stale"):
            return False
        if event.component == "dock":
            return self.aborted_at is not None and self.time - self.aborted_at < WITHIN - 2
        found = (said.get(event.component, False) for said in (self.said_before, self.said))
        return all(found)

    def finish(self, *, broken: bool) -> None:
        """All is repaired, and no fault is left; or all fails, and each part is a fault."""
        self.is_on = self.shows_nodes = self.answers = True
        self.driver.state.plan([], self.driver.now)
        self.broken = dict.fromkeys(PARTS, broken)
        self.wait(90)
        self.goal(succeeds=not broken)
        self.wait(TO_FAIL - 100 if broken else TO_REST)
        lasting = {each.identity for each in self.driver.state.faults()}
        if not broken:
            assert not lasting, f"after all was repaired: {lasting}"
            return
        wanted = {*PARTS, "dock"} - ({*DRIVERS} if self.source == "none" else set())
        missing = wanted - {each.component for each in lasting}
        is_one = any(each.state == "many" for each in lasting)
        assert is_one or not missing, f"{missing} fail, and are no fault beside {lasting}"


Step = tuple[str, dict[str, Any], int]  # what happens, how, and how many seconds it then goes on


def random_steps(seed: int, number: int = 12) -> list[Step]:
    """A history of so many steps."""
    random, steps = Random(seed), list[Step]()
    for _ in range(number):
        away = random.choice((2, 40))
        what, how = random.choice(
            (
                *(("breaks", {"part": random.choice(PARTS)}),) * 3,
                ("goal", {"succeeds": random.random() < 0.4}),
                ("switch", {}),
                ("restart", {"away": away, "without_database": False}),
                ("restart", {"away": away, "without_database": True}),
                ("reload", {}),
                ("hide_nodes", {}),
                ("stop_answers", {}),
                ("plan", {}),
                ("set_clock", {"by": random.choice((-3600.0, -5.0, 5.0, 3600.0))}),
            )
        )
        steps.append((what, how, random.choice((1, 3, 12, 30, 90))))
    return steps


def play(seed: int, steps: list[Step] | None = None) -> None:
    """Play the history of a seed, or these steps.

    Raises:
        AssertionError: What is broken recovered, or is no fault in the end, or what is well is one.
    """
    with TemporaryDirectory() as folder:
        site = Site(Path(folder), SOURCES[seed % len(SOURCES)])
        try:
            site.wait(90)
            site.goal(succeeds=True)
            for what, how, seconds in random_steps(seed) if steps is None else steps:
                getattr(site, what)(**how)
                site.wait(seconds)
            site.finish(broken=seed % 2 == 0)
        finally:
            site.driver.close()
