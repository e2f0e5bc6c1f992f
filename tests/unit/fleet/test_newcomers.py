"""Robots that somebody invents: some are found, none is kept for long, none is a fault."""

import re
from dataclasses import replace
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter.config.fleet import Discovery, Fleet, Limits, Source
from ros_diagnostics_exporter.fleet import registry
from ros_diagnostics_exporter.fleet.newcomers import _is_gone
from ros_diagnostics_exporter.model import Array, Endpoint, Status, Topic
from support.configs import load_text
from support.state_driver import ERROR, OK, StateDriver

PATTERN = re.compile(r"/(?P<robot>[^/]+)/diagnostics")
FLEET = Fleet("f", discoveries=(Discovery(PATTERN, "/{robot}/diagnostics"),))
TRUE = tuple(f"true_{number}" for number in range(5))


def topic(name: str) -> Topic:
    return Topic(0, f"/{name}/diagnostics")


class Playing:
    """Five true robots, and what else is there at a second."""

    def __init__(self, fleet: Fleet = FLEET, seconds: int = 125) -> None:
        self.driver = StateDriver(fleet=fleet)
        self.play(0, seconds)

    def play(
        self, begin: int, end: int, *names: str, level: int = OK, publishing: tuple[str, ...] = ()
    ):
        driver = self.driver
        for second in range(begin, end):
            driver.at(float(second))
            graph = {topic(name).name: Endpoint(1) for name in (*TRUE, *names, *publishing)}
            driver.state.update_graph(0, graph, driver.now)
            for name in (*TRUE, *names):
                if name in driver.state.robots:
                    shown = level if name in names else OK
                    array = Array(driver.now.wall, (Status(shown, f"Motor of {name}"),))
                    driver.state.receive(topic(name), array, driver.now)
        return self

    def invented(self) -> list[str]:
        return [name for name in self.driver.state.robots if name not in TRUE]

    def faults(self) -> list[str]:
        return [each.robot for each in self.driver.events if each.kind == "fault_began"]


def test_seven_invented_robots_a_second_do_not_become_a_fleet():
    playing = Playing()
    for second in range(125, 425):
        playing.play(second, second + 1, *(f"x{second}_{n}" for n in range(7)))

    assert 50 <= len(playing.invented()) <= 50 + 50 * 300 // 600 + 1
    assert playing.driver.state.rejected["new_robots"] > 1_800
    assert all(playing.driver.state.robots[name].up for name in TRUE)

    assert playing.play(425, 425 + 620).invented() == []
    assert playing.faults() == []


def test_robots_that_are_invented_right_after_the_start_are_limited_once_many_are_gone():
    playing = Playing(seconds=5)
    for second in range(5, 305):
        playing.play(second, second + 1, *(f"x{second}_{n}" for n in range(7)))

    assert len(playing.invented()) <= 50 + 7 * 12 + 50 * 300 // 600
    assert all(playing.driver.state.robots[name].up for name in TRUE)
    assert playing.play(305, 305 + 620).invented() == []
    assert playing.faults() == []


@pytest.mark.parametrize(
    ("source", "shared", "received", "is_up", "publishers", "gone"),
    [
        (Source.AUTO, False, 3.0, True, 0, True),
        (Source.AUTO, False, 3.0, False, 1, False),
        (Source.NONE, False, None, False, 0, False),  # it is found, and not received yet
        (Source.NONE, False, 3.0, True, 0, False),
        (Source.NONE, False, 3.0, False, 0, True),
        (Source.AUTO, True, 3.0, True, 0, False),
    ],
)
def test_a_robot_is_gone_when_nobody_publishes_as_it(  # noqa: PLR0917
    source, shared, received, is_up, publishers, gone
):
    robot: Any = SimpleNamespace(
        settings=SimpleNamespace(source=source),
        shared=shared,
        last_mono=received,
        up=is_up,
        network=SimpleNamespace(publishers=publishers),
    )
    assert _is_gone(robot) is gone


def test_robots_of_an_earlier_process_that_are_off_do_not_end_the_start(tmp_path):
    playing = Playing(replace(FLEET, limits=Limits(new_robots=2))).play(125, 195, "a", "b")
    playing.play(500, 570, "c")
    playing.driver = playing.driver.again(tmp_path / "db")
    assert not playing.play(0, 60).driver.state.robots["a"].up
    assert len(playing.play(60, 65, *(f"new_{number}" for number in range(10))).invented()) == 13


def test_a_fleet_that_is_found_at_the_start_is_not_limited():
    driver = StateDriver(fleet=FLEET)
    found = {topic(f"r{number}").name: Endpoint(1) for number in range(1_000)}
    found |= {f"{name}_agg": Endpoint(1) for name in found}
    for second in range(5):
        driver.at(float(second))
        driver.state.update_graph(0, found, driver.now)
        assert len(driver.state.robots) == 200 * (second + 1)  # the next ones once these publish
        assert driver.state.unclaimed == []
        for name in driver.state.robots:
            driver.state.receive(topic(name), Array(0.0, (Status(OK, "Motor"),)), driver.now)
    assert not any(driver.state.rejected.values())


