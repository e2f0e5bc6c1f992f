"""What the ROS graph shows of robots, as statuses; time is given."""

import json
import re
from collections.abc import Iterable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.config.fleet import Profile, Robot
from ros_diagnostics_exporter.config.graph import Graph, Watched
from ros_diagnostics_exporter.faults.model import LEARNED
from ros_diagnostics_exporter.faults.stored import parse
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources import graph_nodes, graph_topics
from ros_diagnostics_exporter.sources.graph import CLAIMED, GraphWatch
from ros_diagnostics_exporter.sources.graph_messages import Log, Transition
from ros_diagnostics_exporter.sources.graph_topics import (
    SEEN_FOR,
    UNKNOWN,
    US,
    Mismatch,
    Peer,
    TopicView,
)
from ros_diagnostics_exporter.sources.link import LinkReading
from ros_diagnostics_exporter.sources.robot_graph import GRAPH, SHADOW, Report

WALL = 1_700_000_000.0
DAY = 86_400.0
ON = Graph(mode="on")
USUAL = ("diag", "amcl", "driver", "nav/planner", "nav/controller")
CHAT = TopicView((Peer("/r/amcl", "01" * 16),), (Peer("/r/driver", "02" * 16),))


class Site:
    """One robot "r" in the namespace /r, looked at once a second."""

    def __init__(self, graph: Graph = ON, namespace: str = "/r") -> None:
        self.now = Instant(50_000.0, WALL)
        self.watch = GraphWatch()
        self.graph, self.namespace = graph, namespace
        self.reports: list[Report] = []
        self.rows: dict[str, dict[str, object] | None] = {}
        self.known = {"r"}

    def look(self, seconds: float, *nodes: str, **topics: TopicView) -> None:
        """Let time pass in which the graph stays like that."""
        end = self.now.mono + seconds
        while self.now.mono < end:
            mono = min(end, self.now.mono + 1)
            self.now = Instant(mono, self.now.wall + mono - self.now.mono)
            self.watch.set_robots(0, self._robots(), self.now)
            self.watch.see_nodes(
                0, [_split(f"{self.namespace}/{each}") for each in nodes], self.now
            )
            named = {f"{self.namespace}/{name}": view for name, view in topics.items()}
            self.watch.see_topics(0, named, self.now)
            self.reports += self.watch.reports(0, self.now)
            self.rows |= dict(self.watch.take_rows(self.known, self.now))

    def learn(self, *nodes: str, **topics: TopicView) -> None:
        """A day in which all is as usual."""
        self.look(5, *nodes, **topics)
        self.now = Instant(self.now.mono + DAY, self.now.wall + DAY)
        self.look(5, *nodes, **topics)

    def _robots(self) -> Iterable[Robot]:
        return [Robot("r", namespace=self.namespace, profile=Profile(graph=self.graph))]

    def lose(self, lost: int, of: int = 100) -> None:
        self.watch.see_links({"r": LinkReading(of, lost, 0.0, 0.0)}, self.now)

    @property
    def problems(self) -> dict[str, str]:
        """By component what was last reported of those in trouble."""
        return {each.name: each.message for each in self.reports[-1].statuses if each.level}

    @property
    def names(self) -> list[str]:
        return [each.name for each in self.reports[-1].statuses]

    @property
    def events(self) -> list[str]:
        return [text for each in self.reports for text in each.events]


def _split(name: str) -> tuple[str, str]:
    namespace, _slash, own = name.rpartition("/")
    return own, namespace or "/"


def without(*gone: str) -> list[str]:
    return [each for each in USUAL if each not in gone]


@pytest.fixture
def site() -> Site:
    return Site()


# -- nodes -------------------------------------------------------------------------------------


