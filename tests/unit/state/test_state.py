"""What is known about a robot, told as stories on a time line of seconds."""

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
    Maintenance,
    Profile,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.state.network import Endpoint
from ros_diagnostics_exporter.state.registry import TIME_TO_PUBLISH
from ros_diagnostics_exporter.state.state import Topic
from support.recordings import CASES, aggregated, raw
from support.state_driver import ERROR, OK, STALE, WALL, WARN, Story, tree

MOTOR, HOT = Status(OK, "Motor 1", "OK", "mc-01"), Status(ERROR, "Motor 1", "Hot", "mc-01")
LASER = Status(OK, "Laser 1", "OK")


# -- history --------------------------------------------------


def test_a_fault_has_a_begin_a_course_and_an_end():
    story = Story()
    story.raw(MOTOR)
    story.at(1)
    story.raw(MOTOR._replace(level=WARN))
    story.at(2)
    story.raw(HOT)

    motor = story.component("Motor 1")
    assert (motor.level, motor.since, motor.problem_since) == (ERROR, WALL + 2, WALL + 1)
    assert motor.changes == 2

    story.at(3)
    story.raw(MOTOR)
    assert (motor.level, motor.since, motor.problem_since) == (OK, WALL + 3, None)
    assert motor.changes == 3


def test_a_repeated_level_changes_nothing():
    story = Story()
    story.raw_every(1, 5, HOT)

    motor = story.component("Motor 1")
    assert (motor.since, motor.problem_since, motor.changes) == (WALL, WALL, 0)


def test_stale_keeps_the_begin_of_the_problem_and_the_level_before():
    story = Story(stale_after=5.0)
    story.raw_every(1, 3, HOT)
    story.at(20)

    motor = story.component("Motor 1")
    assert (motor.level, motor.before_stale, motor.problem_since) == (STALE, ERROR, WALL)
    assert story.sample("component_level_before_stale", component="Motor 1") == ERROR

    story.raw(MOTOR)
    assert (motor.level, motor.before_stale, motor.problem_since) == (OK, None, None)
    assert story.sample("component_level_before_stale", component="Motor 1") is None


def test_a_fault_shorter_than_a_scrape_leaves_its_two_changes():
    story = Story()
    story.raw(MOTOR)
    story.samples()
    story.raw(HOT)
    story.raw(MOTOR)

    assert story.sample("component_changes_total", component="Motor 1") == 2


def test_a_level_beyond_stale_is_an_error_and_counted():
    story = Story()
    story.raw(MOTOR._replace(level=255))

    assert story.level("Motor 1") == ERROR
    assert story.sample("robot_rejected_total", reason="bad_level") == 1


def test_the_config_turns_an_error_into_a_warning_and_leaves_out_what_it_ignores():
    rules = (
        ComponentRule(re.compile("^Motor"), levels={ERROR: WARN}),
        ComponentRule(re.compile("^Laser"), ignore=True),
    )
    story = Story(components=rules)
    story.raw(HOT, LASER)

    motor = story.component("Motor 1")
    assert (motor.level, motor.reported) == (WARN, ERROR)
    assert [each.name for each in story.robot.components.values()] == ["Motor 1"]


def test_every_change_is_an_event():
    story = Story()
    story.raw(MOTOR)
    story.at(1)
    story.raw(HOT)

    event = story.events[-1]
    assert (event.kind, event.robot, event.component) == ("level", "r", "Motor 1")
    assert (event.before, event.after, event.message) == ("OK", "ERROR", "Hot")


def test_a_message_is_renewed_with_the_level_or_when_more_than_its_digits_change():
    story = Story()
    for text in ("Hot: 91 C", "Hot: 92 C"):
        story.raw(HOT._replace(message=text))
    assert story.component("Motor 1").message == "Hot: 91 C"

    story.raw(HOT._replace(message="Hot: 93 C, fan dead"))
    assert story.component("Motor 1").message == "Hot: 93 C, fan dead"


# -- silence --------------------------------------------------


