"""Whatever a robot sends costs no more than its size, is kept within limits, and is logged once.

A test that needs the square of what was sent would run into its time-out.
"""

import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import pytest

import ros_diagnostics_exporter
from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Fleet,
    Limits,
    Profile,
    Robot,
    Shared,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.decode.cdr import decode
from ros_diagnostics_exporter.model import Array, Endpoint, Status, Topic
from ros_diagnostics_exporter.robots.limits import MAX_TEXT, truncate, truncate_statuses
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.rejections import (
    LOG_TEXTS,
    MAX_LINES,
    MAX_OVER_LIMIT,
    MAX_REJECTED,
    RejectionReason,
)
from ros_diagnostics_exporter.robots.values import _MAX_CACHED_KEY, _describe, parse_numbers
from support.state_driver import ERROR, OK, StateDriver, tree
from virtual_robots.recording.cdr import encode_array

EXPORTER = Path(ros_diagnostics_exporter.__file__).parent
RUNBOOK = Path(__file__).parents[3] / "docs/alerts/RosDiagnosticsLimitHit.md"
LONG = "x" * 1_000_000
SLASHES = "/" * 1_000_000
AGG = Topic(0, "/r/diagnostics_agg")
RAW = Topic(0, "/r/diagnostics")


def bounded_story(*rules: ValueRule, **limits: int) -> StateDriver:
    topics = {"topic_agg": AGG.name, "topic_raw": RAW.name}
    robot = Robot("r", source=Source.BOTH, profile=Profile(values=rules), **topics)
    return StateDriver(fleet=Fleet("f", (robot,), limits=Limits(**limits)))


def send(driver: StateDriver, topic: Topic, *statuses: Status) -> None:
    """As it comes from the network: with its size."""
    texts = [s.name + s.message + s.hardware_id + str(s.values) for s in statuses]
    driver.state.receive(topic, Array(0.0, statuses, sum(map(len, texts))), driver.now)


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
    driver = bounded_story()
    send(driver, RAW, status)
    send(driver, RAW, status._replace(level=ERROR))

    shown = fleet_snapshot(driver.state, driver.now)
    assert len(shown["robots"][0]["components"]) == 1
    assert len(str(shown)) < 4 * MAX_TEXT
    assert max(len(event.message) for event in driver.events) <= MAX_TEXT
    assert driver.robot.rejected["label_length"] >= 2
    assert caplog.text.count("robot 'r': a text is too long and is truncated") == 1


def test_an_array_of_usual_texts_is_taken_as_it_is():
    text = "x" * MAX_TEXT
    statuses = (Status(OK, text, text, text, ((text, text),)),)
    assert truncate_statuses(statuses) is statuses


def test_a_long_text_in_a_message_as_it_comes_is_cut():
    array = decode(encode_array([Status(OK, "Motor", values=(("Level", LONG),))], 0.0))
    ((_key, text),) = truncate_statuses(array.statuses)[0].values
    assert len(text) == MAX_TEXT


def test_half_a_character_is_replaced_and_whole_ones_are_kept():
    assert [truncate(text, 9) for text in ("°C \ud800", "°C \U0001f916")] == [
        "°C ?",
        "°C \U0001f916",
    ]


@pytest.mark.parametrize("topic", [AGG, RAW])
def test_names_of_nothing_but_slashes_do_not_cost_their_square(topic):
    driver = bounded_story()
    send(driver, topic, *(Status(OK, f"{SLASHES}{n}") for n in range(20)))
    send(driver, topic, Status(ERROR, "/Motor/Motor 1"), Status(OK, "/Motor"))
    assert len(driver.robot.components) <= 22


def test_a_component_keeps_as_many_key_values_as_the_limits_allow(caplog):
    driver = bounded_story(values=50, robot_series=50)
    same = tuple(("k", f"{n}") for n in range(200_000))
    send(driver, RAW, Status(OK, "Motor", "", "", same))
    send(driver, RAW, Status(OK, "Motor", "", "", same[::-1]))

    motor = driver.component("Motor")
    assert len(motor.last.values) == len(motor.values.all) == 50
    assert driver.robot.rejected["value_limit"] == 2
    assert "values of a component beyond limits.values are rejected" in caplog.text
    assert "'Motor'" in caplog.text


