"""Silent faults through the state: faults, shadow mode, lost messages, restarts."""

import re
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.conditions import Condition
from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Fleet,
    Profile,
    Query,
    Robot,
    Source,
)
from ros_diagnostics_exporter.config.graph import Graph, Watched
from ros_diagnostics_exporter.model import Endpoint, Instant, Status
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.sources.graph_messages import Log, Transition
from ros_diagnostics_exporter.sources.link import LinkReading
from ros_diagnostics_exporter.storage.storage import Storage
from support.state_driver import ERROR, OK, STALE, StateDriver

MOTOR = Status(OK, "Motor", "OK")
LOSSY, WELL = LinkReading(100, 40, 0.5, 0.1), LinkReading(100, 0, 0.25, 0.01)
USUAL = ("diag", "amcl")


def fleet(**graph) -> Fleet:
    profile = Profile(graph=Graph(**{"mode": "on", "learn_after": 60.0, **graph}))
    settings = {"namespace": "/r", "topic_raw": "/r/diagnostics", "source": Source.RAW}
    return Fleet("f", (Robot("r", profile=profile, **settings),))


class Driver(StateDriver):
    """One robot, whose graph is looked at once a second."""

    link: LinkReading | None = WELL

    def go_on(self, seconds: float, *nodes: str, statuses=(MOTOR,)):
        for _ in self.seconds(seconds):
            if statuses:
                self.raw(*statuses)
            self.state.update_links(0, {"/r/diagnostics": self.link}, self.now)
            self.state.update_nodes(0, [(each, "/r") for each in nodes], self.now)
        return self


def test_a_node_that_is_gone_is_a_fault_of_its_robot_until_it_is_back():
    driver = Driver(fleet=fleet())
    assert driver.go_on(5, *USUAL).sample("robot_expected_nodes") == 0
    assert [each.name for each in driver.go_on(65, *USUAL).robot.components] == ["Motor"]
    driver.go_on(14, "diag")
    assert (driver.faults(), driver.component("node amcl").group) == ([], "ROS graph")
    assert driver.go_on(4, "diag").faults() == [("node amcl", "critical")]
    assert driver.sample("robot_expected_nodes") == 2
    assert (driver.go_on(2, *USUAL).faults(), driver.level("node amcl")) == ([], OK)
    assert [each.name for each in driver.go_on(3700, *USUAL).robot.components] == ["Motor"]


def test_a_shadow_is_shown_and_no_fault_until_it_is_none():
    driver = Driver(fleet=fleet(mode="auto")).go_on(70, *USUAL)
    component = driver.go_on(60, "diag").component("node amcl")
    assert (component.level, component.suppressed_because) == (
        ERROR,
        "shadow mode (graph in fleet.yml)",
    )
    assert driver.sample("component_level", component="node amcl") == ERROR
    assert driver.sample("component_state", component="node amcl") is None
    assert driver.faults() == []
    driver.configure(fleet(mode="auto", learn_after=61.0))
    assert driver.go_on(60, "diag").faults() == []

    driver.configure(fleet(mode="on"))
    driver.go_on(45, "diag")
    assert (driver.faults(), component.suppressed_because) == ([("node amcl", "critical")], "")
    driver.configure(fleet(mode="on", learn_after=61.0))
    assert driver.go_on(45, "diag").faults() == [("node amcl", "critical")]
    assert not [each for each in driver.events if each.kind == "fault_ended"]


def test_what_is_not_received_is_no_fault_while_too_many_messages_are_lost():
    other = Status(OK, "Laser", "OK")
    driver = Driver(fleet=fleet())
    driver.go_on(70, *USUAL, statuses=(MOTOR, other))
    driver.link = LOSSY
    driver.go_on(60, *USUAL)
    assert (driver.level("Laser"), driver.faults()) == (STALE, [("link", "critical")])
    driver.link = WELL
    assert driver.go_on(20, *USUAL).faults() == [("Laser", "stale")]
    driver.link = LOSSY
    assert driver.go_on(20, *USUAL).faults() == [("Laser", "stale"), ("link", "critical")]


@pytest.mark.parametrize("was_late", [False, True])
def test_what_the_robot_itself_reports_as_stale_is_a_fault_also_while_messages_are_lost(was_late):
    laser = Status(OK, "Laser", "OK")
    driver = Driver(fleet=fleet())
    driver.go_on(70, *USUAL, statuses=(MOTOR, laser))
    driver.link = LOSSY
    driver.go_on(30 if was_late else 1, *USUAL)
    driver.go_on(30, *USUAL, statuses=(MOTOR, laser._replace(level=STALE)))
    assert set(driver.faults()) == {("Laser", "stale"), ("link", "critical")}