def test_a_silent_robot_is_not_up_and_all_of_it_is_stale():
    story = Story(Source.AGG, stale_after=5.0)
    story.agg(*tree(Motor=[MOTOR], Laser=[LASER]))
    story.at(4.9)
    assert story.sample("robot_up") == 1

    story.at(5.5)
    assert story.sample("robot_up") == 0
    assert (story.level("Motor 1"), story.level("Laser 1")) == (STALE, STALE)
    assert story.events[-1].after in ("STALE", "silent")


def test_a_robot_never_seen_is_down_and_says_so():
    story = Story()
    story.at(100)

    assert story.sample("robot_up") == 0
    assert story.sample("robot_last_message_timestamp_seconds") == 0
    assert story.sample("robot_silent_reason", reason="never_seen") == 1


def test_a_component_of_a_raw_topic_is_late_after_three_of_its_own_gaps():
    story = Story(stale_after=60.0)
    slow, fast = Status(OK, "slow"), Status(OK, "fast")
    for second in range(31):
        story.at(second)
        story.raw(*([slow, fast] if second % 10 == 0 else [fast]))
    for second in range(31, 59):
        story.at(second)
        story.raw(Status(OK, "other"))
        assert story.level("fast") == (OK if second <= 35 else STALE)
        assert story.level("slow") == OK
    story.at(61)
    story.raw(Status(OK, "other"))
    story.at(62)
    assert story.level("slow") == STALE


def test_a_component_heard_once_is_given_time_for_a_slow_period():
    story = Story(stale_after=10.0)
    story.raw(Status(OK, "every minute"))
    story.raw_every(1, 80, Status(OK, "fast"))
    assert story.level("every minute") == OK

    story.raw_every(1, 100, Status(OK, "fast"))
    assert story.level("every minute") == STALE


def test_the_return_of_a_dead_driver_does_not_blunt_the_watch():
    story = Story(stale_after=1000.0)
    alive = Status(OK, "alive")
    story.raw_every(1, 10, MOTOR, alive)
    story.raw_every(1, 500, alive)
    assert story.level("Motor 1") == STALE

    story.raw_every(1, 515, MOTOR, alive)
    story.raw_every(1, 550, alive)
    assert story.level("Motor 1") == STALE


def test_a_component_has_its_own_threshold_from_the_config():
    rules = (ComponentRule(re.compile("Motor"), stale_after=3.0),)
    story = Story(stale_after=60.0, components=rules)
    story.raw(MOTOR, LASER)
    story.at(4)

    assert (story.level("Motor 1"), story.level("Laser 1")) == (STALE, OK)


def test_an_aggregator_that_repeats_a_stale_item_for_ever_does_not_keep_it_alive():
    story = Story(Source.AGG)
    story.agg(*tree(Motor=[HOT]))
    for second in range(1, 30):
        story.at(second)
        story.agg(*tree(Motor=[HOT._replace(level=STALE)]))

    motor = story.component("Motor 1")
    assert (motor.level, motor.before_stale, motor.message) == (STALE, ERROR, "Hot")
    assert story.sample("robot_up") == 1


def test_a_component_that_vanishes_from_the_aggregate_is_stale_at_once():
    story = Story(Source.AGG)
    story.agg(*tree(Motor=[HOT], Laser=[LASER]))
    story.at(1)
    story.agg(*tree(Laser=[LASER]))

    assert (story.level("Motor 1"), story.level("Laser 1")) == (STALE, OK)
    assert story.component("Motor 1").before_stale == ERROR


def test_an_aggregator_restart_is_no_change_of_any_component():
    story = Story(Source.AGG)
    story.agg(*tree(Motor=[MOTOR]))
    story.at(1)
    story.agg(Status(STALE, "/Motor", "Stale"))
    assert story.level("Motor 1") == OK

    story.at(2)
    story.agg(*tree(Motor=[MOTOR]))
    assert story.component("Motor 1").changes == 0


