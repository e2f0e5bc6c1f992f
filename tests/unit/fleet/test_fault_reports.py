"""What the state receives becomes faults: arrays, silence, time and config in, faults out."""

import json
import re
from dataclasses import replace
from unittest.mock import patch

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.capabilities import Capability, ComponentsOf, Expression
from ros_diagnostics_exporter.config.conditions import Condition
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Check,
    ComponentRule,
    Discovery,
    FaultSettings,
    Fleet,
    Maintenance,
    Profile,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import Reason, Row, State
from ros_diagnostics_exporter.fleet.robot_reports import RobotReports
from ros_diagnostics_exporter.model import Downtime, Endpoint, Instant, Status
from ros_diagnostics_exporter.regex import Pattern
from support.state_driver import ERROR, OK, SETTLED, STALE, WALL, WARN, StateDriver, raw_fleet, tree

MOTOR, LASER = Status(OK, "Motor"), Status(OK, "Laser")
CRITICAL = ("component", "critical", "r", "Motor")
HOT, WARM = Status(ERROR, "Motor", "Hot"), Status(WARN, "Motor", "Warm")


def settled(*statuses: Status, **profile) -> StateDriver:
    """A robot that is received once a second, with these statuses, until restart_grace is over."""
    return StateDriver(**profile).raw_every(1, SETTLED, *statuses)


def reloaded(driver: StateDriver, **profile) -> None:
    (robot,) = driver.state.fleet.robots
    driver.follow_profile(replace(robot.profile, **profile))


def restarted(driver: StateDriver, rows: list[Row]) -> StateDriver:
    """Another process, from the rows and the robots that the one before wrote."""
    again = StateDriver(fleet=driver.state.fleet)
    again.now = driver.now
    written = {name: robot.persist(driver.now) for name, robot in driver.state.robots.items()}
    again.state.restore(written, again.now)
    stored = json.loads(json.dumps(rows))
    again.restore_faults([Row(kind, tuple(key), fields) for kind, key, fields in stored])
    return again


# -- components ----------------------------------------------------------------------------------


def test_what_was_due_begins_by_what_was_known_before_the_message_that_ends_it():
    """No tick comes between: the exporter takes a message as soon as it is there."""
    driver = settled(MOTOR).stand(9, HOT)
    after = driver.now.mono + 1.1
    driver.now = Instant(after, WALL + after)
    began, ended = [each for each in driver.raw(MOTOR).events if each.kind.startswith("fault")]
    assert (began.kind, ended.kind) == ("fault_began", "fault_ended")
    assert (began.message, began.details["level"]) == ("Hot", "ERROR")


def test_config_says_when_stale_is_critical_and_what_a_level_counts_as():
    rules = (ComponentRule(re.compile("Motor"), levels={WARN: OK}),)
    driver = settled(MOTOR, stale_is_critical=True, components=rules)
    assert driver.stand(12, WARM).fault_names() == set()
    driver.stand(12, MOTOR._replace(level=STALE, message="no encoder"))
    found = {each.identity.state.value: each.evidence[:10] for each in driver.state.faults()}
    assert found == {"stale": "no encoder", "critical": "no encoder"}


def test_a_component_has_its_own_confirm_after_and_follows_a_reload():
    rule = ComponentRule(re.compile("Motor"), confirm_after=3.0)
    driver = settled(MOTOR, components=(rule,))
    assert driver.stand(5, HOT).fault_names() == {CRITICAL}
    driver.raw(MOTOR)
    reloaded(driver, components=(replace(rule, confirm_after=60.0),))
    assert driver.stand(50, HOT).fault_names() == set()
    reloaded(driver, components=(rule,))
    assert driver.fault_names() == {CRITICAL}


def test_silence_is_no_trouble_of_a_component_that_was_ok_before():
    driver = settled(MOTOR, LASER)
    driver.wait(100)
    back = driver.now.wall
    (fault,) = driver.stand(12, WARM, LASER).state.faults()
    assert fault.since == driver.problem_since("Motor") == back


steps = st.lists(
    st.tuples(
        st.sampled_from([1, 1, 1, 3, 8, 30]),
        st.lists(st.sampled_from([OK, WARN, ERROR, STALE, None]), min_size=2, max_size=2),
        st.booleans(),
    ),
    min_size=1,
    max_size=25,
)


@settings(max_examples=60, deadline=None)
@given(steps)
def test_the_since_of_a_warning_is_that_of_its_component_whatever_happened(history):
    driver = settled(MOTOR, LASER, confirm_after=2.0)
    for seconds, levels, restarts in history:
        parts = list(zip((MOTOR, LASER), levels, strict=True))
        for _ in range(2):
            driver.raw(*(each._replace(level=to) for each, to in parts if to is not None))
        driver.wait(seconds)
        if restarts and seconds == 30:
            driver = restarted(driver, driver.fault_rows()).raw(MOTOR)
        lasting = [fault for fault in driver.state.faults() if fault.identity.component]
        # One that flaps has its fault, too, while it is OK.
        flapping = {each.identity.component for each in lasting if each.identity[0] == "flapping"}
        for fault in lasting:
            name = fault.identity.component
            if fault.identity.state == "warning" and name not in flapping:
                assert driver.problem_since(name) == fault.since


def test_a_component_that_the_config_ignores_goes_with_its_fault_and_may_come_back():
    driver = settled(MOTOR, LASER).stand(12, HOT, LASER)
    reloaded(driver, components=(ComponentRule(re.compile("Motor"), ignore=True),))
    assert driver.fault_names() == set()
    assert [each.name for each in driver.raw(HOT, LASER).robot.components] == ["Laser"]
    reloaded(driver, components=())
    assert driver.raw(HOT, LASER).level("Motor") == ERROR