@pytest.mark.parametrize("how", ["planned", "its `when` is not known", "messages are lost"])
def test_what_is_not_received_after_an_error_does_not_hide_what_depends_on_it(how):
    """A board that says ERROR for three seconds before it is off, and a lidar that then fails."""
    mode = Status(OK, "Mode", values=(("mode", "auto"),))
    is_auto = Condition(
        component=(Pattern("Mode"),), key=(Pattern("mode"),), texts=(Pattern("auto"),)
    )
    rules = {"planned": {"planned_stale": True}, "its `when` is not known": {"when": (is_auto,)}}
    board_rule = ComponentRule(pattern=Pattern("Board"), **rules.get(how, {}))
    lidar_rule = ComponentRule(pattern=Pattern("Lidar"), depends_on=(Pattern("Board"),))
    used = fleet()
    profile = replace(used.robots[0].profile, components=(board_rule, lidar_rule))
    driver = Driver(fleet=replace(used, robots=(replace(used.robots[0], profile=profile),)))
    board, lidar = Status(OK, "Board"), Status(OK, "Lidar")
    driver.go_on(60, *USUAL, statuses=(MOTOR, mode, board, lidar))
    if how == "messages are lost":
        driver.link = LOSSY
    driver.go_on(3, *USUAL, statuses=(MOTOR, mode, board._replace(level=ERROR), lidar))
    assert driver.go_on(20, *USUAL, statuses=(MOTOR, lidar)).level("Board") == STALE
    driver.go_on(15, *USUAL, statuses=(MOTOR, lidar._replace(level=ERROR)))
    assert ("Lidar", "critical") in driver.faults()
    assert not [name for name, _state in driver.faults() if name == "Board"]


def test_what_reports_only_changes_does_not_end_while_messages_are_lost():
    """What its driver repeats may be lost; afterwards it has its time to be repeated."""
    rule = ComponentRule(pattern=Pattern("Gripper"), reports="on_change", ends_after=60.0)
    used = fleet()
    profile = replace(used.robots[0].profile, components=(rule,))
    driver = Driver(fleet=replace(used, robots=(replace(used.robots[0], profile=profile),)))
    driver.go_on(20, *USUAL)
    driver.go_on(1, *USUAL, statuses=(MOTOR, Status(ERROR, "Gripper")))
    driver.go_on(20, *USUAL)
    driver.link = LOSSY
    driver.go_on(300, *USUAL)
    driver.link = WELL
    assert driver.go_on(50, *USUAL).faults() == [("Gripper", "critical")]
    assert driver.go_on(15, *USUAL).faults() == []


def test_a_link_that_loses_messages_suppresses_nothing_in_shadow():
    driver = Driver(fleet=fleet(mode="shadow"))
    driver.go_on(70, *USUAL, statuses=(MOTOR, Status(OK, "Laser", "OK")))
    driver.link = LOSSY
    assert driver.go_on(60, *USUAL).level("link") == ERROR
    assert driver.faults() == [("Laser", "stale")]


def test_what_a_person_forgets_or_accepts_is_no_fault_any_more():
    driver = Driver(fleet=fleet()).go_on(70, *USUAL, "driver", "lift")
    driver.go_on(30, "diag")
    found = [("node amcl", "critical"), ("node driver", "critical"), ("node lift", "critical")]
    assert driver.faults() == found
    assert driver.state.forget("r", "node amcl", driver.now) == 1
    assert driver.go_on(60, "diag").faults() == found[1:]
    assert driver.state.accept_graph("r", driver.now) == 1
    assert driver.go_on(60, "diag").faults() == []
    assert {each.reason for each in driver.events if each.kind == "fault_ended"} == {
        "removed",
        "recovered",
    }


def test_how_messages_arrive_is_served_while_it_is_known():
    driver = Driver(fleet=fleet())
    driver.link = LOSSY
    assert driver.go_on(5, *USUAL).sample("robot_link_lost_ratio") == 0.4
    assert driver.sample("robot_link_delay_seconds") == 0.5
    assert driver.sample("robot_link_jitter_seconds") == 0.1
    driver.link = None
    assert driver.go_on(5, *USUAL).sample("robot_link_lost_ratio") is None


def test_a_fault_and_what_was_learned_outlive_a_restart(tmp_path: Path):
    driver = Driver(fleet=fleet()).go_on(70, *USUAL)
    assert driver.go_on(30, "diag").faults() == [("node amcl", "critical")]
    driver.keep(tmp_path / "state.db").close()
    again = Driver(fleet=fleet())
    with closing(Storage(tmp_path / "state.db")) as storage:
        storage.load(again.state, again.now)
    assert again.go_on(300, "diag").faults() == [("node amcl", "critical")]
    assert not [each for each in again.events if each.kind == "fault_ended"]
    assert again.go_on(5, *USUAL).faults() == []


