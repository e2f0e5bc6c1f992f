"""Profiles that extend one another, with checks, components and values."""

import pytest

from ros_diagnostics_exporter.config.fleet import Threshold
from ros_diagnostics_exporter.robots.rules import check_matches, component_rule, value_rule

FAMILY = """
    fleet: demo
    stale_is_critical: true
    profiles:
      default:
        stale_after: 5s
        checks: {motors: Motor}
        components: [{match: Motor, confirm_after: 1m}]
      wheeled:
        confirm_after: 0
        stale_is_critical: false
        checks:
          batteries: {match: [battery, ACCU], expect: 2}
          arms: {match: {regex: "^/Arm/.*joint"}}
        components:
          - {match: [Laser, {regex: "^cam: "}], stale_after: 90s}
          - {match: Motor 2, ignore: true}
      turtlebot4:
        extends: wheeled
        forget_after: 1h
        checks: {motors: null, batteries: {expect: 0}}
"""


def test_missing_keys_come_from_the_profile_that_is_extended(fleet_of):
    profile = fleet_of(FAMILY).profiles["turtlebot4"]
    assert profile.name == "turtlebot4"
    assert (profile.stale_after, profile.confirm_after, profile.forget_after) == (5.0, 0.0, 3600.0)
    assert not profile.stale_is_critical


def test_fleet_wide_stale_is_critical_applies_to_profiles_that_do_not_set_it(fleet_of):
    fleet = fleet_of(FAMILY)
    assert fleet.profiles["default"].stale_is_critical
    assert fleet_of("fleet: demo\nstale_is_critical: true").profiles["default"].stale_is_critical


def test_checks_are_added_replaced_and_removed_and_all_stays_first(fleet_of):
    profiles = fleet_of(FAMILY).profiles
    assert [check.name for check in profiles["wheeled"].checks] == [
        *("all", "motors", "batteries", "arms")
    ]
    turtlebot = {check.name: check for check in profiles["turtlebot4"].checks}
    assert [*turtlebot] == ["all", "batteries", "arms"]
    assert turtlebot["batteries"].expect == 0


def test_check_all_may_expect_a_number(fleet_of):
    profiles = fleet_of("""
        fleet: demo
        profiles: {default: {checks: {all: {expect: 16}}}}
    """).profiles
    assert [(check.name, check.patterns, check.expect) for check in profiles["default"].checks] == [
        ("all", (), 16)
    ]


@pytest.mark.parametrize(
    ("check", "group", "component", "matches"),
    [
        ("all", "/Anything", "at all", True),
        ("motors", "/Motor", "left wheel", True),
        ("motors", "/Drive", "drive: front MOTOR", True),
        ("motors", "/Drive", "drive: front wheel", False),
        ("batteries", "", "Robot Battery", True),
        ("batteries", "/Power", "accu 1", True),
        ("arms", "/Arm/left", "joint 1", True),
        ("arms", "/Arm/left", "Joint 1", False),
    ],
)
def test_check_contains_components_whose_group_or_name_has_a_word(
    fleet_of, check, group, component, matches
):
    checks = {each.name: each for each in fleet_of(FAMILY).profiles["wheeled"].checks}
    assert check_matches(checks[check], group, component) is matches


@pytest.mark.parametrize(
    ("name", "stale_after", "confirm_after", "ignore"),
    [
        ("sick: LASER front", 90.0, None, False),
        ("cam: stream", 90.0, None, False),
        ("Motor 2", None, None, True),
        ("Motor 1", None, 60.0, False),
    ],
)
def test_first_component_rule_applies_and_own_rules_come_before_inherited_ones(
    fleet_of, name, stale_after, confirm_after, ignore
):
    rule = component_rule(fleet_of(FAMILY).profiles["turtlebot4"], name)
    assert (rule.stale_after, rule.confirm_after, rule.ignore) == (
        *(stale_after, confirm_after, ignore),
    )


def test_levels_are_mapped_by_the_rule(fleet_of):
    rule = (
        fleet_of("""
        fleet: demo
        profiles:
          default:
            components:
              - {match: Laser, levels: {ERROR: WARN, stale: ok, 255: OK}, planned_stale: true}
    """)
        .profiles["default"]
        .components[0]
    )
    assert (dict(rule.levels), rule.planned_stale) == ({2: 1, 3: 0, 255: 0}, True)


