"""What nodes log, and say of their life cycle and parameters; time is given."""

import re
from dataclasses import replace
from math import inf

import pytest

from ros_diagnostics_exporter.config.fleet import Profile, Robot
from ros_diagnostics_exporter.config.graph import Graph, Watched
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources.graph import TRY_AGAIN, GraphWatch
from ros_diagnostics_exporter.sources.graph_messages import (
    LOG_TYPE,
    PARAMETERS_TYPE,
    RECENT,
    STUCK,
    TRANSITION_TYPE,
    Log,
    Messages,
    Parameters,
    Stopwatch,
    Transition,
    is_asked_for,
)
from ros_diagnostics_exporter.sources.robot_graph import SOON, Report

ALL = Watched(
    logs=True,
    log_faults=(re.compile(".*out of memory.*"),),
    transitions=True,
    parameters=True,
)
TYPES = {
    "/rosout": [LOG_TYPE],
    "/parameter_events": [PARAMETERS_TYPE],
    "/r/amcl/transition_event": [TRANSITION_TYPE],
    "/other/amcl/transition_event": [TRANSITION_TYPE],
    "/r/battery_state": ["sensor_msgs/msg/BatteryState"],
    "/r/scan": ["sensor_msgs/msg/LaserScan"],
}
LIFE = "/r/amcl/transition_event"


class Site:
    """Two robots, of which the first is watched in this way."""

    def __init__(self, watch: Watched = ALL) -> None:
        self.now = Instant(50_000.0, 1_700_000_000.0)
        self.watch = GraphWatch()
        profile = Profile(graph=Graph(mode="on", watch=watch))
        self.robots = [Robot("r", namespace="/r", profile=profile), Robot("s", namespace="/s")]
        self.report: Report | None = None
        self.events: list[str] = []
        self.go_on(1)

    def go_on(self, seconds: float) -> None:
        for _ in range(int(seconds)):
            self.now = Instant(self.now.mono + 1, self.now.wall + 1)
            self.watch.set_robots(0, self.robots, self.now)
            self.watch.see_nodes(0, [("amcl", "/r"), ("amcl", "/s")], self.now)
            for each in self.watch.reports(0, self.now):
                if each.robot == "r":
                    self.report = each
                    self.events += each.events

    def send(self, topic: str, message) -> None:
        self.watch.see_message(0, topic, message, self.now)
        self.go_on(1)

    def wanted(self) -> set[str]:
        return set(self.watch.wanted(0, TYPES, self.now))

    @property
    def problems(self) -> dict[str, str]:
        return {each.name: each.message for each in self.report.statuses if each.level}


@pytest.fixture
def site() -> Site:
    return Site()


@pytest.mark.parametrize(
    ("watch", "wanted"),
    [
        (Watched(), set()),
        (Watched(logs=True), {"/rosout"}),
        (Watched(parameters=True), {"/parameter_events"}),
        (Watched(transitions=True), {LIFE}),
    ],
)
def test_nothing_is_subscribed_but_what_the_config_names(watch, wanted):
    assert Site(watch).wanted() == wanted


def test_what_a_node_logs_is_beside_the_faults_for_a_minute_and_is_none_itself(site):
    site.send("/rosout", Log("r.amcl", "No laser scan"))
    site.send("/rosout", Log("s.amcl", "Of another"))
    site.send("/rosout", Log("r.amcl.map", "No map"))
    assert site.report.logs == ("amcl/map: No map", "amcl: No laser scan")
    assert site.problems == {}
    site.go_on(70)
    assert site.report.logs == ()


def test_a_log_message_that_the_config_names_is_a_fault_for_a_time(site):
    site.send("/rosout", Log("r.amcl", "std::bad_alloc, out of memory"))
    assert site.problems == {"log amcl": "std::bad_alloc, out of memory"}
    site.go_on(500)
    site.send("/rosout", Log("r.amcl", "out of memory again"))
    site.go_on(590)
    assert site.problems == {"log amcl": "out of memory again"}
    site.go_on(60)
    assert site.problems == {}