def test_while_no_node_is_seen_after_a_restart_none_that_is_gone_is_back(tmp_path: Path):
    driver = Driver(fleet=fleet()).go_on(70, *USUAL)
    driver.go_on(30, "diag")
    again = restarted(driver, fleet(), tmp_path / "state.db", 5)
    assert again.go_on(1200).faults() == [("node amcl", "critical")]
    assert again.go_on(400, "diag").faults() == [("node amcl", "critical")]
    assert ended(again) == []
    assert again.go_on(5, *USUAL).faults() == []


WATCHED = Watched(logs=True, log_faults=(re.compile("out of memory"),), log_ends_after=1000.0)


def restarted(driver: Driver, site: Fleet, path: Path, away: float) -> Driver:
    """Another process that goes on from the database of the first after so many seconds."""
    driver.keep(path).close()
    again = Driver(fleet=site).at(driver.now.mono + away)
    with closing(Storage(path)) as storage:
        storage.load(again.state, again.now)
    return again


def ended(driver: Driver) -> list[str]:
    return [each.component for each in driver.events if each.kind == "fault_ended"]


def test_what_was_logged_or_fell_neither_ends_nor_begins_anew_with_a_restart(tmp_path: Path):
    driver = Driver(fleet=fleet(watch=WATCHED)).go_on(5, *USUAL)
    driver.state.receive_watched(0, "/rosout", Log("r.amcl", "out of memory"), driver.now)
    fell = Transition("errorprocessing", "unconfigured")
    driver.state.receive_watched(0, "/r/diag/transition_event", fell, driver.now)
    driver.go_on(50, *USUAL)
    both = [("lifecycle diag", "critical"), ("log amcl", "critical")]
    assert driver.faults() == both
    again = restarted(driver, fleet(watch=WATCHED), tmp_path / "state.db", 2000)
    assert (again.go_on(940, *USUAL).faults(), ended(again)) == (both, [])
    began = [each.component for each in again.events if each.kind == "fault_began"]
    assert "log amcl" not in began
    assert (again.go_on(100, *USUAL).faults(), ended(again)) == (both[:1], ["log amcl"])


def taken_over(driver: Driver) -> Driver:
    """Another process that has no database, and goes on with the faults that fire."""
    again = Driver(fleet=driver.state.fleet)
    again.now = Instant(0.0, driver.now.wall + 5)
    again.state.adopt(driver.state.faults(), again.now)
    return again


@pytest.mark.parametrize(("mode", "gone"), [("on", 1), ("on", 4), ("auto", 1)])
def test_without_its_database_a_node_that_is_gone_is_a_fault_until_it_is_back(mode, gone):
    names = ("diag", "amcl", "a", "b", "c")
    driver = Driver(fleet=fleet(mode="on")).go_on(70, *names)
    faults = driver.go_on(60, *names[:1], *names[1 + gone :]).faults()
    assert faults == [("nodes" if gone > 3 else "node amcl", "critical")]

    driver.state.configure(fleet(mode=mode), driver.now)
    again = taken_over(driver)
    assert again.go_on(400, *names[:1], *names[1 + gone :]).faults() == faults
    assert again.go_on(5, *names).faults() == []


def test_without_its_database_what_was_logged_or_fell_is_a_fault_until_it_is_over():
    driver = Driver(fleet=fleet(watch=WATCHED)).go_on(5, *USUAL)
    driver.state.receive_watched(0, "/rosout", Log("r.amcl", "out of memory"), driver.now)
    for node, start, goal in (("diag", "errorprocessing", "finalized"), ("amcl", "", "activating")):
        topic = f"/r/{node}/transition_event"
        driver.state.receive_watched(0, topic, Transition(start, goal), driver.now)
    faults = driver.go_on(60, *USUAL).faults()
    assert faults == [
        (f"{each}", "critical") for each in ("lifecycle amcl", "lifecycle diag", "log amcl")
    ]

    again = taken_over(driver)
    assert again.go_on(900, *USUAL).faults() == faults
    for node in USUAL:
        topic = f"/r/{node}/transition_event"
        again.state.receive_watched(0, topic, Transition("activating", "active"), again.now)
    assert again.go_on(5, *USUAL).faults() == faults[2:]
    assert again.go_on(200, *USUAL).faults() == []


def test_a_log_fault_does_not_end_while_its_robot_is_silent():
    driver = Driver(fleet=fleet(watch=WATCHED)).go_on(5, *USUAL)
    driver.state.receive_watched(0, "/rosout", Log("r.amcl", "out of memory"), driver.now)
    driver.go_on(50, *USUAL)
    driver.go_on(5000, statuses=())
    driver.go_on(960, *USUAL)  # of which the first minute does not count
    assert ("log amcl", "critical") in driver.faults()
    assert "log amcl" not in ended(driver)
    driver.go_on(100, *USUAL)
    assert "log amcl" in ended(driver)


