"""What `when` and `unless` of fleet.yml suppress: no fault begins, and one that lasts ends."""

from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.event_texts import event_text
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.robots.conditions import RobotConditions
from ros_diagnostics_exporter.severity import SEVERITIES, shown_problems, state_of
from support.configs import load_text
from support.state_driver import ERROR, OK, SETTLED, STALE, WARN, StateDriver

LOW, FULL = Status(ERROR, "Battery", "Low"), Status(OK, "Battery", "Full")
UNLESS = (
    "components: [{match: Battery, unless: {component: Charger, key: State, equals: charging}}]"
)
WHEN = "components: [{match: Battery, when: {component: Charger, key: State, equals: idle}}]"
CRITICAL = ("component", "critical", "r", "Battery")


def charger(state: str, level: int = OK) -> Status:
    return Status(level, "Charger", "", "", (("State", state),))


CHARGING, IDLE = charger("charging"), charger("idle")


@pytest.fixture
def driver_of(tmp_path):
    def make(profile: str) -> StateDriver:
        return StateDriver(fleet=fleet_of(tmp_path, profile))

    return make


def fleet_of(folder: Path, profile: str) -> Fleet:
    return load_text(
        folder,
        "fleet: f\n"
        f"profiles: {{default: {{{profile}}}}}\n"
        "robots: [{name: r, topic: /r/diagnostics, source: raw}]\n",
    )


def changes(driver: StateDriver) -> list[str]:
    """The events of faults and conditions, in words."""
    kinds = {"condition", "fault_began", "fault_ended"}
    events = (each for each in driver.events if each.kind in kinds)
    return [event_text({**vars(each), "message": ""}) for each in events]


def standings(driver: StateDriver) -> list[str]:
    snapshot = fleet_snapshot(driver.state, driver.now)
    shown, _number = shown_problems(snapshot["robots"][0], driver.now.wall, 9)
    return [f"{each.state} {each.subject}: {each.standing}" for each in shown]


# -- unless --------------------------------------------------------------------------------------


def test_what_a_condition_suppresses_is_no_fault_and_shown_so(driver_of):
    driver = driver_of(UNLESS).stand(SETTLED, FULL, CHARGING)
    driver.stand(60, LOW, CHARGING)

    assert driver.fault_names() == set()
    suppressed = "suppressed: by its condition in fleet.yml, unless Charger State is charging"
    assert standings(driver) == [f"CRITICAL Battery: {suppressed}"]
    assert changes(driver) == ["suppressed by its condition: CRITICAL Battery"]
    snapshot = fleet_snapshot(driver.state, driver.now)["robots"][0]
    assert state_of(snapshot) == "OK"
    assert driver.sample("component_level", component="Battery") == ERROR
    assert driver.sample("component_state", component="Battery") is None


def test_it_is_a_fault_confirm_after_the_condition_ceases_to_hold(driver_of):
    driver = driver_of(UNLESS).stand(SETTLED, LOW, CHARGING)
    unplugged = driver.now.wall
    assert driver.stand(9, LOW, IDLE).fault_names() == set()
    assert driver.sample("component_state", component="Battery") == SEVERITIES["CRITICAL"]
    driver.stand(2, LOW, IDLE)

    (fault,) = driver.state.faults()
    assert (fault.since, fault.confirmed) == (unplugged, unplugged + 10)
    assert changes(driver) == [
        "suppressed by its condition: CRITICAL Battery",
        "no longer suppressed by its condition: CRITICAL Battery",
        "fault began: CRITICAL Battery",
    ]


@pytest.mark.parametrize("known", [(), (charger("charging", STALE),), (charger("on"),)])
def test_what_is_not_known_suppresses_nothing(driver_of, known):
    driver = driver_of(UNLESS).stand(SETTLED, FULL, *known)
    assert driver.stand(12, LOW, *known).fault_names() >= {CRITICAL}


# -- when ----------------------------------------------------------------------------------------


def test_while_it_is_not_known_no_fault_begins_and_none_ends_but_by_a_lower_level(driver_of):
    driver = driver_of(WHEN)
    assert driver.stand(SETTLED, LOW).fault_names() == set()
    assert standings(driver)[0].endswith("only when Charger State is idle, which is not known")

    driver.stand(12, LOW, IDLE)
    assert CRITICAL in driver.stand(60, LOW, charger("idle", STALE)).fault_names()
    assert CRITICAL not in driver.raw(FULL).fault_names()
    assert changes(driver).count("fault began: CRITICAL Battery") == 1


