"""What is known about a robot, on a time line of seconds."""

import re
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Fleet,
    Limits,
    Profile,
    Query,
    Robot,
    Source,
)
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.events import filled
from ros_diagnostics_exporter.model import Endpoint, Status
from ros_diagnostics_exporter.robots.updates import is_of_graph
from ros_diagnostics_exporter.sources.link import LinkReading
from ros_diagnostics_exporter.sources.robot_graph import GRAPH, GROUP
from support.state_driver import ERROR, HOT, LASER, MOTOR, OK, STALE, WALL, WARN, StateDriver, tree

# -- history --------------------------------------------------


def of_motor(driver: StateDriver) -> tuple[int, float, float | None, int]:
    """Its level, since when, since when it is a problem, and its changes."""
    motor = driver.component("Motor 1")
    return motor.level, motor.since, driver.problem_since("Motor 1"), motor.changes


def test_a_fault_has_a_begin_a_course_and_an_end():
    driver = StateDriver().raw(MOTOR)
    driver.at(1)
    driver.raw(MOTOR._replace(level=WARN))
    driver.at(2)
    driver.raw(HOT)

    assert of_motor(driver) == (ERROR, WALL + 2, WALL + 1, 2)
    driver.at(3)
    driver.raw(MOTOR)
    assert of_motor(driver) == (OK, WALL + 3, None, 3)


def test_stale_keeps_the_begin_of_the_problem_and_the_level_before():
    driver = StateDriver(stale_after=5.0).raw_every(1, 3, HOT)
    driver.at(20)

    motor = driver.component("Motor 1")
    assert motor.before_stale == ERROR
    assert of_motor(driver)[::2] == (STALE, WALL)

    driver.raw(MOTOR)
    assert motor.before_stale is None
    assert of_motor(driver)[::2] == (OK, None)


def test_a_fault_shorter_than_a_scrape_leaves_its_two_changes():
    driver = StateDriver().raw(MOTOR)
    driver.samples()
    driver.raw(HOT)
    driver.raw(MOTOR)

    assert driver.sample("component_changes_total", component="Motor 1") == 2


def test_a_level_beyond_stale_is_an_error_and_counted():
    driver = StateDriver().raw(MOTOR._replace(level=255))

    assert driver.level("Motor 1") == ERROR
    assert driver.sample("robot_rejected_total", reason="bad_level") == 1


def test_the_config_turns_an_error_into_a_warning_and_leaves_out_what_it_ignores():
    rules = (
        ComponentRule(re.compile("^Motor"), levels={ERROR: WARN}),
        ComponentRule(re.compile("^Laser"), ignore=True),
    )
    driver = StateDriver(components=rules).raw(HOT, LASER)

    motor = driver.component("Motor 1")
    assert (motor.level, motor.reported) == (WARN, ERROR)
    assert [each.name for each in driver.robot.components] == ["Motor 1"]


def test_every_change_is_an_event_and_a_first_level_that_is_not_ok():
    driver = StateDriver().raw(HOT, LASER)
    driver.raw(MOTOR)

    first, second = (each for each in driver.events if each.kind == "level")
    assert event_text(filled(first)) == "Motor 1 new → ERROR: Hot"
    assert (second.robot, second.component, second.before, second.after, second.message) == (
        *("r", "Motor 1", "ERROR", "OK", "OK"),
    )


def test_a_message_is_renewed_with_the_level_or_when_more_than_its_digits_change():
    driver = StateDriver()
    for text in ("Hot: 91 C", "Hot: 92 C"):
        driver.raw(HOT._replace(message=text))
    assert driver.component("Motor 1").message == "Hot: 91 C"

    driver.raw(HOT._replace(message="Hot: 93 C, fan dead"))
    assert driver.component("Motor 1").message == "Hot: 93 C, fan dead"


# -- silence --------------------------------------------------


