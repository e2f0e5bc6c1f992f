"""Components that a query of Prometheus measures, beside what the robot publishes."""

from dataclasses import replace
from pathlib import Path

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import Discovery, Fleet, Profile, Query, Robot, Source
from ros_diagnostics_exporter.model import Endpoint, Status
from ros_diagnostics_exporter.severity import state_of
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver, tree

MOTOR = Status(OK, "Motor", "OK")
DISK, FULL = Status(OK, "disk", "50 %"), Status(ERROR, "disk", "95 %, above 90")
QUERY = Query("x", "disk", robot="robot", stale_after=60.0, confirm_after=20.0)
ROBOT = Robot("r", topic_agg="/r/diagnostics_agg", topic_raw="/r/diagnostics", profile=Profile())
ABSENT = 2 * 60.0  # seconds that are enough for an absent component to be a fault


class Driver(StateDriver):
    """One robot that a query measures every 15 s."""

    def __init__(self, source: Source = Source.RAW, query: Query = QUERY) -> None:
        fleet = Fleet("f", (replace(ROBOT, source=source),), queries=(query,))
        super().__init__(fleet=fleet)

    def answer(self, *statuses: Status) -> None:
        self.state.receive_answer(
            self.state.fleet.queries[0].feed, {"r": statuses} if statuses else {}, self.now
        )

    def pass_to(self, end: float, *statuses: Status, ros: bool = True, answers: bool = True):
        """Let both feeds go on until then."""
        while self.now.mono < end:
            second = int(self.now.mono)
            if ros:
                self.raw(MOTOR)
            if answers and second % 15 == 0:
                self.answer(*statuses)
            self.at(second + 1)
        return self


@pytest.fixture
def driver() -> Driver:
    return Driver()


def test_it_is_a_component_of_the_robot_and_a_fault_after_the_querys_time(driver):
    driver.pass_to(30, DISK)
    driver.pass_to(49, FULL)
    assert (driver.component("disk").group, driver.level("disk")) == ("Host", ERROR)
    assert driver.faults() == []
    assert driver.pass_to(51, FULL).faults() == [("disk", "critical")]
    labels = {"fleet": "f", "robot": "r", "component": "disk", "group": "Host"}
    assert driver.sample("component_level", **labels) == ERROR
    assert driver.pass_to(61, DISK).faults() == []


def test_its_answers_do_not_make_a_robot_up_and_their_absence_does_not_make_it_silent(driver):
    driver.answer(FULL)
    assert not driver.at(1).robot.up
    assert driver.level("disk") == ERROR

    assert driver.pass_to(30, DISK).robot.up
    assert driver.pass_to(300, answers=False).robot.up

    driver.answer(FULL)
    assert not driver.pass_to(320, ros=False, answers=False).robot.up
    assert (driver.level("Motor"), driver.level("disk")) == (STALE, ERROR)
    assert driver.faults() == [("", "silent")]
    assert driver.at(400).level("disk") == STALE


def test_while_prometheus_does_not_answer_it_is_stale_and_nothing_begins_or_ends(driver):
    assert driver.pass_to(40, FULL).faults() == [("disk", "critical")]
    assert driver.pass_to(40 + ABSENT, answers=False).level("disk") == STALE
    assert driver.faults() == [("disk", "critical")]

    well = Driver().pass_to(30, DISK)
    assert (well.pass_to(30 + 3600, answers=False).level("disk"), well.faults()) == (STALE, [])
    well.answer(DISK)
    assert well.level("disk") == OK


def test_what_an_answer_lacks_is_a_stale_component(driver):
    driver.pass_to(30, DISK)
    assert driver.pass_to(30 + 60).faults() == []
    driver.pass_to(30 + ABSENT)
    assert (driver.level("disk"), driver.faults()) == (STALE, [("disk", "stale")])
    assert driver.pass_to(30 + ABSENT + 20, DISK).faults() == []


