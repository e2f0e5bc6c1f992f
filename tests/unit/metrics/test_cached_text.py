"""Whatever happens to a fleet: what is kept of it is what would be made anew.

Histories of messages, answers of queries, topics, silence, reloads, removals and restarts. After
each step the cached text is compared with that of a new Exposition, and what was reported of the
robots with what is reported when all of it is; at the end, what was written step by step to the
database with what is written at once.
"""

from __future__ import annotations

import json
import re
import tempfile
from collections.abc import Mapping
from dataclasses import replace
from math import inf
from pathlib import Path

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.capabilities import Capability, ComponentsOf, Expression
from ros_diagnostics_exporter.config.conditions import Condition
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Check,
    ComponentRule,
    Discovery,
    FaultSettings,
    Fleet,
    Limits,
    Maintenance,
    Profile,
    Query,
    Robot,
    Shared,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.config.missions import ActionRule, Modes, TooMany
from ros_diagnostics_exporter.decode.goals import ABORTED, EXECUTING, SUCCEEDED, Goal
from ros_diagnostics_exporter.events import EventLog
from ros_diagnostics_exporter.fleet.discovery import found_robot
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import (
    ALL_PARTS,
    Array,
    Downtime,
    Endpoint,
    Feed,
    Instant,
    Part,
    Status,
    Topic,
)
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.robots.persisted import PersistedComponent, PersistedRobot
from ros_diagnostics_exporter.sources.link import LinkReading
from ros_diagnostics_exporter.sources.robot_graph import GRAPH, SHADOW, Report
from ros_diagnostics_exporter.storage.database import Database
from ros_diagnostics_exporter.storage.storage import Storage
from support.state_driver import ERROR, OK, STALE, WALL, WARN, tree

FAULTS = FaultSettings(restart_grace=4.0, pending_after=8.0, confirm_after=2.0)
PLAIN = Profile(stale_after=6.0, confirm_after=3.0, forget_after=20.0, flap_interval=1.0)
RICH = replace(
    PLAIN,
    name="rich",
    flap_interval=5.0,
    stale_is_critical=True,
    checks=(Check("all"), Check("motors", (Pattern("Motor"),), expect=2)),
    components=(
        ComponentRule(Pattern("Laser"), levels={WARN: OK}, stale_after=3.0, planned_stale=True),
        ComponentRule(
            Pattern("Motor"),
            unless=(Condition("Laser is ERROR", (Pattern("Laser"),), levels=(ERROR,)),),
        ),
        ComponentRule(
            Pattern("Arm"),
            unless=(Condition("Laser", (Pattern("Laser"),), key=(Pattern("Volt"),), above=3.0),),
        ),
    ),
    values=(
        ValueRule(
            key=Pattern("Charge"),
            thresholds=(Threshold("low", "critical", 10.0),),
            unless=(Condition("Laser is ERROR", (Pattern("Laser"),), levels=(ERROR,)),),
        ),
        ValueRule(key=Pattern("Volt"), metric="ros_voltage_volts", scale=0.5),
    ),
    capabilities={
        "driving": Capability("driving", Expression(None, (ComponentsOf((Pattern("Motor"),)),))),
        "seeing": Capability(
            "seeing", Expression(1, (ComponentsOf((Pattern("Laser"), Pattern("Arm"))),))
        ),
    },
    actions=(ActionRule((Pattern("go"),), aborted=TooMany(1, 2, 20.0)),),
    modes=Modes((Pattern("Laser"),), (Pattern("Volt"),), (Pattern("5"),)),
)
STRICT = replace(
    PLAIN,
    name="strict",
    stale_after=8.0,
    components=(
        ComponentRule(Pattern("Arm"), ignore=True),
        ComponentRule(Pattern("Motor"), levels={STALE: OK, ERROR: WARN}),
    ),
    values=(ValueRule(key=Pattern("Volt"), keep=False),),
)
R1 = Robot("r1", 0, "", "/r1/d_agg", "/r1/d", Source.BOTH, PLAIN, labels={"uplink": "ap"})
AP = Robot("ap", source=Source.QUERIES, profile=PLAIN)
PING = Query("x", "ping", "Uplink", "robot", interval=1.0, stale_after=5.0, uplink=True)
LOAD = Query("y", "load", robot="robot", interval=1.0, stale_after=5.0)
QUERIES = (PING, LOAD)
R2 = Robot("r2", topic_raw="/r2/d", source=Source.RAW, profile=RICH, labels={"site": "hall"})
FOUND = Discovery(re.compile(r"/(?P<robot>r[0-9])/d(_agg)?"), "/{robot}/d", profile=PLAIN)
SHARED = Shared("/d", raw=True, profile=PLAIN)
R3 = found_robot(FOUND, "r3", "/r3/d", 0)
FLEETS = (
    Fleet("f", (R1, R2, AP), (FOUND,), (SHARED,), faults=FAULTS, queries=QUERIES),
    Fleet("g", (R1, R2), (FOUND,), (SHARED,), faults=FAULTS, exporter="north"),
    Fleet("f", (replace(R1, profile=RICH), replace(R2, profile=STRICT)), faults=FAULTS),
    Fleet(
        "f",
        (
            replace(R1, topic_agg="/r3/d_agg", topic_raw="/r3/d", address="10.0.0.1"),
            replace(R2, labels={"site": "yard"}),
        ),
        faults=replace(FAULTS, many=CauseSettings(2, 0.5)),
        maintenance=(Maintenance("m", {"site": (Pattern("yard"),)}, "", WALL, WALL + 25),),
    ),
    Fleet(
        "f",
        (replace(R1, source=Source.AUTO),),
        (replace(FOUND, profile=RICH),),
        (replace(SHARED, profile=STRICT),),
        limits=Limits(robots=2, components=3, values=2, label_length=6, series=200),
        faults=FAULTS,
    ),
    Fleet(
        "f",
        (R1, R2, AP, R3),
        (FOUND,),
        (SHARED,),
        faults=FAULTS,
        queries=(PING, replace(LOAD, planned_stale=True, confirm_after=1.0)),
    ),
)

