"""What is known about a robot, on a time line of seconds."""

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
from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.events import filled
from ros_diagnostics_exporter.faults.model import State
from ros_diagnostics_exporter.fleet.registry import TIME_TO_PUBLISH
from ros_diagnostics_exporter.model import Array, Downtime, Endpoint, Status, Stream, Topic
from support.recordings import CASES, aggregated, raw
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver, tree

MOTOR, HOT = Status(OK, "Motor 1", "OK", "mc-01"), Status(ERROR, "Motor 1", "Hot", "mc-01")
LASER = Status(OK, "Laser 1", "OK")


def test_a_topic_of_another_type_counts_once_and_again_after_a_reload(caplog):
    wanted = Discovery(re.compile("/(?P<robot>[^/]+)/diagnostics"), "{robot}", source=Source.RAW)
    driver = StateDriver(fleet=Fleet("f"))
    others = {"/r/diagnostics": ("std_msgs/msg/String",), "/r/odom": ("nav_msgs/msg/Odometry",)}
    driver.state.note_other_types(0, others, driver.now)
    assert driver.state.rejected["wrong_type"] == 0
    driver.state.configure(Fleet("f", discoveries=(wanted,)), driver.now)
    driver.state.note_other_types(0, {**others, "/s/odom": ()}, driver.now)
    assert driver.state.rejected["wrong_type"] == 1
    assert not driver.state.robots_over_limit
    assert caplog.text.count("another type, std_msgs/msg/String") == 1


# -- history --------------------------------------------------


def of_motor(driver: StateDriver) -> tuple[int, float, float | None, int]:
    """Its level, since when, since when it is a problem, and its changes."""
    motor = driver.component("Motor 1")
    return motor.level, motor.since, driver.problem_since("Motor 1"), motor.changes


def test_a_fault_has_a_begin_a_course_and_an_end():
    driver = StateDriver()
    driver.raw(MOTOR)
    driver.at(1)
    driver.raw(MOTOR._replace(level=WARN))
    driver.at(2)
    driver.raw(HOT)

    assert of_motor(driver) == (ERROR, WALL + 2, WALL + 1, 2)
    driver.at(3)
    driver.raw(MOTOR)
    assert of_motor(driver) == (OK, WALL + 3, None, 3)


def test_a_repeated_level_changes_nothing():
    driver = StateDriver()
    driver.raw_every(1, 5, HOT)
    assert of_motor(driver) == (ERROR, WALL, WALL, 0)


def test_stale_keeps_the_begin_of_the_problem_and_the_level_before():
    driver = StateDriver(stale_after=5.0)
    driver.raw_every(1, 3, HOT)
    driver.at(20)

    motor = driver.component("Motor 1")
    assert motor.before_stale == ERROR
    assert of_motor(driver)[::2] == (STALE, WALL)

    driver.raw(MOTOR)
    assert motor.before_stale is None
    assert of_motor(driver)[::2] == (OK, None)


def test_a_fault_shorter_than_a_scrape_leaves_its_two_changes():
    driver = StateDriver()
    driver.raw(MOTOR)
    driver.samples()
    driver.raw(HOT)
    driver.raw(MOTOR)

    assert driver.sample("component_changes_total", component="Motor 1") == 2


def test_a_level_beyond_stale_is_an_error_and_counted():
    driver = StateDriver()
    driver.raw(MOTOR._replace(level=255))

    assert driver.level("Motor 1") == ERROR
    assert driver.sample("robot_rejected_total", reason="bad_level") == 1


def test_the_config_turns_an_error_into_a_warning_and_leaves_out_what_it_ignores():
    rules = (
        ComponentRule(re.compile("^Motor"), levels={ERROR: WARN}),
        ComponentRule(re.compile("^Laser"), ignore=True),
    )
    driver = StateDriver(components=rules)
    driver.raw(HOT, LASER)

    motor = driver.component("Motor 1")
    assert (motor.level, motor.reported) == (WARN, ERROR)
    assert [each.name for each in driver.robot.components] == ["Motor 1"]


def test_every_change_is_an_event():
    driver = StateDriver()
    driver.raw(MOTOR)
    driver.at(1)
    driver.raw(HOT)

    event = driver.events[-1]
    assert (event.kind, event.robot, event.component) == ("level", "r", "Motor 1")
    assert (event.before, event.after, event.message) == ("OK", "ERROR", "Hot")


