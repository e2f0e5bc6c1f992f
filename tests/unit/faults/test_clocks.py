"""Clocks that are wrong: a robot's, or the exporter's."""

import pytest

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.model import Fault
from support.fault_histories import Event, back, forget, maintenance, play, player, restart, silent

R1 = "robot/clock r1"
OWN = "exporter/warning clock"
FOUR = ("r1", "r2", "r3", "r4")


def clocks(*offsets: float) -> Event:
    """The offsets of r1, r2 and so on."""
    found = {f"r{number}": offset for number, offset in enumerate(offsets, 1)}
    return lambda faults, now: faults.clocks(found, now)


@pytest.mark.parametrize("offset", [5.1, -5.1])
def test_a_clock_that_is_wrong_for_a_minute_is_a_fault_until_it_is_right(offset):
    play(
        (0, clocks(offset)),
        (59, None),
        (60, None, f"began {R1}"),
        (70, clocks(4.5 if offset > 0 else -4.5)),
        (80, clocks(4.0), f"recovered {R1}"),
    )


def test_five_seconds_are_right():
    play((0, clocks(5.0, -5.0)), (1000, None), robots=FOUR)


def test_a_clock_that_differs_from_at_least_half_of_three_robots_is_the_exporters():
    play(
        (0, clocks(60.0, 60.1, 61.0, -30.0)),
        (60, None, f"began {OWN}"),
        # Then only that of r4 is wrong, as it was all the time.
        (100, clocks(0.1, 0.1, 1.0, -90.0), f"recovered {OWN}"),
        (160, None, "began robot/clock r4"),
        robots=FOUR,
    )


def test_of_two_robots_each_has_a_clock():
    play((0, clocks(60.0, 60.0)), (60, None, f"began {R1}", "began robot/clock r2"), robots=FOUR)


def test_a_robots_fault_is_not_over_while_the_exporters_clock_is_wrong():
    play(
        (0, clocks(60.0, 0.0, 0.0)),
        (60, None, f"began {R1}"),
        (100, clocks(0.0, -60.0, -60.0)),
        (160, None, f"began {OWN}"),
        (200, clocks(0.0, 0.0, 0.0), f"recovered {OWN}", f"recovered {R1}"),
        robots=FOUR,
    )


def test_of_too_few_robots_nothing_is_known_of_the_exporters_clock():
    play(
        (0, clocks(60.0, 60.0, 60.0)),
        (60, None, f"began {OWN}"),
        (70, clocks()),
        (200, clocks(0.0, 0.0, 0.0), f"recovered {OWN}"),
        robots=FOUR,
    )


def test_too_few_robots_have_no_faults_beside_that_of_the_exporters_clock():
    play(
        (0, clocks(60.0, 60.0, 60.0)),
        (60, None, f"began {OWN}"),
        (70, clocks(60.0, 60.0)),
        (200, clocks(0.0, 0.0, 0.0), f"recovered {OWN}"),
        robots=FOUR,
    )


def test_silence_and_maintenance_are_suppressed():
    play(
        (0, clocks(60.0)),
        (10, silent()),
        (20, None, "began robot/silent r1"),
        (100, None),
        (110, back(), "recovered robot/silent r1"),
        (111, clocks(60.0), f"began {R1}"),
        (120, maintenance("r1", planned=True)),
        (130, clocks(0.0)),
        (140, maintenance("r1", planned=False), f"recovered {R1}"),
    )


def test_after_a_silence_a_clock_is_wrong_only_if_it_is_seen_to_be():
    play((0, clocks(60.0)), (10, silent()), (15, back()), (100, None))


def test_a_robot_that_is_removed_takes_its_fault_with_it():
    play((0, clocks(60.0)), (60, None, f"began {R1}"), (70, forget(), f"removed {R1}"))


def test_the_exporters_is_adopted_and_judged_on():
    known = player(FOUR, FaultSettings())
    known.go(0, clocks(60.0, 60.0, 60.0))
    [began] = known.go(60)
    lost = player(FOUR, FaultSettings())
    [adopted] = lost.go(90, restart(), lambda faults, now: faults.adopt(began.fault, now))
    assert adopted.fault == began.fault
    assert isinstance(adopted.fault, Fault)
    assert lost.go(100, clocks(60.0, 60.0, 60.0)) == []
    [ended] = lost.go(110, clocks(0.0, 0.0, 0.0))
    assert (ended.what, ended.fault) == ("recovered", began.fault)
