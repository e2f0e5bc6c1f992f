"""Another config takes over: what it leaves unchanged loses nothing."""

from __future__ import annotations

import dataclasses
import re

import pytest

from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Discovery,
    Fleet,
    Limits,
    Profile,
    Robot,
    Shared,
    Source,
    ValueRule,
)
from ros_diagnostics_exporter.file_watcher import FileWatcher
from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_exporter.state.network import Endpoint
from ros_diagnostics_exporter.state.state import Topic
from support.state_driver import ERROR, OK, STALE, WARN, Story, tree

HOT, LASER = Status(ERROR, "Motor", "Hot"), Status(OK, "Laser", values=(("Voltage", "12 V"),))


def raw_robot(name: str, **more) -> Robot:
    return Robot(name, topic_raw=f"/{name}/diagnostics", source=Source.RAW, **more)


def faulty() -> Story:
    story = Story(fleet=Fleet("f", (raw_robot("r"),)))
    story.raw(LASER)
    story.at(1)
    story.raw(HOT)
    return story


def test_robots_come_and_go_while_a_fault_goes_on_unbroken():
    story = faulty()
    before = story.samples()

    for fleet in (
        Fleet("f", (raw_robot("r"), raw_robot("new"))),
        Fleet("f", (raw_robot("r"),)),
        Fleet("f", (raw_robot("r"), raw_robot("other"))),
    ):
        story.state.configure(fleet, story.now)
        after = story.samples()
        for name, samples in before.items():
            assert samples.items() <= after[name].items(), name
    assert set(story.state.robots) == {"r", "other"}
    assert [event.after for event in story.events if event.robot == "new"] == ["known", "forgotten"]


def test_a_changed_profile_is_followed_without_a_reset():
    story = faulty()
    rules = (ComponentRule(re.compile("Motor"), levels={ERROR: WARN}, stale_after=3.0),)
    checks = (Check("all"), Check("motors", (re.compile("Motor"),)))
    values = (ValueRule(key=re.compile("Voltage"), metric="ros_voltage_volts"),)
    profile = Profile(name="softer", components=rules, checks=checks, values=values)
    story.state.configure(Fleet("f", (raw_robot("r", profile=profile),)), story.now)

    motor = story.component("Motor")
    assert (motor.level, motor.reported, motor.changes) == (WARN, ERROR, 1)
    assert story.sample("robot_messages_total") == 2
    assert story.sample("check_components", check="motors", level="warn") == 1
    assert story.sample("component_stale_after_seconds", component="Motor") == 3
    assert story.sample("component_value", component="Laser") is None
    assert b"ros_voltage_volts{" in story.exposition.render()


def test_a_component_that_is_ignored_now_goes_and_may_come_back():
    story = faulty()
    ignoring = Profile(components=(ComponentRule(re.compile("Motor"), ignore=True),))
    story.state.configure(Fleet("f", (raw_robot("r", profile=ignoring),)), story.now)
    story.raw(HOT)
    assert [each.name for each in story.robot.components.values()] == ["Laser"]

    story.state.configure(Fleet("f", (raw_robot("r"),)), story.now)
    story.raw(HOT)
    assert story.level("Motor") == ERROR


def test_a_fleet_that_is_renamed_is_renamed_in_every_sample():
    story = faulty()
    before = story.samples()
    story.state.configure(dataclasses.replace(story.state.fleet, name="renamed"), story.now)

    after = story.samples()
    assert before.keys() == after.keys()
    for name, series in after.items():
        assert {dict(labels)["fleet"] for labels in series} == {"renamed"}, name


def test_labels_change_without_touching_anything_else():
    story = faulty()
    story.state.configure(Fleet("f", (raw_robot("r", labels={"site": "yard"}),)), story.now)

    assert story.sample("robot_info", site="yard") == 1
    assert story.component("Motor").changes == 0


def test_a_robot_keeps_its_history_when_it_moves_to_another_topic():
    story = faulty()
    moved = Robot("r", topic_raw="/elsewhere/diagnostics", source=Source.RAW)
    story.state.configure(Fleet("f", (moved,)), story.now)
    assert story.state.wanted(0) == [Topic(0, "/elsewhere/diagnostics")]

    story.at(2)
    array = Array(0.0, (HOT,), 10)
    story.state.receive(Topic(0, "/elsewhere/diagnostics"), array, story.now)
    assert story.component("Motor").problem_since == story.now.wall - 1


def test_a_discovered_robot_that_is_declared_stays_the_same_robot_and_back():
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    story = Story(fleet=Fleet("f", discoveries=(discovery,)))
    story.state.graph(0, {"/r/diagnostics_agg": Endpoint(1)}, story.now)
    story.agg(*tree(Motor=[HOT]))

    declared = Robot("r", topic_agg="/r/diagnostics_agg", topic_raw="/r/diagnostics")
    for fleet in (
        Fleet("f", (declared,), (discovery,)),
        Fleet("f", discoveries=(discovery,)),
    ):
        story.state.configure(fleet, story.now)
        assert story.level("Motor") == ERROR

    story.state.configure(Fleet("f"), story.now)
    assert not story.state.robots
    assert story.state.wanted(0) == []


def test_the_budget_is_whole_again_when_all_robots_have_gone():
    story = faulty()
    story.state.configure(Fleet("f"), story.now)

    assert story.state._roster.budget.used == 0