def test_a_node_that_is_stuck_or_fell_is_a_problem_until_it_is_in_a_state_again(site):
    site.send(LIFE, Transition("inactive", "activating"))
    site.go_on(STUCK - 5)
    assert site.problems == {}
    site.go_on(10)
    assert site.problems == {"lifecycle amcl": "stuck in activating"}
    site.send(LIFE, Transition("activating", "active"))
    assert site.problems == {}
    site.send(LIFE, Transition("active", "errorprocessing"))
    site.send(LIFE, Transition("errorprocessing", "unconfigured"))
    assert site.problems == {"lifecycle amcl": "fell to unconfigured after an error"}
    site.send(LIFE, Transition("unconfigured", "configuring"))
    site.send(LIFE, Transition("configuring", "inactive"))
    assert site.problems == {}
    site.send(LIFE, Transition("cleaningup", "unconfigured"))  # as somebody asked for
    assert site.problems == {}


@pytest.mark.parametrize("goal", ["configuring", "cleaningup", "shuttingdown", "errorprocessing"])
def test_a_node_can_be_stuck_between_any_two_states(site, goal):
    site.send(LIFE, Transition("inactive", goal))
    site.go_on(STUCK + 5)
    assert site.problems == {"lifecycle amcl": f"stuck in {goal}"}


def test_a_parameter_that_is_set_is_an_event(site):
    changed = (("max_range", "10.0"), ("old", None))
    site.send("/parameter_events", Parameters("/r/amcl", changed))
    expected = ["parameter max_range of amcl is now 10.0", "parameter old of amcl was deleted"]
    assert site.events == expected


def test_a_robot_is_looked_at_again_when_time_makes_a_problem_or_ends_one():
    """The time in which it was not received is behind it."""
    messages, begin = Messages(), 50_000.0

    def at(second: float) -> Instant:
        return Instant(begin + second, 0.0)

    def due(second: float) -> float:
        return messages.due(ALL, at(second)) - begin

    for second, there in (0, True), (10, False), (110, True):
        messages.follow(at(second), there=there, lossy=False)
    assert due(110) == inf
    messages.note("amcl", Transition("inactive", "activating"), ALL, at(120))
    assert due(120) == 120 + STUCK
    messages.follow(at(130), there=False, lossy=False)
    messages.follow(at(230), there=True, lossy=False)
    assert due(230) == 220 + STUCK
    assert due(220 + STUCK) == inf
    messages.accept()
    messages.note("amcl", Log("r.amcl", "out of memory"), ALL, at(300))
    assert due(300) == 300 + RECENT
    assert due(300 + RECENT) == 300 + ALL.log_ends_after
    assert messages.judge(ALL, at(299 + ALL.log_ends_after)).keys() == {"log amcl"}
    assert messages.judge(ALL, at(300 + ALL.log_ends_after)) == {}


def test_time_in_which_a_robot_is_not_received_does_not_count():
    stopwatch = Stopwatch()
    assert stopwatch.read(5.0) == 0.0
    assert stopwatch.set(running=True, mono=10.0)
    assert not stopwatch.set(running=True, mono=12.0)
    assert stopwatch.set(running=False, mono=15.0)
    assert stopwatch.read(30.0) == 5.0
    stopwatch.set(running=True, mono=40.0)
    assert stopwatch.read(41.0) == 6.0


def test_what_a_node_says_is_written_soon(site):
    """A later process goes on with it; of a parameter nothing lasts."""

    def written() -> list[str]:
        return [name for name, _learned in site.watch.take_rows({"r"}, site.now)]

    written()
    site.send("/parameter_events", Parameters("/r/amcl", (("max_range", "10.0"),)))
    site.go_on(SOON)
    assert written() == []
    site.send("/rosout", Log("r.amcl", "out of memory"))
    site.go_on(SOON)
    assert written() == ["r"]


def test_what_a_person_accepts_or_forgets_of_messages_is_no_problem_any_more(site):
    site.send("/rosout", Log("r.amcl", "out of memory"))
    site.send(LIFE, Transition("errorprocessing", "unconfigured"))
    assert set(site.problems) == {"log amcl", "lifecycle amcl"}
    site.watch.forget("r", "log amcl", site.now)
    site.go_on(1)
    assert set(site.problems) == {"lifecycle amcl"}
    site.watch.forget("r", "lifecycle amcl", site.now)
    site.go_on(1)
    assert site.problems == {}
    site.send("/rosout", Log("r.amcl", "out of memory"))
    site.send(LIFE, Transition("errorprocessing", "unconfigured"))
    site.watch.accept("r", site.now)
    site.go_on(1)
    assert site.problems == {}