def test_a_node_that_was_there_for_a_day_and_is_gone_is_a_problem_until_it_is_back(site):
    site.learn(*USUAL)
    assert site.names == []
    site.look(4, *without("amcl"))
    assert site.problems == {}
    site.look(3, *without("amcl"))
    assert site.problems == {"node amcl": "the node is gone"}
    site.look(DAY / 24, *without("amcl"))
    assert site.problems == {"node amcl": "the node is gone"}
    site.look(2, *USUAL)
    assert (site.problems, site.names) == ({}, ["node amcl"])
    site.look(3700, *USUAL)
    assert site.names == []


def test_a_node_is_expected_once_it_was_there_for_long_enough_in_all(site):
    site.graph = Graph(mode="on", learn_after=100.0)
    site.look(90, *USUAL)
    site.look(90, *without("amcl"))
    assert site.problems == {}
    site.look(20, *USUAL)
    site.look(20, *without("amcl"))
    assert site.problems == {"node amcl": "the node is gone"}


def test_a_node_that_the_config_expects_need_not_be_learned(site):
    site.graph = Graph(mode="on", expect=("amcl", "/r/nav/planner", "never"))
    site.look(59, *without("amcl"))
    assert site.problems == {}
    site.look(5, *without("amcl"))
    assert site.problems.keys() == {"node amcl", "node never"}


def test_of_a_robot_of_which_no_node_is_there_nothing_is_said(site):
    site.learn(*USUAL)
    site.look(1, *without("amcl"))
    before = len(site.reports)
    site.look(3600)
    assert len(site.reports) == before
    site.look(50, *without("amcl"))
    assert site.problems == {}  # others start, too
    site.look(15, *without("amcl"))
    assert site.problems == {"node amcl": "the node is gone"}


@pytest.mark.parametrize(
    "name",
    [
        *("_ros2cli_daemon_0_a1", "rviz2", "rqt_graph", "launch_ros_4711", "talker_30412"),
        *("transform_listener_impl_5581ca7e", "ros_diagnostics_exporter", "x_5581ca7e", "own"),
    ],
)
def test_tools_and_names_with_numbers_of_processes_never_count(site, name):
    site.graph = Graph(mode="on", learn_after=1.0, ignore=(re.compile("own"),))
    site.look(60, *USUAL, name, name)
    site.look(60, *USUAL)
    assert site.names == []


def test_the_number_of_a_robot_is_none_of_a_process():
    site = Site(Graph(mode="on", learn_after=1.0), namespace="/j100_0849")
    site.look(60, *USUAL)
    site.look(60, *without("amcl", "nav/planner"))
    assert site.problems.keys() == {"node amcl", "node nav/planner"}


def test_a_namespace_whose_processes_leave_at_once_was_stopped(site):
    views = {
        "plan": TopicView((Peer("/r/nav/planner", "0a" * 16),), ()),
        "go": TopicView((Peer("/r/nav/controller", "0b" * 16),), ()),
    }
    site.learn(*USUAL, **views)
    site.look(60, *without("nav/planner", "nav/controller"))
    assert (site.problems, site.events) == ({}, ["all 2 nodes in nav were stopped"])
    site.look(60, *USUAL)
    site.look(60, *without("nav/planner"))
    assert site.problems == {"node nav/planner": "the node is gone"}


def test_a_process_that_ran_a_whole_namespace_and_processes_that_end_one_by_one_are_gone(site):
    one = "0a" * 16
    views = {
        "plan": TopicView((Peer("/r/nav/planner", one),), ()),
        "go": TopicView((Peer("/r/nav/controller", one),), ()),
    }
    site.learn(*USUAL, **views)
    site.look(60, *without("nav/planner", "nav/controller"))
    gone = {"node nav/planner", "node nav/controller"}
    assert (site.problems.keys(), site.events) == (gone, [])

    other = Site()
    views["go"] = TopicView((Peer("/r/nav/controller", "0b" * 16),), ())
    other.learn(*USUAL, **views)
    other.look(2, *without("nav/planner"))
    other.look(60, *without("nav/planner", "nav/controller"))
    assert (other.problems.keys(), other.events) == (gone, [])


