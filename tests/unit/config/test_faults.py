"""The section `faults` of fleet.yml: how faults are judged, and what --config.check says of it."""

from ros_diagnostics_exporter.config.check import describe
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Falling,
    FaultSettings,
    Flapping,
    Intermittent,
    WarningHours,
)

MINIMAL = "fleet: x\nrobots: [{name: r1}]\n"


def test_without_the_section_the_defaults_apply(fleet_of):
    fleet = fleet_of(MINIMAL)
    assert fleet.faults == FaultSettings()
    assert "faults" not in describe(fleet)


def test_every_key_of_the_section_is_applied(fleet_of):
    fleet = fleet_of("""
        fleet: x
        robots: [{name: r1}]
        faults:
          {restart_grace: 1m, pending_after: 1h, confirm_after: 20s, value_hysteresis: 0.05,
           flapping: {start: 0.5, stop: 0.3}, intermittent: {changes: 6, within: 20m},
           falling: {ahead: 1h, over: 5m}, many: {components: 3, share: 0.4, absolute: 9},
           site: {robots: 24, share: 0.6}, common: {robots: 6, share: 0.2, absolute: 30},
           warning_hours: {weekly: [Mon-Fri 06:00-18:00], time_zone: Europe/Berlin}}
    """)
    assert fleet.faults == FaultSettings(
        confirm_after=20.0,
        restart_grace=60.0,
        pending_after=3600.0,
        flapping=Flapping(0.5, 0.3),
        intermittent=Intermittent(6, 1200.0),
        falling=Falling(over=300.0, ahead=3600.0),
        value_hysteresis=0.05,
        many=CauseSettings(3, 0.4, absolute=9),
        site=CauseSettings(24, 0.6, absolute=24),
        common=CauseSettings(6, 0.2, absolute=30),
        warning_hours=WarningHours(tuple((day, 360, 1080) for day in range(5)), "Europe/Berlin"),
    )
    described = describe(fleet).partition("faults (10):\n")[2].splitlines()
    assert described == [
        "  after a start, missing data is no fault for 1m",
        "  robots that are never received: after 1h",
        "  flapping from 0.5 until below 0.3",
        "  intermittent from 6 changes in 20m",
        "  values too low within 1h, by the last 5m",
        "  values have to come back by 5 % of their threshold",
        "  many components of a robot: 3 and 0.4 of all, or 9",
        "  silent robots of a site: 24 and 0.6 of all, or 24, confirmed after 20s",
        "  robots with the same component CRITICAL: 6 and 0.2 of all, or 30, confirmed after 20s",
        "  warnings begin Mon,Tue,Wed,Thu,Fri 06:00-18:00 Europe/Berlin",
    ]


def test_a_part_of_an_entry_leaves_the_rest_at_its_default(fleet_of):
    found = fleet_of(MINIMAL + "faults: {many: {share: 0.1}, flapping: {stop: 0.1}}").faults
    assert found.many == CauseSettings(8, 0.1, absolute=20)
    assert found.flapping == Flapping(0.4, 0.1)


def test_the_longest_confirm_after_is_that_of_any_profile_in_use(fleet_of):
    text = """
        fleet: x
        robots: [{name: r1, profile: slow}]
        profiles:
          slow: {confirm_after: 1m, components: [{match: Laser, confirm_after: %s}]}
          unused: {confirm_after: 1h}
    """
    assert fleet_of(text % "5m").longest_confirm_after == 300
    assert fleet_of(text % "1s").longest_confirm_after == 60
    everything = "faults: {confirm_after: 2m}"
    assert fleet_of(MINIMAL + everything).longest_confirm_after == 120
    measured = "queries: [{expr: up, component: up, confirm_after: 3m}]"
    assert fleet_of(MINIMAL + measured).longest_confirm_after == 180
