"""Whatever a robot sends costs no more than its size, is kept within bounds, and is said once.

A test that needs the square of what was sent would run into its time-out.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import pytest

import ros_diagnostics_exporter
from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Fleet,
    Limits,
    Robot,
    Shared,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.ingest.values import _LONGEST_KEPT, _describe, readings
from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_exporter.state.network import Endpoint
from ros_diagnostics_exporter.state.reasons import TOLD, Rejection
from ros_diagnostics_exporter.state.rejections import MOST_LINES, MOST_REJECTED, MOST_SHUT_OUT
from ros_diagnostics_exporter.state.snapshot import fleet_snapshot
from ros_diagnostics_exporter.state.state import Topic
from ros_diagnostics_exporter.state.trimming import MOST_TEXT, trimmed
from support.state_driver import ERROR, OK, Story, tree

STATE = Path(ros_diagnostics_exporter.__file__).parent / "state"
RUNBOOKS = Path(__file__).parents[3] / "docs" / "alerts"
LONG = "x" * 1_000_000
SLASHES = "/" * 1_000_000
AGG = Topic(0, "/r/diagnostics_agg")
RAW = Topic(0, "/r/diagnostics")


def bounded_story(**limits: int) -> Story:
    robot = Robot("r", topic_agg=AGG.name, topic_raw=RAW.name, source=Source.BOTH)
    return Story(fleet=Fleet("f", (robot,), limits=Limits(**limits)))


def send(story: Story, topic: Topic, *statuses: Status) -> None:
    """As it comes from the network: with its size."""
    texts = [s.name + s.message + s.hardware_id + str(s.values) for s in statuses]
    story.state.receive(topic, Array(0.0, statuses, sum(map(len, texts))), story.now)


@pytest.mark.parametrize(
    "status",
    [
        Status(OK, LONG),
        Status(OK, "Motor", LONG),
        Status(OK, "Motor", "", LONG),
        Status(OK, "Motor", "", "", ((LONG, "1"),)),
        Status(OK, "Motor", "", "", (("Level", LONG),)),
    ],
    ids=["name", "message", "hardware_id", "key", "value"],
)
def test_a_text_without_end_is_cut_wherever_it_stands_and_said_once(status, caplog):
    story = bounded_story()
    send(story, RAW, status)
    send(story, RAW, status._replace(level=ERROR))

    shown = fleet_snapshot(story.state, story.now)
    assert len(shown["robots"][0]["components"]) == 1
    assert len(str(shown)) < 4 * MOST_TEXT
    assert max(len(event.message) for event in story.events) <= MOST_TEXT
    assert story.robot.rejected["label_length"] >= 2
    assert caplog.text.count("robot 'r': a text is too long and is cut") == 1


def test_an_array_of_usual_texts_is_taken_as_it_is():
    array = Array(0.0, (Status(OK, "Motor", "x" * MOST_TEXT),), 2 * MOST_TEXT)
    assert trimmed(array) is array


@pytest.mark.parametrize("topic", [AGG, RAW])
def test_names_of_nothing_but_slashes_do_not_cost_their_square(topic):
    story = bounded_story()
    send(story, topic, *(Status(OK, f"{SLASHES}{n}") for n in range(20)))
    send(story, topic, Status(ERROR, "/Motor/Motor 1"), Status(OK, "/Motor"))
    assert len(story.robot.components) <= 22


def test_a_component_keeps_as_many_key_values_as_the_limits_allow(caplog):
    story = bounded_story(values=50)
    same = tuple(("k", f"{n}") for n in range(200_000))
    send(story, RAW, Status(OK, "Motor", "", "", same))
    send(story, RAW, Status(OK, "Motor", "", "", same[::-1]))

    motor = story.component("Motor")
    assert len(motor.last.values) == len(motor.values.all) == 50
    assert story.robot.rejected["value_limit"] == 2
    assert "more values of a component than limits.values are left out" in caplog.text
    assert "'Motor'" in caplog.text


def test_keys_that_are_invented_without_end_are_not_remembered_without_end():
    story = bounded_story(values=50)
    for number in range(40):
        pairs = tuple((f"key {number} {each}", "1 V") for each in range(50))
        send(story, RAW, Status(OK, "Motor", "", "", pairs))
    assert len(story.component("Motor").values._units) <= 100


def test_a_long_key_is_read_and_not_remembered():
    before = _describe.cache_info().currsize
    assert readings("k" * (_LONGEST_KEPT + 1) + " (V)", "3")[0].unit == "V"
    assert _describe.cache_info().currsize == before


def test_ten_thousand_components_are_as_many_as_the_limits_allow(caplog):
    for topic in (AGG, RAW):
        story = bounded_story()
        for _ in range(3):
            send(story, topic, *(Status(OK, f"Part {n}") for n in range(10_000)))
        assert len(story.robot.components) == Limits().components
    assert caplog.text.count("more components or groups than limits.components") == 2


def test_groups_are_as_many_as_the_limits_allow():
    story = bounded_story(components=10)
    rows = [row for n in range(100) for row in tree(**{f"Group {n}": [Status(OK, "Part")]})]
    send(story, AGG, *rows)
    assert len(story.samples()["group_level"]) == 10
    assert story.robot.rejected["component_limit"] >= 1


def test_every_refusal_has_its_words():
    assert TOLD.keys() == set(get_args(Rejection))


def test_statuses_that_name_no_robot_are_counted_and_an_example_is_said_once(caplog):
    shared = Shared("/diagnostics", raw=True)
    story = Story(fleet=Fleet("f", shared=(shared,)))
    for _ in range(2):
        send(story, Topic(0, "/diagnostics"), Status(OK, "Motor"), Status(OK, "Arm", "", "r1"))

    assert set(story.state.robots) == {"r1"}
    assert story.state.rejected["no_robot"] == 2
    assert caplog.text.count("names no robot: name 'Motor', hardware_id ''") == 1


def test_robots_that_are_invented_without_end_are_not_remembered_without_end(caplog):
    shared = Shared("/diagnostics", raw=True)
    story = Story(fleet=Fleet("f", shared=(shared,), limits=Limits(robots=10)))
    names = [f"r{n}" for n in range(MOST_REJECTED + 20)]
    send(story, Topic(0, shared.topic), *(Status(OK, "Arm", "", name) for name in names))

    assert len(story.state.robots) == 10
    assert len(story.state.shut_out) == MOST_SHUT_OUT
    assert len(story.state._roster.refusals._robots) == MOST_REJECTED
    assert story.state.rejected["robot_limit"] == len(names) - 10
    assert caplog.text.count("is not taken in") == MOST_LINES
    assert caplog.text.count("robots were rejected within a minute") == 1


def test_a_robot_beyond_the_limit_is_counted_named_and_logged_after_any_number_of_others(caplog):
    discovery = Discovery(re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    story = Story(fleet=Fleet("f", discoveries=(discovery,), limits=Limits(robots=1)))
    found = {f"/r{n}/diagnostics": Endpoint(1) for n in range(MOST_SHUT_OUT + 500)}
    story.state.graph(0, found, story.now)
    story.at(61)
    before = story.state.rejected["robot_limit"]
    for _ in range(3):
        story.state.graph(0, {**found, "/newcomer/diagnostics": Endpoint(1)}, story.now)

    assert before == len(found) - 1
    assert story.state.rejected["robot_limit"] == before + 1
    assert story.sample("robot_silent_reason", robot="newcomer", reason="limit") == 1
    assert caplog.text.count("robot 'newcomer' on topic") == 1


def test_a_long_text_on_a_shared_topic_is_nobodys(caplog):
    story = Story(fleet=Fleet("f", shared=(Shared("/diagnostics", raw=True),)))
    topic = Topic(0, "/diagnostics")
    send(story, topic, Status(OK, "Arm", "", "r1"))
    for _ in range(2):
        send(story, topic, Status(OK, "Arm", LONG, "r2"))

    assert story.state.rejected["label_length"] == 2
    assert not story.state.robots["r1"].rejected
    assert caplog.text.count("a text on the shared topic /diagnostics in domain 0 is too long") == 1


def test_dropped_messages_are_counted_for_the_robot_or_on_a_shared_topic_for_nobody():
    shared, own = Shared("/diagnostics", raw=True), Topic(0, "/r1/diagnostics")
    robots = (Robot("r1", topic_raw=own.name, source=Source.RAW), Robot("r2"))
    story = Story(fleet=Fleet("f", robots, shared=(shared,)))
    send(story, Topic(0, shared.topic), Status(OK, "Arm", "", "r3"))
    for topic in (own, Topic(0, shared.topic), Topic(1, own.name)):
        story.state.dropped(topic, 7)

    assert {name: robot.rejected["rate"] for name, robot in story.state.robots.items()} == {
        "r1": 7,
        "r2": 0,
        "r3": 0,
    }
    assert story.state.rejected["rate"] == 7
    assert story.samples()["robot_rejected_total"]


@pytest.mark.parametrize("page", ["LimitHit", "UnknownRejected"])
def test_the_runbooks_find_in_the_log_what_is_said_there(page):
    runbook = (RUNBOOKS / f"RosDiagnostics{page}.md").read_text()
    (words,) = re.findall(r'grep (?:-E )?"([^"]+)"', runbook)
    said = "\n".join(
        path.read_text() for path in (*STATE.glob("r*.py"), STATE.parent / "ingest/ros.py")
    )
    assert all(word in said for word in words.split("|"))


# -- what is sent costs in proportion to its size ---------------------------------------------


def steps(work: Callable[[], object]) -> int:
    """How many instructions of Python ``work`` takes: the same on every machine."""
    counted = 0

    def trace(frame, event, _argument):
        nonlocal counted
        frame.f_trace_lines, frame.f_trace_opcodes = False, True
        counted += event == "opcode"
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return counted


def without_end(**limits: int) -> Story:
    many = {"values": 10_000, "components": 10_000, "robot_series": 1_000_000}
    return bounded_story(**{**many, **limits})


def equal_keys(size: int) -> Callable[[], object]:
    story = without_end()
    values = tuple(("Error", str(n)) for n in range(size))
    return lambda: send(story, RAW, Status(OK, "Motor", values=values))


def keys_in_the_way_of_numbers(size: int) -> Callable[[], object]:
    story = without_end()
    numbered = tuple((f"Error#{n}", "1") for n in range(2, size // 2))
    values = numbered + (("Error", "1"),) * (size // 2)
    return lambda: send(story, RAW, Status(OK, "Motor", values=values))


def components_of_one_label(size: int) -> Callable[[], object]:
    """A label is "name [hardware_id]": with brackets in both it can be parted in many places."""
    story = without_end()
    parts = [f"p{n}" for n in range(size)]
    for cut in range(1, size):
        name, own = " [".join(parts[:cut]), " [".join(parts[cut:])
        send(story, RAW, Status(OK, name, "", own), Status(OK, name, "", "other"))
    return story.exposition.render


def robots_of_a_shared_topic(size: int) -> Callable[[], object]:
    topic = Topic(0, "/diagnostics")
    story = Story(fleet=Fleet("f", shared=(Shared(topic.name, raw=True),)))
    statuses = [Status(OK, "Arm", "", f"r{n}") for n in range(size)]
    send(story, topic, *statuses)
    return lambda: send(story, topic, *statuses)


@pytest.mark.parametrize(
    "attack",
    [
        equal_keys,
        keys_in_the_way_of_numbers,
        components_of_one_label,
        robots_of_a_shared_topic,
    ],
)
def test_twice_as_much_costs_twice_as_much(attack):
    once, twice = steps(attack(150)), steps(attack(300))
    assert twice < 2.2 * once


def test_one_component_in_many_groups_does_not_cost_the_square_of_them():
    story = without_end()
    rows = tree(**{f"Group {n}": [Status(OK, "Part")] for n in range(150_000)})
    send(story, AGG, *rows)
    assert story.component("Part").level == OK


def test_a_key_of_blanks_does_not_cost_the_square_of_them():
    story = without_end()
    values = tuple((f"({' ' * 4_000}{n}", "1") for n in range(200))
    send(story, RAW, Status(OK, "Motor", values=values))
    assert len(story.component("Motor").values.all) == len(values)


# -- one robot's share ---------------------------------------------------------------------


def repeated(components: int, values: int, turn: int = 0) -> list[Status]:
    """What was once enough to take all robots down: 200 equal keys in each of 500 components."""
    pairs = tuple(("Error", str(n + turn)) for n in range(values))
    return [Status(OK, f"Part {n}", values=pairs) for n in range(components)]


def test_one_robot_has_no_more_than_its_share_of_series(caplog):
    story = bounded_story()
    for turn in range(2):
        send(story, RAW, *repeated(500, 200, turn))

    most = Limits().robot_series
    shown = story.samples()
    assert len(shown["component_value"]) == most
    assert len(shown["component_level"]) == 500  # levels are not crowded out by values
    assert sum(len(each.last.values) for each in story.robot.components.values()) == most
    assert story.robot.rejected["robot_series_limit"] > 0
    assert caplog.text.count("than limits.robot_series are left out") == 1


def test_a_robot_at_its_limit_takes_nothing_from_another():
    robots = [Robot(n, topic_raw=f"/{n}/diagnostics", source=Source.RAW) for n in ("r", "good")]
    story = Story(fleet=Fleet("f", tuple(robots), limits=Limits(robot_series=100)))
    send(story, RAW, *repeated(50, 20))
    send(story, Topic(0, "/good/diagnostics"), *repeated(10, 3))

    assert story.robot.rejected["robot_series_limit"] > 0
    assert not story.state.robots["good"].rejected
    assert len(story.samples()["component_value"]) >= 30


def test_what_was_beyond_a_robots_limit_has_its_place_when_there_is_one():
    story = bounded_story(robot_series=7)
    send(story, RAW, *repeated(2, 5))
    assert [len(each.values.all) for each in story.robot.components.values()] == [5, 2]

    story.state.forget("r", "Part 0", story.now)
    send(story, RAW, *repeated(2, 5, turn=1)[1:])
    assert len(story.component("Part 1").values.all) == 5


def test_a_components_share_of_key_values_is_given_back_with_it():
    story = bounded_story(robot_series=50)
    texts = tuple((f"k{n}", "no number") for n in range(40))
    send(story, RAW, Status(OK, "a", values=texts), Status(OK, "b", values=texts))
    assert len(story.component("b").last.values) == 10

    send(story, RAW, Status(OK, "a", values=texts[:5]))
    send(story, RAW, Status(OK, "b", values=texts))
    assert len(story.component("b").last.values) == 40
    story.state.forget("r", "b", story.now)
    send(story, RAW, Status(OK, "a", values=texts))
    assert len(story.component("a").last.values) == 40


def test_a_value_with_thresholds_counts_as_the_series_that_it_has():
    bounds = tuple(Threshold(bound, "warning", 1.0) for bound in ("low", "high"))
    story = Story(values=(ValueRule(thresholds=bounds),))
    story.raw(Status(OK, "Motor", values=(("Volt", "1"),)))

    of_values = [name for name in story.samples() if "value" in name]
    served = sum(len(story.samples()[name]) for name in of_values)
    assert story.component("Motor").values.all[0].series == served == 4


def test_values_beyond_a_limit_build_nothing_anew_and_are_counted_each_time():
    story = bounded_story(robot_series=3)
    lists = [Status(OK, "Motor", values=(("k", f"[1, 2, 3, {n}]"),)) for n in range(5)]
    send(story, RAW, lists[0])
    more = Status(OK, "Arm", values=(("k", "[4, 5]"), ("k", "6")))
    send(story, RAW, more)
    structure = story.robot.versions.structure
    send(story, RAW, lists[1])
    send(story, RAW, lists[2], more._replace(values=(("k", "[4, 9]"), ("k", "9"))))
    assert story.robot.versions.structure == structure
    assert story.robot.rejected["robot_series_limit"] == 3 + 2 * 2
    assert [each.number for each in story.component("Motor").values.all] == [1, 2, 3]


def test_a_unit_that_changes_builds_nothing_anew_and_is_counted_each_time():
    story = bounded_story()
    for text in ("1 V", "1 mV"):
        send(story, RAW, Status(OK, "Motor", values=(("Volt", text),)))
    structure = story.robot.versions.structure
    for text in ("2 mV", "3 mV"):
        send(story, RAW, Status(OK, "Motor", values=(("Volt", text),)))
    assert story.robot.versions.structure == structure
    assert story.robot.rejected["unit_changed"] == 3
    assert story.sample("component_value", key="Volt") is None

    send(story, RAW, Status(OK, "Motor", values=(("Volt", "4 V"),)))
    assert story.sample("component_value", key="Volt") == 4


def test_an_array_has_no_more_rows_than_could_be_of_the_components():
    story = bounded_story(components=10)
    send(story, AGG, *(Status(OK, "Part") for _ in range(1_000)))
    assert story.robot.rejected["component_limit"] == 1
    assert len(story.robot._tree._plan[0][1]) == 40
