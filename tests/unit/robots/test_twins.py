"""Several nodes that publish one status name, each in arrays of its own."""

import re
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.fleet import ComponentRule, Source, Threshold, ValueRule
from ros_diagnostics_exporter.model import Status
from simulation import twins as simulated
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver, tree

LEFT, RIGHT = (Status(OK, "lidar: Status", "scanning", side) for side in ("left", "right"))
FRONT, REAR = (
    Status(OK, "battery: Battery", "discharging", side, (("Charge (%)", "90"),))
    for side in ("front", "rear")
)
LOW = ValueRule(
    re.compile("Battery"), re.compile("Charge.*"), thresholds=(Threshold("low", "critical", 15.0),)
)


class Nodes:
    """Nodes that publish once a second, each half a second after the one before."""

    def __init__(self, *publishers: str, **profile):
        self.driver = StateDriver(**profile)
        self.publishers = publishers  # none: not known

    def stand(self, seconds: float, *statuses: Status | None):
        """Let them publish these; None: it publishes nothing."""
        end = self.driver.now.mono + seconds
        while self.driver.now.mono < end:
            for node, status in enumerate(statuses):
                if status is not None:
                    publisher = self.publishers[node] if self.publishers else ""
                    self.driver.raw(status, publisher=publisher)
                self.driver.at(self.driver.now.mono + 1 / len(statuses))
        return self

    @property
    def faults(self) -> set[tuple[str, ...]]:
        return self.driver.fault_names()

    @property
    def ends(self) -> list[str]:
        return [each.reason for each in self.driver.state.served()[1]]

    @property
    def labels(self) -> set[str]:
        return {each.label for each in self.driver.robot.components}


@pytest.mark.parametrize("publishers", [(), ("a", "b")])
def test_the_one_that_dies_is_a_fault_that_names_it_and_the_other_is_not(publishers):
    nodes = Nodes(*publishers)
    assert nodes.stand(30, LEFT, RIGHT).labels == {"lidar: Status [left]", "lidar: Status [right]"}
    nodes.stand(60, LEFT, RIGHT._replace(level=ERROR, message="no data"))
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status [right]")}
    assert nodes.stand(60, LEFT, None).driver.level("lidar: Status [right]") == STALE
    assert nodes.driver.level("lidar: Status [left]") == OK


def test_the_threshold_that_one_of_them_passes_is_seen_and_its_end_is_one():
    nodes = Nodes(values=(LOW,)).stand(30, FRONT, REAR)
    nodes.stand(60, FRONT, REAR._replace(values=(("Charge (%)", "2"),)))
    (fault,) = nodes.driver.state.faults()
    assert fault.identity.component == "battery: Battery [rear]"
    assert (nodes.stand(5, FRONT, REAR).faults, nodes.ends) == (set(), ["recovered"])


@pytest.mark.parametrize("publishers", [(), ("a", "b")])
def test_what_is_broken_before_they_are_told_apart_is_a_fault_that_names_it(publishers):
    nodes = Nodes(*publishers).stand(60, LEFT, RIGHT._replace(level=ERROR))
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status [right]")}


def test_they_have_the_same_names_after_a_restart(tmp_path):
    nodes = Nodes().stand(30, LEFT, RIGHT)
    before, labels = nodes.stand(30, LEFT, RIGHT._replace(level=ERROR)).faults, nodes.labels
    nodes.driver = nodes.driver.again(tmp_path / "state")
    nodes.stand(60, LEFT, RIGHT._replace(level=ERROR))
    assert (nodes.faults, nodes.labels, nodes.ends) == (before, labels, [])


@pytest.mark.parametrize("ids", [("m-1", "m-2"), ("m-1", "m-2", "m-1"), ("", "m-2", "m-2")])
def test_hardware_that_is_replaced_is_the_same_component(ids):
    nodes = Nodes()
    for hardware_id in ids:
        nodes.stand(20, LEFT._replace(hardware_id=hardware_id))
    assert nodes.labels == {"lidar: Status"}
    assert nodes.driver.component("lidar: Status").hardware_id == ids[-1]


def test_three_of_them_are_three_components():
    nodes = Nodes().stand(30, *(LEFT._replace(hardware_id=each) for each in ("a", "b", "")))
    assert nodes.labels == {"lidar: Status [a]", "lidar: Status [b]", "lidar: Status"}


def test_of_those_that_nothing_tells_apart_the_worse_counts_and_that_is_said(caplog):
    nodes, same = Nodes("a", "b"), LEFT._replace(hardware_id="")
    nodes.stand(30, same, same)
    nodes.stand(60, same, same._replace(level=ERROR, message="no data"))
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status")}
    component = nodes.driver.component("lidar: Status")
    assert component.trouble_text == "no data (several nodes publish it, the worse counts)"
    assert component.changes == 1
    assert nodes.driver.robot.rejected["duplicate_component"] > 50
    assert caplog.text.count("the worse counts") == 1
    assert (nodes.stand(10, same, same).faults, nodes.ends) == (set(), ["recovered"])
    nodes.stand(100, same, None)
    assert component.trouble_text == "scanning"