def test_a_stale_that_is_planned_is_no_fault_and_ends_none():
    driver = Driver(query=replace(QUERY, planned_stale=True)).pass_to(30, DISK)
    assert (driver.pass_to(30 + ABSENT).level("disk"), driver.faults()) == (STALE, [])
    driver.pass_to(200, FULL)
    driver.pass_to(200 + ABSENT)
    assert (driver.level("disk"), driver.faults()) == (STALE, [("disk", "critical")])


def test_what_has_no_ros_is_up_once_it_is_measured_and_never_silent(tmp_path: Path):
    server = Robot("r", source=Source.QUERIES).completed({})
    driver = Driver(query=QUERY)
    driver.configure(Fleet("f", (server,), queries=(QUERY,)))
    assert driver.state.fleet.domain_ids == ()
    driver.answer()
    assert not driver.robot.up
    assert driver.at(1000).faults() == [("", "pending")]

    driver.answer(DISK)
    assert (driver.at(1001).robot.up, driver.faults()) == (True, [])
    driver.at(3000)  # Prometheus is away
    assert (driver.robot.up, driver.level("disk"), driver.faults()) == (True, STALE, [])
    driver.answer()  # and the server is not measured
    assert (driver.at(3100).robot.up, driver.faults()) == (True, [("disk", "stale")])

    driver.keep(tmp_path / "db")
    again = driver.restart(tmp_path / "db")
    assert (again.at(100).robot.up, [each.identity.component for each in again.state.faults()]) == (
        True,
        ["disk"],
    )
    again.close()


def test_an_aggregator_that_does_not_list_it_says_nothing_of_it():
    driver = Driver(Source.AGG).agg(*tree(Drive=[MOTOR]))
    driver.answer(DISK)
    assert driver.agg(*tree(Drive=[MOTOR], Power=[Status(OK, "Battery", "OK")])).level("disk") == OK
    driver.agg(*tree(Host=[Status(WARN, "disk", "mine")]))
    found = [(each.group, each.level) for each in driver.robot.components if each.name == "disk"]
    assert found == [("Host", OK), ("/Host", WARN)]


def test_after_a_restart_it_is_the_same_component_and_no_fault_for_want_of_an_answer(
    driver, tmp_path: Path
):
    driver.pass_to(40, FULL)
    driver.keep(tmp_path / "db")
    again = driver.restart(tmp_path / "db")
    try:
        again.raw_every(1, 300, MOTOR)  # the robot is back, Prometheus is not
        found = [each.identity.component for each in again.state.faults()]
        assert (again.level("disk"), found) == (STALE, ["disk"])
        again.state.receive_answer(QUERY.feed, {"r": [DISK]}, again.now)
        assert again.raw(MOTOR).level("disk") == OK
        assert again.state.faults() == []
        assert len(again.robot.components) == 2
    finally:
        again.close()


def test_a_query_that_is_taken_out_takes_its_components_and_their_faults_with_it(driver):
    driver.pass_to(40, FULL)
    old = QUERY.feed
    driver.configure(queries=())
    assert [each.name for each in driver.robot.components] == ["Motor"]
    assert driver.faults() == []
    driver.state.receive_answer(old, {"r": [FULL]}, driver.now)  # which was under way
    assert [each.name for each in driver.robot.components] == ["Motor"]


def test_it_does_not_keep_a_robot_that_never_published(driver):
    fleet = driver.state.fleet
    discovery = Discovery(template="/{robot}/diagnostics").completed({})
    found = StateDriver(fleet=replace(fleet, robots=(), discoveries=(discovery,)))
    found.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, found.now)
    found.state.update_graph(0, {}, found.now)
    feed = QUERY.feed
    for hour in range(30):
        found.state.receive_answer(feed, {"r": [DISK]}, found.now)
        found.now = found.now._replace(mono=3600.0 * hour)
        found.state.tick(found.now)
    assert not found.state.robots


def test_a_robot_is_ok_while_what_a_query_measures_is_stale_as_planned():
    driver = Driver(query=replace(QUERY, planned_stale=True)).pass_to(40, DISK).pass_to(150)
    assert (driver.level("disk"), driver.faults()) == (STALE, [])
    assert driver.sample("robot_state") == 0
    assert driver.sample("component_planned_stale", component="disk") == 1
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    assert state_of(robot) == "OK"