def test_after_an_aggregator_restart_a_component_that_stays_away_becomes_stale():
    story = Story(Source.AGG, stale_after=5.0)
    story.agg(*tree(Motor=[HOT]))
    for second in range(1, 8):
        story.at(second)
        story.agg(Status(STALE, "/Motor", "Stale"))

    assert (story.level("Motor 1"), story.component("Motor 1").before_stale) == (STALE, ERROR)


def test_time_is_the_receivers_never_the_stamps():
    story = Story(stale_after=5.0)
    story.raw(MOTOR, stamp=WALL - 3600)
    story.at(4)

    assert story.sample("robot_up") == 1
    assert story.sample("robot_clock_offset_seconds") == 3600


# -- identity --------------------------------------------------


SENT_AND_PUBLISHED = [case for case in CASES if aggregated(case) and raw(case)]


@pytest.mark.parametrize("case", SENT_AND_PUBLISHED)
def test_raw_or_aggregated_the_components_of_a_recording_are_the_same(case):
    """Names, and the level at the end where every component is still sent."""
    seen_raw, seen_agg = Story(Source.RAW), Story(Source.AGG)
    for story, arrays, take in (
        (seen_raw, raw(case), "raw"),
        (seen_agg, aggregated(case), "agg"),
    ):
        for t, array in arrays:
            story.at(t + 1)
            getattr(story, take)(*array.statuses)

    names = {each.name for each in seen_agg.robot.components.values()}
    raw_names = {each.name for each in seen_raw.robot.components.values()}
    made_up = {"Motor 9", "GPS fix", "GPS/antenna"} if case == "expected_missing" else set()
    dropped = {"Cam 1"} if case == "discard_ignore_other" else set()
    assert names - made_up == raw_names - dropped


def test_one_name_with_two_hardware_ids_in_one_array_is_two_components():
    story = Story()
    left, right = MOTOR._replace(hardware_id="left"), HOT._replace(hardware_id="right")
    story.raw(left, right)
    story.raw(right)

    assert story.level("Motor 1 [left]") == OK
    assert story.level("Motor 1 [right]") == ERROR
    assert len(story.robot.components) == 2


def test_an_id_that_is_filled_in_later_is_information_only():
    """A node that starts says "Node starting up" with an empty hardware_id."""
    story = Story()
    story.raw(Status(OK, "Motor 1", "Node starting up"))
    story.raw(MOTOR)

    (motor,) = story.robot.components.values()
    assert motor.hardware_id == "mc-01"
    assert story.sample("component_info", hardware_id="mc-01") == 1


def test_the_last_of_two_equal_names_in_one_array_counts():
    story = Story()
    story.raw(HOT, MOTOR)

    assert (story.level("Motor 1"), story.component("Motor 1").changes) == (OK, 0)


def test_the_group_of_a_raw_component_is_its_node():
    story = Story()
    story.raw(Status(OK, "mavros: endpoint 1: /dev/ttyUSB0:57600"), Status(OK, "/arms/motor"))

    groups = {each.name: each.group for each in story.robot.components.values()}
    assert groups == {"mavros: endpoint 1: /dev/ttyUSB0:57600": "mavros", "/arms/motor": ""}


def test_a_source_of_auto_takes_the_aggregate_and_holds_it():
    story = Story(Source.AUTO)
    story.raw(MOTOR)
    story.at(1)
    story.agg(*tree(Motor=[MOTOR]))
    story.at(9)
    story.raw(HOT)

    assert story.robot.source is Source.AGG
    assert (story.level("Motor 1"), story.component("Motor 1").group) == (OK, "/Motor")


def test_a_source_of_auto_takes_raw_where_no_aggregate_comes():
    story = Story(Source.AUTO)
    story.raw_every(1, 7, HOT)
    story.agg(*tree(Motor=[MOTOR]))

    assert story.robot.source is Source.RAW
    assert story.level("Motor 1") == ERROR


def test_with_both_the_aggregate_gives_the_group_and_raw_the_changes():
    story = Story(Source.BOTH)
    story.raw(MOTOR)
    story.agg(*tree(Motor=[MOTOR]))
    story.raw(HOT)
    story.raw(MOTOR)
    story.agg(*tree(Motor=[MOTOR]))

    motor = story.component("Motor 1")
    assert (motor.group, motor.changes, motor.level) == ("/Motor", 2, OK)


