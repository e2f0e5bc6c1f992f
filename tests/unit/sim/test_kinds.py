"""Kinds of robots: those that come along, faults and their course, files of one's own."""

from pathlib import Path
from random import Random
from typing import Any

import pytest

from support.simulated_fleet import fleet_of, level_of, of
from virtual_robots.model import ERROR, OK, STALE, WARN
from virtual_robots.schema.documents import DocumentError
from virtual_robots.schema.kinds import ComponentModel, KindModel
from virtual_robots.simulation.components import Component, Fault
from virtual_robots.simulation.kinds import build_components, kind_path, known_kinds, load_kind
from virtual_robots.simulation.outputs import FieldMessage, Topic

EACH_FAULT = [
    (kind, component.name, fault)
    for kind in known_kinds()
    for component in build_components(load_kind(kind_path(kind)), "")
    for fault in component.model.faults
    if component.model.publishes is None
]
# A battery is charged again for hours: one of them is enough for each day.
LONG = [each for each in EACH_FAULT if each[2] == "draining"][1:]


def component(**model: object) -> Component:
    return Component(ComponentModel.model_validate({"name": "C", **model}), "C", "", Random(1))


def test_a_kobuki_s_tree_has_no_stray_components() -> None:
    last = of(fleet_of("kobuki").advance(4.0), Topic.AGGREGATED)[-1]
    parents = [s.name for s in last.statuses if s.name.count("/") == 1]
    assert parents == ["/Input Ports", "/Kobuki", "/Power System", "/Sensors"]


@pytest.mark.parametrize(
    ("kind", "name", "fault"),
    [pytest.param(*each, marks=[pytest.mark.slow] * (each in LONG)) for each in EACH_FAULT],
)
def test_each_fault_of_a_kind_begins_takes_its_course_and_ends(kind, name, fault):
    fleet = fleet_of(kind)
    before = of(fleet.advance(3.0), Topic.RAW)[-1]
    fleet.inject("robot_1", name, Fault(fault, fleet.now))
    faulty = of(fleet.advance(133.0), Topic.RAW)[-1]
    fleet.inject("robot_1", name, None)
    # A drained battery is charged again, which takes its time.
    after = of(fleet.advance(133.0 + 4 * 3600 if fault == "draining" else 200.0), Topic.RAW)[-1]
    assert level_of(before, name) == OK
    assert level_of(faulty, name) in {WARN, ERROR}
    assert level_of(after, name) == OK


def fields_of(fleet, until: float) -> dict[str, list[Any]]:
    """The fields of the messages of each topic of its own."""
    found: dict[str, list[Any]] = {}
    for each in fleet.advance(until):
        if isinstance(each, FieldMessage):
            found.setdefault(each.topic.topic, []).append(each.fields)
    return found


def test_an_arm_without_diagnostics_publishes_its_topics_and_no_arrays():
    fleet = fleet_of("arm")
    outputs = list(fleet.advance(10.0))
    assert {type(each) for each in outputs} == {FieldMessage}
    fleet.inject("robot_1", "E-stop", Fault("pressed", fleet.now))
    found = fields_of(fleet, 20.0)
    assert [float(each["data"]) for each in found["e_stop"]] == [1]  # on a change
    assert len(found["joint_states"]) == 10
    fleet.inject("robot_1", "E-stop", None)
    fleet.inject("robot_1", "Safety mode", Fault("protective_stop", fleet.now))
    found = fields_of(fleet, 30.0)
    assert [float(each["data"]) for each in found["e_stop"]] == [0]
    (safety,) = found["io_and_status_controller/safety_mode"]
    assert float(safety["mode"]) == 3


def test_the_hazards_of_a_create_3_are_elements_of_an_array_while_they_last():
    fleet = fleet_of("create3")
    assert fields_of(fleet, 5.0)["hazard_detection"][-1] == {"detections": ()}
    fleet.inject("robot_1", "Hazards", Fault("lifted", fleet.now))
    (hazard,) = fields_of(fleet, 10.0)["hazard_detection"][-1]["detections"]
    assert hazard == {"header": {"frame_id": "wheel_drop_left"}, "type": 4}


def test_a_turtlebot_s_names_have_two_blanks_where_its_node_writes_a_path():
    last = of(fleet_of("turtlebot4").advance(8.0), Topic.AGGREGATED)[-1]
    names = {status.name for status in last.statuses}
    assert "/Turtlebot4/Lidar/turtlebot4_diagnostics:  scan topic status" in names
    assert "/Turtlebot4/Create3/Battery/turtlebot4_diagnostics: Battery Percentage" in names


def test_an_amr_without_diagnostics_drains_its_battery_and_is_charged():
    fleet = fleet_of("amr")
    before = fields_of(fleet, 5.0)["battery_state"][-1]
    fleet.inject("robot_1", "Battery", Fault("draining", fleet.now))
    drained = fields_of(fleet, 130.0)["battery_state"][-1]
    assert (float(before["percentage"]) > 0.5, float(drained["percentage"]) < 0.1) == (True, True)
    assert (before["power_supply_status"], drained["power_supply_status"]) == ("2", "1")


def test_a_silent_component_of_its_own_topic_publishes_nothing():
    fleet = fleet_of("arm")
    list(fleet.advance(3.0))
    fleet.inject("robot_1", "Joints", Fault("silent", fleet.now))
    assert fields_of(fleet, 10.0) == {}