def test_a_component_in_another_group_keeps_the_name_of_its_fault_until_that_is_over():
    driver = StateDriver(Source.AGG)
    before = driver.agg_every(1, 60, *tree(Old=[HOT, LASER])).state.faults()
    assert driver.agg_every(1, 120, *tree(New=[HOT, LASER])).state.faults() == before
    assert {each.label: each.group for each in driver.robot.components} == {
        "Motor": "/Old",
        "Laser": "/New",
    }
    driver.agg_every(1, 140, *tree(New=[MOTOR, LASER]))
    assert [each.reason for each in driver.state.served()[1]] == ["recovered"]
    assert {each.group for each in driver.robot.components} == {"/New"}


def flap_ratios(driver) -> tuple[float, float]:
    """The ratio of the motor as a scrape and as the API show it."""
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    (motor,) = (each for each in robot["components"] if each["component"] == "Motor")
    served = driver.sample("component_flap_ratio", component="Motor") or 0.0
    return served, round(motor["flap_ratio"], 6)


def test_the_ratio_that_is_served_is_the_one_by_which_flapping_is_judged():
    driver = settled(MOTOR)
    for _ in range(2):
        driver.stand(1, HOT)
        driver.stand(1, MOTOR)
    ratio, shown = flap_ratios(driver)
    assert ratio == shown == pytest.approx(sum((1.25, 1.224, 1.197, 1.171)) / 20, abs=1e-3)

    driver.wait(400)  # silence is neither a change nor rest
    driver.raw(MOTOR)
    assert flap_ratios(driver) == (ratio, ratio)

    driver.stand(16, MOTOR)
    served, shown = flap_ratios(driver)
    assert 0 < served == shown < ratio
    driver.stand(21 * 15, MOTOR)
    assert flap_ratios(driver) == (0.0, 0.0)


def test_the_evidence_says_what_was_known_when_the_fault_began():
    hot = HOT._replace(message="Hot\n\u202eagain", values=(("Temperature", "91 C"),))
    driver = settled(MOTOR, LASER).stand(12, hot, LASER._replace(level=WARN))
    evidence = {each.identity.component: each.evidence for each in driver.state.faults()}
    assert evidence == {
        "Motor": "Hot \\u202eagain;\nvalues: Temperature: 91 C;\nalso faulty: Laser WARNING",
        "Laser": "also faulty: Motor CRITICAL",
    }


# -- events --------------------------------------------------------------------------------------


def fault_events(driver: StateDriver) -> list[Event]:
    return [each for each in driver.events if each.kind in ("fault_began", "fault_ended")]


def test_a_fault_that_begins_and_one_that_ends_are_events_with_its_labels():
    driver = settled(MOTOR)
    since = driver.now.wall
    driver.stand(12, HOT)
    driver.raw(MOTOR)
    began, ended = fault_events(driver)
    labels = {"scope": "component", "state": "critical", "severity": "critical"}
    of_motor = Event(since + 10, "fault_began", "r", "", "Motor", message="Hot", since=since)
    assert began == replace(of_motor, **labels, details=began.details)
    assert (began.details or {})["message"] == "Hot"
    end = {"time": driver.now.wall, "kind": "fault_ended", "reason": "recovered", "message": "OK"}
    assert ended == replace(began, **end, details=ended.details)


def test_what_a_person_removes_ends_as_removed_and_is_of_its_site():
    driver = StateDriver(fleet=raw_fleet("r", labels={"site": "hall"}))
    driver.raw_every(1, SETTLED, MOTOR).stand(12, WARM)
    driver.state.forget("r", "Motor", driver.now)
    found = [(each.kind, each.severity, each.site, each.reason) for each in fault_events(driver)]
    assert found == [
        ("fault_began", "warning", "hall", ""),
        ("fault_ended", "warning", "hall", "removed"),
    ]


def test_a_restart_is_no_event_but_a_robot_that_the_config_no_longer_has_is():
    before = StateDriver()
    rows = before.raw_every(1, SETTLED, HOT).fault_rows()
    assert fault_events(restarted(before, rows)) == []
    before.state.fleet = Fleet("f")
    (ended,) = fault_events(restarted(before, rows))
    assert (ended.kind, ended.component, ended.reason) == ("fault_ended", "Motor", "removed")


# -- robots --------------------------------------------------------------------------------------


def test_a_silent_robot_is_one_fault_and_its_components_keep_theirs():
    driver = StateDriver(Source.AGG).agg_every(1, SETTLED, *tree(Parts=[MOTOR, LASER]))
    driver.agg_every(1, 60, *tree(Parts=[HOT, LASER]))
    last = driver.now.wall - 1
    driver.wait(30)
    critical = ("component", "critical", "r", "/Parts", "Motor")
    assert driver.fault_names() == {("robot", "silent", "r"), critical}
    assert [each.since for each in driver.state.faults() if not each.identity.component] == [last]
    assert driver.agg(*tree(Parts=[HOT, LASER])).fault_names() == {critical}
    assert driver.agg(*tree(Parts=[MOTOR, LASER])).fault_names() == set()


def test_a_robot_that_publishes_and_is_never_received_is_silent_after_its_stale_after():
    driver = StateDriver(stale_after=20.0).at(SETTLED)
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    assert driver.at(SETTLED + 29).fault_names() == set()
    assert driver.at(SETTLED + 32).fault_names() == {("robot", "silent", "r")}
    after = restarted(driver, driver.fault_rows()).at(SETTLED + 1_000)
    assert after.fault_names() == {("robot", "silent", "r")}  # and it is not pending
    driver.state.update_graph(0, {}, driver.now)
    driver.at(SETTLED + 40)
    (problem,) = (p for p in driver.state.problems(driver.now) if p.fault is not None)
    assert problem.identity.state == "silent"  # a person, or a message, ends it