# -- forgetting --------------------------------------------------


def test_absence_never_ends_a_fault_but_what_was_ok_is_forgotten():
    story = Story(forget_after=100.0, stale_after=5.0)
    story.raw_every(1, 5, HOT, LASER)
    story.at(200)

    assert [each.name for each in story.robot.components.values()] == ["Motor 1"]


RAW = "/r/diagnostics"
LOW = ValueRule(thresholds=(Threshold("low", "critical", 10.0),))


def discovered(**profile) -> Story:
    """One robot "r", found by its topic."""
    discovery = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics"),
        "/{robot}/diagnostics",
        source=Source.RAW,
        profile=Profile(forget_after=100.0, stale_after=5.0, **profile),
    )
    story = Story(fleet=Fleet("f", discoveries=(discovery,)))
    story.state.graph(0, {RAW: Endpoint(1)}, story.now)
    return story


@pytest.mark.parametrize(
    ("status", "rules"),
    [
        (HOT, {}),
        (MOTOR._replace(level=STALE), {}),
        (HOT, {"components": (ComponentRule(re.compile(""), levels={STALE: OK}),)}),
        (MOTOR._replace(values=(("Volt", "9"),)), {"values": (LOW,)}),
    ],
    ids=["error", "stale", "stale counts as ok", "value"],
)
def test_a_discovered_robot_that_was_not_ok_stays_until_a_person_takes_it_out(status, rules):
    story = discovered(**rules)
    story.raw_every(1, 5, status, LASER)
    story.state.graph(0, {}, story.now)
    story.at(1_000)
    assert [each.name for each in story.robot.components.values()] == ["Motor 1"]

    story.state.forget("r", None, story.now)
    assert not story.state.robots


@pytest.mark.parametrize(
    ("status", "rules"),
    [
        (MOTOR, {}),
        (HOT, {"components": (ComponentRule(re.compile(""), levels={ERROR: OK}),)}),
        (MOTOR._replace(values=(("Volt", "11"),)), {"values": (LOW,)}),
        (
            MOTOR._replace(level=STALE),
            {"components": (ComponentRule(re.compile("Motor"), planned_stale=True),)},
        ),
    ],
    ids=["ok", "error counts as ok", "value", "planned stale"],
)
def test_a_discovered_robot_that_was_ok_is_forgotten_when_its_publisher_is_long_gone(status, rules):
    story = discovered(**rules)
    story.raw_every(1, 5, status, LASER)
    story.at(1_000)
    assert story.robot.components == {}  # its publisher is still there
    story.state.graph(0, {}, story.now)
    story.at(1_002)
    assert not story.state.robots


def test_what_the_network_keeps_from_us_is_not_forgotten():
    story = discovered()
    story.raw(MOTOR)
    story.state.graph(0, {RAW: Endpoint(0, wrong_type="std_msgs/msg/String")}, story.now)
    story.at(1_000)
    assert story.robot.silent_reason == "wrong_type"


def test_a_discovered_robot_that_never_publishes_is_forgotten_when_its_publisher_is_long_gone():
    story = discovered()
    story.at(500)
    assert story.robot.silent_reason == "mute"
    story.state.graph(0, {}, story.now)
    story.at(599)
    assert story.robot.silent_reason == "never_seen"
    story.at(602)
    assert not story.state.robots


def test_forget_takes_out_what_a_person_names():
    story = Story()
    story.raw(HOT, LASER)

    assert story.state.forget("r", "Motor 1", story.now) == 1
    for name, component in (("r", "no such"), ("no such", None)):
        with pytest.raises(LookupError, match="no such"):
            story.state.forget(name, component, story.now)
    assert [each.name for each in story.robot.components.values()] == ["Laser 1"]


# -- fleet --------------------------------------------------


def discovering(**more) -> Story:
    discovery = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg"), "/{robot}/diagnostics_agg", **more
    )
    return Story(fleet=Fleet("f", discoveries=(discovery,)))