def test_the_first_level_of_a_component_is_an_event_where_it_is_not_ok():
    driver = StateDriver()
    driver.raw(HOT, LASER)

    found = [each for each in driver.events if each.kind == "level"]
    assert [(each.component, each.before, each.after) for each in found] == [
        ("Motor 1", "", "ERROR")
    ]
    assert event_text(filled(found[0])) == "Motor 1 new → ERROR: Hot"


def test_a_message_is_renewed_with_the_level_or_when_more_than_its_digits_change():
    driver = StateDriver()
    for text in ("Hot: 91 C", "Hot: 92 C"):
        driver.raw(HOT._replace(message=text))
    assert driver.component("Motor 1").message == "Hot: 91 C"

    driver.raw(HOT._replace(message="Hot: 93 C, fan dead"))
    assert driver.component("Motor 1").message == "Hot: 93 C, fan dead"


# -- silence --------------------------------------------------


def test_a_silent_robot_is_not_up_and_all_of_it_is_stale():
    driver = StateDriver(Source.AGG, stale_after=5.0)
    driver.agg(*tree(Motor=[MOTOR], Laser=[LASER]))
    driver.at(4.9)
    assert driver.sample("robot_up") == 1

    driver.at(5.5)
    assert driver.sample("robot_up") == 0
    assert (driver.level("Motor 1"), driver.level("Laser 1")) == (STALE, STALE)
    assert driver.events[-1].after in ("STALE", "silent")


def test_a_robot_never_seen_is_down_and_says_so():
    driver = StateDriver()
    driver.at(100)

    assert driver.sample("robot_up") == 0
    assert driver.sample("robot_last_message_timestamp_seconds") == 0
    assert driver.sample("robot_silent_reason", reason="never_seen") == 1


def test_a_component_of_a_raw_topic_is_late_after_three_of_its_own_gaps():
    driver = StateDriver(stale_after=60.0)
    slow, fast = Status(OK, "slow"), Status(OK, "fast")
    for second in range(31):
        driver.at(second)
        driver.raw(*([slow, fast] if second % 10 == 0 else [fast]))
    for second in range(31, 59):
        driver.at(second)
        driver.raw(Status(OK, "other"))
        assert driver.level("fast") == (OK if second <= 35 else STALE)
        assert driver.level("slow") == OK
    driver.at(61)
    driver.raw(Status(OK, "other"))
    driver.at(62)
    assert driver.level("slow") == STALE


def test_a_component_heard_once_is_given_time_for_a_slow_period():
    driver = StateDriver(stale_after=10.0)
    driver.raw(Status(OK, "every minute"))
    driver.raw_every(1, 80, Status(OK, "fast"))
    assert driver.level("every minute") == OK

    driver.raw_every(1, 100, Status(OK, "fast"))
    assert driver.level("every minute") == STALE


def test_two_arrays_at_one_moment_do_not_make_a_slow_driver_fast():
    driver = StateDriver(stale_after=10.0)
    slow = Status(OK, "every minute")
    driver.raw(slow)
    driver.raw(slow)
    driver.raw_every(1, 60, Status(OK, "fast"))
    assert driver.level("every minute") == OK

    driver.raw(slow)
    driver.raw_every(1, 239, Status(OK, "fast"))
    assert driver.level("every minute") == OK
    driver.raw_every(1, 242, Status(OK, "fast"))
    assert driver.level("every minute") == STALE


@pytest.mark.parametrize("period", [0.01, 0.5, 1.0])
def test_a_fast_driver_is_late_after_five_seconds_once_it_is_known_for_as_long(period):
    driver = StateDriver(stale_after=60.0)
    fast = Status(OK, "fast")
    driver.raw_every(period, 6, fast)
    driver.raw_every(1, 10, Status(OK, "other"))
    assert driver.level("fast") == OK

    driver.raw_every(1, 12, Status(OK, "other"))
    assert driver.level("fast") == STALE


def test_the_return_of_a_dead_driver_does_not_blunt_the_watch():
    driver = StateDriver(stale_after=1000.0)
    alive = Status(OK, "alive")
    driver.raw_every(1, 10, MOTOR, alive)
    driver.raw_every(1, 500, alive)
    assert driver.level("Motor 1") == STALE

    driver.raw_every(1, 515, MOTOR, alive)
    driver.raw_every(1, 550, alive)
    assert driver.level("Motor 1") == STALE


