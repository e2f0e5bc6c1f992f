"""Robots behind an uplink, or a DDS domain, that fails: its fault alone, decided before theirs."""

from collections.abc import Iterable
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.capabilities import Capability, ComponentsOf, Expression
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Fleet,
    Profile,
    Query,
    Robot,
    Source,
)
from ros_diagnostics_exporter.model import Downtime, Status
from ros_diagnostics_exporter.regex import Pattern
from support.state_driver import ERROR, OK, StateDriver

ALL = ("r", "r2", "r3", "r4", "r5", "r6")
WIRED = "w"
UPLINK_PING = Query("x", "ping", "Uplink", "robot", interval=5.0, confirm_after=20.0, uplink=True)
HOST_PING = Query("y", "ping", robot="robot", confirm_after=60.0)


def robot(name: str, uplink: str = "ap", **more) -> Robot:
    topics = {"topic_agg": f"/{name}/diagnostics_agg", "topic_raw": f"/{name}/diagnostics"}
    return Robot(
        name, source=Source.RAW, profile=Profile(), labels={"uplink": uplink}, **topics, **more
    )


def access_point(name: str, uplink: str = "") -> Robot:
    return Robot(name, source=Source.QUERIES, profile=Profile(), labels={"uplink": uplink})


class Driver(StateDriver):
    """Six robots behind the access point ``ap``, which is behind ``router``, and a wired one."""

    def __init__(self) -> None:
        points = access_point("ap", "router"), access_point("router")
        robots = (*map(robot, ALL), robot(WIRED, uplink=""), *points)
        super().__init__(fleet=Fleet("f", robots, queries=(UPLINK_PING, HOST_PING)))
        self.received: set[str] = {*ALL, WIRED}
        self.failing: set[str] = set()
        self.asked = True
        self.began: list[str] = []
        self.ended: list[str] = []

    def pass_to(self, end: float):
        """Let the robots that are received publish, and Prometheus answer every 5 s."""
        while self.now.mono < end:
            second = int(self.now.mono)
            for name in sorted(self.received):
                self.receive(f"/{name}/diagnostics", Status(OK, "Motor"))
            if self.asked and second % 5 == 0:
                self._answer(UPLINK_PING, ("ap", "router"))
                self._answer(HOST_PING, ALL)
            self.at(second + 1)
        for event in self.state.take_events():
            what = f"{event.robot or event.site} {event.component or event.state}".strip()
            if event.kind == "fault_began":
                self.began.append(what)
            elif event.kind == "fault_ended":
                self.ended.append(what)
        return self

    def _answer(self, query: Query, robots: Iterable[str]) -> None:
        statuses = {
            name: (Status(ERROR if name in self.failing else OK, "ping"),) for name in robots
        }
        self.state.receive_answer(query.feed, statuses, self.now)

    def suppressed(self, name: str) -> dict[str, str]:
        """Why the problems of a robot are suppressed."""
        return {
            each.identity.component or each.identity.state.value: each.suppressed.value
            for each in self.state.problems(self.now, name)
            if each.suppressed is not None
        }


@pytest.fixture
def driver() -> Driver:
    return Driver().pass_to(60)


def fail(driver: Driver, *uplinks: str) -> None:
    """All robots behind it are gone, with what they are reached through."""
    driver.received -= set(ALL)
    driver.failing |= {*uplinks, *ALL}


def heal(driver: Driver, *, all_of_them: bool = False) -> None:
    """The uplinks work again, and all robots are received where ``all_of_them``."""
    driver.failing -= {"ap", "router"}
    if all_of_them:
        driver.failing.clear()
        driver.received |= {*ALL, WIRED}


def test_an_uplink_that_fails_is_one_fault_and_its_robots_and_their_site_are_none(driver):
    fail(driver, "ap")
    assert driver.pass_to(600).began == ["ap ping"]
    assert driver.suppressed("r") == {"silent": "unreachable", "ping": "unreachable"}
    reasons = {"fleet": "f", "robot": "r", "reason": "uplink_down"}
    assert driver.sample("robot_silent_reason", **reasons) == 1

    heal(driver)
    assert driver.pass_to(620).ended == ["ap ping"]
    heal(driver, all_of_them=True)
    assert (driver.pass_to(900).began, driver.ended) == (["ap ping"], ["ap ping"])