def test_robots_that_never_publish_are_few_at_once_and_take_turns(monkeypatch):
    monkeypatch.setattr(registry, "MOST_ANNOUNCED", 3)
    playing = Playing(seconds=20)
    mute = tuple(f"mute_{number}" for number in range(7))
    assert playing.play(20, 30, publishing=mute).invented() == ["mute_0", "mute_1", "mute_2"]
    assert playing.play(30, 115, publishing=mute).invented() == ["mute_3", "mute_4", "mute_5"]
    assert all(playing.driver.state.robots[name].up for name in TRUE)


def test_while_as_many_wait_as_may_what_else_is_offered_is_not_looked_through():
    driver = StateDriver(fleet=FLEET)
    offered = {topic(f"mute_{number}").name: Endpoint(1) for number in range(300)}
    driver.state.update_graph(0, offered, driver.now)
    again = Mock(wraps=offered)
    driver.state.update_graph(0, again, driver.now)
    assert len(driver.state.robots) == 200
    assert not again.items.called


def test_the_rate_is_settable_and_a_rejected_robot_is_found_later():
    playing = Playing(replace(FLEET, limits=Limits(new_robots=2)))
    names = ("a", "b", "c")
    assert len(playing.play(125, 126, *names).invented()) == 2
    assert sorted(playing.play(126, 126 + 310, *names).invented()) == ["a", "b", "c"]


def test_a_look_at_the_graph_ends_where_very_many_are_rejected(monkeypatch):
    monkeypatch.setattr(registry, "MAX_REJECTED", 100)
    driver = StateDriver(fleet=replace(FLEET, limits=Limits(robots=50)))
    offered = {topic(f"x{number}").name: Endpoint(1) for number in range(5_000)}
    driver.state.update_graph(0, offered, driver.now)
    assert len(driver.state.robots) == 50
    assert driver.state.rejected["robot_limit"] == 100


def test_newcomers_may_have_half_of_the_series_and_leave_the_others_to_those_that_are_known():
    playing = Playing(replace(FLEET, limits=Limits(series=1_000)))
    assert len(playing.play(125, 140, *(f"x{n}" for n in range(40))).invented()) == 20
    assert playing.driver.state.rejected["series_limit"] > 0
    many = tuple(Status(OK, f"Part {number}") for number in range(50))
    array = Array(playing.driver.now.wall, many)
    playing.driver.state.receive(topic(TRUE[0]), array, playing.driver.now)
    assert not any(playing.driver.state.robots[TRUE[0]].rejected.values())
    assert playing.play(140, 140 + 620).invented() == []


@pytest.mark.parametrize(("seconds", "level"), [(70, OK), (30, ERROR)])
def test_a_newcomer_that_was_received_for_a_minute_or_had_a_fault_stays(seconds, level):
    playing = Playing().play(125, 125 + seconds, "new", level=level)
    assert playing.play(125 + seconds, 1_000).invented() == ["new"]
    assert "new" in playing.faults()


def test_a_newcomer_that_is_silent_while_its_publisher_is_there_is_a_fault():
    playing = Playing().play(125, 140, "new")
    assert "new" in playing.play(140, 200, publishing=("new",)).faults()


def test_a_robot_that_an_earlier_process_knew_is_no_newcomer(tmp_path):
    playing = Playing().play(125, 140, "new")
    playing.driver = playing.driver.again(tmp_path / "db")
    assert "new" in playing.play(0, 100).faults()


def test_a_robot_that_a_shared_topic_names_for_a_moment_is_no_fault(tmp_path):
    fleet = load_text(tmp_path, "fleet: f\nshared: [{topic: /diagnostics, by: hardware_id}]\n")
    driver = StateDriver(fleet=fleet)

    def play(seconds: int, *names: str) -> StateDriver:
        for _ in range(seconds):
            driver.state.update_graph(0, {"/diagnostics": Endpoint(2)}, driver.now)
            driver.receive("/diagnostics", *(Status(OK, "Motor", "OK", each) for each in names))
            driver.at(driver.now.mono + 1)
        return driver

    play(120, "r1", "r2")
    play(3, "r1", "r2", "r1;")
    assert play(100, "r1", "r2").fault_names() == set()
    assert play(600, "r1", "r2").state.robots.keys() == {"r1", "r2"}
    assert play(40, "r1").fault_names() == {("robot", "silent", "r2")}


def test_a_robot_of_a_shared_topic_that_fleet_yml_no_longer_names_is_taken_out(tmp_path):
    shared = "fleet: f\nshared: [{topic: /diagnostics, by: hardware_id}]\n"
    text = f"{shared}robots: [{{name: r1, topic: /diagnostics, source: raw}}]\n"
    driver = StateDriver(fleet=load_text(tmp_path, text))
    driver.receive("/diagnostics", Status(OK, "Motor", "OK", "r1")).at(60)
    driver.state.update_graph(0, {"/diagnostics": Endpoint(2)}, driver.now)
    assert driver.fault_names() == {("robot", "silent", "r1")}

    driver.state.configure(load_text(tmp_path, shared), driver.now)
    assert (driver.fault_names(), list(driver.state.robots)) == (set(), [])