def test_a_component_has_its_own_threshold_from_the_config():
    rules = (ComponentRule(re.compile("Motor"), stale_after=3.0),)
    driver = StateDriver(stale_after=60.0, components=rules)
    driver.raw(MOTOR, LASER)
    driver.at(4)

    assert (driver.level("Motor 1"), driver.level("Laser 1")) == (STALE, OK)


def test_an_aggregator_that_repeats_a_stale_item_for_ever_does_not_keep_it_alive():
    driver = StateDriver(Source.AGG)
    driver.agg(*tree(Motor=[HOT]))
    for second in range(1, 30):
        driver.at(second)
        driver.agg(*tree(Motor=[HOT._replace(level=STALE)]))

    motor = driver.component("Motor 1")
    assert (motor.level, motor.before_stale, motor.message) == (STALE, ERROR, "Hot")
    assert driver.sample("robot_up") == 1


def test_a_component_that_vanishes_from_the_aggregate_is_stale_at_once():
    driver = StateDriver(Source.AGG)
    driver.agg(*tree(Motor=[HOT], Laser=[LASER]))
    driver.at(1)
    driver.agg(*tree(Laser=[LASER]))

    assert (driver.level("Motor 1"), driver.level("Laser 1")) == (STALE, OK)
    assert driver.component("Motor 1").before_stale == ERROR


def test_an_aggregator_restart_is_no_change_of_any_component():
    driver = StateDriver(Source.AGG)
    driver.agg(*tree(Motor=[MOTOR]))
    driver.at(1)
    driver.agg(Status(STALE, "/Motor", "Stale"))
    assert driver.level("Motor 1") == OK

    driver.at(2)
    driver.agg(*tree(Motor=[MOTOR]))
    assert driver.component("Motor 1").changes == 0


def test_after_an_aggregator_restart_a_component_that_stays_away_becomes_stale():
    driver = StateDriver(Source.AGG, stale_after=5.0)
    driver.agg(*tree(Motor=[HOT]))
    for second in range(1, 8):
        driver.at(second)
        driver.agg(Status(STALE, "/Motor", "Stale"))

    assert (driver.level("Motor 1"), driver.component("Motor 1").before_stale) == (STALE, ERROR)


def test_time_is_the_receivers_never_the_stamps():
    driver = StateDriver(stale_after=5.0)
    driver.raw(MOTOR, stamp=WALL - 3600)
    driver.at(4)

    assert driver.sample("robot_up") == 1
    assert driver.sample("robot_clock_offset_seconds") == 3600


# -- identity --------------------------------------------------


SENT_AND_PUBLISHED = [case for case in CASES if aggregated(case) and raw(case)]


@pytest.mark.parametrize("case", SENT_AND_PUBLISHED)
def test_raw_or_aggregated_the_components_of_a_recording_are_the_same(case):
    """Names, and the level at the end where every component is still sent."""
    seen_raw, seen_agg = StateDriver(Source.RAW), StateDriver(Source.AGG)
    for driver, arrays, take in ((seen_raw, raw(case), "raw"), (seen_agg, aggregated(case), "agg")):
        for t, array in arrays:
            driver.at(t + 1)
            getattr(driver, take)(*array.statuses)

    names = {each.name for each in seen_agg.robot.components}
    raw_names = {each.name for each in seen_raw.robot.components}
    made_up = {"Motor 9", "GPS fix", "GPS/antenna"} if case == "expected_missing" else set()
    dropped = {"Cam 1"} if case == "discard_ignore_other" else set()
    assert names - made_up == raw_names - dropped


def test_one_name_with_two_hardware_ids_in_one_array_is_two_components():
    driver = StateDriver()
    left, right = MOTOR._replace(hardware_id="left"), HOT._replace(hardware_id="right")
    driver.raw(left, right)
    driver.raw(right)

    assert driver.level("Motor 1 [left]") == OK
    assert driver.level("Motor 1 [right]") == ERROR
    assert len(driver.robot.components) == 2


def test_an_id_that_is_filled_in_later_is_information_only():
    """A node that starts says "Node starting up" with an empty hardware_id."""
    driver = StateDriver()
    driver.raw(Status(OK, "Motor 1", "Node starting up"))
    driver.raw(MOTOR)

    (motor,) = driver.robot.components
    assert motor.hardware_id == "mc-01"
    assert driver.sample("component_info", hardware_id="mc-01") == 1