@pytest.mark.parametrize(
    ("analyzers", "publishes", "what"),
    [
        ("a.yaml", {"topic": "x", "type": "std_msgs/msg/Bool", "fields": {}}, "no diagnostics"),
        (None, None, "needs analyzers"),
    ],
)
def test_a_kind_has_analyzers_where_it_has_diagnostics(analyzers, publishes, what):
    components = [{"name": "C", "publishes": publishes}]
    with pytest.raises(ValueError, match=what):
        KindModel.model_validate({"components": components, "analyzers": analyzers})


def test_an_overheating_motor_warns_before_it_fails() -> None:
    fleet = fleet_of()
    list(fleet.advance(3.0))
    fleet.inject("robot_1", "Motor 1", Fault("overheating", fleet.now))
    levels = [level_of(m, "Motor 1") for m in of(fleet.advance(40.0), Topic.RAW)]
    assert levels == sorted(levels)
    assert set(levels) == {OK, WARN, ERROR}


def test_a_fault_goes_as_fast_as_it_came() -> None:
    fleet = fleet_of("kobuki")
    list(fleet.advance(3.0))
    name = "kobuki_ros_node: Cliff Sensor"
    fleet.inject("robot_1", name, Fault("cliff", fleet.now))
    assert level_of(of(fleet.advance(8.0), Topic.RAW)[-1], name) == WARN
    fleet.inject("robot_1", name, None)
    assert level_of(of(fleet.advance(10.5), Topic.RAW)[-1], name) == OK


@pytest.mark.parametrize(
    ("what", "level", "message"),
    [
        ("ok", OK, "fine"),
        ("warn", WARN, "so-so"),
        ("error", ERROR, "broken"),
        ("stale", STALE, "Stale"),
    ],
)
def test_a_level_brings_the_kind_s_message_unless_it_has_its_own(what, level, message):
    part = component(message="fine", warn="so-so", error="broken")
    part.inject(Fault(what, 0.0))
    assert part.status(0.0)[:3:2] == (level, message)
    if what != "ok":
        part.inject(Fault(what, 0.0, "my words"))
        assert part.status(0.0)[:3:2] == (level, "my words")


def test_a_flapping_component_changes_each_period() -> None:
    part = component()
    part.inject(Fault("flap", 10.0, period=2.0))
    assert [part.status(10.0 + t).level for t in range(6)] == [2, 2, 0, 0, 2, 2]


def test_a_battery_drains_is_charged_and_drains_again() -> None:
    battery = {
        "battery": True, "start": 50, "drain": 3600, "charge": 7200, "dock_at": 40, "leave_at": 60,
    }  # fmt: skip
    part = component(variables={"level": battery})
    levels = []
    for second in range(60):
        part.advance(float(second), 1.0)
        levels.append(part.variables["level"])
    assert min(levels) == pytest.approx(40, abs=1)
    assert max(levels) == pytest.approx(60, abs=2)
    assert levels[0] > levels[5] < levels[15]


def test_a_drifting_value_stays_between_its_bounds() -> None:
    part = component(variables={"t": {"walk": 5, "start": 20, "low": 10, "high": 30}})
    values = []
    for second in range(300):
        part.advance(float(second), 1.0)
        values.append(part.variables["t"])
    assert all(10 <= value <= 30 for value in values)
    assert len(set(values)) > 200


def test_a_value_returns_after_a_fault_that_was_injected_twice() -> None:
    part = component(
        variables={"t": {"walk": 0, "start": 80, "low": 60, "high": 100}},
        faults={"low": {"drive": "t", "to": 15, "over": 1}},
    )
    for second in range(2):
        part.inject(Fault("low", float(second)))
        part.advance(second + 1.0, 1.0)
        assert part.variables["t"] == 15
    part.inject(None)
    part.advance(3.0, 1.0)
    assert part.variables["t"] == 60


ELEMENT = "publishes: {{topic: t, type: a/msg/B, fields: {{x: [{{if: z, above: 1{}}}]}}}}"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("name: Arm, colour: red", "components.0.colour: is no key"),
        ("", "components.0.name: is missing"),
        ("name: Arm, message: '{t}'", "components.0: Arm: no variable t"),
        (
            "name: A, variables: {t: {walk: 1, start: 3, low: 0}}",
            "components.0.variables.t.walk.high: is missing",
        ),
        (
            "name: A, variables: {t: {wobble: 1}}",
            "components.0.variables.t: needs 'walk', 'battery', 'follows' or 'count'",
        ),
        ("name: 'Arm {x}'", "components.0: Arm {x}: a text cannot be filled in: 'x'"),
        (
            "name: Arm, faults: {error: {level: error}}",
            "components.0: Arm: a fault cannot be called error",
        ),
        (
            f"name: A, {ELEMENT.format(', then: 1')}",
            "components.0: A: no variable z",
        ),
        (
            f"name: A, {ELEMENT.format('')}",
            "components.0.publishes.fields: an element of an array: then: is missing",
        ),
        (
            "name: A, publishes: {topic: t, type: a/msg/B, fields: {x: null}}",
            "a field is a text, a number, a list or a mapping, not None",
        ),
        (
            "name: A, variables: {t: {walk: 1, start: 9, low: 0, high: 5}}",
            "start 9.0 must lie between low and high",
        ),
    ],
)
def test_a_wrong_kind_file_names_file_key_and_remedy(tmp_path: Path, text: str, what: str) -> None:
    path = tmp_path / "wrong.yaml"
    path.write_text(f"components: [{{{text}}}]\nanalyzers: a\n")
    with pytest.raises(DocumentError) as caught:
        load_kind(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert what in str(caught.value)