def test_a_slow_driver_is_no_stale_component_after_its_robots_return():
    driver = StateDriver()
    slow = Status(OK, "Slow")
    for second in range(120):
        driver.at(second)
        driver.raw(MOTOR, *([slow] if second % 30 == 0 else []))
    assert driver.at(180).fault_names() == {("robot", "silent", "r")}
    assert driver.stand(60, MOTOR).fault_names() == set()
    assert driver.stand(60, MOTOR).fault_names() == {("component", "stale", "r", "Slow")}
    assert driver.raw(slow).fault_names() == set()


def test_a_raw_robot_that_falls_silent_has_no_stale_component_before():
    """A component is late after 5 s, its robot silent after 20 s."""
    driver = settled(MOTOR, LASER, stale_after=20.0, confirm_after=3.0).stand(10, HOT, LASER)
    assert driver.fault_names() == {CRITICAL}
    last = driver.now.mono - 1
    assert (driver.at(last + 10).level("Motor"), driver.level("Laser")) == (STALE, STALE)
    assert driver.at(last + 22).fault_names() == {CRITICAL}
    assert driver.at(last + 24).fault_names() == {CRITICAL, ("robot", "silent", "r")}


def test_a_raw_component_that_is_late_is_stale_once_another_is_received_after_that():
    driver = settled(MOTOR, LASER, stale_after=60.0, confirm_after=3.0)
    last = driver.now.mono - 1
    assert driver.at(last + 30).fault_names() == set()
    assert driver.raw(LASER).at(last + 32).level("Motor") == STALE
    assert driver.fault_names() == set()  # its confirm_after
    assert driver.at(last + 34).fault_names() == {("component", "stale", "r", "Motor")}


def test_a_component_with_a_short_time_of_its_own_is_not_stale_because_the_robot_is_silent():
    rule = ComponentRule(re.compile("Motor"), stale_after=3.0, confirm_after=0.0)
    driver = StateDriver(Source.AGG, components=(rule,))
    driver.agg_every(1, SETTLED, *tree(Parts=[MOTOR, LASER]))
    assert driver.at(SETTLED + 7).level("Motor") == STALE
    assert driver.fault_names() == set()
    driver.agg(*tree(Parts=[LASER]))
    assert driver.fault_names() == {("component", "stale", "r", "/Parts", "Motor")}


@pytest.mark.parametrize("before", [OK, STALE])
def test_what_reports_stale_after_the_robots_return_is_in_trouble_from_that_array_on(before):
    driver = StateDriver(stale_after=20.0)
    driver.raw_every(10, SETTLED, MOTOR._replace(level=before), LASER)
    driver.wait(60)
    driver.raw(LASER)
    driver.wait(2)
    driver.raw(MOTOR._replace(level=STALE), LASER)

    problems = driver.state.problems(driver.now)

    (stale,) = (each for each in problems if each.identity.component == "Motor")
    assert stale.identity.state.value == "stale"
    assert stale.since == (WALL if before == STALE else driver.now.wall)
    driver.raw_every(10, driver.now.mono + 11, MOTOR._replace(level=STALE), LASER)
    assert driver.fault_names() == {("component", "stale", "r", "Motor")}


def test_an_aggregator_that_starts_before_its_robot_falls_silent_shows_nothing_to_be_stale():
    driver = StateDriver(Source.AGG, stale_after=5.0, confirm_after=3.0).agg(*tree(Parts=[MOTOR]))
    driver.at(1)
    driver.agg(Status(STALE, "/Parts", "Stale"))
    driver.at(7)  # the component is late, and then the robot is silent

    assert driver.level("Motor") == STALE
    assert [each.identity.state.value for each in driver.state.problems(driver.now)] == ["silent"]
    driver.agg(Status(STALE, "/Parts", "Stale"))
    problems = {each.identity.state.value: each for each in driver.state.problems(driver.now)}
    assert problems["stale"].since == driver.now.wall


def planned(component: str = "", begin: float = 50, end: float = 150) -> Downtime:
    return Downtime("r", component, WALL + begin, WALL + end, "ann", "new gears")


@pytest.mark.parametrize("component", ["", "Motor", None])
def test_nothing_begins_in_maintenance_and_what_is_still_wrong_after_it_does(component):
    robots = {"robot": (re.compile("r"),)}
    window = Maintenance("night", robots, "", start=WALL + 50, end=WALL + 150)
    of_config = replace(StateDriver().state.fleet, maintenance=(window,))
    driver = StateDriver(fleet=of_config if component is None else None)
    if component is not None:
        driver.state.plan([planned(component)], driver.now)
    driver.raw_every(1, 60, MOTOR, LASER)
    assert driver.raw_every(1, 100, HOT, LASER).fault_names() == set()
    (problem,) = driver.state.problems(driver.now, "r")
    assert problem.suppressed is Reason.MAINTENANCE
    if component != "Motor":
        driver.at(140)  # switched off
    assert driver.fault_names() == set()
    assert driver.raw_every(1, 155, HOT, LASER).fault_names() == {CRITICAL}


def test_a_robot_that_is_awaited_in_maintenance_is_pending_after_it():
    driver = StateDriver()
    driver.state.plan([planned("", 0, 1_000)], driver.now)
    assert driver.at(950).fault_names() == set()
    assert driver.at(1_002).fault_names() == {("robot", "pending", "r")}


@pytest.mark.parametrize("component", ["", "Motor"])
def test_a_downtime_is_in_force_after_a_restart_before_anybody_repeats_it(component, tmp_path):
    before = StateDriver()
    before.state.plan([planned(component, 0)], before.now)
    after = before.raw_every(1, 5, MOTOR, LASER).again(tmp_path / "exporter.db")

    assert after.raw_every(1, 149, HOT, LASER).fault_names() == set()
    assert after.raw_every(1, 152, HOT, LASER).fault_names() == {CRITICAL}