def test_a_robot_never_seen_is_down_and_says_so():
    driver = StateDriver().at(100)

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
        assert driver.raw(Status(OK, "other")).level("fast") == (OK if second <= 35 else STALE)
        assert driver.level("slow") == OK
    driver.at(61)
    driver.raw(Status(OK, "other"))
    assert driver.at(62).level("slow") == STALE


def test_two_arrays_at_one_moment_do_not_make_a_slow_driver_fast():
    driver = StateDriver(stale_after=10.0)
    slow = Status(OK, "every minute")
    driver.raw(slow)
    driver.raw(slow)
    assert driver.raw_every(1, 60, Status(OK, "fast")).level("every minute") == OK

    driver.raw(slow)
    assert driver.raw_every(1, 239, Status(OK, "fast")).level("every minute") == OK
    assert driver.raw_every(1, 242, Status(OK, "fast")).level("every minute") == STALE


@pytest.mark.parametrize("period", [0.01, 0.5, 1.0])
def test_a_fast_driver_is_late_after_five_seconds_once_it_is_known_for_as_long(period):
    driver = StateDriver(stale_after=60.0)
    fast = Status(OK, "fast")
    driver.raw_every(period, 6, fast)
    assert driver.raw_every(1, 10, Status(OK, "other")).level("fast") == OK

    assert driver.raw_every(1, 12, Status(OK, "other")).level("fast") == STALE


def test_the_return_of_a_dead_driver_does_not_blunt_the_watch():
    driver = StateDriver(stale_after=1000.0)
    alive = Status(OK, "alive")
    driver.raw_every(1, 10, MOTOR, alive)
    assert driver.raw_every(1, 500, alive).level("Motor 1") == STALE

    driver.raw_every(1, 515, MOTOR, alive)
    assert driver.raw_every(1, 550, alive).level("Motor 1") == STALE


def test_a_component_has_its_own_threshold_from_the_config():
    rules = (ComponentRule(re.compile("Motor"), stale_after=3.0),)
    driver = StateDriver(stale_after=60.0, components=rules).raw(MOTOR, LASER)
    driver.at(4)

    assert (driver.level("Motor 1"), driver.level("Laser 1")) == (STALE, OK)


def test_an_aggregator_that_repeats_a_stale_item_for_ever_does_not_keep_it_alive():
    driver = StateDriver(Source.AGG).agg(*tree(Motor=[HOT]))
    for second in range(1, 30):
        driver.at(second)
        driver.agg(*tree(Motor=[HOT._replace(level=STALE)]))
        assert driver.level("Motor 1") == STALE

    motor = driver.component("Motor 1")
    assert (motor.level, motor.before_stale, motor.message) == (STALE, ERROR, "Hot")
    assert driver.sample("robot_up") == 1


def test_time_is_the_receivers_never_the_stamps():
    driver = StateDriver(stale_after=5.0).raw(MOTOR, stamp=WALL - 3600)
    driver.at(4)

    assert driver.sample("robot_up") == 1
    assert driver.sample("robot_clock_offset_seconds") == 3600


def test_a_clock_is_behind_as_the_stamps_say_and_without_stamps_as_the_link_does():
    driver = StateDriver()
    for stamp, behind in ((0.0, 5.0), (WALL - 3600, 3600.0)):
        driver.raw(MOTOR, stamp=stamp)
        driver.robot.update_link(LinkReading(1, 0, 0.0, 0.0, behind=5.0))
        assert driver.robot.clock_behind == behind


# -- identity --------------------------------------------------


def test_one_name_with_two_hardware_ids_in_one_array_is_two_components():
    driver = StateDriver()
    left, right = MOTOR._replace(hardware_id="left"), HOT._replace(hardware_id="right")
    driver.raw(left, right)
    driver.raw(right)

    assert driver.level("Motor 1 [left]") == OK
    assert driver.level("Motor 1 [right]") == ERROR
    assert len(driver.robot.components) == 2


