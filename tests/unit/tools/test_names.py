"""Which component a person means by a name that is short, was copied, or is only a part of it."""

import pytest

from ros_diagnostics_tools.names import meant

NAMES = ("lidar: Front  left", "lidar: Rear", "arm: Motor", "base: Motor", "Battery")


@pytest.mark.parametrize(
    ("word", "name"),
    [
        ("Battery", "Battery"),
        ("lidar: Front left", "lidar: Front  left"),
        ("front LEFT", "lidar: Front  left"),
        ("Rear", "lidar: Rear"),
        ("batt", "Battery"),
        ("Motor", "Motor"),  # of two
        ("arm: motor", "arm: Motor"),
        ("laser", "laser"),
    ],
)
def test_the_only_name_that_fits_is_meant(word, name):
    assert meant(word, NAMES) == name


def test_where_it_matters_a_part_is_not_enough():
    assert meant("batt", NAMES, by_part=False) == "batt"
    assert meant("rear", NAMES, by_part=False) == "lidar: Rear"