def test_the_group_of_a_raw_component_is_its_node():
    driver = StateDriver()
    driver.raw(Status(OK, "mavros: endpoint 1: /dev/ttyUSB0:57600"), Status(OK, "/arms/motor"))

    groups = {each.name: each.group for each in driver.robot.components}
    assert groups == {"mavros: endpoint 1: /dev/ttyUSB0:57600": "mavros", "/arms/motor": ""}


def test_a_source_of_auto_takes_the_aggregate_and_holds_it():
    driver = StateDriver(Source.AUTO)
    driver.raw(MOTOR)
    driver.at(1)
    driver.agg(*tree(Motor=[MOTOR]))
    driver.at(9)
    driver.raw(HOT)

    assert driver.robot.source is Source.AGG
    assert (driver.level("Motor 1"), driver.component("Motor 1").group) == (OK, "/Motor")


def test_a_source_of_auto_takes_raw_where_no_aggregate_comes():
    driver = StateDriver(Source.AUTO)
    driver.raw_every(1, 7, HOT)
    driver.agg(*tree(Motor=[MOTOR]))

    assert driver.robot.source is Source.RAW
    assert driver.level("Motor 1") == ERROR


def test_with_both_the_aggregate_gives_the_group_and_raw_the_changes():
    driver = StateDriver(Source.BOTH)
    driver.raw(MOTOR)
    driver.agg(*tree(Motor=[MOTOR]))
    driver.raw(HOT)
    driver.raw(MOTOR)
    driver.agg(*tree(Motor=[MOTOR]))

    motor = driver.component("Motor 1")
    assert (motor.group, motor.changes, motor.level) == ("/Motor", 2, OK)


# -- forgetting --------------------------------------------------


def test_absence_never_ends_a_fault_but_what_was_ok_is_forgotten():
    driver = StateDriver(forget_after=100.0, stale_after=5.0)
    driver.raw_every(1, 5, HOT, LASER)
    driver.at(200)

    assert [each.name for each in driver.robot.components] == ["Motor 1"]


RAW = "/r/diagnostics"
LOW = ValueRule(thresholds=(Threshold("low", "critical", 10.0),))


BY_TOPIC = Discovery(
    re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics", source=Source.RAW
)


def look(driver: StateDriver, *robots: str) -> None:
    """Find the topics of these robots, each with a publisher."""
    endpoints = {f"/{name}/diagnostics": Endpoint(1) for name in robots}
    driver.state.update_graph(0, endpoints, driver.now)


def discovered(**profile) -> StateDriver:
    """One robot "r", found by its topic."""
    profile = Profile(forget_after=100.0, stale_after=5.0, **profile)
    found = dataclasses.replace(BY_TOPIC, profile=profile)
    driver = StateDriver(fleet=Fleet("f", discoveries=(found,)))
    look(driver, "r")
    return driver


STALE_IS_OK = {"components": (ComponentRule(re.compile(""), levels={STALE: OK}),)}
ERROR_IS_OK = {"components": (ComponentRule(re.compile(""), levels={ERROR: OK}),)}
PLANNED = {"components": (ComponentRule(re.compile("Motor"), planned_stale=True),)}
LEFT = {  # the last status of a discovered robot's motor, its profile; whether the motor stays
    "error": (HOT, {}, True),
    "stale": (MOTOR._replace(level=STALE), {}, True),
    "stale counts as ok": (HOT, STALE_IS_OK, True),
    "value": (MOTOR._replace(values=(("Volt", "9"),)), {"values": (LOW,)}, True),
    "ok": (MOTOR, {}, False),
    "error counts as ok": (HOT, ERROR_IS_OK, False),
    "value above the threshold": (
        MOTOR._replace(values=(("Volt", "11"),)),
        {"values": (LOW,)},
        False,
    ),
    "planned stale": (MOTOR._replace(level=STALE), PLANNED, False),
}