def test_fleet_yml_says_what_a_level_means_that_ros_does_not_know(tmp_path):
    """An aggregator of a maker: what was not started yet has level 255."""
    (tmp_path / "fleet.yml").write_text(
        """
        fleet: f
        profiles: {default: {components: [{match: {regex: .}, levels: {255: ok, 4: error}}]}}
        robots: [{name: r, topic: /r/diagnostics_agg}]
        """
    )
    driver = StateDriver(fleet=load(tmp_path / "fleet.yml"))
    sonar = Status(255, "Stream", "Not started")
    driver.agg_every(1, 60, *tree(Sonar=[sonar, Status(4, "Setup", "failed")]))
    assert driver.fault_names() == {("component", "critical", "r", "/Sonar", "Setup")}
    assert driver.component("Stream").level == OK
    assert driver.robot.rejected["bad_level"] == 0
    (shown, _setup) = fleet_snapshot(driver.state, driver.now)["robots"][0]["components"]
    assert (shown["level"], shown["reported_level"]) == ("OK", "ERROR")

    driver.follow_profile(Profile())
    assert driver.component("Stream").level == ERROR


def test_an_id_that_is_filled_in_later_is_information_only():
    """A node that starts says "Node starting up" with an empty hardware_id."""
    driver = StateDriver().raw(Status(OK, "Motor 1", "Node starting up"))
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
    driver = StateDriver(Source.AUTO).raw(MOTOR)
    driver.at(1)
    driver.agg(*tree(Motor=[MOTOR]))
    driver.at(9)
    driver.raw(HOT)

    assert driver.robot.source is Source.AGG
    assert (driver.level("Motor 1"), driver.component("Motor 1").group) == (OK, "/Motor")


def test_a_source_of_auto_takes_raw_while_no_aggregate_comes():
    driver = StateDriver(Source.AUTO).raw_every(1, 7, HOT)

    assert driver.robot.source is Source.RAW
    assert driver.level("Motor 1") == ERROR
    assert (driver.robot.topic, driver.sample("robot_info", topic="/r/diagnostics")) == (
        "/r/diagnostics",
        1,
    )
    assert driver.state.wanted_topics(0) == {"/r/diagnostics": False, "/r/diagnostics_agg": False}


def read_both(driver: StateDriver, seconds: int, raw, aggregated) -> None:
    """Receive both topics once a second."""
    for _ in driver.seconds(seconds):
        driver.raw(*raw)
        driver.agg(*tree(Motor=aggregated))


def test_a_robot_whose_aggregator_starts_late_is_read_from_that_and_keeps_its_faults():
    driver = StateDriver(Source.AUTO).raw_every(1, 60, HOT, LASER)
    read_both(driver, 50, (HOT, LASER), [HOT])
    assert driver.robot.source is Source.BOTH
    assert driver.level(LASER.name) == LASER.level
    read_both(driver, 30, (HOT, LASER), [HOT])
    assert driver.robot.source is Source.AGG
    assert driver.state.wanted_topics(0) == {"/r/diagnostics_agg": False}
    assert driver.component("Motor 1").group == ""  # as its fault has it, until that is over
    assert [each.name for each in driver.robot.components] == ["Motor 1"]  # all that it lists
    assert driver.sample("robot_info", topic="/r/diagnostics_agg") == 1
    told = [each.message for each in driver.events if each.kind == "graph"]
    assert told == ["diagnostics are read from /r/diagnostics_agg in place of /r/diagnostics"]
    faults = [each for each in driver.events if each.kind == "fault_began"]
    assert [(each.group, each.since) for each in faults] == [("", WALL + 5)]
    driver.agg_every(1, driver.now.mono + 20, *tree(Motor=[MOTOR]))
    assert (driver.level("Motor 1"), driver.component("Motor 1").group) == (OK, "/Motor")
    assert driver.state.faults() == []