def test_a_downtime_that_was_cancelled_is_not_restored(tmp_path):
    before = StateDriver()
    before.state.plan([planned("", 0, 1_000)], before.now)
    before.raw_every(1, 10, MOTOR, LASER)
    before.keep(tmp_path / "exporter.db")
    before.state.plan([], before.now)

    assert before.again(tmp_path / "exporter.db").state.downtimes("r") == ()


def test_a_downtime_goes_on_after_a_reload_and_for_a_robot_that_comes_later():
    driver = StateDriver()
    driver.state.plan([planned("Motor", 0, 1_000)], driver.now)
    taken = [{row.kind for row in driver.state.take_fault_rows(driver.now)} for _ in range(2)]
    assert ["downtimes" in kinds for kinds in taken] == [True, False]
    fleet = driver.raw_every(1, 60, MOTOR, LASER).state.fleet
    driver.configure(robots=())
    driver.configure(robots=fleet.robots, faults=replace(fleet.faults, restart_grace=1))
    assert driver.raw_every(1, 100, HOT, LASER).fault_names() == set()


# -- values and checks ---------------------------------------------------------------------------

LOW = ValueRule(key=re.compile("Volt"), thresholds=(Threshold("low", "critical", 10.0),))


def volt(number: str) -> Status:
    return MOTOR._replace(values=(("Volt", number),))


BELOW = ("value", "critical", "r", "Motor", "Volt", "low")


@pytest.mark.parametrize(
    "status",
    [MOTOR, volt("unknown"), volt("12")._replace(level=STALE)],
    ids=["missing", "no number", "stale"],
)
def test_a_value_that_is_no_longer_known_goes_on(status):
    driver = settled(volt("12"), values=(LOW,)).stand(12, volt("9"))
    assert BELOW in driver.stand(60, status).fault_names()
    assert driver.stand(1, volt("12")).fault_names() == set()


def test_what_is_late_ends_nothing_where_stale_counts_as_ok():
    """A driver that dies in its ERROR; only what it publishes as STALE is OK."""
    rule = ComponentRule(re.compile("Motor"), levels={STALE: OK})
    driver = settled(MOTOR, components=(rule,)).stand(12, HOT)
    assert driver.stand(60, LASER).fault_names() == {CRITICAL}
    assert driver.stand(1, HOT._replace(level=STALE)).fault_names() == set()


def test_what_a_condition_ends_says_so():
    mode = Status(OK, "Mode", values=(("mode", "off"),))
    unless = Condition(
        component=(Pattern("Mode"),), key=(Pattern("mode"),), texts=(Pattern("off"),)
    )
    driver = settled(MOTOR, components=(ComponentRule(Pattern("Motor"), unless=(unless,)),))
    driver.stand(12, HOT).stand(1, HOT, mode)
    (end,) = driver.state.served()[1]
    assert end.message == f"unless {unless.text}"


def test_a_stale_component_that_counts_as_ok_confirms_no_value():
    rule = ComponentRule(re.compile("Motor"), levels={STALE: OK})
    driver = settled(volt("12"), values=(LOW,), components=(rule,)).stand(5, volt("9"))
    assert driver.stand(60, volt("9")._replace(level=STALE)).fault_names() == set()


@pytest.mark.parametrize("last", [volt("9"), MOTOR], ids=["published", "missing"])
def test_a_fault_goes_with_its_threshold(last):
    driver = settled(volt("12"), values=(LOW,)).stand(12, volt("9")).stand(1, last)
    reloaded(driver, stale_after=11.0)
    assert driver.fault_names() == {BELOW}
    reloaded(driver, values=())
    assert driver.fault_names() == set()


def test_an_expected_component_that_is_missing_is_a_fault_of_its_check():
    motors = Check("motors", (re.compile("Motor"),), expect=2)
    driver = settled(MOTOR, checks=(Check("all"), motors))
    assert driver.fault_names() == {("check", "critical", "r", "motors")}
    assert driver.raw(MOTOR, Status(OK, "Motor 2")).fault_names() == set()

    driver.state.forget("r", "Motor 2", driver.now)
    assert driver.stand(12, MOTOR).fault_names() == {("check", "critical", "r", "motors")}
    reloaded(driver, checks=(Check("all"),))
    assert driver.fault_names() == set()


# -- people, config, restarts ----------------------------------------------------------------------


def test_a_robot_that_the_config_no_longer_has_has_no_faults():
    driver = settled(MOTOR).stand(12, HOT)
    driver.configure(Fleet("f"))
    assert driver.fault_names() == set()
    assert [each.after for each in driver.events if each.kind == "robot"][-1] == "forgotten"
    with pytest.raises(LookupError):
        driver.state.problems(driver.now, "r")


def test_time_forgets_no_component_with_a_problem():
    """It is missing on a robot that is there: STALE, until a person takes it out."""
    driver = StateDriver(Source.AGG, forget_after=100.0)
    driver.agg_every(1, SETTLED, *tree(Parts=[MOTOR._replace(message="fine"), LASER]))
    (fault,) = driver.agg_every(1, 400, *tree(Parts=[LASER])).state.faults()
    assert fault.evidence.startswith("no longer reports; its last message: fine")
    assert driver.fault_names() == {("component", "stale", "r", "/Parts", "Motor")}