READING = LinkReading(100, 40, 0.5, 0.1)
# Few of each, so that most of what is sent is there already and only a part of it is new.
names = st.sampled_from(["Motor", "Motor", "Laser", "Arm: left", "Motor Left"])
values = st.sampled_from(
    [
        (),
        (("Volt", "5"),),
        (("Volt", "12.5"),),
        (("Volt", "7 A"),),
        (("Volt", "5"), ("Charge", "5")),
        (("Volt", "5"), ("Charge", "50")),
        (("Volt", "nan"), ("Volt", "[1, 2]"), ("Temp", "text")),
    ]
)
statuses = st.builds(
    Status,
    st.sampled_from([OK, OK, WARN, ERROR, ERROR, STALE, STALE, 7]),
    names,
    st.sampled_from(["fine", "fine", "hot: 70", "hot: 71"]),
    st.sampled_from(["", "", "r1", "r4"]),
    values,
)
rows = st.lists(statuses, min_size=1, max_size=3).map(tuple)
topics = st.sampled_from(["/r1/d", "/r1/d", "/r2/d", "/r3/d", "/r5/d", "/d"])
groups = st.sampled_from(["Base", "Top", "Motor"])
aggregates = st.dictionaries(groups, st.lists(statuses, max_size=2), max_size=2)
changed = st.one_of(
    st.tuples(st.just("level"), st.sampled_from([OK, ERROR, STALE])),
    st.tuples(st.just("message"), st.sampled_from(["fine", "hot: 70", "hot"])),
    st.tuples(st.just("hardware_id"), st.sampled_from(["r1", "r4"])),
    st.tuples(st.just("values"), values),
)
endpoints = st.sampled_from([Endpoint(0), Endpoint(1), Endpoint(2), Endpoint(0, "std_msgs/String")])
downtimes = st.builds(
    Downtime,
    st.sampled_from(["r1", "r2"]),
    st.sampled_from(["", "Motor"]),
    st.just(WALL),
    st.sampled_from([WALL + 10, WALL + 1e6]),
    st.just("me"),
    st.just(""),
)
answers = st.dictionaries(st.sampled_from(["r1", "r2", "r3", "ap"]), st.sampled_from([OK, ERROR]))
reports = st.builds(
    Report,
    st.just("r1"),
    st.sampled_from([GRAPH, SHADOW]),
    st.sampled_from([(), (Status(OK, "node a"),), (Status(ERROR, "node a", "gone"),)]),
    st.just(frozenset()),
    st.integers(0, 2),
    st.booleans(),
    st.just(()),
)
goals = st.sampled_from(["go", "go", "dock"])  # their actions
events = st.one_of(
    st.tuples(st.just("raw"), topics, rows),
    st.tuples(st.just("raw"), topics, rows),
    st.tuples(st.just("again"), changed),
    st.tuples(st.just("again"), changed),
    st.tuples(st.just("raw_for"), topics, rows, st.integers(2, 9)),
    st.tuples(st.just("aggregate"), st.sampled_from(["/r1/d_agg", "/r3/d_agg"]), aggregates),
    st.tuples(st.just("regroup"), groups),
    st.tuples(st.just("wait"), st.sampled_from([0.5, 3.0, 7.0, 30.0])),
    st.tuples(st.just("graph"), st.dictionaries(topics, endpoints)),
    st.tuples(st.just("domain"), st.booleans()),
    st.tuples(st.just("undecodable"), topics),
    st.tuples(st.just("dropped"), topics),
    st.tuples(st.just("configure"), st.integers(0, len(FLEETS) - 1)),
    st.tuples(st.just("plan"), st.lists(downtimes, max_size=2)),
    st.tuples(st.just("forget"), st.sampled_from(["r1", "r2", "r3"]), names | st.none()),
    st.tuples(st.just("restart"), st.sampled_from([None, OK, ERROR])),
    st.tuples(st.just("answer"), st.sampled_from(QUERIES), answers),
    st.tuples(st.just("report"), reports),
    st.tuples(st.just("goals"), goals, st.sampled_from([EXECUTING, EXECUTING, SUCCEEDED, ABORTED])),
    st.tuples(st.just("links"), st.sampled_from([None, READING])),
)
LASER = Status(OK, "Laser", "", "", (("Volt", "5"),))
BATTERY = Status(OK, "Battery", "", "", (("Charge", "5"),))
MOTOR = Status(OK, "Motor", "", "", (("Charge", "50"),))
# What is rendered after a step, as the two scrape jobs do; nothing: between two scrapes.
SCRAPES = {"all": ALL_PARTS, "faults": frozenset({Part.FAULTS}), "none": frozenset[Part]()}
scrapes = st.sampled_from(["all", "all", "faults", "none"])
histories = st.lists(st.tuples(events, scrapes), max_size=25)