def test_a_robot_that_is_back_ends_nothing_before_its_condition_is_known(driver_of):
    """Raw topics come one by one: the battery's first message comes before the charger's."""
    driver = driver_of(WHEN).stand(SETTLED, LOW, IDLE)
    assert ("robot", "silent", "r") in driver.wait(60).fault_names()
    driver.raw(LOW)
    driver.wait(1)
    driver.raw(IDLE)
    driver.stand(20, LOW, IDLE)

    assert driver.fault_names() == {CRITICAL}
    assert [each for each in changes(driver) if "Battery" in each] == [
        "fault began: CRITICAL Battery"
    ]


OWN = "{key: State, equals: idle}"


@pytest.mark.parametrize(
    ("when", "is_suppressed"),
    [(OWN, False), (f"[{OWN}, {{component: Battery, level: ERROR}}]", True)],
)
def test_a_component_that_is_stale_is_not_suppressed_by_its_own_values(
    driver_of, when, is_suppressed
):
    driver = driver_of(f"components: [{{match: Charger, when: {when}}}]")
    driver.stand(SETTLED, FULL, charger("idle"))
    assert driver.stand(20, FULL, charger("charging", ERROR)).fault_names() == set()
    driver.stand(60, FULL, charger("", STALE))
    stale = {("component", "stale", "r", "Charger")}
    assert driver.fault_names() == (set() if is_suppressed else stale)


def test_stale_is_planned_while_the_condition_of_another_component_says_so(driver_of):
    driver = driver_of(UNLESS).stand(SETTLED, FULL, CHARGING)
    assert driver.stand(60, FULL._replace(level=STALE), CHARGING).fault_names() == set()
    driver.stand(12, FULL._replace(level=STALE), IDLE)
    assert driver.fault_names() == {("component", "stale", "r", "Battery")}


# -- the language --------------------------------------------------------------------------------

GRIPPER = Status(OK, "Gripper", "", "", (("Force:", "12 N"), ("Mode", " Auto ")))


@pytest.mark.parametrize(
    ("condition", "holds"),
    [
        ("{component: Gripper, level: OK}", True),
        ("{component: Battery, level: ERROR}", True),
        ("{component: Gripper, level: [WARN, ERROR]}", False),
        ("{component: grip, key: Force, above: 10}", True),
        ("{component: Gripper, key: Force, above: 12}", False),
        ("{component: Gripper, key: Fo*, above: 10, below: 13}", True),
        ("{component: Gripper, key: Force, below: 12}", False),
        ("{component: Gripper, key: Mode, equals: auto}", True),
        ("{component: Gripper, key: Mode, equals: [manual, a*]}", True),
        ('{component: Gripper, key: Mode, equals: {regex: "AUTO"}}', False),
        ("{component: Gripper, key: Mode, above: 3}", None),
        ("{component: Gripper, key: None, equals: auto}", None),
        ("{component: Arm, level: OK}", None),
        ("[{component: Gripper, level: OK}, {component: Gripper, key: Mode, equals: x}]", False),
        ("[{component: Gripper, level: OK}, {component: Arm, level: OK}]", None),
        ("[{component: Arm, level: OK}, {component: Gripper, level: WARN}]", False),
    ],
)
def test_what_conditions_compare(driver_of, condition, holds):
    """`when` of all of a list; what is not known is unlike what does not hold."""
    driver = driver_of(f"components: [{{match: Battery, when: {condition}}}]")
    assert (CRITICAL in driver.stand(SETTLED, LOW, GRIPPER).fault_names()) is (holds is True)
    if holds is not True:
        assert standings(driver)[0].endswith("not known") is (holds is None)


def test_one_of_several_components_is_enough(driver_of):
    driver = driver_of(UNLESS)
    driver.stand(SETTLED, LOW, Status(OK, "Charger 2", "", "", (("State", "x"),)), CHARGING)
    assert driver.fault_names() == set()


def test_values_have_conditions_of_their_own(driver_of):
    driver = driver_of(
        "values: [{component: Battery, key: Charge, thresholds: {low: {critical: 10}},"
        " unless: {key: Charging, equals: true}}, {key: Charge, unit: '%'}]"
    )

    def battery(charge: str, charging: str) -> Status:
        return Status(OK, "Battery", "", "", (("Charge", charge), ("Charging", charging)))

    driver.stand(SETTLED, battery("5", "False"))
    assert driver.fault_names() == {("value", "critical", "r", "Battery", "Charge", "low")}
    assert driver.stand(20, battery("5.1", "True")).fault_names() == set()
    because = "suppressed: by its condition in fleet.yml, unless Charging is True"
    assert standings(driver) == [f"CRITICAL Battery: Charge: {because}"]
    assert state_of(fleet_snapshot(driver.state, driver.now)["robots"][0]) == "OK"
    driver.stand(12, battery("5", "False"))
    assert driver.fault_names() == {("value", "critical", "r", "Battery", "Charge", "low")}
    assert [each for each in changes(driver) if each.startswith("fault")] == [
        "fault began: CRITICAL Battery: Charge",
        "fault recovered: CRITICAL Battery: Charge",
        "fault began: CRITICAL Battery: Charge",
    ]