def test_a_discovered_robot_that_lacked_a_component_when_it_left_is_kept():
    motors = Check("motors", (re.compile("Motor"),), expect=2)
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics")
    profile = Profile(forget_after=100.0, checks=(Check("all"), motors))
    found = Discovery(pattern, "/{robot}/diagnostics", source=Source.RAW, profile=profile)
    driver = StateDriver(fleet=Fleet("f", discoveries=(found,)))
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    driver.raw_every(1, SETTLED, MOTOR)
    driver.state.update_graph(0, {}, driver.now)
    assert ("check", "critical", "r", "motors") in driver.at(500).fault_names()
    assert not [*driver.robot.components]
    assert not restarted(driver, driver.fault_rows()).robot.declared
    driver.state.forget("r", None, driver.now)
    assert driver.fault_names() == set()


def test_a_discovered_robot_that_was_never_received_goes_with_its_publisher():
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics")
    found = Discovery(pattern, "/{robot}/diagnostics", profile=Profile(forget_after=100.0))
    driver = StateDriver(fleet=Fleet("f", discoveries=(found,)))
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    assert driver.at(500).fault_names() == {("robot", "silent", "r")}
    driver.state.update_graph(0, {}, driver.now)
    assert not driver.at(700).state.robots
    assert driver.fault_names() == set()


def without_database(driver: StateDriver) -> StateDriver:
    """Another process that has nothing but the alerts that fire."""
    again = StateDriver(fleet=driver.state.fleet)
    again.now = driver.now
    again.state.adopt(driver.state.faults(), again.now)
    return again


def test_without_its_database_a_process_goes_on_with_what_fires():
    before = settled(MOTOR, LASER).stand(12, HOT, LASER)
    before.wait(100)
    lost = {CRITICAL, ("robot", "silent", "r")}
    assert before.fault_names() == lost
    after = without_database(before)
    assert after.wait(1_000).fault_names() == lost  # and it is not pending
    assert after.state.faults() == before.state.faults()
    assert after.raw(HOT, LASER).fault_names() == {CRITICAL}
    assert after.raw(MOTOR, LASER).fault_names() == set()
    ends = {end.fault.identity.state.value: end.message for end in after.state.served()[1]}
    assert ends == {"silent": "", "critical": "OK"}


def test_without_its_database_a_check_counts_the_component_whose_fault_fires():
    motors, other = Check("motors", (re.compile("Motor"),), expect=2), Status(OK, "Motor 2", "OK")
    before = settled(MOTOR, other, checks=(motors,)).stand(60, MOTOR)
    stale = {("component", "stale", "r", "Motor 2")}
    assert before.fault_names() == stale
    after = without_database(before).stand(60, MOTOR)
    assert after.fault_names() == stale
    after.state.forget("r", "Motor 2", after.now)
    assert after.stand(12, MOTOR).fault_names() == {("check", "critical", "r", "motors")}


BUMPER, BUMPED = Status(OK, "Bumper", "OK"), Status(ERROR, "Bumper", "hit")


@pytest.mark.parametrize("missed", ["while it was down", "on its link"])
@pytest.mark.parametrize("levels", [{}, {ERROR: WARN, WARN: ERROR}])
def test_a_half_that_missed_a_change_does_not_end_the_fault_of_the_other(tmp_path, missed, levels):
    rule = ComponentRule(re.compile("Bumper"), reports="on_change", levels=levels)
    one = settled(MOTOR, BUMPER, components=(rule,)).stand(10, MOTOR)
    other = settled(MOTOR, BUMPER, components=(rule,)).stand(10, MOTOR)
    fault = one.stand(1, BUMPED).stand(20, MOTOR).state.faults()[0]
    if missed == "while it was down":
        other = other.again(tmp_path / "x.db", after=21)
    other.stand(21, MOTOR).state.adopt([fault], other.now)

    assert other.stand(60, MOTOR).state.faults() == [fault]
    assert other.component("Bumper").message == "hit"
    assert other.stand(1, BUMPER).fault_names() == set()


def test_a_half_that_received_a_change_after_a_fault_began_ends_it():
    rule = ComponentRule(re.compile("Bumper"), reports="on_change")
    one = settled(MOTOR, BUMPER, components=(rule,)).stand(10, MOTOR)
    fault = one.stand(1, BUMPED).stand(20, MOTOR).state.faults()[0]
    other = StateDriver(fleet=one.state.fleet).at(one.now.mono).stand(1, MOTOR, BUMPER)
    other.state.adopt([fault], other.now)

    assert other.fault_names() == set()


def test_a_person_forgets_what_fires_of_components_that_were_never_received_here():
    before = settled(MOTOR, LASER).stand(12, HOT, LASER)
    after = without_database(before)
    after.state.forget("no such", None, after.now)
    after.wait(1_000)
    pending = {("robot", "pending", "r")}
    assert after.fault_names() == {CRITICAL} | pending
    after.state.forget("r", None, after.now)
    assert after.fault_names() == pending
    assert [end.reason for end in after.state.served()[1] if end.fault] == ["removed"]


def test_a_person_forgets_one_component_that_was_never_received_here():
    before = settled(MOTOR, LASER).stand(12, HOT, LASER)
    after = without_database(before)
    assert after.state.forget("r", "Motor", after.now) == 1
    assert CRITICAL not in after.fault_names()
    with pytest.raises(LookupError, match="has no component 'Motor'"):
        after.state.forget("r", "Motor", after.now)


def test_what_fires_of_a_component_that_the_config_ignores_now_ends_at_the_reload():
    before = settled(MOTOR, LASER).stand(12, HOT, LASER)
    after = without_database(before)
    assert after.raw_every(1, 60, LASER).fault_names() == {CRITICAL}
    reloaded(after, components=(ComponentRule(re.compile("Motor"), ignore=True),))
    assert after.fault_names() == set()