def test_the_fault_of_an_uplink_names_the_robots_behind_it(driver):
    fail(driver, "ap")
    driver.pass_to(600)

    (fault,) = driver.state.faults()
    behind = [name for name in ALL if name != "ap"]
    assert fault.details["behind"] == behind[:5]
    assert f"robots behind it: {', '.join(behind[:5])}" in fault.evidence
    assert "values" not in fault.evidence


def test_the_fault_of_an_uplink_says_nothing_of_what_robots_can_do(driver):
    """It is no robot, but may have the profile of the others."""
    expression = Expression(None, (ComponentsOf((Pattern("Motor"),)),))
    drives = Profile(capabilities={"driving": Capability("driving", expression)})
    driver.follow_profile(drives)
    fail(driver, "ap")
    driver.pass_to(600)

    (fault,) = driver.state.faults()
    assert (fault.identity.robot, fault.capabilities) == ("ap", "")


def test_what_is_still_silent_when_the_uplink_is_back_begins_after_the_others_had_time(driver):
    fail(driver, "ap")
    driver.pass_to(600)
    heal(driver)
    driver.pass_to(610)
    driver.received |= set(ALL) - {"r"}
    driver.failing -= driver.received
    assert driver.pass_to(675).began == ["ap ping"]
    assert driver.pass_to(695).began == ["ap ping", "r silent"]
    driver.received.add("r")
    driver.failing.clear()
    driver.pass_to(800)
    assert (driver.began, driver.ended) == (["ap ping", "r silent"], ["ap ping", "r silent"])


def test_a_robot_of_the_same_site_that_is_not_behind_it_is_a_fault_of_its_own(driver):
    fail(driver, "ap")
    driver.pass_to(100)
    driver.received.discard(WIRED)
    assert driver.pass_to(140).began == ["ap ping", "w silent"]


def test_a_site_that_was_a_fault_before_ends_only_with_its_robots_return(driver):
    driver.received.clear()
    assert driver.pass_to(120).began == ["silent"]
    driver.failing.add("ap")
    assert driver.pass_to(300).ended == []
    heal(driver, all_of_them=True)
    driver.pass_to(600)
    assert sorted(driver.ended) == sorted(driver.began)


def test_behind_an_uplink_that_is_behind_another_the_outermost_is_the_fault(driver):
    fail(driver, "ap", "router")
    assert driver.pass_to(600).began == ["router ping"]
    assert driver.suppressed("ap") == {"ping": "unreachable"}
    heal(driver, all_of_them=True)
    assert (driver.pass_to(900).began, driver.ended) == (["router ping"], ["router ping"])


def test_a_silence_that_began_before_goes_on_and_ends_with_the_robots_return(driver):
    driver.received.discard("r")
    assert driver.pass_to(120).began == ["r silent"]
    fail(driver, "ap")
    driver.pass_to(600)
    heal(driver, all_of_them=True)
    assert driver.pass_to(900).began == ["r silent", "ap ping"]
    assert sorted(driver.ended) == ["ap ping", "r silent"]


def test_a_silence_with_its_uplink_up_waits_until_the_ping_is_known_and_is_a_fault_then(driver):
    driver.received.discard("r")
    assert driver.pass_to(85).began == []
    assert driver.pass_to(95).began == ["r silent"]


def test_one_lost_ping_is_no_fault_and_delays_a_silence_by_seconds(driver):
    driver.failing.add("ap")
    driver.pass_to(64)
    heal(driver)
    driver.received.discard("r")
    assert driver.pass_to(100).began == ["r silent"]


def test_without_prometheus_an_uplink_that_failed_still_does_and_nothing_begins_or_ends(driver):
    fail(driver, "ap")
    driver.pass_to(300)
    driver.asked = False
    assert (driver.pass_to(1000).began, driver.ended) == (["ap ping"], [])
    driver.asked = True
    heal(driver, all_of_them=True)
    assert (driver.pass_to(1300).began, driver.ended) == (["ap ping"], ["ap ping"])


def test_without_prometheus_robots_of_an_uplink_that_answered_last_are_silent_themselves(driver):
    driver.asked = False
    driver.received.discard("r")
    assert driver.pass_to(300).began == ["r silent"]