def test_keys_that_are_invented_without_end_are_not_remembered_without_end():
    driver = bounded_story(ValueRule(key=re.compile("Charge")), values=50)
    remembered = []
    for number in range(250):
        send_and_read(driver, Status(OK, "Motor", values=((f"key {number}", "1 V"),)))
        values = driver.component("Motor").values
        remembered.append((len(values._units), len(values._rules)))
    assert [max(each) for each in zip(*remembered, strict=True)] == [100, 100]


def test_a_long_key_is_read_and_not_remembered():
    before = _describe.cache_info().currsize
    assert parse_numbers("k" * (_MAX_CACHED_KEY + 1) + " (V)", "3")[0].unit == "V"
    assert _describe.cache_info().currsize == before


def test_groups_are_as_many_as_the_limits_allow():
    driver = bounded_story(components=10)
    rows = [row for n in range(100) for row in tree(**{f"Group {n}": [Status(OK, "Part")]})]
    send(driver, AGG, *rows)
    assert len(driver.samples()["group_level"]) == 10
    assert driver.robot.rejected["component_limit"] >= 1


def test_every_refusal_has_its_words():
    assert LOG_TEXTS.keys() == set(get_args(RejectionReason))


def test_statuses_that_name_no_robot_are_counted_and_an_example_is_said_once(caplog):
    shared = Shared("/diagnostics", raw=True)
    driver = StateDriver(fleet=Fleet("f", shared=(shared,)))
    for _ in range(2):
        send(driver, Topic(0, "/diagnostics"), Status(OK, "Motor"), Status(OK, "Arm", "", "r1"))

    assert set(driver.state.robots) == {"r1"}
    assert driver.state.rejected["no_robot"] == 2
    assert caplog.text.count("names no robot: name 'Motor', hardware_id ''") == 1


def test_robots_that_are_invented_without_end_are_not_remembered_without_end(caplog):
    shared = Shared("/diagnostics", raw=True)
    driver = StateDriver(fleet=Fleet("f", shared=(shared,), limits=Limits(robots=10)))
    names = [f"r{n}" for n in range(MAX_REJECTED + 20)]
    send(driver, Topic(0, shared.topic), *(Status(OK, "Arm", "", name) for name in names))

    assert len(driver.state.robots) == 10
    assert len(driver.state.robots_over_limit) == MAX_OVER_LIMIT
    assert len(driver.state._registry.rejections._robots) == MAX_REJECTED
    assert driver.state.rejected["robot_limit"] == len(names) - 10
    assert caplog.text.count("is rejected") == MAX_LINES
    assert caplog.text.count("robots were rejected within a minute") == 1