class ScrapedState(FleetState):
    """One that is scraped when its robots are restored, and their faults are not yet."""

    def __init__(self, fleet: Fleet, now: Instant) -> None:
        super().__init__(fleet, now)
        self.exposition = Exposition(self)

    def restore(self, persisted: Mapping[str, PersistedRobot], now: Instant) -> None:
        super().restore(persisted, now)
        self.exposition.render()


class History:
    """A state, what is cached of it, and its database."""

    def __init__(self, folder: Path) -> None:
        self._path = folder / "state.db"
        self.now = Instant(0.0, WALL)
        self.state = FleetState(FLEETS[0], self.now)
        self.exposition = Exposition(self.state)
        self.storage = Storage(self._path)
        self.storage.load(self.state, self.now)
        self._downtimes: list[Downtime] = []
        self._goals = 0
        self._last: tuple[str, tuple[Status, ...]] = "/r1/d", (Status(OK, "Motor"),)
        self._groups: dict[str, list[Status]] = {"Base": [Status(OK, "Motor")]}

    def do(self, what: str, *how: object) -> None:
        getattr(self, f"_do_{what}")(*how)
        self.state.tick(self.now)

    def _do_raw(self, topic: str, rows: tuple[Status, ...]) -> None:
        self._last = topic, rows
        self.state.receive(Topic(0, topic), Array(self.now.wall - 0.5, rows, 100), self.now)

    def _do_raw_for(self, topic: str, rows: tuple[Status, ...], seconds: int) -> None:
        for _ in range(seconds):
            self._do_raw(topic, rows)
            self._do_wait(1.0)

    def _do_again(self, changed: tuple[str, object]) -> None:
        """The last array, of which one status is other."""
        topic, (*rows, row) = self._last
        self._do_raw(topic, (*rows, row._replace(**dict([changed]))))

    def _do_regroup(self, group: str) -> None:
        """The last aggregate, with all its components in one group."""
        self._do_aggregate(
            "/r1/d_agg", {group: [each for g in self._groups.values() for each in g]}
        )

    def _do_aggregate(self, topic: str, groups: dict[str, list[Status]]) -> None:
        self._groups = groups
        self._do_raw(topic, tree(**groups) or (Status(OK, "/Base"),))

    def _do_wait(self, seconds: float) -> None:
        end = self.now.mono + seconds
        while self.now.mono < end:
            self.now = Instant(self.now.mono + 0.5, self.now.wall + 0.5)
            self.state.tick(self.now)

    def _do_graph(self, endpoints: dict[str, Endpoint]) -> None:
        self.state.update_graph(0, endpoints, self.now)

    def _do_domain(self, up: bool) -> None:
        if up:
            self.state.domain_joined(0)
        else:
            self.state.domain_failed(0, "no interface", self.now)

    def _do_answer(self, query: Query, levels: dict[str, int]) -> None:
        statuses = {name: (Status(level, "of a query"),) for name, level in levels.items()}
        self.state.receive_answer(query.feed, statuses, self.now)

    def _do_report(self, report: Report) -> None:
        self.state._receive_report(report, self.now)

    def _do_links(self, reading: LinkReading | None) -> None:
        self.state.update_links(0, {"/r1/d": reading}, self.now)

    def _do_goals(self, action: str, status: int) -> None:
        """A list of one goal of r1: a new one if it is executed."""
        robot = self.state.robots.get("r1")
        self._goals += status == EXECUTING
        goal = Goal(self._goals.to_bytes(16, "big"), float(self._goals), status)
        if robot is not None:
            self.state._with_missions().see(robot, action, (goal,), self.now)
            self.state._follow(robot, self.now)

    def _do_undecodable(self, topic: str) -> None:
        self.state.reject_undecodable(Topic(0, topic), "too short", self.now)

    def _do_dropped(self, topic: str) -> None:
        self.state.reject_dropped(Topic(0, topic), 3)

    def _do_configure(self, fleet: int) -> None:
        self.state.configure(FLEETS[fleet], self.now)

    def _do_plan(self, downtimes: list[Downtime]) -> None:
        self._downtimes = downtimes
        self.state.plan(downtimes, self.now)

    def _do_forget(self, robot: str, component: str | None) -> None:
        known = self.state.robots.get(robot)
        names = () if known is None else [each.label for each in known.components]
        if known is not None and (component is None or component in names):
            self.state.forget(robot, component, self.now)

    def _do_restart(self, received: int | None) -> None:
        """Another process; it is scraped before it has read the database, and meanwhile.

        The last array is received with another level before the database is read, too.
        """
        self.save()
        self.storage.close()
        self.now = Instant(100.0, self.now.wall + 5.0)
        self.state = ScrapedState(self.state.fleet, self.now)
        self.exposition = self.state.exposition
        self.exposition.render()
        self.state.plan(self._downtimes, self.now)
        if received is not None:
            self._do_again(("level", received))
        self.storage = Storage(self._path)
        self.storage.load(self.state, self.now)
        self.compare(ALL_PARTS)

    def compare(self, parts: frozenset[Part]) -> list[str]:
        """The samples, after the check that those that are kept are what is made anew."""
        kept, anew = of(self.exposition, parts), of(Exposition(self.state), parts)
        assert kept == anew
        return anew

    def save(self) -> None:
        self.storage.save(self.state, EventLog(), self.now, at_once=True)

    def loaded(self, path: Path) -> FleetState:
        """A new process' state, from a database."""
        now = Instant(50.0, self.now.wall + 5.0)
        state, storage = FleetState(self.state.fleet, now), Storage(path)
        state.plan(self._downtimes, now)
        storage.load(state, now)
        storage.close()
        return state