VALUES = """
    fleet: demo
    profiles:
      default:
        values:
          - key: ["Voltage (V)", "* voltage"]
            component: Battery
            unit: V
            metric: ros_battery_voltage_volts
            scale: 0.001
            thresholds: {low: {warning: 11.5, critical: 10.8}, high: {critical: 15}}
          - {key: Source, enum: {None: 0, Adapter: 1, " Dock ": 2}}
          - {key: {regex: "Core \\\\d+ .*"}, unit: °C, offset: -273.15}
          - {key: PID, keep: false}
          - {key: "Received packets", unit: packets}
          - {key: "Remote [3]", unit: x}
          - {component: Debug, keep: false}
"""


def test_value_rule_has_all_settings(fleet_of):
    rule = value_rule(fleet_of(VALUES).profiles["default"], "Robot battery", "Voltage (V)")
    assert (rule.unit, rule.scale, rule.offset, rule.metric) == (
        *("V", 0.001, 0.0, "ros_battery_voltage_volts"),
    )
    assert rule.thresholds == (
        Threshold("low", "warning", 11.5),
        Threshold("low", "critical", 10.8),
        Threshold("high", "critical", 15.0),
    )


@pytest.mark.parametrize(
    ("component", "key", "unit"),
    [
        ("Robot Battery", "Cell voltage", "V"),
        ("Motor", "Voltage (V)", None),
        ("CPU", "Core 0 Temperature", "°C"),
        ("CPU", "My Core 0 Temperature", None),
        ("mavros", "Received packets:", "packets"),
        ("mavros", "Remote [3]", "x"),
    ],
)
def test_value_rule_matches_the_component_and_the_whole_key(fleet_of, component, key, unit):
    rule = value_rule(fleet_of(VALUES).profiles["default"], component, key)
    assert (rule and rule.unit) == unit


def test_words_of_an_enum_are_numbers_whatever_their_case(fleet_of):
    rule = value_rule(fleet_of(VALUES).profiles["default"], "any", "Source")
    assert dict(rule.enum) == {"none": 0.0, "adapter": 1.0, "dock": 2.0}


def test_values_can_be_dropped_by_key_and_by_component(fleet_of):
    profile = fleet_of(VALUES).profiles["default"]
    assert not value_rule(profile, "any", "PID").keep
    assert not value_rule(profile, "Debug", "whatever").keep
    assert value_rule(profile, "any", "whatever") is None


def test_text_of_a_robot_is_cut_before_it_is_searched(fleet_of):
    profile = fleet_of("""
        fleet: demo
        profiles: {default: {components: [{match: {regex: ".*.*.*x"}, ignore: true}]}}
    """).profiles["default"]
    assert component_rule(profile, "a" * 255 + "x")
    assert component_rule(profile, "a" * 256 + "x") is None


def test_own_rules_for_values_come_before_inherited_ones(fleet_of):
    profiles = fleet_of("""
        fleet: demo
        profiles:
          default:
            values:
              - {key: Voltage, thresholds: {low: {critical: 10}}}
              - {key: Current, thresholds: {high: {critical: 3}}}
          large: {values: [{key: Voltage, thresholds: {low: {critical: 22}}}]}
    """).profiles
    found = {
        name: [value_rule(profiles[name], "Battery", key).thresholds[0].value for key in keys]
        for name, keys in {"default": ["Voltage"], "large": ["Voltage", "Current"]}.items()
    }
    assert found == {"default": [10.0], "large": [22.0, 3.0]}


@pytest.mark.parametrize(
    ("bound", "beyond", "held", "back"),
    [("low", 9.9, 10.4, 10.5), ("high", 10.1, 9.6, 9.5)],
)
def test_a_value_is_beyond_a_threshold_until_it_is_back_by_the_margin(bound, beyond, held, back):
    threshold = Threshold(bound, "critical", 10.0)
    found = [threshold.is_beyond(each) for each in (beyond, 10.0, held)]
    assert found == [True, False, False]
    assert threshold.is_beyond(held, 0.05)
    assert not threshold.is_beyond(back, 0.05)