@pytest.mark.parametrize(("ends_after", "asked"), [(None, False), (60.0, True)])
def test_what_is_not_repeated_is_looked_for_only_where_a_rule_ends_it(ends_after, asked):
    rules = (ComponentRule(re.compile("Motor"), reports="on_change", ends_after=ends_after),)
    driver = settled(MOTOR, components=rules)

    with patch.object(RobotReports, "end_unrepeated", return_value=[]) as end_unrepeated:
        driver.at(SETTLED + 2)

    assert end_unrepeated.called is asked


def test_what_fires_and_is_not_repeated_for_its_ends_after_ends():
    rules = (ComponentRule(re.compile("Motor"), reports="on_change", ends_after=60.0),)
    before = settled(MOTOR, LASER, components=rules).stand(12, HOT, LASER)
    after = without_database(before)
    after.wait(1_000)  # its robot is silent
    begin = after.now.mono
    after.raw_every(1, begin + 115, LASER)  # of which the first minute does not count
    assert CRITICAL in after.fault_names()
    assert after.raw_every(1, begin + 125, LASER).fault_names() == set()


def test_what_is_late_as_another_lapses_is_no_fault_before_an_array_lacks_it():
    rules = (ComponentRule(re.compile("Bumper"), reports="on_change", ends_after=5.0),)
    driver = settled(BUMPED, MOTOR, components=rules, stale_after=120.0).raw(BUMPED, MOTOR)
    assert driver.wait(100).level("Motor") == STALE
    assert driver.fault_names() == set()
    assert driver.stand(20, LASER).fault_names() == {("component", "stale", "r", "Motor")}


def fleet_of_found(number: int) -> StateDriver:
    """A driver of robots of one site that are found by their topics: so many, of r0 on."""
    discovery = Discovery(
        pattern=re.compile("/(?P<robot>[^/]+)/diagnostics"),
        template="/{robot}/diagnostics",
        labels={"site": "hall"},
        source=Source.RAW,
        profile=Profile(forget_after=600.0),
    )
    settings = FaultSettings(site=CauseSettings(3, 0.5))
    driver = StateDriver(fleet=Fleet("f", discoveries=(discovery,), faults=settings))
    find(driver, number)
    return driver


def find(driver: StateDriver, number: int) -> None:
    endpoints = {f"/r{each}/diagnostics": Endpoint(1) for each in range(number)}
    driver.state.update_graph(0, endpoints, driver.now)


def send(driver: StateDriver, until: float, number: int) -> None:
    for _ in driver.seconds(until - driver.now.mono):
        for each in range(number):
            driver.receive(f"/r{each}/diagnostics", MOTOR)


def test_what_fires_of_a_site_lasts_until_its_robots_had_time_to_be_found():
    before = fleet_of_found(6)
    send(before, SETTLED, 6)
    before.at(SETTLED + 60)
    silent = {("site", "silent", "hall")}
    assert before.fault_names() == silent
    after = fleet_of_found(1)
    after.state.adopt(before.state.faults(), after.now)
    send(after, 100, 1)  # the others are not found yet
    assert (after.fault_names(), after.state.served()[1]) == (silent, [])
    find(after, 6)
    send(after, 130, 6)
    assert after.fault_names() == set()


def test_a_robot_that_was_found_is_kept_as_long_as_something_fires_of_it():
    """It was received by a process whose database is lost, and only announced since."""
    before = fleet_of_found(1)
    send(before, SETTLED, 1)
    assert before.at(SETTLED + 60).fault_names() == {("robot", "silent", "r0")}
    after = fleet_of_found(1)
    after.state.adopt(before.state.faults(), after.now)
    after.at(1)
    after.state.update_graph(0, {}, after.now)
    assert after.at(1_300).fault_names() == {("robot", "silent", "r0")}
    assert after.state.served()[1] == []


def test_what_fires_of_a_robot_that_is_well_ends_as_soon_as_it_is_adopted():
    before = settled(MOTOR).stand(12, HOT)
    after = settled(MOTOR)
    after.state.adopt(before.state.faults(), after.now)
    assert after.fault_names() == set()
    assert [end.reason for end in after.state.served()[1]] == ["recovered"]


def test_a_fault_survives_a_restart_until_the_component_is_received_better():
    before = StateDriver(confirm_after=10.0).raw_every(1, SETTLED, MOTOR).stand(12, HOT)
    after = restarted(before, before.fault_rows())
    assert after.fault_names() == {CRITICAL}
    assert after.state.faults() == before.state.faults()
    assert not after.state.settled(after.now)
    after.wait(20)
    assert after.fault_names() == {CRITICAL}  # nothing received yet, within restart_grace
    assert after.stand(20, HOT).fault_names() == {CRITICAL}
    assert after.state.settled(after.now)
    assert after.raw(MOTOR).fault_names() == set()


def test_a_component_that_never_returns_after_a_restart_is_stale():
    before = StateDriver().raw_every(1, SETTLED, MOTOR, LASER)
    after = restarted(before, before.fault_rows())
    assert after.stand(60, LASER).fault_names() == set()  # its driver may be slow
    assert after.stand(60, LASER).fault_names() == {("component", "stale", "r", "Motor")}


def test_a_restart_without_rows_finds_the_fault_again_before_it_is_settled():
    before = StateDriver(confirm_after=60.0).raw_every(1, SETTLED, MOTOR).stand(70, HOT)
    after = restarted(before, [])
    after.wait(20)  # until the robot is received
    while not after.fault_names():
        assert not after.state.settled(after.now)
        after.stand(1, HOT)
    assert after.fault_names() == {CRITICAL}
    after.stand(20, HOT)
    assert after.state.settled(after.now)