def of(exposition: Exposition, parts: frozenset[Part]) -> list[str]:
    """Its samples, but for the reasons that applied once: a new one does not know them."""
    return [
        line
        for line in exposition.render(parts=parts).decode().splitlines()
        if not (line[0] == "#" or ("robot_silent_reason" in line and line.endswith(" 0.0")))
    ]


def is_reported(state: FleetState) -> bool:
    """Whether anything has come, or a second has passed, since the faults were restored."""
    return all(each._presence is not None for each in state._faults._robots.values())


Name = tuple[str, str, str]  # robot, group, component


def check_problems(text: list[str], state: FleetState, now: Instant) -> None:
    """What is in trouble in the text is judged so, by the same name; and nothing else is."""
    levels, troubled = names_in(text, "component_level"), names_in(text, "component_state")
    problems = {
        (each.identity.robot, each.identity.group, each.identity.component): each
        for each in state.problems(now)
        if each.identity.scope in {"component", "flapping"} and state.robots[each.identity.robot].up
    }
    assert problems.keys() <= levels.keys()
    assert {name for name in troubled if levels[name] in "12"} <= problems.keys()


def check_reported(state: FleetState, now: Instant) -> None:
    """To report all of every robot again is to report nothing new, once each was looked at."""
    state._slow_tick_at = -inf
    state.tick(now)
    reports, known = state._faults, reported(state)
    for robot in state.robots.values():
        reports._robots[robot.settings.name]._everything = True
        reports._record(reports._robots[robot.settings.name].update(reports.engine, now))
    assert reported(state) == known