def test_many_nodes_that_go_together_are_one_problem(site):
    nodes = [f"n{number}" for number in range(10)]
    site.learn("diag", *nodes)
    site.look(3, "diag", *nodes[2:])
    site.look(60, "diag", *nodes[5:])
    text = "5 of 11 nodes are gone: n0, n1, n2, n3, n4"
    assert site.problems == {"nodes": text}
    site.look(60, "diag", *nodes[6:])
    assert site.problems == {"nodes": text, "node n5": "the node is gone"}
    site.look(60, "diag", *nodes)
    assert site.problems == {}

    other = Site()  # that knows the problem alone
    other.look(1, "diag")
    other.watch.adopt("r", "nodes", text, other.now)
    assert other.watch._robots["r"]._nodes.expected == 0
    other.look(5, "diag", *nodes)
    assert other.watch._robots["r"]._nodes.expected == 5


def test_two_nodes_of_one_name_are_a_problem_unless_one_of_them_is_about_to_go(site):
    site.learn(*USUAL)
    site.look(25, *USUAL, "amcl")
    assert site.problems == {}
    site.look(25, *USUAL)
    assert site.problems == {}
    site.look(35, *USUAL, "amcl")
    assert site.problems == {"node amcl": "2 nodes have this name"}
    site.look(2, *USUAL)
    assert site.problems == {}


def test_nodes_that_always_had_one_name_are_as_usual(site):
    site.learn(*USUAL, "twin", "twin")
    site.look(60, *USUAL, "twin", "twin")
    site.look(60, *USUAL)
    assert site.problems == {}


def test_of_very_many_nodes_the_one_that_is_gone_and_was_there_shortest_is_forgotten(site):
    nodes = [f"n{number}" for number in range(graph_nodes.MOST - 2)]
    site.look(2, *nodes, "short", "long")
    site.look(1, *nodes, "long")
    for new, kept in ("new", {"new", "long"}), ("newer", {"new", "newer"}):
        site.look(1, *nodes, "new", new)
        known = site.watch._robots["r"].learned(site.now).nodes
        assert known.keys() == {*nodes, *kept}


def test_of_a_robot_whose_nodes_are_not_seen_its_topics_say_that_it_is_there(site):
    site.look(1)
    assert site.watch.present(0) == set()
    for topics, present in (["/other/scan"], set()), (["/r/scan", "/r/x"], {"r"}), ([], set()):
        site.watch.see_offered(0, topics)
        assert site.watch.present(0) == present


# -- topics ------------------------------------------------------------------------------------


def test_endpoints_that_cannot_match_are_a_problem(site):
    why = Mismatch("/r/amcl", "/r/driver", "best effort and reliable")
    tool = Mismatch("/r/amcl", "/r/rviz2", "best effort and reliable")
    site.look(60, *USUAL, chat=CHAT._replace(mismatches=(tool,)))
    assert site.problems == {}
    site.look(SEEN_FOR, *USUAL, chat=CHAT._replace(mismatches=(why, tool)))
    assert site.problems == {}
    site.look(1, *USUAL, chat=CHAT._replace(mismatches=(why, tool)))
    text = "/r/driver receives nothing from /r/amcl: best effort and reliable"
    assert site.problems == {"topic chat": text}
    site.look(2, *USUAL, chat=CHAT)
    assert site.problems == {}


def test_what_was_seen_once_is_no_problem_until_it_is_seen_again(site):
    why = Mismatch("/r/amcl", "/r/driver", "best effort and reliable")
    site.look(1, *USUAL, chat=CHAT._replace(mismatches=(why,)))
    site.look(120, *USUAL)
    assert site.problems == {}
    site.look(1, *USUAL, chat=CHAT._replace(mismatches=(why,)))
    assert site.problems.keys() == {"topic chat"}


