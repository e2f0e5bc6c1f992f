"""One row of an aggregator's array is one component, by whatever name it is known."""

import pytest

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.model import Status
from support.state_driver import ERROR, OK, STALE, StateDriver

AIR = Status(ERROR, "/Gripper/Air", "no pressure")
PLAIN = (Status(ERROR, "/Gripper", "no pressure"), AIR)
NAMED = (
    Status(OK, "/Gripper", "OK", "", (("/Gripper/Air", "OK"),)),
    AIR._replace(level=OK, message="OK"),
)
DRIVES = (
    Status(OK, "/Drives", "OK", "", (("/Drives/Left", "running"),)),
    Status(OK, "/Drives/Left", "running"),
)


def known(driver) -> dict[tuple[str, str], int]:
    return {(each.group, each.label): each.level for each in driver.robot.components}


def ends(driver) -> list[str]:
    return [each.reason for each in driver.state.served()[1]]


def rows(base: str, *, values: bool, level: int = OK) -> tuple[Status, ...]:
    """An aggregator's rows with and without `publish_values`."""
    motors = [Status(level, f"{base}/Motors/Motor {n}", "OK", "", (("U", "1"),)) for n in (1, 2)]
    cam = Status(OK, f"{base}/Cameras/Cam 1", "OK")
    keys = (("Motor 1", "OK"), ("Motor/2", "OK")), (("Cam 1", "OK"),)
    headers = [
        Status(OK, f"{base}/{name}", "OK", "", key if values else ())
        for name, key in zip(("Motors", "Cameras"), keys, strict=True)
    ]
    return headers[0], *motors, headers[1], cam


def test_a_header_that_gets_its_values_later_renames_the_component_and_its_fault_recovers():
    driver = StateDriver(Source.AGG).agg_every(1, 60, *DRIVES, *PLAIN)
    assert driver.fault_names() == {("component", "critical", "r", "/Gripper", "Air")}
    driver.agg_every(1, 180, *DRIVES, *NAMED)
    assert (driver.fault_names(), ends(driver)) == (set(), ["recovered"])
    assert known(driver) == {("/Drives", "/Drives/Left"): OK, ("/Gripper", "/Gripper/Air"): OK}


def test_the_fault_keeps_its_name_and_its_begin_while_it_lasts(tmp_path):
    driver = StateDriver(Source.AGG)
    before = driver.agg_every(1, 60, *DRIVES, *PLAIN).state.faults()
    named = (NAMED[0]._replace(level=ERROR), AIR)
    driver.agg_every(1, 100, *DRIVES, *named)
    driver = driver.again(tmp_path / "state").agg_every(1, 60, *DRIVES, *named)
    assert [(each.identity, each.since, each.confirmed) for each in driver.state.faults()] == [
        (each.identity, each.since, each.confirmed) for each in before
    ]
    assert known(driver)["/Gripper", "Air"] == ERROR
    driver.agg_every(1, 80, *DRIVES, *NAMED)
    assert (driver.fault_names(), ends(driver)) == (set(), ["recovered"])
    assert ("/Gripper", "/Gripper/Air") in known(driver)


def test_a_name_that_is_known_exactly_stays_when_the_header_has_no_values_any_more(tmp_path):
    driver = StateDriver(Source.AGG).agg_every(1, 20, *rows("", values=True))
    names = set(known(driver))
    assert names == {("/Motors", "Motor 1"), ("/Motors", "Motor/2"), ("/Cameras", "Cam 1")}
    driver.agg_every(1, 40, *rows("", values=False))
    assert known(driver) == dict.fromkeys(names, OK)
    driver = driver.again(tmp_path / "state").agg_every(1, 20, *rows("", values=False))
    assert known(driver) == dict.fromkeys(names, OK)


@pytest.mark.parametrize("before", [True, False])
@pytest.mark.parametrize("after", [True, False])
def test_another_base_path_moves_the_components(before, after):
    driver = StateDriver(Source.AGG).agg_every(1, 30, *rows("/Robot", values=before, level=ERROR))
    assert len(driver.fault_names()) == 2
    driver.agg_every(1, 60, *rows("/Other", values=after, level=ERROR))
    assert len(driver.fault_names()) == 2
    driver.agg_every(1, 90, *rows("/Other", values=after))
    assert (driver.fault_names(), ends(driver)) == (set(), ["recovered"] * 2)
    assert set(known(driver).values()) == {OK}
    assert {group for group, _label in known(driver)} == {"/Other/Motors", "/Other/Cameras"}
    assert not any("~" in label for _group, label in known(driver))


def test_a_component_of_the_same_name_in_another_group_is_another():
    driver = StateDriver(Source.AGG)
    cams = [Status(OK, f"/{side}/Cam", "fine", "", (("a", "1"),)) for side in ("Left", "Right")]
    left = Status(OK, "/Left", "OK"), cams[0]
    driver.agg_every(1, 20, *DRIVES, *left)
    driver.agg_every(1, 60, *DRIVES, Status(OK, "/Right", "OK"), cams[1])
    assert known(driver)["/Left", "Cam"] == STALE
    assert known(driver)["/Right", "Cam"] == OK
