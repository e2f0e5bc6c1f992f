"""What is published only when something changes: it is not late, and ends as fleet.yml says."""

import re
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Profile,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.config.topics import TopicEntry
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.model import Instant, Status
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver, tree

SERIAL, MOTOR = Status(ERROR, "rosserial", "lost sync"), Status(OK, "Motor")
RULE = ComponentRule(re.compile("rosserial"), reports="on_change")
ENDS = replace(RULE, ends_after=600.0)
CRITICAL = {("component", "critical", "r", "rosserial")}
START = 60  # seconds after a return in which a driver may start


def level(driver):
    """The level and the message of the reporter."""
    (robot,) = fleet_snapshot(driver.state, driver.now)["robots"]
    (found,) = [each for each in robot["components"] if each["component"] == "rosserial"]
    return found["level"], found["message"]


def once(*rules, status=SERIAL, source=Source.RAW):
    """A robot that is received for a minute, and then also this status, once."""
    driver = StateDriver(source, components=rules).raw_every(1, 60, MOTOR)
    driver.raw(MOTOR, status)
    return driver


def stand(driver, seconds):
    driver.stand(seconds, MOTOR)


def test_without_the_rule_it_becomes_stale_and_is_so_until_forgotten():
    driver = once()
    stand(driver, 3_600)
    assert level(driver) == ("STALE", "lost sync")
    assert ("component", "stale", "r", "rosserial") in driver.fault_names()