def test_a_robot_is_in_maintenance_from_the_moment_it_is_known():
    """Else a scrape after a restart would end the downtime, and the next begin it anew."""
    every = Maintenance("m", {"robot": (re.compile(".*"),)}, "always")
    found = Discovery(re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    story = Story(fleet=Fleet("f", (Robot("r"),), (found,), maintenance=(every,)))
    story.state.graph(0, {"/new/diagnostics": Endpoint(1)}, story.now)

    assert story.sample("robot_maintenance", robot="r") == 1
    assert story.sample("robot_maintenance", robot="new") == 1


def test_a_robot_is_discovered_by_its_topic_and_wants_both_of_its_topics():
    story = discovering()
    story.state.graph(0, {"/r/diagnostics_agg": Endpoint(1)}, story.now)

    assert story.state.wanted(0) == [
        Topic(0, "/r/diagnostics_agg"),
        Topic(0, "/r/diagnostics"),
    ]
    story.agg(*tree(Motor=[MOTOR]))
    assert story.sample("robot_up", robot="r") == 1
    assert story.state.wanted(0) == [Topic(0, "/r/diagnostics_agg")]


def test_a_topic_without_publisher_is_no_robot():
    story = discovering()
    story.state.graph(0, {"/r/diagnostics_agg": Endpoint(0)}, story.now)

    assert not story.state.robots


def test_an_excluded_robot_is_not_discovered():
    story = discovering(exclude=(re.compile("r.*"),))
    story.state.graph(0, {"/r/diagnostics_agg": Endpoint(1)}, story.now)

    assert not story.state.robots


def test_the_reason_of_silence_follows_the_graph():
    story = Story(stale_after=5.0)
    topic = "/r/diagnostics"
    reasons = []
    for endpoint in (
        Endpoint(1),
        Endpoint(1, wrong_type="std_msgs/msg/String"),
    ):
        story.state.graph(0, {topic: endpoint}, story.now)
        reasons.append(story.robot.silent_reason)
    story.state.graph(0, {topic: Endpoint(1)}, story.now)
    story.raw(MOTOR)
    reasons.append(story.robot.silent_reason)
    story.at(10)
    story.state.graph(0, {}, story.now)
    reasons.append(story.robot.silent_reason)
    story.state.undecodable(Topic(0, topic), story.now, "bad bytes")
    reasons.append(story.robot.silent_reason)
    story.state.domain_joined(0, joined=False)
    reasons.append(story.robot.silent_reason)

    assert reasons == [
        "mute",
        "wrong_type",
        None,
        "publisher_gone",
        "undecodable",
        "domain_unreachable",
    ]
    shown = {
        dict(labels)["reason"]: v for labels, v in story.samples()["robot_silent_reason"].items()
    }
    assert shown == {"domain_unreachable": 1}


# -- checks and bounds --------------------------------------------------


def test_checks_count_their_components_by_level():
    checks = (Check("all"), Check("motors", (re.compile("motor", re.IGNORECASE),), expect=2))
    story = Story(checks=checks)
    story.raw(HOT, LASER, Status(WARN, "Motor 2"))

    assert story.sample("check_components", check="all", level="ok") == 1
    assert story.sample("check_components", check="motors", level="ok") == 0
    assert story.sample("check_components", check="motors", level="warn") == 1
    assert story.sample("check_components", check="motors", level="error") == 1
    assert story.sample("check_expected_components", check="motors") == 2
    assert story.sample("check_expected_components", check="all") is None


def bounded_story(**limits) -> Story:
    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW)
    return Story(fleet=Fleet("f", (robot,), limits=Limits(**limits)))


def test_too_many_components_lose_only_the_surplus_and_never_the_known():
    story = bounded_story(components=3)
    story.raw(*(Status(OK, f"c{n}") for n in range(3)))
    story.raw(*(Status(ERROR, f"x{n}") for n in range(5)), Status(WARN, "c1"))

    assert sorted(each.name for each in story.robot.components.values()) == ["c0", "c1", "c2"]
    assert story.level("c1") == WARN
    assert story.sample("robot_rejected_total", reason="component_limit") == 5