def reported(state: FleetState) -> object:
    """What is known of each problem, and how its component is judged."""
    return {
        each: (problem.verdict, problem.component and problem.component.settings)
        for each, problem in state._faults.engine._book.problems.items()
    }


def names_in(text: list[str], family: str) -> dict[Name, str]:
    """The samples of a family, of robots that are up."""
    up = {line.split('"')[3] for line in text if "_robot_up{" in line and line.endswith(" 1.0")}
    found = (line.split('"') for line in text if f"_{family}{{" in line)
    return {
        (robot, group, name): v[2:] for _, _, _, robot, _, group, _, name, v in found if robot in up
    }


def fault_texts(state: FleetState) -> dict[object, object]:
    """The faults of robots that were received: of others nothing outlives the process."""
    return {
        each.identity: each
        for each in state.faults()
        if not each.identity.robot or state.robots[each.identity.robot].last_wall
    }


def persisted(state: FleetState, now: Instant) -> dict[str, PersistedRobot]:
    """What would be written of each robot, but for what is written once an hour."""
    found = {name: robot.persist(now) for name, robot in state.robots.items()}
    return {
        name: replace(robot, components=[*map(_without_slow, robot.components)])
        for name, robot in found.items()
    }


def rows_of(path: Path) -> dict[str, object]:
    """The robots as a database has them, but for what is written once an hour."""
    database = Database(path)
    found = {name: json.loads(text) for name, text, _seen in database.robots()}
    database.close()
    for robot in found.values():
        del robot["last_seen"]
        for component in robot["components"]:
            del component["listed"]
            if component["level"] == OK:
                del component["message"]
    return found


def _without_slow(component: PersistedComponent) -> PersistedComponent:
    message = "" if component.level == OK else component.message
    return replace(component, listed=0.0, message=message)