# -- shared topics ----------------------------------------------------------------------


def shared(**more) -> Story:
    settings = Shared("/diagnostics", raw=True, **more)
    return Story(fleet=Fleet("f", shared=(settings,)))


def receive(story: Story, *statuses: Status, topic: str = "/diagnostics") -> None:
    story.state.receive(Topic(0, topic), Array(0.0, statuses, 100), story.now)


def test_robots_on_one_topic_are_told_apart_by_hardware_id():
    story = shared()
    receive(
        story,
        Status(OK, "Motor", hardware_id="r1"),
        Status(ERROR, "Motor", hardware_id="r2"),
        Status(ERROR, "Motor"),
    )

    assert story.sample("component_level", robot="r1", component="Motor") == OK
    assert story.sample("component_level", robot="r2", component="Motor") == ERROR
    assert story.state.rejected["no_robot"] == 1
    assert story.state.wanted(0) == [Topic(0, "/diagnostics")]


def test_robots_on_one_topic_are_told_apart_by_a_pattern_in_the_name():
    pattern = re.compile(r"(?P<robot>[^/]+)/(?P<component>.*)")
    story = shared(by="name", pattern=pattern)
    receive(story, Status(OK, "r1/motor: left"), Status(WARN, "r2/motor: left"))

    assert story.sample("component_level", robot="r2", component="motor: left") == WARN


def test_a_robot_on_a_shared_topic_falls_silent_alone():
    story = shared(profile=Profile(stale_after=5.0))
    r1, r2 = Status(OK, "Motor", hardware_id="r1"), Status(OK, "Motor", hardware_id="r2")
    receive(story, r1, r2)
    for second in range(1, 8):
        story.at(second)
        receive(story, r1)

    assert story.sample("robot_up", robot="r1") == 1
    assert story.sample("robot_up", robot="r2") == 0
    assert story.sample("component_level", robot="r2") == STALE


def test_a_declared_robot_on_a_shared_topic_is_known_before_it_comes():
    declared = Robot("r1", topic_raw="/diagnostics", source=Source.RAW, labels={"site": "hall"})
    settings = Shared("/diagnostics", raw=True)
    story = Story(fleet=Fleet("f", robots=(declared,), shared=(settings,)))
    assert story.sample("robot_up", robot="r1") == 0

    receive(story, Status(OK, "Motor", hardware_id="r1"), Status(OK, "Motor", hardware_id="r2"))

    assert story.sample("robot_up", robot="r1") == story.sample("robot_up", robot="r2") == 1
    assert story.sample("robot_info", robot="r1", site="hall") == 1


def test_an_aggregate_shared_by_robots_is_complete_for_each_of_them():
    settings = Shared("/diagnostics_agg", raw=False)
    story = Story(fleet=Fleet("f", shared=(settings,)))
    r1, r2 = (Status(OK, f"Motor {n}", hardware_id=f"r{n}") for n in (1, 2))
    laser = Status(OK, "Laser", hardware_id="r1")
    receive(story, *tree(Motor=[r1, r2], Laser=[laser]), topic="/diagnostics_agg")
    receive(story, *tree(Motor=[r1, r2]), topic="/diagnostics_agg")

    assert story.sample("component_level", robot="r1", component="Laser") == STALE
    assert story.sample("component_level", robot="r1", component="Motor 1", group="/Motor") == OK
    assert story.sample("component_level", robot="r2", component="Motor 2") == OK


def test_names_invented_without_end_meet_the_limit_of_robots():
    story = Story(
        fleet=Fleet("f", shared=(Shared("/diagnostics", raw=True),), limits=Limits(robots=3))
    )
    receive(story, *(Status(OK, "Motor", hardware_id=f"r{n}") for n in range(10)))
    receive(story, Status(ERROR, "Motor", hardware_id="r1"))

    assert len(story.state.robots) == 3
    assert story.state.rejected["robot_limit"] == 7
    assert story.sample("component_level", robot="r1") == ERROR


# -- watching ----------------------------------------------------------------------------


@pytest.mark.parametrize("change", ["write", "replace", "add to folder", "remove"])
def test_a_change_of_a_file_or_folder_is_told_once_and_after_it_came_to_rest(tmp_path, change):
    file, folder = tmp_path / "fleet.yml", tmp_path / "robots.d"
    file.write_text("a")
    folder.mkdir()
    watch = FileWatcher((file, folder))
    assert not watch.changed()

    if change == "write":
        file.write_text("longer")
    elif change == "replace":
        (tmp_path / "new").write_text("b")
        (tmp_path / "new").replace(file)
    elif change == "add to folder":
        (folder / "r.yml").write_text("name: r")
    else:
        file.unlink()

    assert [watch.changed() for _ in range(4)] == [False, True, False, False]


def test_a_file_that_changes_while_it_is_read_is_read_again(tmp_path):
    file, other = tmp_path / "fleet.yml", tmp_path / "robots.yml"
    for path in (file, other):
        path.write_text("a")
    watch = FileWatcher((file,))
    watch.mark()
    file.write_text("longer, and written after the exporter has read it")
    watch.watch((file, other))

    assert [watch.changed() for _ in range(3)] == [True, False, False]