@pytest.mark.parametrize(("status", "rules", "stays"), LEFT.values(), ids=LEFT)
def test_a_discovered_robot_stays_until_a_person_takes_it_out_with_what_was_not_ok(
    status, rules, stays
):
    driver = discovered(**rules)
    driver.raw_every(1, 5, status, LASER)
    driver.state.update_graph(0, {}, driver.now)
    for seconds in (1_000, 1_500):
        driver.at(seconds)
        assert [each.name for each in driver.robot.components] == ["Motor 1"] * stays
        assert State.SILENT in {each.identity.state for each in driver.state.faults()}

    driver.state.forget("r", None, driver.now)
    assert not driver.state.robots
    assert {end.reason for end in driver.state.served()[1]} == {"removed"}


def test_what_the_network_keeps_from_us_is_not_forgotten():
    driver = discovered()
    driver.raw(MOTOR)
    driver.state.update_graph(0, {RAW: Endpoint(0, wrong_type="std_msgs/msg/String")}, driver.now)
    driver.at(1_000)
    assert driver.robot.silent_reason == "wrong_type"


def test_a_discovered_robot_that_never_publishes_is_forgotten_when_its_publisher_is_long_gone():
    driver = discovered()
    driver.at(500)
    assert driver.robot.silent_reason == "mute"
    driver.state.update_graph(0, {}, driver.now)
    driver.at(599)
    assert driver.robot.silent_reason == "never_seen"
    driver.at(602)
    assert not driver.state.robots


def test_forget_takes_out_what_a_person_names():
    driver = StateDriver()
    driver.raw(HOT, LASER)

    assert driver.state.forget("r", "Motor 1", driver.now) == 1
    for name, component in (("r", "no such"), ("no such", "Laser 1")):
        with pytest.raises(LookupError, match="no such"):
            driver.state.forget(name, component, driver.now)
    assert [each.name for each in driver.robot.components] == ["Laser 1"]


def test_what_a_person_forgets_is_known_again_with_the_next_array():
    driver = StateDriver(Source.AGG)
    array = tree(Parts=[HOT, LASER])
    driver.agg(*array)
    driver.state.forget("r", "Motor 1", driver.now)
    driver.agg(*array)
    assert driver.level("Motor 1") == ERROR


# -- fleet --------------------------------------------------


def discovering(**more) -> StateDriver:
    discovery = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg"), "/{robot}/diagnostics_agg", **more
    )
    return StateDriver(fleet=Fleet("f", discoveries=(discovery,)))


def test_a_robot_is_in_maintenance_from_the_moment_it_is_known():
    """Else a scrape after a restart would end the downtime, and the next begin it anew."""
    every = Maintenance("m", {"robot": (re.compile(".*"),)}, "always")
    found = Discovery(re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    driver = StateDriver(fleet=Fleet("f", (Robot("r"),), (found,), maintenance=(every,)))
    driver.state.update_graph(0, {"/new/diagnostics": Endpoint(1)}, driver.now)

    assert driver.sample("robot_maintenance", robot="r") == 1
    assert driver.sample("robot_maintenance", robot="new") == 1


def test_a_downtime_of_many_robots_is_one_sample_for_each_site():
    of_sites = Maintenance("floor", {"site": (re.compile("hall|yard"),)}, "new", start=WALL + 10)
    sites = ("hall", "hall", "yard", "lab")
    robots = tuple(Robot(f"r{n}", labels={"site": each}) for n, each in enumerate(sites))
    driver = StateDriver(fleet=Fleet("f", robots, maintenance=(of_sites,)))
    planned = [("", WALL + 20), ("Motor", WALL + 20), ("", WALL + 5)]
    downtimes = [Downtime("r0", part, WALL, end, "ann", "\u202ex") for part, end in planned]
    driver.state.plan(downtimes, driver.now)
    ann = {(("author", "ann"), ("downtime", "\\u202ex"), ("fleet", "f"), ("site", "hall")): 1.0}
    floor = {
        (("downtime", "floor"), ("fleet", "f"), ("site", "hall")): 2.0,
        (("downtime", "floor"), ("fleet", "f"), ("site", "yard")): 1.0,
    }

    found = []
    for seconds in (2, 12, 22):
        driver.at(seconds)
        samples = driver.samples().get("downtime_robots", {})
        found.append({tuple(sorted(labels)): number for labels, number in samples.items()})
    assert found == [ann, ann | floor, floor]


def test_a_robot_is_discovered_by_its_topic_and_wants_both_of_its_topics():
    driver = discovering()
    driver.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(1)}, driver.now)

    assert driver.state.wanted_topics(0) == {"/r/diagnostics_agg": False, "/r/diagnostics": False}
    driver.agg(*tree(Motor=[MOTOR]))
    assert driver.sample("robot_up", robot="r") == 1
    assert driver.state.wanted_topics(0) == {"/r/diagnostics_agg": False}