def test_a_second_publisher_where_one_was_is_a_problem(site):
    second = Peer("/r/driver", "03" * 16)
    doubled = CHAT._replace(publishers=(*CHAT.publishers, second))
    usual = {"rosout": CHAT, "go/_action/status": CHAT, "other": doubled}
    site.learn(*USUAL, chat=CHAT, **usual)
    now = dict.fromkeys(usual, doubled)
    site.look(SEEN_FOR, *USUAL, chat=doubled, **now)
    assert site.problems == {}
    site.look(1, *USUAL, chat=doubled, **now)
    assert site.problems == {"topic chat": "2 publishers where one was: /r/amcl, /r/driver"}


def test_the_publishers_of_a_node_that_is_there_twice_are_no_problem_of_their_own(site):
    site.learn(*USUAL, chat=CHAT, plan=CHAT)
    other = Peer("/r/amcl", "04" * 16)
    same = Peer("/r/amcl", "01" * 12 + "05" * 4)  # of the same process
    twice = CHAT._replace(publishers=(*CHAT.publishers, other))
    plan = CHAT._replace(publishers=(*CHAT.publishers, same))
    site.look(40, *USUAL, "amcl", chat=twice, plan=plan)
    assert site.problems == {
        "node amcl": "2 nodes have this name",
        "topic plan": "2 publishers where one was: /r/amcl",
    }


def test_a_side_that_a_topic_lost_although_its_node_goes_on_is_a_problem(site):
    unheard, silent = CHAT._replace(subscribers=()), CHAT._replace(publishers=())
    site.learn(*USUAL, chat=CHAT, plan=CHAT, new=unheard)
    site.look(SEEN_FOR, *USUAL, chat=unheard, plan=silent, new=unheard)
    assert site.problems == {}
    site.look(1, *USUAL, chat=unheard, plan=silent, new=unheard)
    lost = {
        "topic chat": "nobody subscribes any more, as /r/driver did",
        "topic plan": "nobody publishes any more, as /r/amcl did",
    }
    assert site.problems == lost

    again = Site()
    again.watch.restore({"r": site.rows["r"]}, again.now)
    again.look(20, *USUAL, chat=unheard, plan=silent)
    assert again.reports[-1].held == lost.keys()
    again.look(120, *USUAL, chat=unheard, plan=silent)
    assert again.problems == lost

    site.look(60, *without("driver"), chat=unheard, plan=CHAT)
    assert site.problems.keys() == {"node driver"}
    site.watch.accept("r", site.now)
    site.look(60, *USUAL, chat=unheard)
    assert site.problems == {}


def test_a_node_that_is_back_has_time_to_publish_again_before_its_topic_is_a_problem(site):
    unheard = CHAT._replace(subscribers=())
    site.learn(*USUAL, chat=CHAT)
    site.look(60, *without("driver"), chat=unheard)
    assert site.problems.keys() == {"node driver"}
    site.look(25, *USUAL)  # the topic is not read again yet
    assert site.problems == {}
    site.look(1, *USUAL, chat=unheard)
    assert site.problems == {}
    site.look(10, *USUAL, chat=unheard)
    assert site.problems.keys() == {"topic chat"}


def test_of_very_many_topics_those_that_were_found_first_are_judged(site):
    why = Mismatch("/r/amcl", "/r/driver", "best effort and reliable")
    views = {f"t{number}": CHAT for number in range(graph_topics.MOST)}
    bad = CHAT._replace(mismatches=(why,))
    site.look(1, *USUAL, **views)
    for _ in range(2):
        site.look(1, *USUAL, **{**views, "t1": bad, "new": bad})
        site.now = Instant(site.now.mono + 100, site.now.wall + 100)
    assert site.problems.keys() == {"topic t1"}


