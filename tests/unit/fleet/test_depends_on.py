"""Components that fleet.yml says are behind others of their robot: which, and one fault of them."""

import sys
from collections.abc import Mapping

import pytest

from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    Fleet,
    Profile,
    Query,
    Robot,
    Source,
)
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.regex import Pattern
from support.state_driver import ERROR, OK, SETTLED, StateDriver

COMPUTER = Query("up", "Computer 2", robot="robot", interval=5.0, confirm_after=10.0)
PARTS = ("Laser", "Camera", "Motor", "Power")


def profile(**behind: str) -> Profile:
    rules = (
        ComponentRule(pattern=Pattern(match.replace("_", " ")), depends_on=(Pattern(of),))
        for match, of in behind.items()
    )
    return Profile(components=tuple(rules))


class Driver(StateDriver):
    """A robot whose second computer is measured every 5 s, and publishes all else each second."""

    def __init__(self, found: Profile) -> None:
        topics = {"topic_agg": "/r/diagnostics_agg", "topic_raw": "/r/diagnostics"}
        robot = Robot("r", source=Source.RAW, profile=found, **topics)
        super().__init__(fleet=Fleet("f", (robot,), queries=(COMPUTER,)))
        self.pass_to(20)

    def pass_to(self, end: float, *failing: str):
        levels: Mapping[str, int] = dict.fromkeys(failing, ERROR)
        while self.now.mono < end:
            self.raw(*(Status(levels.get(each, OK), each) for each in PARTS))
            if int(self.now.mono) % 5 == 0:
                found = (Status(levels.get("Computer 2", OK), "Computer 2"),)
                self.state.receive_answer(COMPUTER.feed, {"r": found}, self.now)
            self.at(int(self.now.mono) + 1)
        return self

    def began(self) -> list[str]:
        return [each.component for each in self.state.take_events() if each.kind == "fault_began"]

    def reasons(self) -> dict[str, str]:
        """The reasons that are served."""
        found = map(dict, self.samples().get("component_suppressed", ()))
        return {labels["component"]: labels["reason"] for labels in found}

    def suppressed(self) -> dict[str, str]:
        found = self.state.problems(self.now, "r")
        return {each.identity.component: each.suppressed.value for each in found if each.suppressed}


def test_behind_what_is_measured_a_fault_waits_until_that_is_known():
    driver = Driver(profile(Laser="Computer")).pass_to(39, "Laser")  # since 20 s
    assert driver.began() == []
    assert driver.pass_to(42, "Laser", "Computer 2").suppressed() == {"Laser": "depends_on"}
    assert driver.reasons() == {}  # it is not due yet
    driver.pass_to(300, "Laser", "Computer 2")  # known 20 s after it
    assert driver.began() == ["Computer 2"]
    assert driver.suppressed() == driver.reasons() == {"Laser": "depends_on"}
    assert driver.pass_to(400).reasons() == {}

    driver = Driver(profile(Laser="Computer"))
    assert driver.pass_to(44, "Laser").began() == []
    driver.pass_to(47, "Laser")  # confirm_after, and the time of a query
    assert driver.began() == ["Laser"]
    assert driver.pass_to(60, "Laser", "Computer 2").reasons() == {}  # its own fault goes on


def test_behind_what_is_published_it_is_a_fault_as_soon_as_others():
    driver = Driver(profile(Laser="Power"))
    assert driver.pass_to(32, "Laser").began() == ["Laser"]


def test_what_is_behind_what_is_behind_it_is_explained_too():
    driver = Driver(profile(Laser="Motor", Motor="Power"))
    assert driver.pass_to(60, "Laser", "Power").began() == ["Power"]


def test_what_depends_on_another_does_so_from_its_first_message_on():
    driver = Driver(profile(Wheel="Power"))
    driver.raw(Status(ERROR, "Wheel"), Status(ERROR, "Power"))
    assert driver.suppressed() == {"Wheel": "depends_on"}


@pytest.mark.parametrize("rules", [{"Power": "Power"}, {"Power": "Motor", "Motor": "Power"}])
def test_what_would_be_behind_itself_is_a_fault_of_its_own(rules):
    driver = Driver(profile(**rules))
    assert sorted(driver.pass_to(60, "Motor", "Power").began()) == ["Motor", "Power"]


def test_other_settings_are_followed():
    driver = Driver(profile(Laser="Power"))
    assert driver.pass_to(60, "Laser", "Power").began() == ["Power"]
    driver.follow_profile(profile())
    assert driver.pass_to(70, "Laser", "Power").began() == ["Laser"]


def test_each_pattern_is_searched_once_in_each_name():
    """Not in each name for each component: an array of 400 new names took seconds."""
    searches = 0

    class Counting(Pattern):
        def search(self, text: str) -> bool:
            nonlocal searches
            searches += 1
            return super().search(text)

    rules = (ComponentRule(pattern=Pattern("Part"), depends_on=(Counting("Power"),)),)
    names = [f"Part {number}" for number in range(400)]
    StateDriver(components=rules).raw(*(Status(OK, each) for each in (*names, "Power")))
    assert 0 < searches <= 2 * (len(names) + 1)


def calls(number: int, *rules: ComponentRule) -> int:
    """How many calls of functions and generators it takes that so many new names fail at once."""
    made = 0

    def count(_frame: object, event: str, _argument: object) -> None:
        nonlocal made
        made += event == "call"

    driver = StateDriver(components=rules).stand(SETTLED, Status(OK, "Power"))
    failing = (Status(ERROR, "Power"), *(Status(ERROR, f"Part {each}") for each in range(number)))
    sys.setprofile(count)
    try:
        driver.stand(15, *failing)
    finally:
        sys.setprofile(None)
    assert driver.faults()
    return made


@pytest.mark.parametrize("depends", [True, False])
def test_twice_as_many_new_names_take_twice_as_many_calls(depends):
    """Each looked at all others of its robot, for what it depends on or for what many explain."""
    rule = ComponentRule(pattern=Pattern("Part"), depends_on=(Pattern("Power"),))
    rules = (rule,) if depends else ()
    assert calls(200, *rules) < 2.1 * calls(100, *rules)