def test_a_topic_without_publisher_is_no_robot():
    driver = discovering()
    driver.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(0)}, driver.now)

    assert not driver.state.robots


@pytest.mark.parametrize(
    ("domain_id", "robot", "is_found"),
    [
        (0, "r1", True),
        (7, "r1", True),
        (1, "r1", False),
        pytest.param(0, "r9", False, id="excluded"),
        pytest.param(0, "r1b", False, id="only a part of its name is included"),
    ],
)
def test_a_discovery_finds_the_robots_of_its_domains_that_it_includes(domain_id, robot, is_found):
    only = {"include": (re.compile("r[0-9]"),), "exclude": (re.compile("r9"),)}
    driver = discovering(domain_ids=(0, 7), **only)
    topic = f"/{robot}/diagnostics_agg"
    driver.state.update_graph(domain_id, {topic: Endpoint(1)}, driver.now)

    assert bool(driver.state.robots) is is_found


def test_the_reason_of_silence_follows_the_graph():
    driver = StateDriver(stale_after=5.0)

    def graph(**endpoint) -> None:
        endpoints = {RAW: Endpoint(1, **endpoint)} if driver.now.mono < 10 else {}
        driver.state.update_graph(0, endpoints, driver.now)

    graph()
    assert driver.robot.silent_reason == "mute"
    graph(wrong_type="std_msgs/msg/String")
    assert driver.robot.silent_reason == "wrong_type"
    graph()
    driver.raw(MOTOR)
    assert driver.robot.silent_reason is None
    driver.at(10)
    graph()
    assert driver.robot.silent_reason == "publisher_gone"
    driver.state.reject_undecodable(Topic(0, RAW), "bad bytes", driver.now)
    assert driver.robot.silent_reason == "undecodable"
    driver.state.domain_failed(0, "broken", driver.now)
    assert driver.robot.silent_reason == "domain_unreachable"
    shown = {
        dict(labels)["reason"]: v for labels, v in driver.samples()["robot_silent_reason"].items()
    }
    assert shown == {"domain_unreachable": 1}


def test_the_graph_of_one_domain_says_nothing_of_another():
    here, there = (
        Robot(name, domain_id=domain_id, topic_raw="/diagnostics", source=Source.RAW)
        for name, domain_id in (("here", 0), ("there", 1))
    )
    driver = StateDriver(fleet=Fleet("f", (here, there)))
    driver.state.update_graph(0, {"/diagnostics": Endpoint(2)}, driver.now)
    driver.state.update_graph(1, {}, driver.now)

    assert driver.sample("robot_publishers", robot="here") == 2
    assert driver.sample("robot_publishers", robot="there") == 0


# -- checks and bounds --------------------------------------------------


def test_checks_count_their_components_by_level():
    checks = (Check("all"), Check("motors", (re.compile("motor", re.IGNORECASE),), expect=2))
    driver = StateDriver(checks=checks)
    driver.raw(HOT, LASER, Status(WARN, "Motor 2"))

    assert driver.sample("check_components", check="all", level="ok") == 1
    assert driver.sample("check_components", check="motors", level="ok") == 0
    assert driver.sample("check_components", check="motors", level="warn") == 1
    assert driver.sample("check_components", check="motors", level="error") == 1
    assert driver.sample("check_expected_components", check="motors") == 2
    assert driver.sample("check_expected_components", check="all") is None


def bounded_story(**limits) -> StateDriver:
    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW)
    return StateDriver(fleet=Fleet("f", (robot,), limits=Limits(**limits)))


def test_too_many_components_lose_only_the_surplus_and_never_the_known():
    driver = bounded_story(components=3)
    driver.raw(*(Status(OK, f"c{n}") for n in range(3)))
    driver.raw(*(Status(ERROR, f"x{n}") for n in range(5)), Status(WARN, "c1"))

    assert sorted(each.name for each in driver.robot.components) == ["c0", "c1", "c2"]
    assert driver.level("c1") == WARN
    assert driver.sample("robot_rejected_total", reason="component_limit") == 5


