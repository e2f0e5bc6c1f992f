"""What is known survives the process, and only what changed is written."""

import json
import re

import pytest

from ros_diagnostics_exporter.config.fleet import ComponentRule, Discovery, Fleet, Source
from ros_diagnostics_exporter.model import Endpoint, Instant, Status
from ros_diagnostics_exporter.storage.storage import Storage
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver, raw_fleet, tree

HOT, COOL = Status(ERROR, "Motor", "Hot", "mc-1"), Status(OK, "Motor", "OK", "mc-1")
LASER = Status(OK, "Laser")
MUTE = HOT._replace(level=STALE)
DAY = 86_400.0


def motor(driver: StateDriver) -> tuple[int, float, float | None, int]:
    """Its level, since when, since when it is a problem, and its changes."""
    found = driver.component("Motor")
    return found.level, found.since, driver.problem_since("Motor"), found.changes


def test_what_is_restored_is_stale_until_it_is_heard(path):
    before = StateDriver().at(1)
    after = before.raw(HOT, LASER).again(path)

    assert after.component("Motor").before_stale == ERROR
    assert (after.level("Motor"), after.problem_since("Motor")) == (STALE, WALL + 1)
    assert after.sample("robot_up") == 0
    assert after.sample("robot_last_message_timestamp_seconds") == WALL + 1


# The last status, the restarts, the first status after them; what the motor is then, and what the
# events have of its level.
RESTARTS = {
    "a fault goes on": (HOT, 1, HOT, (ERROR, WALL + 1, WALL + 1, 0, [])),
    "a fault goes on over two": (HOT, 2, HOT, (ERROR, WALL + 1, WALL + 1, 0, [])),
    "a fault ended": (HOT, 1, COOL, (OK, WALL + 6, None, 1, [("ERROR", "OK")])),
    "a fault is stale": (HOT, 1, MUTE, (STALE, WALL + 6, WALL + 1, 0, [("ERROR", "STALE")])),
    "what was ok is": (COOL, 1, COOL, (OK, WALL, None, 0, [])),
}


@pytest.mark.parametrize(("last", "times", "first", "found"), RESTARTS.values(), ids=RESTARTS)
def test_a_restart_is_no_change_of_level(path, last, times, first, found):
    driver = StateDriver().raw(COOL)
    driver.at(1)
    driver.raw(last)
    for _ in range(times):
        driver = driver.again(path)
    driver.raw(first)

    of_motor = motor(driver)
    assert driver.component("Motor").before_stale is (ERROR if first is MUTE else None)
    changes = [(each.before, each.after) for each in driver.at(2).events if each.kind == "level"]
    assert (*of_motor, changes) == found


def test_a_restart_ends_no_problem_where_stale_counts_as_ok(path):
    rule = ComponentRule(re.compile(""), levels={STALE: OK})
    before = StateDriver(components=(rule,), stale_after=5.0)
    again = before.raw(HOT).again(path)
    assert again.problem_since("Motor") is None  # it is OK, as the config has it
    again.keep(path)

    for level in (ERROR, WARN):
        after = again.restart(path).raw(HOT._replace(level=level))
        assert motor(after)[::2] == (level, WALL)
        after.close()


@pytest.mark.parametrize(("status", "stays"), [(HOT, True), (COOL, False), (MUTE, True)])
def test_what_was_not_ok_is_not_forgotten_after_a_restart_either(path, status, stays):
    before = StateDriver(forget_after=100.0).raw(COOL)
    after = before.raw(status).again(path).again(path)
    assert bool(after.at(200).robot.components) == stays


def test_a_restless_component_stays_restless(path):
    before = StateDriver()
    for second in range(8):
        before.at(second)
        before.raw(HOT if second % 2 else COOL)
    ratio = before.sample("component_flap_ratio", component="Motor")
    assert before.again(path).sample("component_flap_ratio", component="Motor") == ratio > 0.3


# -- robots ----------------------------------------------------------------------------------

AGG = "/r/diagnostics_agg"


def discovered(*topics: str) -> StateDriver:
    """Robots that discovery found by these topics."""
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    driver = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    driver.state.update_graph(0, {topic: Endpoint(1) for topic in topics}, driver.now)
    return driver


def test_a_robot_that_never_published_does_not_survive_a_restart(path):
    before = discovered(AGG, "/mute/diagnostics_agg")
    for second in (10, 20):
        before.at(second)
        before.agg(*tree(Motor=[COOL]))
    assert set(before.again(path).state.robots) == {"r"}


def test_a_discovered_robot_that_is_away_is_known_again_if_discovery_still_wants_it(path):
    before = discovered(AGG)
    again = before.agg(*tree(Motor=[HOT])).again(path)
    assert again.component("Motor").before_stale == ERROR
    assert again.robot.source is Source.AGG
    again.close()
    assert not before.restart(path, fleet=Fleet("f")).state.robots