def test_an_aggregator_that_runs_for_a_moment_takes_nothing_over():
    driver = StateDriver(Source.AUTO).raw_every(1, 60, HOT)
    for _ in range(3):
        read_both(driver, 30, (HOT,), [MOTOR])
        driver.raw_every(1, int(driver.now.mono) + 60, HOT)
    assert driver.robot.source is Source.BOTH
    assert driver.level("Motor 1") == ERROR


def test_with_both_the_aggregate_gives_the_group_and_raw_the_changes():
    driver = StateDriver(Source.BOTH).raw(MOTOR)
    driver.agg(*tree(Motor=[MOTOR]))
    driver.raw(HOT)
    driver.raw(MOTOR)
    driver.agg(*tree(Motor=[MOTOR]))

    motor = driver.component("Motor 1")
    assert (motor.group, motor.changes, motor.level) == ("/Motor", 2, OK)


# -- checks and bounds --------------------------------------------------


def test_checks_count_their_components_by_level():
    checks = (Check("all"), Check("motors", (re.compile("motor", re.IGNORECASE),), expect=2))
    fine = [Status(OK, f"Motor {number}") for number in (3, 4)]
    driver = StateDriver(checks=checks).raw(HOT, LASER, Status(WARN, "Motor 2"), *fine)

    assert driver.sample("check_components", check="all", level="ok") == 3
    assert driver.sample("check_components", check="motors", level="ok") == 2
    assert driver.sample("check_components", check="motors", level="warn") == 1
    assert driver.sample("check_components", check="motors", level="error") == 1
    assert driver.sample("check_expected_components", check="motors") == 2
    assert driver.sample("check_expected_components", check="all") is None


def bounded_story(**limits) -> StateDriver:
    return StateDriver().configure(limits=Limits(**limits))


def test_too_many_components_lose_only_the_surplus_and_never_the_known(caplog):
    driver = bounded_story(components=3).raw(*(Status(OK, f"c{n}") for n in range(3)))
    driver.raw(*(Status(ERROR, f"x{n}") for n in range(5)), Status(WARN, "c1"))

    assert sorted(each.name for each in driver.robot.components) == ["c0", "c1", "c2"]
    assert driver.level("c1") == WARN
    assert driver.sample("robot_rejected_total", reason="component_limit") == 5
    assert caplog.text.count("components or groups beyond limits.components") == 1
    assert "'x0'" in caplog.text


def test_the_budget_of_series_is_kept_and_given_back():
    driver = bounded_story(series=44)
    assert len(driver.raw(*(Status(OK, f"c{n}") for n in range(5))).robot.components) == 3
    assert driver.sample("robot_rejected_total", reason="series_limit") == 2

    driver.state.forget("r", "c0", driver.now)
    assert driver.raw(Status(OK, "c4")).level("c4") == OK


def test_long_names_are_cut_and_stay_different(caplog):
    driver = bounded_story(label_length=64)
    driver.raw(Status(OK, "x" * 1000 + "a"), Status(ERROR, "x" * 1000 + "b"))

    assert "is truncated, for example 'xxx" in caplog.text
    names = {each.name for each in driver.robot.components}
    assert len(names) == 2
    assert all(len(name) == 64 for name in names)


# -- another config -------------------------------------------


def configure(driver: StateDriver, **settings: object) -> None:
    robot = driver.robot
    robot.configure(replace(robot.settings, **settings), robot.limits, driver.now)


def test_another_profile_counts_at_once_for_what_was_reported_last():
    driver = StateDriver().raw(Status(OK, "Fan"), HOT, LASER)
    rules = (
        ComponentRule(re.compile("^Motor"), levels={ERROR: WARN}),
        ComponentRule(re.compile("Fan"), ignore=True),
    )
    configure(driver, profile=Profile(components=rules))

    levels = [(each.name, each.level) for each in driver.robot.components]
    assert levels == [("Motor 1", WARN), ("Laser 1", OK)]