def test_endpoints_of_no_known_node_are_half_a_discovery(site):
    half = CHAT._replace(mismatches=(UNKNOWN,))
    site.look(SEEN_FOR, *USUAL, chat=half, plan=half, other=CHAT)
    assert site.problems == {}
    site.look(1, *USUAL, chat=half, plan=half, other=CHAT)
    text = "endpoints of 2 topics are of no known node: chat, plan"
    assert site.problems == {"discovery": text}
    site.look(10, *USUAL, chat=CHAT, plan=CHAT)
    assert site.problems == {}
    site.look(40, *USUAL, chat=half)
    site.watch.forget("r", "discovery", site.now)
    site.look(40, *USUAL, chat=half)
    assert site.problems == {}


def test_what_was_wrong_with_a_topic_before_a_restart_is_well_once_it_was_read_twice(site):
    why = Mismatch("/r/amcl", "/r/driver", "best effort and reliable")
    site.look(40, *USUAL, chat=CHAT._replace(mismatches=(why,)))
    again = Site()
    again.watch.restore({"r": site.rows["r"]}, again.now)
    again.look(1, *USUAL, chat=CHAT)
    again.look(300, *USUAL)  # there are many topics to read
    assert (again.names, again.reports[-1].held) == ([], {"topic chat"})
    again.look(31, *USUAL, chat=CHAT)
    again.look(31, *USUAL)
    assert (again.names, again.problems) == (["topic chat"], {})

    again = Site()
    again.watch.restore({"r": site.rows["r"]}, again.now)
    again.look(1050, *USUAL)  # the topic is not there any more
    assert (again.names, again.problems) == (["topic chat"], {})


@pytest.mark.parametrize("between", [(), (Peer("/r/amcl", "01" * 16), Peer("/r/amcl", "09" * 16))])
def test_a_publisher_that_was_replaced_in_its_node_is_an_event(site, between):
    site.look(5, *USUAL, chat=CHAT)
    if between:
        site.look(5, *USUAL, chat=CHAT._replace(publishers=between))
    site.look(5, *USUAL, chat=CHAT._replace(publishers=(Peer("/r/amcl", "09" * 16),)))
    assert site.events == ["the publisher of chat in /r/amcl was restarted"]


# -- the link ----------------------------------------------------------------------------------


def test_while_too_many_messages_are_lost_the_link_is_the_problem_and_nothing_else(site):
    site.learn(*USUAL)
    site.lose(21)
    site.look(2, *USUAL)
    assert site.problems == {"link": "21 % of its messages are lost"}
    assert site.reports[-1].lossy
    site.look(60, *without("amcl"))
    assert site.problems.keys() == {"link"}
    site.lose(11)
    site.look(2, *without("amcl"))
    assert site.problems.keys() == {"link"}
    site.lose(9)
    site.look(2, *without("amcl"))
    assert (site.problems.keys(), site.reports[-1].lossy) == ({"node amcl"}, False)


def test_few_messages_say_nothing_about_the_link(site):
    site.lose(9, of=19)
    site.look(2, *USUAL)
    assert site.problems == {}


def test_a_link_of_few_messages_is_judged_over_as_many_minutes_as_it_takes(site):
    site.look(2, *USUAL)
    site.lose(60)
    site.look(2, *USUAL)
    assert site.problems.keys() == {"link"}
    for _ in range(3):
        site.lose(0, of=12)
        site.look(60, *USUAL)
    assert (site.problems, site.reports[-1].lossy) == ({}, False)
    for _ in range(3):
        site.lose(4, of=12)
        site.look(60, *USUAL)
    assert site.problems.keys() == {"link"}


def test_silence_does_not_end_what_is_wrong_with_the_link(site):
    site.look(2, *USUAL)
    site.lose(60)
    site.look(2, *USUAL)
    site.watch.see_links({"r": None}, site.now)
    site.look(600, *USUAL)
    assert site.problems == {"link": "60 % of its messages are lost"}


# -- what the config ignores -------------------------------------------------------------------


def ignoring(*names: str) -> Graph:
    return Graph(mode="on", ignore=tuple(map(re.compile, names)))


