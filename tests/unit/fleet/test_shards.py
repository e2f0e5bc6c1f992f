"""Exporters that share one fleet.yml: each robot is served by one, and none is lost as it moves."""

from __future__ import annotations

from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Shared, Source
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.faults.model import Fault
from ros_diagnostics_exporter.model import Endpoint, Status, Topic
from support.configs import load_text
from support.state_driver import ERROR, OK, SETTLED, StateDriver

NAMES = [f"r{number}" for number in range(1, 13)]  # of three shards the last has r6, r10, r12
FOUND = '{fleet: f, discovery: [{topic: "/{robot}/diagnostics"}]}'


def part(fleet: Fleet, number: int, count: int) -> StateDriver:
    return StateDriver(fleet=fleet.part(Shard(number, count)))


def publishing(driver: StateDriver, *topics: str) -> None:
    driver.state.update_graph(0, dict.fromkeys(topics, Endpoint(1)), driver.now)


def send(driver: StateDriver, until: float, **levels: int) -> None:
    """Have these robots publish once a second, as the one that receives them asks for."""
    while driver.now.mono < until:
        publishing(driver, *(f"/{name}/diagnostics" for name in levels))
        for topic in list(driver.state.wanted_topics(0)):
            name = topic.split("/")[1]
            if name in levels:
                driver.receive(topic, Status(levels[name], "Motor", "text"))
        driver.at(driver.now.mono + 1)


@pytest.mark.parametrize("count", [1, 2, 4])
def test_what_is_discovered_is_served_by_one_exporter_and_the_others_want_no_topic_of_it(
    tmp_path, count
):
    fleet = load_text(tmp_path, FOUND)
    shards = [part(fleet, number, count) for number in range(1, count + 1)]
    for each in shards:
        publishing(each, *(f"/{name}/diagnostics" for name in NAMES))
    served = [set(each.state.robots) for each in shards]
    assert sorted(name for names in served for name in names) == sorted(NAMES)
    for each, names in zip(shards, served, strict=True):
        wanted = {topic.split("/")[1] for topic in each.state.wanted_topics(0)}
        assert wanted == names
        assert each.state.unclaimed == []


def test_a_robot_that_fleet_yml_names_is_not_discovered_elsewhere_by_another_name(tmp_path):
    """Of r2 the topic has another robot's name, which the hash gives to the other exporter."""
    text = """
    fleet: f
    robots: [{name: r2, topic: /r1/diagnostics}]
    discovery: [{topic: "/{robot}/diagnostics"}]
    """
    fleet = load_text(tmp_path, text)
    shards = [part(fleet, number, 2) for number in (1, 2)]
    for each in shards:
        publishing(each, "/r1/diagnostics", "/r1/diagnostics_agg")
    assert [list(each.state.robots) for each in shards] == [[], ["r2"]]
    assert [each.state.unclaimed for each in shards] == [[], []]


def test_of_a_topic_that_robots_share_each_exporter_takes_its_own():
    fleet = Fleet("f", shared=(Shared(topic="/diagnostics"),))
    shards = [part(fleet, number, 2) for number in (1, 2)]
    for each in shards:
        each.receive("/diagnostics", *(Status(OK, "Motor", "", name) for name in NAMES[:4]))
    assert [sorted(each.state.robots) for each in shards] == [["r1", "r3"], ["r2", "r4"]]
    assert all(not any(each.state.rejected.values()) for each in shards)


def test_a_topic_of_another_type_is_rejected_by_the_exporter_of_its_robot(tmp_path):
    fleet = load_text(tmp_path, FOUND)
    shards = [part(fleet, number, 2) for number in (1, 2)]
    for each in shards:
        each.state.note_other_types(0, {"/r1/diagnostics": ("std_msgs/msg/String",)}, each.now)
    assert [each.state.rejected["wrong_type"] for each in shards] == [1, 0]


def test_what_matches_only_robots_of_another_exporter_is_no_mistake(tmp_path):
    text = """
    fleet: f
    robots: [{name: r1, namespace: /r1, source: raw}, {name: r2, namespace: /r2, source: raw}]
    maintenance: [{name: n, selector: {robot: r2}, comment: c, weekly: ["daily 22:00-23:00"]}]
    """
    driver = part(load_text(tmp_path, text), 1, 2)
    send(driver, 700, r1=OK)
    assert driver.state.unmatched.entries == ()


# -- a robot moves ---------------------------------------------------------------------------


def broken(folder: Path) -> tuple[Fleet, StateDriver, Fault]:
    """Robot r6, of the second of two exporters, has a fault; of three the third has it."""
    fleet = load_text(folder, FOUND)
    driver = part(fleet, 2, 2)
    send(driver, SETTLED, r2=OK, r6=OK)
    send(driver, 60, r2=OK, r6=ERROR)
    [fault] = driver.state.faults()
    assert fault.identity.robot == "r6"
    return fleet, driver, fault


def test_a_fault_of_a_robot_that_moves_does_not_end(tmp_path):
    fleet, before, _fault = broken(tmp_path)
    database = tmp_path / "a.db"
    after = before.again(database, fleet=fleet.part(Shard(2, 3)))
    assert sorted(after.state.robots) == ["r2"]
    send(after, 60, r2=OK, r6=ERROR)
    assert after.state.served() == ([], [])
    assert [each.kind for each in after.events if each.robot == "r6"] == []
    later = after.again(database, fleet=fleet.part(Shard(2, 2)))
    assert later.state.faults() == []  # what it had before is not in the database any more


def test_the_fault_of_a_robot_that_is_removed_from_fleet_yml_ends(tmp_path):
    _fleet, before, fault = broken(tmp_path)
    after = before.again(tmp_path / "a.db", fleet=Fleet("f").part(Shard(2, 2)))
    [end] = after.state.served()[1]
    assert (end.fault.identity, end.reason) == (fault.identity, "removed")


@pytest.mark.parametrize("level", [ERROR, OK])
def test_the_exporter_to_which_a_robot_moves_goes_on_with_its_fault(tmp_path, level):
    fleet, _before, fault = broken(tmp_path)
    after = part(fleet, 3, 3)
    after.state.adopt([fault], after.now)
    assert after.state.faults() == []  # nothing is known of the robot yet
    send(after, 3, r6=level)
    after.state.adopt([fault], after.now)
    send(after, 6, r6=level)
    served, ends = after.state.served()
    assert [each.identity for each in served] == ([fault.identity] if level == ERROR else [])
    assert [each.fault.identity for each in ends] == ([] if level == ERROR else [fault.identity])


def test_an_uplink_is_in_each_exporter_and_its_fault_is_the_same():
    points = Robot("ap", source=Source.QUERIES), Robot("r2", labels={"uplink": "ap"})
    parts = [Fleet("f", points).part(Shard(number, 2)) for number in (1, 2)]
    assert [[each.name for each in fleet.robots] for fleet in parts] == [["ap"], ["ap", "r2"]]
    assert Topic(0, "/r2/diagnostics") not in parts[1].shard.elsewhere
