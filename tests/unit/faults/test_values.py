"""Faults of values: thresholds and hysteresis."""

import math

import pytest

from ros_diagnostics_exporter.config.fleet import Threshold
from support.fault_histories import ERROR, STALE, level, play, value

HOT = (Threshold("high", "warning", 80.0),)
LOW = "value/warning r1 battery charge low"
EMPTY = "value/critical r1 battery charge low"


def test_a_battery_below_its_thresholds_warns_first_and_ends_with_the_hysteresis():
    play(
        (60, value(18.0)),
        (70, None, f"began {LOW}"),
        (90, value(9.0)),
        (100, None, f"began {EMPTY}"),
        (150, value(None)),
        (180, value(9.5)),
        (210, value(10.1)),  # 10.2 is 2 % above the threshold
        (220, value(10.2), f"recovered {EMPTY}"),
        (240, value(80.0), f"recovered {LOW}"),
    )


def test_a_value_within_the_hysteresis_goes_on_to_be_confirmed_and_does_not_begin_anew():
    play(
        (0, value(19.9)),
        (5, value(20.2)),
        (10, None, f"began {LOW}"),
        (20, value(21.0), f"recovered {LOW}"),
        (30, value(20.2)),
        (50, None),
    )


def test_a_value_above_its_threshold():
    hot = "value/warning r1 battery degrees high"
    play(
        (0, value(81.0, HOT, key="degrees")),
        (10, None, f"began {hot}"),
        (20, value(78.5, HOT, key="degrees")),
        (30, value(78.4, HOT, key="degrees"), f"recovered {hot}"),
    )


def test_a_value_has_the_confirm_after_of_its_component():
    play((0, value(19.0, confirm_after=30)), (29, None), (30, None, f"began {LOW}"))


@pytest.mark.parametrize("unknown", [None, math.nan])
def test_a_value_that_is_not_known_neither_begins_nor_ends(unknown):
    play(
        (0, value(19.0)),
        (5, value(unknown)),
        (20, value(19.0), f"began {LOW}"),
        (30, value(unknown)),
        (40, value(19.0)),
        (50, value(math.inf), f"recovered {LOW}"),
    )


def test_a_stale_component_has_no_values():
    play(
        (0, value(19.0)),
        (5, level("battery", STALE)),
        (15, None, "began component/stale r1 battery"),
        (20, level("battery", ERROR), "began component/critical r1 battery"),
        (21, value(19.0), f"began {LOW}"),
    )