def test_what_one_of_them_said_once_counts_for_as_long_as_a_slow_one_may_take():
    nodes, same = Nodes("a", "b"), LEFT._replace(hardware_id="")
    nodes.stand(30, same, None).stand(1, same, same._replace(level=ERROR))
    assert nodes.stand(85, same, None).driver.level("lidar: Status") == ERROR
    assert nodes.stand(10, same, None).driver.level("lidar: Status") == OK


def test_one_that_an_earlier_process_knew_is_not_several(tmp_path):
    nodes = Nodes("a").stand(30, LEFT._replace(level=ERROR, message="no data"))
    component = nodes.driver.again(tmp_path / "state").component("lidar: Status")
    assert component.trouble_text == "no longer reports; its last message: no data"


def test_of_values_that_nothing_tells_apart_the_one_beyond_a_threshold_counts():
    nodes, same = Nodes("a", "b", values=(LOW,)), FRONT._replace(hardware_id="b")
    nodes.stand(30, same, same)
    assert nodes.stand(60, same, same._replace(values=(("Charge (%)", "2"),))).faults == {
        ("value", "critical", "r", "battery", "battery: Battery", "Charge (%)", "low")
    }
    assert (nodes.stand(10, same, same).faults, nodes.ends) == (set(), ["recovered"])


def test_a_node_that_crashes_and_starts_again_and_again_is_one():
    nodes, hot = Nodes("0"), LEFT._replace(level=ERROR)
    for number in range(20):
        nodes.stand(12, hot)
        nodes.publishers = (f"{number + 1}",)
        nodes.stand(12, LEFT)
    assert nodes.driver.component("lidar: Status").said is None
    assert nodes.driver.level("lidar: Status") == OK


def test_an_aggregator_in_place_of_them_has_a_component_of_their_name(tmp_path):
    nodes = Nodes()
    (robot,) = nodes.stand(30, LEFT, RIGHT).driver.state.fleet.robots
    fleet = replace(nodes.driver.state.fleet, robots=(replace(robot, source=Source.AGG),))
    driver = nodes.driver.again(tmp_path / "state", fleet=fleet)
    assert driver.agg_every(1, 20, *tree(Lidars=[LEFT])).level("lidar: Status") == OK


def test_an_aggregator_beside_them_makes_no_third_component():
    driver = StateDriver(Source.BOTH)
    for _ in range(20):
        for side in (LEFT, RIGHT):
            driver.raw(side)
            driver.wait(0.5)
            driver.agg(*tree(Lidars=[side]))
    assert {each.label for each in driver.robot.components} == {
        "lidar: Status [left]",
        "lidar: Status [right]",
    }


def test_one_that_had_a_fault_when_they_were_told_apart_ends_it_after_a_restart(tmp_path):
    """It keeps the name of its fault until then."""
    nodes = Nodes("a", "b").stand(30, LEFT._replace(level=ERROR), None)
    nodes.stand(30, LEFT._replace(level=ERROR), RIGHT)
    nodes.driver = nodes.driver.again(tmp_path / "state")
    nodes.stand(30, LEFT._replace(level=ERROR), RIGHT)
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status")}
    nodes.stand(10, LEFT, RIGHT)
    assert (nodes.faults, recovered(nodes.driver)) == (set(), ["lidar: Status"])


# -- what is published only on a change ----------------------------------------------------------

ONCE = ComponentRule(re.compile("rosserial"), reports="on_change")
SERIAL = Status(OK, "rosserial", "in sync")
LOST = SERIAL._replace(level=ERROR, message="lost sync")
CRITICAL = {("component", "critical", "r", "rosserial")}


def twins(rule: ComponentRule = ONCE) -> StateDriver:
    """A robot of which two nodes have said OK once, and then one of them ERROR."""
    driver = StateDriver(components=(rule,))
    driver.graph("a", "b", "motor")
    for publisher in "ab":
        driver.raw(SERIAL, publisher=publisher)
    on(driver, 60)
    driver.raw(LOST, publisher="a")
    return driver


def on(driver: StateDriver, seconds: float) -> None:
    """Let the robot be received for some seconds."""
    for _ in driver.seconds(seconds):
        driver.raw(Status(OK, "Motor"), publisher="motor")


def recovered(driver: StateDriver) -> list[str]:
    """The components of which a fault recovered since the start, also of those that began again."""
    return [
        each.component for each in driver.events if each.reason == "recovered" and each.component
    ]


def test_one_of_two_that_says_ok_once_is_no_end_of_what_the_other_said():
    driver = twins()
    on(driver, 30)
    driver.raw(SERIAL, publisher="b")
    on(driver, 600)
    assert (driver.fault_names(), recovered(driver)) == (CRITICAL, [])
    text = "lost sync (several nodes publish it, the worse counts)"
    assert driver.component("rosserial").trouble_text == text
    assert driver.raw(SERIAL, publisher="a").fault_names() == set()


