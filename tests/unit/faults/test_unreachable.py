"""Robots behind something that fails: what rests on that is suppressed, not counted."""

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from ros_diagnostics_exporter.faults.book import UPLINK_TIME
from support.fault_histories import (
    ERROR,
    STALE,
    Event,
    check,
    level,
    levels,
    on_robots,
    player,
    robot_settings,
    silent,
    texts,
    together,
    unreachable,
)

ROBOTS = ("r1", "r2", "r3", "r4")
COMMON = FaultSettings(common=CauseSettings(3, 0.5))
SILENT = "began robot/silent r1"
PING = "began component/critical r1 ping"


def play(*steps, robots=("r1",), settings=None):
    """As `fault_histories.play`; what is unreachable is reported anew after a start."""
    for each_second in (False, True):
        known = player(robots, settings or FaultSettings(), each_second=each_second)
        for second, event, *expected in steps:
            changes = known.go(second, *([] if event is None else [event]))
            assert texts(changes) == expected, f"at {second} s"


def on_all(component: str, to: int) -> Event:
    """What is measured of a component on all robots."""
    return together(*(level(component, to, robot, measured=True) for robot in ROBOTS))


def test_an_uplink_that_fails_again_at_once_goes_on_to_explain():
    play(
        (0, unreachable("r1", is_so=True)),
        (5, silent()),
        (30, unreachable("r1", is_so=False)),
        (40, unreachable("r1", is_so=True)),  # before the robot had its half minute to return
        (300, None),
        (301, unreachable("r1", is_so=False)),
        (370, None),
        (371, None, SILENT),
    )


def test_what_was_not_reached_is_confirmed_from_when_it_may_be():
    play(
        (0, unreachable("r1", is_so=True)),
        (5, level("ping", ERROR, measured=True)),
        (20, unreachable("r1", is_so=False)),
        (49, None),
        (50, None, PING),
    )


def test_hosts_behind_it_are_no_common_cause():
    play(
        (0, unreachable(*ROBOTS, is_so=True)),
        (5, on_all("ping", ERROR)),
        (300, None),
        robots=ROBOTS,
        settings=COMMON,
    )


def test_a_common_cause_does_not_end_because_its_hosts_are_not_reached_any_more():
    play(
        (0, on_all("disk", ERROR)),
        (10, None, "began common/critical disk"),
        (20, unreachable(*ROBOTS, is_so=True)),
        (30, on_all("disk", STALE)),
        (300, None),
        robots=ROBOTS,
        settings=COMMON,
    )


def test_many_components_of_a_robot_behind_it_are_not_one_fault():
    measured = levels([f"check {number}" for number in range(12)], ERROR, measured=True)
    play((0, unreachable("r1", is_so=True)), (5, measured), (300, None))


def test_only_what_an_uplink_may_explain_waits_for_it():
    play(
        (0, together(robot_settings("r1", uplink="ap"), check(1, 2))),
        (10, None, "began check/critical r1 motors"),
        (20, silent()),
        (30, None),
        (20 + 10 + UPLINK_TIME, None, SILENT),
        robots=("ap", "r1"),
    )


def test_the_silence_of_a_site_behind_an_uplink_waits_for_it_and_goes_on_when_that_fails():
    behind = together(*(robot_settings(each, uplink="ap", site="hall") for each in ROBOTS))
    settings = FaultSettings(site=CauseSettings(3, 0.5))
    silence = "began site/silent hall"
    play(
        (0, behind),
        (20, on_robots(ROBOTS, silent)),
        (30, None),
        (20 + 10 + UPLINK_TIME, None, silence),
        (100, unreachable(*ROBOTS, is_so=True)),
        (300, None),
        robots=("ap", *ROBOTS),
        settings=settings,
    )
    play(
        (0, behind),
        (20, on_robots(ROBOTS, silent)),
        (25, unreachable(*ROBOTS, is_so=True)),
        (300, None),
        robots=("ap", *ROBOTS),
        settings=settings,
    )


def test_an_uplink_that_fails_after_its_robots_fell_silent_is_one_fault_and_their_site_none():
    play(
        (0, together(*(robot_settings(each, uplink="ap", site="hall") for each in ROBOTS))),
        (20, on_robots(ROBOTS, silent)),
        (25, level("ping", ERROR, "ap", measured=True, uplink=True)),
        (35, None, "began component/critical ap ping"),
        (300, None),
        robots=("ap", *ROBOTS),
        settings=FaultSettings(site=CauseSettings(3, 0.5)),
    )