def test_it_lasts_as_it_was_reported_until_it_is_reported_ok():
    driver = once(RULE)
    stand(driver, 3 * 86_400 // 100)
    assert level(driver) == ("ERROR", "lost sync")
    assert driver.fault_names() == CRITICAL
    assert driver.raw(MOTOR, SERIAL._replace(level=OK)).fault_names() == set()


def test_the_evidence_says_that_it_was_reported_once_and_when():
    driver = once(RULE)
    stand(driver, 12)
    (fault,) = driver.state.faults()
    assert fault.evidence.split(";\n")[0] == "lost sync"
    assert "reported once, at 2023-11-14 22:14:20 UTC" in fault.evidence
    assert fault.details["reported_once"] == pytest.approx(WALL + 60, abs=1)
    often = once(RULE, status=SERIAL._replace(level=OK))
    often.stand(3, MOTOR, SERIAL)
    stand(often, 12)
    (fault,) = often.state.faults()
    assert "it reports only changes" in fault.evidence
    assert "reported_once" not in fault.details


@pytest.mark.parametrize("status", [SERIAL, SERIAL._replace(level=STALE)], ids=["error", "stale"])
def test_it_is_over_when_it_was_not_reported_again_for_ends_after(status):
    driver = once(ENDS, status=status)
    stand(driver, 595)
    assert len(driver.fault_names()) == 1
    stand(driver, 10)
    assert driver.fault_names() == set()
    assert level(driver) == ("OK", "not reported again for 10m")
    (end,) = driver.state.served()[1]
    assert (end.reason, end.message) == ("recovered", "OK: not reported again for 10m")

    driver.raw(MOTOR, status)
    stand(driver, 12)
    assert len(driver.fault_names()) == 1


def test_each_report_begins_the_time_anew():
    driver = once(ENDS)
    stand(driver, 500)
    driver.raw(MOTOR, SERIAL)
    stand(driver, 500)
    assert driver.fault_names() == CRITICAL
    stand(driver, 110)
    assert driver.fault_names() == set()


@pytest.mark.parametrize("reloaded", [False, True])
@pytest.mark.parametrize("reported", [ERROR, OK])
def test_silence_of_its_robot_changes_nothing(reported, reloaded):
    driver = once(RULE, status=SERIAL._replace(level=reported))
    stand(driver, 12)
    before, shown = driver.fault_names(), level(driver)
    driver.wait(120)
    if reloaded:  # by this it was not silent
        driver.follow_profile(Profile(components=(RULE,), stale_after=600.0))
    assert level(driver)[0] == "STALE"
    stand(driver, 120)
    assert (driver.fault_names(), level(driver)) == (before, shown)
    assert [each.reason for each in driver.state.served()[1]] == ["recovered"]  # of the silence


def test_a_restart_changes_nothing_and_it_ends_after_as_long():
    driver = once(ENDS)
    stand(driver, 100)
    again = StateDriver(fleet=driver.state.fleet)
    again.now = driver.now
    again.state.restore({"r": driver.state.robots["r"].persist(driver.now)}, again.now)
    again.restore_faults([Row(*each) for each in driver.fault_rows()])
    stand(again, 450 + START)
    assert (again.fault_names(), level(again)[0]) == (CRITICAL, "ERROR")
    stand(again, 100)
    assert again.fault_names() == set()


def test_an_aggregator_that_says_stale_for_want_of_an_update_changes_nothing():
    driver = StateDriver(Source.AGG, components=(ENDS,))
    for second in range(1_200):
        driver.at(second)
        reported = SERIAL if 60 <= second < 65 else SERIAL._replace(level=STALE)
        reported = SERIAL._replace(level=OK, message="") if second < 60 else reported
        driver.agg(*tree(Parts=[MOTOR, reported]))
        if second in (100, 600):
            assert driver.fault_names() == {("component", "critical", "r", "/Parts", "rosserial")}
    assert driver.fault_names() == set()
    assert level(driver) == ("OK", "not reported again for 10m")


@pytest.mark.parametrize("rule", [RULE, replace(RULE, ends_after=10.0)], ids=["lasts", "ends"])
def test_what_an_aggregator_no_longer_has_after_a_reboot_is_stale_until_it_is_published_again(rule):
    driver = StateDriver(Source.AGG, components=(rule,))
    for second in range(300):
        driver.at(second)
        if 60 <= second < 120:
            continue  # the robot boots
        has = second < 60 or second >= 200
        driver.agg(*tree(Parts=[MOTOR, *([SERIAL._replace(level=OK)] if has else [])]))
        if second == 199:
            assert level(driver) == ("STALE", "lost sync")
    assert level(driver)[0] == "OK"


@pytest.mark.parametrize("source", [Source.RAW, Source.AGG])
def test_it_is_over_in_time_although_nothing_else_is_due(source):
    rule = replace(RULE, ends_after=2.0)
    driver = StateDriver(source, stale_after=60.0, components=(rule,))
    if source is Source.RAW:
        driver.raw(MOTOR, SERIAL)
    else:
        driver.agg(*tree(Arms=(MOTOR, SERIAL)))
    driver.at(1.75)
    assert level(driver)[0] == "ERROR"
    driver.at(2.25)
    assert level(driver) == ("OK", "not reported again for 2s")


@pytest.mark.parametrize("gap", [300, 3_600])
def test_silence_does_not_count_towards_its_end(gap):
    """What could not be published again has not ended."""
    driver = once(ENDS)
    stand(driver, 500)
    driver.wait(gap)
    stand(driver, 60 + START)
    assert (driver.fault_names(), level(driver)[0]) == (CRITICAL, "ERROR")
    stand(driver, 60)
    assert driver.fault_names() == set()
    assert level(driver) == ("OK", "not reported again for 10m")


def test_what_was_published_as_stale_does_not_end_in_silence():
    driver = once(ENDS, status=SERIAL._replace(level=STALE))
    stand(driver, 100)
    driver.wait(3_600)
    assert level(driver)[0] == "STALE"
    stand(driver, 100)
    assert level(driver)[0] == "STALE"
    assert ("component", "stale", "r", "rosserial") in driver.fault_names()


def test_a_stop_of_the_exporter_does_not_count_towards_its_end(tmp_path):
    driver = once(ENDS)
    stand(driver, 500)
    again = driver.again(tmp_path / "state", after=3_600.0)
    stand(again, 90 + START)
    assert (again.fault_names(), level(again)[0]) == (CRITICAL, "ERROR")
    stand(again, 20)
    assert again.fault_names() == set()


def test_a_pause_of_the_process_does_not_count_towards_its_end():
    driver = once(ENDS)
    stand(driver, 500)
    driver.now = Instant(driver.now.mono + 300, driver.now.wall + 300)
    stand(driver, 90)
    assert driver.fault_names() == CRITICAL


@pytest.mark.parametrize("has_restart", [False, True])
def test_the_levels_of_fleet_yml_apply_once_to_what_resumes(tmp_path, has_restart):
    rule = replace(RULE, levels={ERROR: WARN, WARN: OK})
    driver = once(rule)
    stand(driver, 12)
    before = driver.fault_names()
    assert before == {("component", "warning", "r", "rosserial")}
    driver.wait(120)
    if has_restart:
        driver = driver.again(tmp_path / "state")
    stand(driver, 60)
    assert (driver.fault_names(), level(driver)[0]) == (before, "WARN")
    assert "recovered" not in [
        each.reason for each in driver.state.served()[1] if each.fault.identity.component
    ]


def test_what_else_keeps_its_robot_up_does_not_count_towards_its_end():
    """Only its own arrays show that it could be published again."""
    entry = TopicEntry(topic="e_stop", component="E-stop", field="data")
    fields = StateDriver(components=(ENDS,), topics=(entry,)).raw_every(1, 60, MOTOR)
    fields.raw(MOTOR, SERIAL)
    for _ in range(1_000):
        fields.wait(1)
        fields.robot.receive_fields((Status(OK, "E-stop"),), fields.now)
    assert fields.robot.up
    assert fields.fault_names() >= CRITICAL
    stand(fields, 590 + START)
    assert fields.fault_names() >= CRITICAL
    stand(fields, 20)
    assert ("component", "critical", "r", "rosserial") not in fields.fault_names()


@pytest.mark.parametrize("is_adopted", [False, True], ids=["received", "adopted"])
def test_what_may_have_been_lost_does_not_count_towards_its_end(is_adopted):
    """It may have been published again."""
    driver = once(ENDS)
    stand(driver, 500)
    if is_adopted:  # by a process that only knows that it fires
        received, driver = driver, StateDriver(fleet=driver.state.fleet)
        driver.now = received.now
        driver.state.adopt(received.state.faults(), driver.now)
        stand(driver, 500)
    for lossy, seconds in ((True, 800), (False, 590 + START * is_adopted)):
        driver.robot.set_reading(driver.now, lossy=lossy, unread=())
        stand(driver, seconds)
        assert driver.fault_names() == CRITICAL
    stand(driver, 20)
    assert driver.fault_names() == set()


def test_the_minute_after_a_return_does_not_count_towards_its_end():
    """Its driver may not have started yet."""
    driver = once(replace(ENDS, ends_after=30.0))
    stand(driver, 15)
    driver.wait(60)
    stand(driver, START + 10)
    assert driver.fault_names() == CRITICAL
    stand(driver, 10)
    assert driver.fault_names() == set()


TEMPERATURE = ValueRule(
    key=re.compile("Temperature"), thresholds=(Threshold("high", "critical", 80.0),)
)
WARM = Status(OK, "rosserial", "", values=(("Temperature", "90"),))


@pytest.mark.parametrize("has_restart", [False, True])
def test_a_value_that_is_not_reported_again_is_over_as_well(tmp_path, has_restart):
    driver = StateDriver(components=(ENDS,), values=(TEMPERATURE,)).raw_every(1, 60, MOTOR)
    driver.raw(MOTOR, WARM)
    stand(driver, 300)
    assert [name[:2] for name in driver.fault_names()] == [("value", "critical")]
    if has_restart:
        driver = driver.again(tmp_path / "state")
    stand(driver, 305 + (START + 5) * has_restart)
    assert driver.fault_names() == set()
    (end,) = driver.state.served()[1]
    message = "OK" if has_restart else "OK: not reported again for 10m"  # its number is not known
    assert (end.reason, end.message) == ("recovered", message)

    driver.raw(MOTOR, WARM)
    stand(driver, 12)
    assert [name[:2] for name in driver.fault_names()] == [("value", "critical")]


@pytest.mark.parametrize("source", [Source.RAW, Source.AGG])
@pytest.mark.parametrize("last", [OK, ERROR])
def test_what_was_late_until_fleet_yml_says_that_it_reports_changes_goes_on(source, last):
    """Once it was STALE until it was published again, or the exporter was started again."""
    status = SERIAL._replace(level=last)
    driver = StateDriver(source)

    def go(seconds, *statuses):
        until = driver.now.mono + seconds
        if source is Source.RAW:
            driver.raw_every(1, until, *(each for each in statuses if each.level != STALE))
        else:
            driver.agg_every(1, until, *tree(Parts=statuses))

    go(60, MOTOR, status)
    go(60, MOTOR, status._replace(level=STALE))
    assert "stale" in {name[1] for name in driver.fault_names()}
    driver.follow_profile(Profile(components=(ENDS,)))
    assert {name[1] for name in driver.fault_names()} == ({"critical", "stale"} if last else set())
    go(600, MOTOR, status._replace(level=STALE))
    assert driver.fault_names() == set()