@pytest.mark.parametrize("there", [True, False])
def test_a_node_that_is_ignored_is_no_problem_whether_it_is_there_or_gone(site, there):
    site.learn(*USUAL)
    site.look(20, *(USUAL if there else without("amcl")))
    site.graph = ignoring("amcl")
    site.look(200, *USUAL)
    assert site.names == []
    site.look(200, *without("amcl"))
    assert site.names == []


def test_nodes_that_went_together_are_no_problem_once_all_of_them_are_ignored(site):
    site.learn(*USUAL)
    site.look(40, "diag")
    assert site.problems.keys() == {"nodes"}
    site.graph = ignoring("amcl", "driver", "nav/.*")
    site.look(1, "diag")
    assert site.names == []


def test_a_topic_and_what_an_ignored_node_has_of_one_are_no_problem_any_more(site):
    why = Mismatch("/r/amcl", "/r/driver", "best effort and reliable")
    second = (*CHAT.publishers, Peer("/r/debug", "03" * 16))
    views = {
        "chat": CHAT._replace(mismatches=(why,)),
        "plan": CHAT._replace(publishers=second),
        "map": CHAT._replace(mismatches=(why,)),
        "go": CHAT._replace(publishers=(*second, Peer("/r/driver", "04" * 16))),
    }
    site.learn(*USUAL, chat=CHAT, plan=CHAT, map=CHAT, go=CHAT)
    site.look(70, *USUAL, **views)
    assert site.problems.keys() == {"topic chat", "topic plan", "topic map", "topic go"}
    site.graph = ignoring("debug", "chat")
    site.look(1, *USUAL, **views)
    assert site.names == ["topic go", "topic map"]
    site.graph = ignoring("debug", "chat", "driver")
    site.look(70, *USUAL, **views)
    assert site.names == []


def test_a_node_that_is_expected_no_more_is_no_problem(site):
    site.graph = Graph(mode="on", expect=("never",))
    site.look(70, *USUAL)
    assert site.problems.keys() == {"node never"}
    site.graph = ON
    site.look(1, *USUAL)
    assert site.names == []


# -- robots ------------------------------------------------------------------------------------


def test_in_the_first_week_of_a_robot_it_is_a_shadow(site):
    site.graph = Graph()
    site.look(5)
    site.now = Instant(10 * DAY, WALL + 10 * DAY)  # declared long before it was ever there
    site.look(5, *USUAL)
    assert site.reports[-1].feed == SHADOW
    site.now = Instant(17.1 * DAY, WALL + 17.1 * DAY)
    site.look(60, *USUAL)
    assert site.reports[-1].feed == GRAPH
    site.graph = Graph(mode="shadow")
    site.look(60, *USUAL)
    assert site.reports[-1].feed == SHADOW


def test_a_day_before_silent_faults_notify_by_themselves_it_is_an_event(site):
    site.graph = Graph()
    site.look(5, *USUAL)
    for day in (5.9, 6.1, 6.5, 7.1):
        site.now = Instant(day * DAY, WALL + day * DAY)
        site.look(60, *USUAL)
        assert len(site.events) == (day > 6)
    assert site.events == ["silent faults notify from 2023-11-21 22:13 UTC on (graph.mode: auto)"]


@pytest.mark.parametrize("mode", ["on", "shadow"])
def test_no_other_mode_of_the_graph_begins_to_notify_by_itself(site, mode):
    site.graph = Graph(mode=mode)
    site.look(5, *USUAL)
    site.now = Instant(6.5 * DAY, WALL + 6.5 * DAY)
    site.look(60, *USUAL)
    assert site.events == []


def test_what_is_off_is_not_reported(site):
    site.graph = Graph(mode="off")
    site.look(120, *USUAL)
    assert site.reports == []