@pytest.mark.parametrize(
    ("graph", "left"),
    [
        ({"watch": ALL}, {"log amcl", "lifecycle amcl"}),
        ({"watch": ALL, "ignore": (re.compile("amcl"),)}, set()),
        ({"watch": replace(ALL, transitions=False)}, {"log amcl"}),
        ({"watch": replace(ALL, log_faults=(re.compile("other"),))}, {"lifecycle amcl"}),
        ({"watch": replace(ALL, logs=False)}, {"lifecycle amcl"}),
    ],
)
def test_what_the_config_does_not_ask_for_any_more_is_no_problem(site, graph, left):
    site.send("/rosout", Log("r.amcl", "out of memory"))
    site.send(LIFE, Transition("errorprocessing", "unconfigured"))
    site.robots[0] = Robot("r", namespace="/r", profile=Profile(graph=Graph(mode="on", **graph)))
    site.go_on(1)
    assert site.problems.keys() == left


def test_what_is_beyond_the_budget_is_given_up_named_and_tried_again(site):
    assert LIFE in site.wanted()
    site.watch.note_watched(0, {"/rosout": 15_000.0, LIFE: 100.0}, site.now)
    site.go_on(1)
    assert (site.report.watched, site.problems) == (15_100.0, {})
    site.watch.note_watched(0, {"/rosout": 30_000.0, LIFE: 100.0}, site.now)
    site.go_on(1)
    assert site.problems == {"watch": "/rosout is given up: 30000 B/s of at most 20000"}
    assert site.wanted() == {"/parameter_events", LIFE}
    site.watch.note_watched(0, {LIFE: 100.0}, site.now)
    site.go_on(1)
    assert (site.report.watched, list(site.problems)) == (100.0, ["watch"])
    site.go_on(TRY_AGAIN)
    assert "/rosout" in site.wanted()
    site.go_on(31)
    assert site.problems == {}


def test_a_topic_of_one_domain_is_tried_again_and_that_of_another_stays_given_up(site):
    site.watch.set_robots(1, [Robot("t", namespace="/t", profile=site.robots[0].profile)], site.now)
    site.watch.see_nodes(1, [("amcl", "/t")], site.now)
    site.wanted()
    site.watch.note_watched(0, {"/rosout": 30_000.0}, site.now)
    site.watch.wanted(1, TYPES, site.now)
    site.go_on(TRY_AGAIN - 1)
    site.watch.note_watched(1, {"/rosout": 40_000.0}, site.now)
    site.go_on(1)
    assert "/rosout" in site.wanted()
    assert "/rosout" not in site.watch.wanted(1, TYPES, site.now)
    site.go_on(31)
    (other,) = site.watch.reports(1, site.now)
    assert site.problems == {}
    assert {each.name: each.message for each in other.statuses if each.level} == {
        "watch": "/rosout is given up: 40000 B/s of at most 20000"
    }


def test_what_all_robots_of_a_domain_ask_for_is_shared_among_them(site):
    site.robots[1] = Robot("s", namespace="/s", profile=site.robots[0].profile)
    site.go_on(1)
    site.wanted()
    site.watch.note_watched(0, {"/rosout": 30_000.0}, site.now)
    site.go_on(1)
    assert (site.report.watched, site.problems) == (15_000.0, {})


def test_robots_of_which_nothing_is_watched_and_those_that_were_known_hide_no_other(site):
    site.robots = [site.robots[1], Robot("t", namespace="/t", profile=site.robots[0].profile)]
    site.go_on(1)
    site.wanted()
    site.watch.note_watched(0, {"/rosout": 15_000.0}, site.now)
    site.watch.see_nodes(0, [("amcl", "/s"), ("amcl", "/t")], site.now)
    watched = {each.robot: each.watched for each in site.watch.reports(0, site.now)}
    assert watched == {"s": None, "t": 15_000.0}


def test_only_what_the_config_names_is_asked_for():
    asked = ["log a", "lifecycle a", "watch"]
    others = ["topic log", "node log", "nodes", "link", "discovery"]
    assert [each for each in (*asked, *others) if is_asked_for(each)] == asked