def test_a_second_restart_while_faults_are_judged_anew_does_not_settle_earlier():
    before = restarted(settled(MOTOR, confirm_after=60.0), [])
    start = before.now.mono
    before.at(start + 20)
    after = restarted(before, before.fault_rows()).at(start + 89)
    assert not after.state.settled(after.now)
    after.at(start + 90)
    assert after.state.settled(after.now)


def test_a_reload_applies_other_settings_of_faults():
    driver = settled(MOTOR)
    parts = (*(HOT._replace(name=f"Part {number}") for number in range(3)), MOTOR)
    driver.stand(1, *parts)
    driver.configure(faults=replace(driver.state.fleet.faults, many=CauseSettings(3, 0.1)))
    driver.stand(20, *parts)
    assert driver.fault_names() == {("robot", "many", "r", "critical")}


def test_a_start_follows_the_settings_of_faults():
    fleet = replace(raw_fleet("r"), faults=FaultSettings(pending_after=100.0))
    driver = restarted(StateDriver(fleet=fleet), [])
    assert driver.at(99).fault_names() == set()
    assert driver.at(101).fault_names() == {("robot", "pending", "r")}


def test_a_fault_follows_its_component_that_is_in_another_group_after_a_start():
    before = StateDriver(Source.AGG).agg_every(1, 60, *tree(Old=[HOT]))
    driver = restarted(before, before.fault_rows())
    assert driver.fault_names() == {("component", "critical", "r", "/Old", "Motor")}
    assert driver.agg(*tree(New=[MOTOR])).fault_names() == set()


def test_a_fault_of_a_component_that_the_config_ignores_after_a_start_ends():
    before = settled(MOTOR).stand(12, HOT)
    ignoring = Profile(components=(ComponentRule(re.compile("Motor"), ignore=True),))
    (robot,) = before.state.fleet.robots
    before.state.fleet = replace(before.state.fleet, robots=(replace(robot, profile=ignoring),))
    driver = restarted(before, before.fault_rows())
    assert driver.fault_names() == set()
    assert [(each.kind, each.reason) for each in driver.events if each.kind == "fault_ended"] == [
        ("fault_ended", "removed")
    ]


def test_what_a_driver_writes_is_no_part_that_the_exporter_wrote():
    driver = settled(MOTOR)
    trick = Status(ERROR, "Motor", "work: can drive;\nvalues: none", "", (("a;\nrobots", "b"),))
    (fault,) = driver.stand(12, trick).state.faults()
    assert fault.evidence == "work: can drive; values: none;\nvalues: a; robots: b"
    assert fault.capabilities == ""


@pytest.fixture
def _short_names(monkeypatch):
    """Names are cut after five characters, so that many are numbered."""
    where = "ros_diagnostics_exporter.robots.components.truncate"
    monkeypatch.setattr(where, lambda text, _length: text[:5])


@pytest.mark.usefixtures("_short_names")
def test_a_name_that_is_numbered_is_that_of_the_api_too():
    long, other = "Motor " + "x" * 300, "Motor " + "x" * 299
    driver = settled(Status(ERROR, long), Status(OK, other))
    snapshot = fleet_snapshot(driver.state, driver.now)["robots"][0]
    assert [each["component"] for each in snapshot["components"]] == ["Motor", "Motor~2"]
    assert driver.state.forget("r", "Motor~2", driver.now) == 1
    assert [each.level for each in driver.robot.components] == [ERROR]


@pytest.mark.usefixtures("_short_names")
def test_a_downtime_of_a_numbered_name_is_of_that_component_alone():
    driver = settled(Status(OK, "Motor a"), Status(OK, "Motor b"))
    driver.state.plan([planned("Motor~2", 0)], driver.now)
    driver.stand(12, Status(ERROR, "Motor a"), Status(ERROR, "Motor b"))
    assert driver.fault_names() == {CRITICAL}
    suppressed = {
        each.identity.component: each.suppressed for each in driver.state.problems(driver.now, "r")
    }
    assert suppressed == {"Motor": None, "Motor~2": Reason.MAINTENANCE}


@pytest.mark.usefixtures("_short_names")
def test_a_component_keeps_its_label_when_another_of_its_name_has_gone():
    parts = [Status(level, f"Motor {letter}") for level, letter in ((OK, "a"), (ERROR, "b"))]
    driver = settled(*parts)
    (fault,) = driver.stand(12, *parts).fault_names()
    assert driver.state.forget("r", "Motor", driver.now) == 1
    driver.stand(12, parts[1])
    assert driver.fault_names() == {fault} == {("component", "critical", "r", "Motor~2")}
    assert {each.label for each in driver.stand(1, *parts).robot.components} == {"Motor~2", "Motor"}


@pytest.mark.parametrize("levels", [(ERROR, OK), (OK, ERROR), (7, STALE), (STALE, WARN)])
def test_of_one_name_twice_in_an_array_the_worse_counts_and_it_is_reported(levels):
    driver = StateDriver().raw(*(Status(level, "Motor", hardware_id="m") for level in levels))
    assert driver.level("Motor") == {ERROR: ERROR, 7: ERROR, STALE: STALE}[max(levels)]
    assert driver.sample("robot_rejected_total", reason="duplicate_component") == 1


JUDGED = {"confirm_after": 1.0, "planned_stale": False, "stale_is_critical": False}
OF_COMPONENT = {"settings": JUDGED, "level": 2, "since": None, "counted": False, "flaps": None}


@pytest.mark.parametrize(
    "row",
    [
        Row("problem", ("component", "critical"), {}),
        Row("component", ("unknown", "", "Motor"), OF_COMPONENT),
        Row("component", ("r",), OF_COMPONENT),
        Row("problem", tuple("x" * 12), {"since": 0, "clock": 0, "verdict": 1, "fault": None}),
    ],
)
def test_a_row_that_cannot_be_restored_is_named_and_harms_no_other(row):
    driver = settled(MOTOR)
    rows = driver.stand(12, HOT).fault_rows()
    assert driver.state.restore_faults([*rows, row], driver.now) == [row]
    assert driver.fault_names() == {CRITICAL}