def test_what_the_network_shows_is_of_its_topics():
    driver = StateDriver()
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    configure(driver, profile=Profile(stale_after=7.0))
    assert driver.robot.network.publishers == 1
    configure(driver, topic_raw="/elsewhere")
    assert driver.robot.network.publishers == 0


def test_only_what_has_ros_falls_silent():
    ping = Query("x", "ping", "Uplink", "robot", uplink=True)
    robots = (Robot("r", source=Source.QUERIES, profile=Profile()),)
    driver = StateDriver(fleet=Fleet("f", robots, queries=(ping,)))

    def measure(level: int) -> bool:
        driver.state.receive_answer(ping.feed, {"r": (Status(level, "ping"),)}, driver.now)
        return driver.robot.fails_as_uplink

    assert measure(OK) is False
    assert driver.robot.up
    assert driver.robot.next_tick == driver.robot.components.next_late
    assert measure(ERROR) is True
    configure(driver, source=Source.RAW)
    assert driver.robot.next_tick == driver.now.mono + driver.robot.settings.profile.stale_after
    driver.robot.tick(driver.now._replace(mono=1_000.0))
    assert not driver.robot.up
    configure(driver, source=Source.QUERIES)
    assert measure(ERROR) is True
    driver.robot.tick(driver.now._replace(mono=2_000.0))
    assert driver.robot.up


def test_what_an_array_of_the_aggregator_lacks_is_missing_until_one_has_it():
    driver = StateDriver(Source.AGG)
    for statuses, missing in (([MOTOR, LASER], False), ([MOTOR], True), ([MOTOR, LASER], False)):
        assert driver.agg(*tree(Motor=statuses)).component("Laser 1").missing is missing


@pytest.mark.parametrize("groups", [{"A": [MOTOR], "B": [HOT]}, {"A": [HOT], "B": [MOTOR]}])
def test_of_two_groups_that_have_a_component_the_worse_counts(groups):
    driver = StateDriver(Source.AGG).agg(*tree(A=[MOTOR], B=[MOTOR]))
    assert driver.agg(*tree(**groups)).level("Motor 1") == ERROR


def test_what_the_ros_graph_shows_is_known_by_its_group():
    of_graph = [is_of_graph(("node", group, "")) for group in (f"query:{GROUP}", "query:x", GROUP)]
    assert of_graph == [True, False, False]


def test_what_a_query_measured_goes_with_it_and_what_the_ros_graph_shows_stays():
    driver = StateDriver().raw(MOTOR)
    ping = Query("x", "ping", robot="robot")
    driver.configure(queries=(ping,)).robot.measure(GRAPH, (Status(OK, "node"),), driver.now)
    driver.state.receive_answer(ping.feed, {"r": (Status(OK, "ping"),)}, driver.now)
    names = [each.name for each in driver.robot.components]
    assert names == ["Motor 1", "node", "ping"]
    assert [each.name for each in driver.configure(queries=()).robot.components] == names[:-1]


def test_a_component_that_reports_no_more_is_shown_with_what_it_reported_last():
    driver = StateDriver(stale_after=5.0).raw(HOT, Status(ERROR, "Arm"))
    accounts = [driver.component(name).trouble_text for name in ("Motor 1", "Arm")]
    assert accounts == ["Hot", ""]
    driver.at(10)
    accounts = [driver.component(name).trouble_text for name in ("Motor 1", "Arm")]
    assert accounts == ["no longer reports; its last message: Hot", "no longer reports"]


def test_that_a_domain_cannot_be_joined_holds_for_another_topic_of_it_and_not_for_another_domain():
    driver = StateDriver()
    robot = driver.robot
    robot.network.domain_up = False
    other = replace(robot.settings, topic_raw="/other")
    robot.configure(other, robot.limits, driver.now)
    assert not robot.network.domain_up
    robot.configure(replace(other, domain_id=other.domain_id + 1), robot.limits, driver.now)
    assert robot.network.domain_up