def test_nor_is_it_after_a_restart_or_a_silence(tmp_path):
    driver = twins()
    on(driver, 30)
    driver = driver.again(tmp_path / "state")
    on(driver, 5)
    driver.raw(SERIAL, publisher="b")
    on(driver, 60)
    driver.wait(120)
    on(driver, 5)
    driver.raw(SERIAL, publisher="b")
    driver = driver.again(tmp_path / "state")
    on(driver, 60)
    assert (driver.fault_names(), recovered(driver)) == (CRITICAL, [])
    assert driver.raw(SERIAL, publisher="a").fault_names() == set()


def test_a_node_that_was_started_again_ends_what_it_said_before():
    """Its publisher has another name then, and the former one is gone from the graph."""
    driver = twins()
    on(driver, 30)
    driver.graph("b", "motor")
    on(driver, 30)
    assert driver.fault_names() == CRITICAL
    driver.graph("a2", "b", "motor")
    driver.raw(SERIAL, publisher="a2")
    assert (driver.fault_names(), recovered(driver)) == (set(), ["rosserial"])


def test_it_does_so_although_the_graph_shows_that_later():
    driver = twins()
    on(driver, 30)
    driver.raw(SERIAL, publisher="a2")
    on(driver, 10)
    assert driver.fault_names() == CRITICAL
    driver.graph("a2", "b", "motor")
    on(driver, 1)
    assert driver.fault_names() == set()


def test_twins_that_repeat_it_are_the_same_after_a_restart_and_a_silence(tmp_path):
    """The one that is well is received first."""
    nodes, hot = Nodes("a", "b"), LEFT._replace(hardware_id="", level=ERROR)
    well = hot._replace(level=OK)
    nodes.stand(60, hot, well)
    nodes.driver = nodes.driver.again(tmp_path / "state")
    nodes.publishers = ("b", "a")
    nodes.stand(60, well, hot)
    nodes.driver.wait(120)
    nodes.stand(60, well, hot)
    assert nodes.faults == {("component", "critical", "r", "lidar", "lidar: Status")}
    assert recovered(nodes.driver) == []


def test_so_are_their_values(tmp_path):
    nodes, full = Nodes("a", "b", values=(LOW,)), FRONT._replace(hardware_id="")
    low = full._replace(values=(("Charge (%)", "2"),))
    found = nodes.stand(60, low, full).faults
    assert [each[0] for each in found] == ["value"]
    nodes.driver = nodes.driver.again(tmp_path / "state")
    nodes.driver.at(1)
    nodes.publishers = ("b", "a")
    assert (nodes.stand(60, full, low).faults, recovered(nodes.driver)) == (found, [])


@pytest.mark.parametrize(
    ("levels", "of_a", "of_b", "worse"),
    [({}, ERROR, STALE, "critical"), ({ERROR: OK}, ERROR, WARN, "warning")],
)
def test_what_fleet_yml_makes_of_their_levels_says_which_is_worse(levels, of_a, of_b, worse):
    rule = ComponentRule(re.compile("lidar"), levels=levels)
    nodes, same = Nodes("a", "b", components=(rule,)), LEFT._replace(hardware_id="")
    nodes.stand(60, same._replace(level=of_a), same._replace(level=of_b))
    assert nodes.faults == {("component", worse, "r", "lidar", "lidar: Status")}


def test_the_latest_counts_where_publishers_have_names_no_more():
    driver = twins()
    on(driver, 30)
    assert driver.raw(SERIAL, publisher="b").fault_names() == CRITICAL
    assert (driver.raw(SERIAL).fault_names(), driver.component("rosserial").said) == (set(), None)


@pytest.mark.parametrize("restart", [False, True])
def test_what_each_said_counts_once_they_are_told_apart(tmp_path, restart):
    rule = ComponentRule(re.compile("lidar"), reports="on_change")
    driver = StateDriver(components=(rule,))
    left, right = LEFT._replace(level=ERROR), RIGHT._replace(level=ERROR)
    driver.raw(right, publisher="b").at(1).raw(left, publisher="a").at(2)
    if restart:
        driver = driver.again(tmp_path / "state")
    for status, publisher in ((right, "c"), (left, "a"), (right, "c")):
        level = WARN if publisher == "c" else ERROR  # b does not take back what it said
        driver.raw(status._replace(level=level), publisher=publisher).wait(1)
    for _ in range(60):
        driver.raw(Status(OK, "Motor")).wait(1)
    assert driver.fault_names() == {
        ("component", "critical", "r", "lidar", "lidar: Status [left]"),
        ("component", "critical", "r", "lidar", "lidar: Status [right]"),
    }


@pytest.mark.parametrize(
    "seed", [1, 47, 54, 73, 130, 731, 20017, 3001127]
)  # each failed before something was mended
def test_whatever_happens_nothing_recovers_that_one_of_them_says_is_error(seed):
    simulated.play(seed)