def test_what_the_config_ignores_is_no_fault_any_more_also_of_a_robot_that_is_off():
    driver = Driver(fleet=fleet()).go_on(70, *USUAL)
    driver.go_on(30, "diag")
    assert ("node amcl", "critical") in driver.go_on(60, statuses=()).faults()
    driver.configure(fleet(ignore=(re.compile("amcl"),)))
    assert ("node amcl", "critical") not in driver.go_on(2, statuses=()).faults()
    ends = [each for each in driver.events if each.kind == "fault_ended"]
    assert [(each.component, each.reason) for each in ends] == [("node amcl", "removed")]


@pytest.mark.parametrize("mode", ["auto", "shadow"])
def test_what_the_config_asks_for_is_a_fault_of_a_shadow_too(mode):
    watch = Watched(logs=True, log_faults=WATCHED.log_faults, transitions=True)
    driver = Driver(fleet=fleet(mode=mode, watch=watch)).go_on(70, *USUAL)
    driver.state.receive_watched(0, "/rosout", Log("r.diag", "out of memory"), driver.now)
    fell = Transition("errorprocessing", "finalized")
    driver.state.receive_watched(0, "/r/diag/transition_event", fell, driver.now)
    driver.go_on(40, "diag")
    found = ["lifecycle diag", "log diag"]
    assert sorted(driver.faults()) == [(each, "critical") for each in found]
    shown = {each.name: each.suppressed_because for each in driver.robot.components}
    shadow = {"node amcl": "shadow mode (graph in fleet.yml)"}
    assert shown == {"Motor": "", **dict.fromkeys(found, ""), **shadow}


def test_a_robot_of_another_domain_and_one_that_is_not_watched_are_left_alone():
    driver = Driver(fleet=fleet())
    assert driver.state.update_nodes(0, [("amcl", "/r")], driver.now)
    assert not driver.state.update_nodes(1, [("amcl", "/r")] * 2, driver.now)
    driver = Driver(fleet=fleet(mode="off"))
    assert not driver.state.update_nodes(0, [("amcl", "/r")], driver.now)
    assert len(driver.robot.components) == 0


@pytest.mark.parametrize(("behind", "where"), [(90.0, "behind"), (-90.0, "ahead of")])
def test_without_stamps_the_clock_is_judged_by_the_link(behind, where):
    driver = Driver(fleet=fleet())
    driver.link = WELL._replace(behind=behind)
    assert driver.go_on(90, *USUAL).sample("robot_link_clock_offset_seconds") == behind
    [fault] = driver.state.faults()
    assert fault.identity.state.value == "clock"
    assert fault.evidence == f"its clock is 90 s {where} the exporter's"


def test_of_a_robot_that_is_not_watched_any_more_nothing_of_the_graph_is_left():
    driver = Driver(fleet=fleet()).go_on(70, *USUAL, statuses=(MOTOR, Status(OK, "Laser", "OK")))
    driver.go_on(30, "diag")
    driver.link = LOSSY
    driver.go_on(60, "diag")
    assert {each for each, _state in driver.faults()} == {"Laser", "link", "node amcl"}
    driver.configure(fleet(mode="off"))
    assert [each.name for each in driver.go_on(5, "diag").robot.components] == ["Motor", "Laser"]
    assert driver.faults() == [("Laser", "stale")]
    assert driver.sample("robot_expected_nodes") is None
    driver.go_on(60, "diag", statuses=(Status(OK, "Laser", "OK"),))
    assert driver.faults() == [("Motor", "stale")]  # lost messages are no reason any more


def test_a_publisher_that_cannot_be_matched_is_why_a_robot_is_silent():
    driver = Driver(fleet=fleet())
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1, refused="DURABILITY")}, driver.now)
    assert driver.sample("robot_silent_reason", reason="incompatible_qos") == 1
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    assert driver.sample("robot_silent_reason", reason="mute") == 1


def test_what_a_node_logged_is_a_fault_also_while_the_uplink_of_its_robot_does_not_answer():
    """Messages of the robot are received, so it is no measurement that fails in its place."""
    ping = Query("x", "ping", "Uplink", "robot", interval=5.0, confirm_after=20.0, uplink=True)
    used = fleet(watch=WATCHED)
    robot = replace(used.robots[0], labels={"uplink": "ap"})
    driver = Driver(
        fleet=replace(used, robots=(robot, Robot("ap", source=Source.QUERIES)), queries=(ping,))
    )
    driver.go_on(5, *USUAL)
    for _ in range(10):
        driver.state.receive_answer(ping.feed, {"ap": (Status(ERROR, "ping"),)}, driver.now)
        driver.go_on(5, *USUAL)
    driver.state.receive_watched(0, "/rosout", Log("r.amcl", "out of memory"), driver.now)
    assert driver.go_on(20, *USUAL).faults() == [("log amcl", "critical"), ("ping", "critical")]