def test_a_node_is_of_the_robot_with_the_longest_namespace():
    watch, now = GraphWatch(), Instant(0.0, WALL)
    profile = Profile(graph=Graph(mode="on", learn_after=1.0))
    robots = [
        Robot(name, namespace=namespace, profile=profile)
        for name, namespace in (("root", ""), ("a", "/a"), ("ab", "/a/b"), ("x", "/x"), ("y", "/x"))
    ]
    watch.set_robots(0, robots, now)
    nodes = [("one", "/"), ("one", "/a"), ("one", "/a/c"), ("one", "/a/b/c"), ("one", "/x")]
    watch.see_nodes(0, nodes, now)
    assert [each.robot for each in watch.reports(0, now)] == ["root", "a", "ab"]

    later = Instant(100.0, WALL + 100)
    kept = [("other", "/"), ("other", "/a"), ("one", "/a/b/c")]
    watch.see_nodes(0, kept, later)
    list(watch.reports(0, later))
    later = Instant(200.0, WALL + 200)
    found = {each.robot: [one.name for one in each.statuses] for each in watch.reports(0, later)}
    assert found == {"root": ["node one"], "a": ["node c/one", "node one"], "ab": []}


def test_what_a_person_accepts_is_expected_from_then_on():
    site = Site(Graph())
    why = Mismatch("/r/amcl", "/r/driver", "best effort and reliable")
    views = {"chat": CHAT._replace(mismatches=(why,)), "plan": CHAT}
    site.learn(*USUAL, **views)
    site.look(60, *without("driver"), "new", "amcl", **views)
    assert site.problems.keys() == {"node driver", "node amcl", "topic chat"}
    assert site.watch.accept("r", site.now) == 4  # of amcl there are two
    assert site.watch._robots["r"].learned(site.now).nodes["amcl"] == 0
    usual = [*without("driver"), "new", "amcl"]
    site.look(60, *usual, **views)
    assert (site.problems, site.reports[-1].feed) == ({}, GRAPH)
    site.look(60, *usual[1:], **views)
    assert site.problems.keys() == {"node diag"}

    again = Site(Graph())
    again.now = Instant(0.0, site.now.wall)
    again.watch.restore({"r": site.rows["r"]}, again.now)
    second = (*CHAT.publishers, Peer("/r/new", "03" * 16))
    again.look(130, *usual, **{**views, "plan": CHAT._replace(publishers=second)})
    assert (again.problems.keys(), again.reports[-1].feed) == ({"topic plan"}, GRAPH)

    with pytest.raises(LookupError, match="nothing of robot 'x' was seen in the ROS graph"):
        site.watch.accept("x", site.now)


def test_what_was_learned_outlives_the_process(site):
    site.graph = Graph()
    second = CHAT._replace(publishers=(*CHAT.publishers, Peer("/r/driver", "03" * 16)))
    for _ in range(8):
        site.learn(*USUAL, chat=CHAT)
    site.look(20, *without("amcl"), chat=CHAT)
    assert site.problems.keys() == {"node amcl"}

    again = Site(Graph())
    again.now = Instant(0.0, site.now.wall)
    again.watch.restore({"r": site.rows["r"], "gone": site.rows["r"]}, again.now)
    again.look(20, *without("amcl"), chat=second)
    assert (again.names, again.reports[-1].held) == ([], {"node amcl"})
    again.look(45, *without("amcl"), chat=second)
    assert again.problems.keys() == {"node amcl", "topic chat"}
    assert (again.reports[-1].held, again.reports[-1].feed) == (set(), GRAPH)


def test_what_was_a_problem_before_a_restart_is_well_once_all_is_seen_again(site):
    site.learn(*USUAL)
    site.look(20, *without("amcl"))
    again = Site()
    again.watch.restore({"r": site.rows["r"]}, again.now)
    again.look(119, *USUAL)
    assert (again.names, again.reports[-1].held) == ([], {"node amcl"})
    again.look(40, *USUAL)
    assert (again.names, again.problems) == (["node amcl"], {})