def check(history: list[tuple[tuple[object, ...], str]]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        played = History(Path(folder))
        for (what, *how), scrape in history:
            played.do(str(what), *how)
            anew = played.compare(SCRAPES[scrape])
            if scrape == "all" and is_reported(played.state):
                check_problems(anew, played.state, played.now)
                check_reported(played.state, played.now)
            if scrape == "none":
                played.save()
        compare_written(played, Path(folder))
        played.storage.close()


def compare_written(played: History, folder: Path) -> None:
    """What was written step by step gives what is written at once, and every fault."""
    played.save()
    played.storage.close()
    at_once = Storage(folder / "at_once.db")
    at_once.save(played.state, EventLog(), played.now, at_once=True)
    at_once.close()
    assert rows_of(folder / "state.db") == rows_of(folder / "at_once.db")
    steps, once = (played.loaded(folder / name) for name in ("state.db", "at_once.db"))
    now = Instant(51.0, played.now.wall + 6.0)
    assert persisted(steps, now) == persisted(once, now)
    assert fault_texts(steps) == fault_texts(played.state)


quick = settings(max_examples=60, suppress_health_check=[HealthCheck.too_slow])


OTHER_TOPIC = 3  # the fleet in which r1 has others
SHORT_LABELS = 4  # ... in which labels have six characters
OTHER_QUERY = 5  # ... in which what LOAD measures is judged otherwise, and r3 is declared
GONE = (Status(ERROR, "node a", "gone"),)
HIGH = (("Volt", "12.5"),)
DOWNTIME = Downtime("r1", "", WALL, WALL + 1e6, "me", "")
BASE = ("aggregate", "/r1/d_agg", {"Base": [Status(OK, "Motor"), Status(OK, "Laser")]})


def report(feed: Feed, statuses: tuple[Status, ...], *, lossy: bool = False) -> tuple[str, Report]:
    return "report", Report("r1", feed, statuses, frozenset(), 2, lossy, ())


def again(**changed: object) -> tuple[object, ...]:
    return "again", *changed.items()


def scraped(*steps: tuple[object, ...]) -> list[tuple[tuple[object, ...], str]]:
    """These steps, with a scrape of all parts after each."""
    return [(step, "all") for step in steps]


@quick
@given(histories)
# How what a query measures is judged, with what it measures as it was.
@example(scraped(again(level=OK), ("answer", LOAD, {"r1": ERROR}), ("configure", OTHER_QUERY)))
# What was shown only is judged.
@example(scraped(again(level=OK), report(SHADOW, GONE), report(GRAPH, GONE)))
@example(scraped(("wait", 0.5), ("answer", LOAD, {"ap": OK})))
@example(scraped(("answer", PING, {"ap": ERROR}), ("wait", 3.0)))
# What was found is declared, and nothing else of it differs.
@example(
    [
        *scraped(("graph", {"/r3/d": Endpoint(1)}), ("raw", "/r3/d", (MOTOR,)), ("wait", 7.0)),
        (("raw", "/r3/d", (MOTOR,)), "none"),
        (("configure", OTHER_QUERY), "all"),
    ]
)
@example([(again(level=OK), "none"), (("configure", OTHER_TOPIC), "all")])
# A problem that is scraped before, and after, the faults of before are restored.
@example(scraped(again(level=OK), ("restart", ERROR)))
@example(scraped(("restart", ERROR)))
# A fault of before the start, whose component has a shorter label since.
@example(
    scraped(
        ("raw", "/r1/d", (Status(ERROR, "Arm: left"),)),
        ("configure", SHORT_LABELS),
        ("restart", None),
        *[("wait", 7.0), again(level=ERROR)] * 2,
    )
)
# A fault whose component has a shorter label since: it keeps its name until it is over.
@example(
    scraped(
        ("raw", "/r1/d", (Status(ERROR, "Arm: left"),)), ("wait", 7.0), ("configure", SHORT_LABELS)
    )
)
# What is STALE may be well while messages are lost.
@example(
    scraped(
        ("raw", "/r1/d", (Status(STALE, "Motor"),)),
        report(GRAPH, (), lossy=True),
        report(GRAPH, ()),
    )
)
# Received as STALE, after it was so for want of anything received.
@example(scraped(again(level=OK), ("wait", 7.0), again(level=STALE)))
# What the network shows of a robot with another topic.
@example(scraped(report(GRAPH, ()), ("links", READING), ("configure", OTHER_TOPIC)))
# Restored, and listed as STALE: no longer as bad as before the start.
@example(
    [
        (("aggregate", "/r1/d_agg", {"Base": [Status(ERROR, "Motor")]}), "all"),
        (("restart", None), "none"),
        (("aggregate", "/r1/d_agg", {"Base": [Status(STALE, "Motor")]}), "all"),
    ]
)
@example(scraped(("graph", {"/r1/d": Endpoint(1)}), ("configure", OTHER_TOPIC)))
@example(scraped(("domain", False), ("configure", OTHER_TOPIC)))
@example(scraped(again(level=ERROR), ("restart", None), ("regroup", "Top")))
@example(scraped(again(level=ERROR), again(message="hot")))
@example(scraped(again(level=OK), again(hardware_id="r4")))
# In maintenance, where nothing else follows a level.
@example(scraped(again(level=WARN), ("plan", [DOWNTIME]), again(level=ERROR)))
# Suppressed by a value of another component.
@example(scraped(("raw", "/r2/d", (Status(STALE, "Arm: left"), LASER)), again(values=HIGH)))
# A value beyond its threshold, before and after its component is STALE.
@example(
    scraped(
        ("raw", "/r2/d", (MOTOR,)),
        again(values=(("Charge", "5"),)),
        again(level=STALE),
        again(level=OK),
        again(values=()),
    )
)
# A value that is suppressed by another component.
@example(scraped(("raw", "/r2/d", (BATTERY, LASER)), again(level=ERROR), again(level=OK)))
# A value that no rule judges.
@example(scraped(("raw", "/r1/d", (LASER,)), again(values=HIGH)))
@example(scraped(again(level=OK), ("dropped", "/r1/d")))
@example(scraped(("domain", True), ("undecodable", "/r1/d")))
@example(scraped(again(level=OK), ("wait", 7.0)))
@example(scraped(again(level=OK), ("graph", {"/r1/d": Endpoint(1)})))
@example(scraped(("wait", 0.5), ("domain", False)))
@example(
    scraped(
        ("raw", "/r1/d_agg", (Status(OK, "/Base"), Status(OK, "/Base/Motor"))),
        ("raw", "/r1/d_agg", (Status(WARN, "/Base"), Status(OK, "/Base/Motor"))),
    )
)
# Forgotten, and received again.
@example(scraped(BASE, ("forget", "r1", "Motor"), BASE, ("regroup", "Top")))
# A flap ratio that falls while nothing else changes.
@example(
    scraped(
        *(again(level=each) for each in (OK, ERROR, OK)),
        ("raw_for", "/r1/d", (Status(OK, "Motor"),), 3),
    )
)
@example(scraped(("raw", "/r2/d", (LASER._replace(name="Motor"),)), again(values=HIGH)))
@example(
    scraped(
        ("raw", "/r1/d", (Status(OK, "Motor", "", "a"),)),
        ("raw", "/r1/d", (Status(OK, "Motor", "", "a"), Status(OK, "Motor", "", "b"))),
    )
)
@example([(("regroup", "Base"), "all"), (("goals", "go", 4), "all")])
@example(
    scraped(
        ("raw", "/r1/d", (MOTOR,)),
        ("raw_for", "/r2/d", (MOTOR,), 7),
        ("regroup", "Base"),
        ("configure", 2),
    )
)
@example(
    scraped(
        ("raw", "/r1/d", (MOTOR,)),
        ("domain", False),
        ("wait", 30.0),
        ("raw", "/r1/d", (MOTOR,)),
        ("domain", True),
    )
)
def test_what_is_kept_is_what_would_be_made_anew(history):
    check(history)