def test_too_many_values_lose_only_the_surplus():
    driver = bounded_story(values=2)
    driver.raw(Status(OK, "c", values=(("a", "1"), ("b", "2"), ("c", "3"))))

    assert driver.sample("component_value", key="b") == 2
    assert driver.sample("component_value", key="c") is None
    assert driver.sample("robot_rejected_total", reason="value_limit") == 1


def test_the_budget_of_series_is_kept_and_given_back():
    driver = bounded_story(series=44)
    driver.raw(*(Status(OK, f"c{n}") for n in range(5)))
    assert len(driver.robot.components) == 3
    assert driver.sample("robot_rejected_total", reason="series_limit") == 2

    driver.state.forget("r", "c0", driver.now)
    driver.raw(Status(OK, "c4"))
    assert driver.level("c4") == OK


def test_long_names_are_cut_and_stay_different():
    driver = bounded_story(label_length=64)
    driver.raw(Status(OK, "x" * 1000 + "a"), Status(ERROR, "x" * 1000 + "b"))

    names = {each.name for each in driver.robot.components}
    assert len(names) == 2
    assert all(len(name) == 64 for name in names)


def test_more_robots_than_the_limit_are_refused_and_counted():
    fleet = Fleet("f", tuple(Robot(f"r{n}") for n in range(3)), limits=Limits(robots=2))
    driver = StateDriver(fleet=fleet)

    assert len(driver.state.robots) == 2
    assert driver.state.rejected["robot_limit"] == 1
    assert driver.sample("robot_silent_reason", robot="r2", reason="limit") == 1

    driver.state.configure(Fleet("f", fleet.robots[1:], limits=Limits(robots=2)), driver.now)
    assert set(driver.state.robots) == {"r1", "r2"}
    assert driver.sample("robot_silent_reason", reason="limit") is None


# -- robots that never publish --------------------------------------------------


def crowded(limit: int) -> StateDriver:
    return StateDriver(fleet=Fleet("f", discoveries=(BY_TOPIC,), limits=Limits(robots=limit)))


def test_a_robot_that_never_published_gives_way_once_it_had_time_to():
    driver = crowded(2)
    look(driver, "mute", "r")
    driver.raw(MOTOR)
    for seconds in (1, TIME_TO_PUBLISH - 1):
        driver.at(seconds)
        look(driver, "mute", "r", "new")
        assert set(driver.state.robots) == {"mute", "r"}

    driver.at(TIME_TO_PUBLISH)
    look(driver, "mute", "r", "new")
    assert set(driver.state.robots) == {"r", "new"}
    look(driver, "mute", "r", "new")
    assert driver.sample("robot_silent_reason", robot="mute", reason="limit") == 1
    assert driver.sample("robot_silent_reason", robot="new", reason="limit") is None


def test_a_robot_that_published_never_gives_way():
    driver = crowded(1)
    look(driver, "r")
    driver.raw(MOTOR)
    driver.at(100_000)
    look(driver, "r", "new")
    assert set(driver.state.robots) == {"r"}


def test_every_robot_that_waits_has_its_turn():
    """However many only announce their topic, and however their names are sorted."""
    driver = crowded(5)
    mute = [f"a{n}" for n in range(20)]
    seen = set()
    for turn in range(1, 8):
        look(driver, *mute, "z")
        seen |= driver.state.robots.keys()
        if "z" in driver.state.robots:
            break
        driver.at(turn * TIME_TO_PUBLISH)
    assert seen == {*mute, "z"}


def test_a_declared_robot_needs_not_wait():
    driver = crowded(1)
    look(driver, "mute")
    declared = dataclasses.replace(driver.state.fleet, robots=(Robot("r", topic_raw=RAW),))
    driver.state.configure(declared, driver.now)
    assert set(driver.state.robots) == {"r"}


def test_what_is_received_is_recorded_as_it_came():
    driver = StateDriver()
    recorded = []
    driver.state.recorder = lambda *message: recorded.append(message)
    topic, array = Topic(0, "/r/diagnostics"), Array(0.0, (HOT,), 3, b"raw")
    driver.state.receive(topic, array, driver.now)

    assert recorded == [(Stream(topic), b"raw", driver.now)]
    assert set(driver.state.topics_of("r")) == {topic, Topic(0, "/r/diagnostics_agg")}
    assert driver.state.topics_of("nobody") == ()