def test_what_was_fine_for_days_is_not_forgotten_by_a_restart(path):
    before = StateDriver()
    before.storage = Storage(path)
    for turn in range(55 * 12 + 1):  # every five minutes
        before.now = Instant(turn * 300.0, WALL + turn * 300.0)
        before.raw(COOL, LASER)
        before.save()
    after = before.restart(path).at(5)

    assert {each.name for each in after.robot.components} == {"Motor", "Laser"}
    seen = after.sample("robot_last_message_timestamp_seconds")
    assert before.now.wall - 30 <= seen <= before.now.wall


# -- what is written -------------------------------------------------------------------------


def receive(driver: StateDriver, robot: str, *statuses: Status) -> None:
    driver.receive(f"/{robot}/diagnostics", *statuses)


def test_the_last_write_has_what_was_seen_last(path):
    before = StateDriver().raw(COOL)
    before.keep(path)
    before.at(7)
    assert before.raw(COOL).again(path).sample("robot_last_message_timestamp_seconds") == WALL + 7


def test_the_file_is_written_at_most_once_a_second_and_only_for_a_change(path, content):
    driver = StateDriver().raw(COOL)
    driver.keep(path)
    first = content()

    driver.at(0.5)
    driver.raw(HOT)
    driver.save()
    assert content() == first

    driver.at(1.5)
    driver.save()
    second = content()
    assert second != first

    driver.at(4)
    driver.raw(HOT)
    driver.save()
    assert content() == second
    assert driver.storage.written_at == WALL + 1.5


def test_only_the_robots_that_changed_are_written(path, content, edit):
    driver = StateDriver(fleet=raw_fleet("r", "s"))
    receive(driver, "s", COOL)
    driver.raw(COOL)
    driver.keep(path)
    edit("UPDATE robots SET data = 'as it was' WHERE name = 's'")
    for second in range(2, 20, 3):  # "last received" of both changes, too
        driver.at(second)
        driver.raw(HOT)
        receive(driver, "s", COOL)
        driver.save()

    robots = dict(content()["robots"])
    assert robots["s"] == "as it was"
    assert json.loads(robots["r"])["components"][0]["level"] == ERROR


@pytest.mark.parametrize("restarted", [False, True])
def test_a_robot_that_is_forgotten_goes(path, content, restarted):
    driver = StateDriver(fleet=raw_fleet("r", "s"))
    driver.keep(path)
    if restarted:
        driver = driver.restart(path, fleet=raw_fleet("r"))
    driver.configure(raw_fleet("r"))
    driver.at(2)
    driver.save()
    assert [name for name, _text in content()["robots"]] == ["r"]


def test_half_of_a_character_makes_no_damaged_file(path, caplog):
    driver = StateDriver().raw(Status(ERROR, "Motor", "Hot \ud800"))
    assert driver.again(path).component("Motor").message == "Hot ?"
    assert not caplog.text


# -- another time of day ---------------------------------------------------------------------


@pytest.mark.parametrize("days", [-2, -1 / 48, 200])
def test_a_wall_clock_that_was_set_between_two_starts_delays_no_fault(path, days):
    driver = StateDriver()
    warm, weak = Status(WARN, "Motor"), Status(ERROR, "Arm")
    driver.raw_every(1, 60, warm)
    driver.raw(warm, weak)
    driver.keep(path)
    assert len(driver.state.faults()) == 1
    after = driver.restart(path, after=days * DAY)
    began = after.now.wall
    for second in range(1, 45):
        after.raw(warm._replace(level=ERROR), weak)
        after.now = Instant(float(second), began + second)
        after.state.tick(after.now)
    assert {*after.faults()} == {("Motor", "warning"), ("Motor", "critical"), ("Arm", "critical")}
    assert all(fault.since <= after.now.wall for fault in after.state.faults() if days > 0)
    assert after.robot.last_wall <= after.now.wall
    after.close()


def test_what_was_known_is_not_forgotten_before_it_can_be_received(path):
    driver = discovered(AGG).agg(*tree(Motor=[COOL]))
    driver.keep(path)
    after = driver.restart(path, after=200 * DAY)

    def ticked(seconds: range) -> None:
        for second in seconds:
            after.now = Instant(float(second), after.now.wall + 1)
            after.state.tick(after.now)

    ticked(range(1, 590))
    assert after.level("Motor") == STALE
    ticked(range(590, 610))
    assert not after.robot.components  # the robot itself was received: it is silent until removed
    assert [each.identity.state.value for each in after.state.faults()] == ["silent"]
    after.close()