def test_conditions_of_values_of_any_component_hold_for_it(driver_of):
    driver = driver_of(
        "values: [{key: Charge, thresholds: {low: {critical: 10}},"
        " unless: {component: Charger, key: State, equals: charging}}]"
    )
    low = Status(OK, "Battery", "", "", (("Charge", "5"),))
    assert driver.stand(SETTLED, low, CHARGING).fault_names() == set()
    driver.stand(12, low, IDLE)
    assert driver.fault_names() == {("value", "critical", "r", "Battery", "Charge", "low")}


# -- config, restart, larger causes -------------------------------------------------------------


def test_a_reload_applies_conditions_at_once(driver_of, tmp_path):
    driver = driver_of("stale_after: 10s")
    assert driver.stand(SETTLED, LOW, CHARGING).fault_names() == {CRITICAL}
    driver.configure(fleet_of(tmp_path, UNLESS))
    assert driver.fault_names() == set()
    assert driver.sample("component_state", component="Battery") is None
    driver.configure(fleet_of(tmp_path, "stale_after: 10s"))
    assert driver.sample("component_state", component="Battery") == SEVERITIES["CRITICAL"]
    assert standings(driver) == ["CRITICAL Battery: not confirmed yet, 10 s left"]
    assert driver.stand(12, LOW, CHARGING).fault_names() == {CRITICAL}


def test_a_fault_outlives_a_restart_and_ends_with_its_condition(driver_of, tmp_path):
    driver = driver_of(WHEN).stand(SETTLED, LOW, IDLE)
    driver.keep(tmp_path / "database")
    again = driver.restart(tmp_path / "database", after=5)
    assert again.raw(LOW).fault_names() == {CRITICAL}
    assert again.raw(CHARGING).fault_names() == set()
    again.close()


def test_a_warning_that_is_suppressed_says_so_again_when_it_gets_worse(driver_of):
    driver = driver_of(UNLESS).stand(SETTLED, LOW._replace(level=WARN), CHARGING)
    driver.stand(5, LOW, CHARGING)
    assert changes(driver) == [
        "suppressed by its condition: WARNING Battery",
        "suppressed by its condition: CRITICAL Battery",
    ]
    driver.state.forget("r", "Battery", driver.now)
    assert standings(driver) == []


# -- any history ---------------------------------------------------------------------------------

NOTHING = Status(-1, "")  # not in the array
STEPS = st.lists(
    st.tuples(
        st.sampled_from((FULL, LOW, LOW._replace(level=WARN), LOW._replace(level=STALE), NOTHING)),
        st.sampled_from((CHARGING, IDLE, charger("charging", STALE), charger("on"), NOTHING)),
        st.integers(1, 25),
    ),
    min_size=1,
    max_size=12,
)


@settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@given(profile=st.sampled_from((UNLESS, WHEN)), steps=STEPS)
def test_each_fault_ends_once_and_what_is_kept_is_as_if_evaluated_anew(driver_of, profile, steps):
    driver = driver_of(profile).stand(SETTLED, FULL, IDLE)
    lasting: set[tuple[object, ...]] = set()
    seen = 0
    for battery, charger_, seconds in steps:
        driver.stand(seconds, *(each for each in (battery, charger_) if each is not NOTHING))
        anew = RobotConditions(driver.robot)
        anew.update((), everything=True)
        component = driver.component("Battery")
        suppressed = anew.find(component, component.rule.conditions)
        because = (
            suppressed.because
            if suppressed is not None and suppressed.known and driver.robot.up
            else ""
        )
        assert component.suppressed_because == because
        for event in driver.events[seen:]:
            about = event.scope, event.state, event.component, event.since
            if event.kind == "fault_began":
                assert about not in lasting
                lasting.add(about)
            elif event.kind == "fault_ended":
                lasting.remove(about)
        seen = len(driver.events)
        suppressed = bool(because) and component.level in (WARN, ERROR)
        flapping = ("flapping", "flapping", "r", "Battery") in driver.fault_names()
        if suppressed and not flapping:
            assert not {("component", "warning", "r", "Battery"), CRITICAL} & driver.fault_names()
    assert len(lasting) == len(driver.state.faults())