def test_a_robot_of_which_messages_are_received_has_its_own_faults_behind_a_failing_uplink(driver):
    driver.failing |= {"ap", "r"}
    assert driver.pass_to(300).began == ["ap ping"]
    driver.raw(Status(ERROR, "Laser"))
    assert driver.pass_to(330).began == ["ap ping", "r Laser"]


def test_what_is_measured_of_a_robot_counts_from_its_return(driver):
    driver.received.discard("r")
    driver.failing.add("r")
    assert driver.pass_to(300).began == ["r silent"]
    driver.received.add("r")
    driver.pass_to(304)
    driver.failing.discard("r")
    assert (driver.pass_to(500).began, driver.ended) == (["r silent"], ["r silent"])


def test_a_ping_that_fails_while_its_robot_is_received_is_a_fault_of_its_own(driver):
    driver.failing.add("r")
    assert driver.pass_to(115).began == []
    assert driver.pass_to(130).began == ["r ping"]


def test_a_domain_that_cannot_be_joined_explains_that_its_robots_are_silent():
    driver = Driver()
    config = driver.state.fleet
    own = replace(config.robots[0], domain_id=7)
    driver.configure(robots=(own, *config.robots[1:]))
    driver.pass_to(30)
    driver.state.domain_failed(7, "no route", driver.now)
    assert driver.pass_to(300).began == []
    assert set(driver.suppressed("r").values()) == {"unreachable"}
    driver.state.domain_joined(7)
    assert driver.pass_to(1200).began == []
    driver.pass_to(1300)  # it could be received for pending_after since a minute after that
    assert driver.began == ["r pending"]


def test_a_robot_that_is_added_behind_a_failing_uplink_is_suppressed(driver):
    fail(driver, "ap")
    config = driver.pass_to(300).state.fleet
    driver.configure(robots=(*config.robots, robot("new")))
    assert driver.pass_to(1500).began == ["ap ping"]
    assert set(driver.suppressed("new").values()) == {"unreachable"}


def test_robots_of_an_uplink_that_fails_again_and_again_do_not_flap(driver):
    for number in range(5):
        fail(driver, "ap")
        driver.pass_to(160 + 200 * number)
        heal(driver, all_of_them=True)
        driver.pass_to(260 + 200 * number)
    assert {name for name in driver.began if not name.startswith("ap")} == set()


def test_the_planned_downtime_of_an_uplink_is_that_of_the_silence_behind_it(driver):
    until = driver.now.wall + 600
    driver.state.plan(
        [Downtime("ap", "", driver.now.wall, until, "kim", "new firmware")], driver.now
    )
    fail(driver, "ap")
    assert driver.pass_to(driver.now.mono + 300).began == []
    assert driver.suppressed("r")["silent"] == "maintenance"
    heal(driver, all_of_them=True)
    assert driver.pass_to(driver.now.mono + 600).began == []


def in_hall(driver: Driver) -> Driver:
    """The same robots, of a site of which three that are silent are one fault."""
    config = driver.state.fleet
    robots = (replace(each, labels={**each.labels, "site": "hall"}) for each in config.robots)
    site = replace(config.faults, site=CauseSettings(3, 0.5))
    driver.configure(robots=tuple(robots), faults=site)
    return driver


@pytest.mark.parametrize("back", [50.0, 200.0])
def test_their_site_counts_robots_that_had_time_to_return_after_their_uplink(driver, back):
    """Once it was silent 25 s after the access point was back, of the minute that they have."""
    fail(in_hall(driver), "ap")
    driver.pass_to(600)
    heal(driver)
    driver.pass_to(600 + back)
    assert driver.began == ["ap ping", "hall silent"][: 1 + (back > 60)]
    heal(driver, all_of_them=True)
    driver.pass_to(1200)
    assert sorted(driver.ended) == sorted(driver.began)


@pytest.mark.parametrize("planned", [("router", ""), ("ap", "ping"), ("router", "ping")])
def test_so_is_that_of_what_it_is_reached_through_and_of_its_ping_alone(driver, planned):
    now = driver.now.wall
    driver.state.plan([Downtime(*planned, now, now + 600, "kim", "new cables")], driver.now)
    fail(driver, "ap", "router" if planned[0] == "router" else "ap")
    assert driver.pass_to(driver.now.mono + 300).began == []
    assert driver.suppressed("r")["silent"] == "maintenance"