def test_a_robot_beyond_the_limit_is_counted_named_and_logged_after_any_number_of_others(caplog):
    discovery = Discovery(re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    driver = StateDriver(fleet=Fleet("f", discoveries=(discovery,), limits=Limits(robots=1)))
    found = {f"/r{n}/diagnostics": Endpoint(1) for n in range(MAX_OVER_LIMIT + 500)}
    driver.state.update_graph(0, found, driver.now)
    before = driver.at(61).state.rejected["robot_limit"]
    for _ in range(3):
        driver.state.update_graph(0, {**found, "/newcomer/diagnostics": Endpoint(1)}, driver.now)

    assert before == len(found) - 1
    assert driver.state.rejected["robot_limit"] == before + 1
    assert driver.sample("robot_silent_reason", robot="newcomer", reason="limit") == 1
    assert caplog.text.count("robot 'newcomer' on topic") == 1


def test_a_long_text_on_a_shared_topic_is_nobodys(caplog):
    driver = StateDriver(fleet=Fleet("f", shared=(Shared("/diagnostics", raw=True),)))
    topic = Topic(0, "/diagnostics")
    send(driver, topic, Status(OK, "Arm", "", "r1"))
    for _ in range(2):
        send(driver, topic, Status(OK, "Arm", LONG, "r2"))

    assert driver.state.rejected["label_length"] == 2
    assert driver.state.robots["r1"].rejected.total() == 0
    assert caplog.text.count("a text on the shared topic /diagnostics in domain 0 is too long") == 1


def test_the_runbook_finds_in_the_log_what_is_said_there():
    runbook = RUNBOOK.read_text()
    (words,) = re.findall(r'grep (?:-E )?"([^"]+)"', runbook)
    source = "\n".join(
        path.read_text()
        for path in (*(EXPORTER / "robots").glob("r*.py"), EXPORTER / "sources/reception.py")
    )
    assert all(word in source for word in words.split("|"))


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
    # Python 3.12 has no event of opcodes unless a frame asked for them before.
    sys._getframe().f_trace_opcodes = True
    sys.settrace(trace)
    try:
        work()
    finally:
        sys.settrace(before)
    return counted


def without_end(**limits: int) -> StateDriver:
    many = {"values": 10_000, "components": 10_000, "robot_series": 1_000_000}
    return bounded_story(**{**many, **limits})


def equal_keys(size: int) -> Callable[[], object]:
    driver = without_end()
    values = tuple(("Error", str(n)) for n in range(size))
    return lambda: send(driver, RAW, Status(OK, "Motor", values=values))


def keys_in_the_way_of_numbers(size: int) -> Callable[[], object]:
    driver = without_end()
    numbered = tuple((f"Error#{n}", "1") for n in range(2, size // 2))
    values = numbered + (("Error", "1"),) * (size // 2)
    return lambda: send(driver, RAW, Status(OK, "Motor", values=values))


def components_of_one_label(size: int) -> Callable[[], object]:
    """A label is "name [hardware_id]": with brackets in both it can be parted in many places."""
    driver = without_end()
    parts = [f"p{n}" for n in range(size)]
    for cut in range(1, size):
        name, own = " [".join(parts[:cut]), " [".join(parts[cut:])
        send(driver, RAW, Status(OK, name, "", own), Status(OK, name, "", "other"))
    return driver.exposition.render


def one_part_in_many_groups(size: int) -> Callable[[], object]:
    driver = without_end()
    rows = tree(**{f"Group {n}": [Status(OK, "Part")] for n in range(size)})
    return lambda: send(driver, AGG, *rows)


def robots_of_a_shared_topic(size: int) -> Callable[[], object]:
    topic = Topic(0, "/diagnostics")
    driver = StateDriver(fleet=Fleet("f", shared=(Shared(topic.name, raw=True),)))
    statuses = [Status(OK, "Arm", "", f"r{n}") for n in range(size)]
    send(driver, topic, *statuses)
    return lambda: send(driver, topic, *statuses)


@pytest.mark.parametrize(
    "attack",
    [
        *(equal_keys, keys_in_the_way_of_numbers, components_of_one_label),
        *(one_part_in_many_groups, robots_of_a_shared_topic),
    ],
)
def test_twice_as_much_costs_twice_as_much(attack):
    steps(attack(10))  # Python 3.13 counts all instructions of a function from its second trace on
    once, twice = steps(attack(150)), steps(attack(300))
    assert twice < 2.2 * once


def test_a_key_of_blanks_does_not_cost_the_square_of_them():
    driver = without_end()
    values = tuple((f"({' ' * 4_000}{n}", "1") for n in range(200))
    send(driver, RAW, Status(OK, "Motor", values=values))
    assert len(driver.component("Motor").values.all) == len(values)


# -- one robot's share ---------------------------------------------------------------------


def repeated(components: int, values: int, turn: int = 0) -> list[Status]:
    """As it once took all robots down: equal keys in each of many components."""
    pairs = tuple(("Error", str(n + turn)) for n in range(values))
    return [Status(OK, f"Part {n}", values=pairs) for n in range(components)]


def test_one_robot_has_no_more_than_its_share_of_series(caplog):
    most = 2_000
    driver = bounded_story(robot_series=most)
    for turn in range(2):
        send(driver, RAW, *repeated(50, 200, turn))

    shown = driver.samples()
    assert len(shown["component_value"]) == most
    assert len(shown["component_level"]) == 50  # levels are not crowded out by values
    assert sum(len(each.last.values) for each in driver.robot.components) == most
    assert driver.robot.rejected["robot_series_limit"] > 0
    assert caplog.text.count("beyond limits.robot_series are rejected") == 1


def test_a_robot_at_its_limit_takes_nothing_from_another():
    robots = [Robot(n, topic_raw=f"/{n}/diagnostics", source=Source.RAW) for n in ("r", "good")]
    driver = StateDriver(fleet=Fleet("f", tuple(robots), limits=Limits(robot_series=100)))
    send(driver, RAW, *repeated(50, 20))
    send(driver, Topic(0, "/good/diagnostics"), *repeated(10, 3))

    assert driver.robot.rejected["robot_series_limit"] > 0
    assert driver.state.robots["good"].rejected.total() == 0
    assert len(driver.samples()["component_value"]) >= 30


def test_what_was_beyond_a_robots_limit_has_its_place_when_there_is_one():
    driver = bounded_story(robot_series=7)
    send(driver, RAW, *repeated(2, 5))
    assert [len(each.values.all) for each in driver.robot.components] == [5, 2]

    driver.state.forget("r", "Part 0", driver.now)
    send(driver, RAW, *repeated(2, 5, turn=1)[1:])
    assert len(driver.component("Part 1").values.all) == 5


def test_a_components_share_of_key_values_is_given_back_with_it():
    driver = bounded_story(robot_series=50)
    texts = tuple((f"k{n}", "no number") for n in range(40))
    send(driver, RAW, Status(OK, "a", values=texts), Status(OK, "b", values=texts))
    assert len(driver.component("b").last.values) == 10

    send(driver, RAW, Status(OK, "a", values=texts[:5]))
    send(driver, RAW, Status(OK, "b", values=texts))
    assert len(driver.component("b").last.values) == 40
    driver.state.forget("r", "b", driver.now)
    send(driver, RAW, Status(OK, "a", values=texts))
    assert len(driver.component("a").last.values) == 40


def test_a_value_with_thresholds_counts_as_the_series_that_it_has():
    bounds = tuple(Threshold(bound, "warning", 1.0) for bound in ("low", "high"))
    driver = StateDriver(values=(ValueRule(thresholds=bounds),))
    driver.raw(Status(OK, "Motor", values=(("Volt", "1"),)))

    of_values = [name for name in driver.samples() if "value" in name]
    served = sum(len(driver.samples()[name]) for name in of_values)
    assert driver.component("Motor").values.all[0].series == served == 3


def send_and_read(driver, *statuses):
    """Send, and have the values read as a scrape does."""
    send(driver, RAW, *statuses)
    driver.robot.components.parse_values()


def test_values_beyond_a_limit_build_nothing_anew_and_are_counted_each_time():
    driver = bounded_story(robot_series=3)
    lists = [Status(OK, "Motor", values=(("k", f"[1, 2, 3, {n}]"),)) for n in range(5)]
    send_and_read(driver, lists[0])
    more = Status(OK, "Arm", values=(("k", "[4, 5]"), ("k", "6")))
    send_and_read(driver, more)
    series = driver.robot.marks.last(Mark.NAMES, Mark.SERIES)
    send_and_read(driver, lists[1])
    send_and_read(driver, lists[2], more._replace(values=(("k", "[4, 9]"), ("k", "9"))))
    assert driver.robot.marks.last(Mark.NAMES, Mark.SERIES) == series
    assert driver.robot.rejected["robot_series_limit"] == 3 + 2 * 2
    assert [each.number for each in driver.component("Motor").values.all] == [1, 2, 3]


def test_a_unit_that_changes_builds_nothing_anew_and_is_counted_each_time():
    driver = bounded_story()
    for text in ("1 V", "1 mV"):
        send_and_read(driver, Status(OK, "Motor", values=(("Volt", text),)))
    series = driver.robot.marks.last(Mark.NAMES, Mark.SERIES)
    for text in ("2 mV", "3 mV"):
        send_and_read(driver, Status(OK, "Motor", values=(("Volt", text),)))
    assert driver.robot.marks.last(Mark.NAMES, Mark.SERIES) == series
    assert driver.robot.rejected["unit_changed"] == 3
    assert driver.sample("component_value", key="Volt") is None

    send(driver, RAW, Status(OK, "Motor", values=(("Volt", "4 V"),)))
    assert driver.sample("component_value", key="Volt") == 4


def test_an_array_has_no_more_rows_than_could_be_of_the_components():
    driver = bounded_story(components=10)
    send(driver, AGG, *(Status(OK, "Part") for _ in range(1_000)))
    assert driver.robot.rejected["component_limit"] == 1
    assert len(driver.robot._aggregated._plan[0][1]) == 40