def test_a_robot_that_was_never_there_is_not_written_and_one_that_is_dropped_is_deleted(site):
    site.look(5)
    assert site.rows == {}
    site.look(5, *USUAL)
    assert site.rows.keys() == {"r"}
    site.watch.set_robots(0, [], site.now)
    assert dict(site.watch.take_rows((), site.now)) == {"r": None}


def test_rows_of_robots_that_never_come_back_are_deleted_an_hour_after_the_start(site):
    site.learn(*USUAL)
    again = Site()
    again.known = {"r", "late"}
    again.watch.restore(dict.fromkeys(("r", "late", "renamed"), site.rows["r"]), again.now)
    again.look(CLAIMED - 1, *USUAL)
    assert again.rows.keys() == {"r"}
    again.look(2, *USUAL)
    assert again.rows == {"r": again.rows["r"], "renamed": None}


def test_the_robots_of_a_domain_that_is_left_are_dropped(site):
    site.learn(*USUAL)
    assert site.watch.configure([1]) == []
    assert dict(site.watch.take_rows((), site.now)) == {"r": None}
    assert [each.expected for each in site.watch.reports(1, site.now)] == [None]


# -- rows --------------------------------------------------------------------------------------

TEXT = st.text(st.characters(exclude_categories=("Cs",)), max_size=2000)
LONG = TEXT.map(lambda text: text + "x" * 250) | TEXT
NAMES = st.lists(LONG.map(lambda text: text.replace("/", "_") or "x"), max_size=4)
MESSAGES = st.one_of(
    st.builds(Log, st.just("r.amcl"), LONG),
    st.builds(Transition, st.sampled_from(["errorprocessing", "active"]), LONG),
    st.just(Transition("errorprocessing", "unconfigured")),
)


@st.composite
def views(draw) -> TopicView:
    peers = st.lists(st.builds(Peer, LONG, st.just("01" * 16)), max_size=120).map(tuple)
    mismatches = st.lists(st.builds(Mismatch, LONG, LONG, LONG), max_size=10).map(tuple)
    return TopicView(draw(peers), draw(peers), draw(mismatches))


@settings(max_examples=150, deadline=None)
@given(nodes=NAMES, topics=st.dictionaries(LONG, views(), max_size=3), messages=MESSAGES)
def test_every_row_that_is_written_can_be_read(nodes, topics, messages):
    watch = Watched(logs=True, log_faults=(re.compile("(?s).*"),), transitions=True)
    site = Site(Graph(mode="on", learn_after=1.0, watch=watch))
    gone = (*USUAL, *nodes)
    site.look(70, *gone, **topics)
    for topic in ("/rosout", "/r/amcl/transition_event"):
        site.watch.see_message(0, topic, messages, site.now)
    site.look(40, "diag", **topics)
    site.watch.accept("r", site.now)
    site.look(1, "diag", **topics)
    (row,) = site.rows.values()
    read, wrong = parse(json.loads(json.dumps([[LEARNED, ["r"], row]])))
    assert wrong == []
    again = Site(site.graph)
    again.watch.restore({"r": read[0].fields}, again.now)
    again.look(1, "diag")
    assert again.rows.keys() == {"r"}


def test_what_a_person_accepts_of_twelve_publishers_can_be_read(site):
    drivers = ", ".join(f"/r/a_driver_with_a_long_name_{number}" for number in range(12))
    why = Mismatch(drivers, US, "by reliability")
    site.learn(*USUAL, diagnostics=CHAT._replace(mismatches=(why,)))
    site.look(70, *USUAL, diagnostics=CHAT._replace(mismatches=(why,)))
    assert site.problems.keys() == {"topic diagnostics"}
    site.watch.accept("r", site.now)
    site.look(70, *USUAL, diagnostics=CHAT._replace(mismatches=(why,)))
    assert site.problems == {}
    _read, wrong = parse([[LEARNED, ["r"], site.rows["r"]]])
    assert wrong == []