def test_too_many_values_lose_only_the_surplus():
    story = bounded_story(values=2)
    story.raw(Status(OK, "c", values=(("a", "1"), ("b", "2"), ("c", "3"))))

    assert story.sample("component_value", key="b") == 2
    assert story.sample("component_value", key="c") is None
    assert story.sample("robot_rejected_total", reason="value_limit") == 1


def test_the_budget_of_series_is_kept_and_given_back():
    story = bounded_story(series=40)
    story.raw(*(Status(OK, f"c{n}") for n in range(5)))
    assert len(story.robot.components) == 3
    assert story.sample("robot_rejected_total", reason="series_limit") == 2

    story.state.forget("r", "c0", story.now)
    story.raw(Status(OK, "c4"))
    assert story.level("c4") == OK


def test_long_names_are_cut_and_stay_different():
    story = bounded_story(label_length=64)
    story.raw(Status(OK, "x" * 1000 + "a"), Status(ERROR, "x" * 1000 + "b"))

    names = {each.name for each in story.robot.components.values()}
    assert len(names) == 2
    assert all(len(name) == 64 for name in names)


def test_more_robots_than_the_limit_are_refused_and_counted():
    fleet = Fleet("f", tuple(Robot(f"r{n}") for n in range(3)), limits=Limits(robots=2))
    story = Story(fleet=fleet)

    assert len(story.state.robots) == 2
    assert story.state.rejected["robot_limit"] == 1
    assert story.sample("robot_silent_reason", robot="r2", reason="limit") == 1

    story.state.configure(Fleet("f", fleet.robots[1:], limits=Limits(robots=2)), story.now)
    assert set(story.state.robots) == {"r1", "r2"}
    assert story.sample("robot_silent_reason", reason="limit") is None


# -- robots that never publish --------------------------------------------------


def crowded(limit: int) -> Story:
    discovery = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics", source=Source.RAW
    )
    return Story(fleet=Fleet("f", discoveries=(discovery,), limits=Limits(robots=limit)))


def look(story: Story, *robots: str) -> None:
    endpoints = {f"/{name}/diagnostics": Endpoint(1) for name in robots}
    story.state.graph(0, endpoints, story.now)


def test_a_robot_that_never_published_gives_way_once_it_had_time_to():
    story = crowded(2)
    look(story, "mute", "r")
    story.raw(MOTOR)
    for seconds in (1, TIME_TO_PUBLISH - 1):
        story.at(seconds)
        look(story, "mute", "r", "new")
        assert set(story.state.robots) == {"mute", "r"}

    story.at(TIME_TO_PUBLISH)
    look(story, "mute", "r", "new")
    assert set(story.state.robots) == {"r", "new"}
    look(story, "mute", "r", "new")
    assert story.sample("robot_silent_reason", robot="mute", reason="limit") == 1
    assert story.sample("robot_silent_reason", robot="new", reason="limit") is None


def test_a_robot_that_published_never_gives_way():
    story = crowded(1)
    look(story, "r")
    story.raw(MOTOR)
    story.at(100_000)
    look(story, "r", "new")
    assert set(story.state.robots) == {"r"}


def test_every_robot_that_waits_has_its_turn():
    """However many only announce their topic, and however their names are sorted."""
    story = crowded(5)
    mute = [f"a{n}" for n in range(20)]
    seen = set()
    for turn in range(1, 8):
        look(story, *mute, "z")
        seen |= story.state.robots.keys()
        if "z" in story.state.robots:
            break
        story.at(turn * TIME_TO_PUBLISH)
    assert seen == {*mute, "z"}


def test_a_declared_robot_needs_not_wait():
    story = crowded(1)
    look(story, "mute")
    declared = dataclasses.replace(story.state.fleet, robots=(Robot("r", topic_raw=RAW),))
    story.state.configure(declared, story.now)
    assert set(story.state.robots) == {"r"}
