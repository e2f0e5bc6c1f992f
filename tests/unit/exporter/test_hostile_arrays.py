"""Whatever a robot sends costs no more than its size, is kept within bounds, and is said once.

A test that needs the square of what was sent would run into its time-out.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import get_args

import pytest

import ros_diagnostics_exporter
from ros_diagnostics_exporter.config.fleet import Fleet, Limits, Robot, Shared, Source
from ros_diagnostics_exporter.diagnostics import Array, Status
from ros_diagnostics_exporter.snapshot import fleet_snapshot
from ros_diagnostics_exporter.state.fleet import Topic
from ros_diagnostics_exporter.state.reasons import TOLD, Rejection
from ros_diagnostics_exporter.state.refusals import MOST_REFUSALS
from ros_diagnostics_exporter.state.trimming import MOST_TEXT, trimmed
from ros_diagnostics_exporter.values import _LONGEST_KEPT, _describe, readings
from stories import ERROR, OK, Story, tree

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


def test_robots_that_are_invented_without_end_are_not_remembered_without_end():
    shared = Shared("/diagnostics", raw=True)
    story = Story(fleet=Fleet("f", shared=(shared,), limits=Limits(robots=10)))
    names = (f"r{n}" for n in range(3_000))
    send(story, Topic(0, shared.topic), *(Status(OK, "Arm", "", name) for name in names))

    assert len(story.state.robots) == 10
    assert len(story.state.shut_out) == story.state.rejected["robot_limit"] == MOST_REFUSALS


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
    said = "\n".join(path.read_text() for path in (*STATE.glob("r*.py"), STATE.parent / "ros.py"))
    assert all(word in said for word in words.split("|"))
