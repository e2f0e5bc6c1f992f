"""Until when a robot is in maintenance, if one planned downtime follows another."""

import re

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Maintenance
from ros_diagnostics_exporter.model import Downtime
from ros_diagnostics_exporter.robots.maintenance import maintenance_until

HALL = {"site": (re.compile("hall"),)}
WINDOWS = (
    Maintenance("first", HALL, "c", start=100.0, end=200.0),
    Maintenance("second", HALL, "c", start=200.0, end=300.0),
    Maintenance("for ever", {"robot": (re.compile("r2|r4"),)}, "c", start=1_000.0),
    Maintenance("first hour", {"robot": (re.compile("r3|r4"),)}, "c", weekly=((3, 0, 60),)),
)
PLANNED = [
    Downtime("r", "", 300.0, 400.0, "ann", "c"),
    Downtime("r", "arm", 400.0, 900.0, "ann", "c"),
]


@pytest.mark.parametrize(
    ("robot", "wall", "until"),
    [
        ("r", 99.0, 99.0),
        ("r", 100.0, 400.0),
        ("r", 350.0, 400.0),
        ("r", 400.0, 400.0),
        ("r2", 1_000.0, None),
        ("r3", 1_800.0, 3_600.0),  # on a Thursday
        ("r4", 1_800.0, None),
        ("r3", 604_800 * 50 + 1_800.0, 604_800 * 50 + 3_600.0),
    ],
)
def test_downtimes_without_a_gap_are_one_and_those_of_a_component_none(robot, wall, until):
    fleet = Fleet("f", maintenance=WINDOWS)
    labels = {"robot": robot, "fleet": "f", "site": "hall"}

    assert maintenance_until(fleet, labels, wall, PLANNED) == until