def test_an_array_in_which_nothing_changed_reports_nothing(monkeypatch):
    driver = settled(HOT, LASER)
    reported = []
    for name in ("components_changed", "values_changed", "check_changed", "robot_back"):
        monkeypatch.setattr(Faults, name, lambda _self, *args: reported.append(args) or [])
    driver.raw(HOT, LASER)
    assert reported == []
    driver.raw(MOTOR, LASER)
    assert [robot for robot, *_more in reported] == ["r"]
    reported.clear()
    driver.state.forget("r", "Laser", driver.now)
    driver.raw(MOTOR)
    assert [(reports, total) for _robot, reports, total, _now in reported] == [([], 1)]


def test_the_robots_whose_clocks_differ_are_the_evidence_against_the_exporters():
    names = ("r1", "r2", "r3")
    driver = StateDriver(fleet=raw_fleet(*names))
    for second in range(130):
        driver.at(second)
        for name, behind in zip(names, (90, 60, 0), strict=True):
            driver.receive(f"/{name}/diagnostics", MOTOR, stamp=driver.now.wall - behind)
    (fault,) = driver.state.faults()
    assert (fault.identity.scope.value, fault.evidence) == ("exporter", "2 robots: r1, r2")


def test_what_a_condition_suppresses_is_a_problem_and_an_event_as_it_changes():
    charging = Condition(text="Charger is OK", component=(re.compile("Charger"),), levels=(OK,))
    driver = settled(MOTOR, components=(ComponentRule(re.compile("Motor"), unless=(charging,)),))
    charger = Status(OK, "Charger")
    driver.stand(12, HOT, charger)
    assert driver.component("Motor").suppressed_because == "unless Charger is OK"
    (problem,) = driver.state.problems(driver.now)
    assert (problem.suppressed, problem.because) == (Reason.CONDITION, "unless Charger is OK")
    driver.stand(2, HOT, charger._replace(level=WARN))
    assert driver.component("Motor").suppressed_because == ""
    events = [each for each in driver.events if each.kind == "condition"]
    assert [(each.after, each.message) for each in events] == [
        ("suppressed", "unless Charger is OK"),
        ("judged", ""),
    ]


def test_a_condition_suppresses_errors_of_what_may_be_stale_as_planned():
    charging = Condition(text="Charger is OK", component=(re.compile("Charger"),), levels=(OK,))
    rule = ComponentRule(re.compile("Motor"), unless=(charging,), planned_stale=True)
    driver = settled(MOTOR, components=(rule,))
    charger = Status(OK, "Charger")
    driver.stand(12, HOT, charger)
    suppressed = [each.identity.state for each in driver.state.problems(driver.now) if each.because]
    assert suppressed == [State.CRITICAL]
    driver.stand(12, HOT._replace(level=STALE), charger)
    assert [each for each in driver.state.problems(driver.now) if each.because] == []


def test_what_suppresses_a_component_is_known_while_the_condition_and_the_robot_are():
    charging = Condition(text="Charger is OK", component=(re.compile("Charger"),), levels=(OK,))
    driver = settled(MOTOR, components=(ComponentRule(re.compile("Motor"), when=(charging,)),))
    assert driver.stand(2, HOT).component("Motor").suppressed_because == ""
    driver.stand(2, HOT, Status(WARN, "Charger"))
    assert driver.component("Motor").suppressed_because == "only when Charger is OK"
    assert driver.wait(60).component("Motor").suppressed_because == ""


# -- both topics ---------------------------------------------------------------------------------


def test_the_tree_is_read_while_no_raw_message_comes():
    """Once all was STALE then, and as the tree listed it, that was no fault; nor was an ERROR."""
    driver = StateDriver(Source.BOTH)

    def go(seconds: float, motor: Status, *, is_raw: bool) -> None:
        for _ in driver.seconds(seconds):
            if is_raw:
                driver.raw(motor, LASER)
            driver.agg(*tree(Parts=(motor, LASER)))

    go(SETTLED, MOTOR, is_raw=True)
    go(60, MOTOR, is_raw=False)
    assert (driver.level("Motor"), driver.fault_names()) == (OK, set())
    go(12, HOT, is_raw=False)
    assert driver.faults() == [("Motor", "critical")]
    go(2, MOTOR, is_raw=True)
    assert driver.fault_names() == set()
    driver.raw(HOT, LASER)
    assert driver.level("Motor") == ERROR


def test_what_only_drivers_publish_is_stale_while_the_tree_goes_on():
    driver = StateDriver(Source.BOTH)
    for _ in driver.seconds(SETTLED + 60):
        if driver.now.mono < SETTLED:
            driver.raw(MOTOR, LASER)
        driver.agg(*tree(Parts=(MOTOR,)))
    assert driver.faults() == [("Laser", "stale")]


def test_a_capability_that_is_found_better_with_its_first_part_begins_nothing():
    """Its parts were taken before their levels, so that one of them was still as before."""
    view = Capability(name="view", need=Expression(1, (ComponentsOf((Pattern("Lidar"),)),)))
    upper, lower = Status(ERROR, "Lidar upper"), Status(OK, "Lidar lower")
    driver = settled(upper, capabilities={"view": view})
    assert driver.fault_names() == {("capability", "lost", "r", "view")}
    driver.stand(20, upper._replace(level=OK), lower)
    began = [each.state for each in driver.events if each.kind == "fault_began"]
    assert (began, driver.fault_names()) == (["lost"], set())
