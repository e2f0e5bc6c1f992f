"""Numbers are found wherever drivers hide them, and nothing else is taken for a number.

The strings are those of real drivers (kobuki, turtlebot4, clearpath, realsense, ros2_control, nav2,
sick, mavros, rplidar, diagnostic_common_diagnostics, Autoware, husarion, velodyne).
"""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.robots.units import unit_in_name
from ros_diagnostics_exporter.robots.values import MAX_ELEMENTS, is_plain, parse_numbers

NUMBERS = [
    # key, text -> unit, number
    ("Voltage (V)", "15.6", "V", 15.6),
    ("Percent", "87.5", "%", 87.5),
    ("Wheel Status", "True", "", 1.0),
    ("Motor drivers energized", "false", "", 0.0),
    ("Emergency", "NO", "", 0.0),
    ("Rx speed", "inf", "", math.inf),
    ("Rx speed", "-inf", "", -math.inf),
    ("Delay", "nan", "", math.nan),
    ("Delay", "-nan", "", math.nan),  # as C++ streams write it
    ("Remote [3]", "255.190", "", 255.19),
    ("Received packets:", "3093", "", 3093.0),
    ("Total (Go)", "468123", "GB", 468123.0),
    ("HDD 0: temperature", "37.0 DegC", "degC", 37.0),
    ("HDD 0: size", "264G", "G", 264.0),
    ("use", "69%", "%", 69.0),
    ("%CPU", "37.5", "%", 37.5),
    ("CPU temperature (°C)", "55", "degC", 55.0),
    ("Temperature", "75.123 °C", "degC", 75.123),
    ("rtc.transport.current_round_trip_time_ms", "12", "ms", 12.0),
    ("Supply", "12300 mV", "mV", 12300.0),
    ("Speed [m/s]", "-0.5", "m/s", -0.5),
    ("Input Voltage V", "24", "V", 24.0),
    ("Status word", "0x0024002F", "", 2359343.0),
    ("Sci", "1e-3", "", 0.001),
    ("Sign", "+5", "", 5.0),
    ("Blanks", " 1.5\n", "", 1.5),
    ("Dot", ".5", "", 0.5),
    ("Zero", "0", "", 0.0),
    ("Charge (%)", "9,5", "%", 9.5),  # a comma where others have a point
    ("Charge", "85,0 %", "%", 85.0),
    ("Charge", "9.5 [%]", "%", 9.5),
    ("Core", "92.0 [degC]", "degC", 92.0),
    ("Core", "92.0 (°C)", "degC", 92.0),
    ("Offset", "-0,125 m", "m", -0.125),
    ("Ratio", "3,1416 V", "V", 3.1416),
]

REFUSED = [
    ("Source", "None"),
    ("Hazard Detection", "['BUMP', 'CLIFF']"),
    ("jtc.execution_time", "Avg: 12.34 [3.10 - 88.00] us, StdDev: 4.21"),
    ("Offset (us)", "N/A"),
    ("TIME+", "23:57.49"),
    ("Distance", "12,000"),  # twelve or twelve thousand?
    ("Count", "1_000"),  # Python's float() would take it
    ("Count", "\u0663"),  # and this Arabic three
    ("Count", "1 000"),
    ("Date", "2024-01-01"),
    ("Peer", "192.168.1.1"),
    ("Release", "v2.5.0"),
    ("Stamp", "1783459823475982374"),  # nineteen digits: a time stamp, beyond a double
    ("Code", "007"),
    ("Code", "00.5"),
    ("Huge", "1e999"),
    ("Serial Number", "841512070537"),
    ("S/N", "12345"),
    ("Firmware version", "1.10"),
    ("IP", "12"),
    ("Summary", "5 errors"),
    ("Ratio", "3/5"),
    ("Register", "0xFFFFFFFFFFFFFFFF"),
    ("Partly", "[1, two, 3]"),
    ("Empty list", "[]"),
    ("Long", str([1] * (MAX_ELEMENTS + 1))),
    ("Empty", ""),
    ("Minus", "-"),
    ("Distance (m)", "1,234"),
    ("Distance (m)", "1,234,567"),
    ("Distance (m)", "1,5,3"),
    ("Distance (m)", "1.234,5"),
    ("Distance (m)", "00,5"),
    ("Firmware version", "2,0"),
    ("Release", "2.5.0"),
    ("Date", "26.11.2026"),
    ("Cores", "3,4"),  # perhaps two of them
    ("Summary", "5 [errors]"),
    ("Register", "5 [4]"),
]


@pytest.mark.parametrize(("key", "text", "unit", "number"), NUMBERS)
def test_a_number_is_found_with_its_unit(key, text, unit, number):
    (reading,) = parse_numbers(key, text)

    assert (reading.key, reading.unit) == (key.rstrip(":"), unit)
    assert reading.value == pytest.approx(number, nan_ok=True)


@pytest.mark.parametrize(("key", "text"), REFUSED)
def test_what_is_no_measurement_is_refused(key, text):
    assert parse_numbers(key, text) == ()


def test_with_thresholds_a_comma_needs_no_unit():
    assert [each.value for each in parse_numbers("Charge", "9,5", is_judged=True)] == [9.5]
    assert parse_numbers("Charge", "1,234", is_judged=True) == ()


def test_a_list_gives_one_number_for_each_element():
    found = parse_numbers("Analog Input", "[4095, 0, 12.5, 7]")

    assert [(each.key, each.value) for each in found] == [
        ("Analog Input[0]", 4095.0),
        ("Analog Input[1]", 0.0),
        ("Analog Input[2]", 12.5),
        ("Analog Input[3]", 7.0),
    ]


def test_the_elements_of_a_list_take_the_keys_unit():
    assert {each.unit for each in parse_numbers("Cells (V)", "(3.7, 3.8)")} == {"V"}


@pytest.mark.parametrize(
    "name", ["Motor A", "Front bar", "Remote [3]", "Time of day", "Gain (front)"]
)
def test_a_name_that_only_looks_like_a_unit_is_none(name):
    assert unit_in_name(name) == ""


@given(st.from_regex(r"[+-]?[0-9]{0,17}(\.[0-9]{0,19})?(e[0-9])?\s?", fullmatch=True))
def test_a_plain_number_is_read_as_any_other(text):
    if is_plain(text):
        assert [float(text)] == [each.value for each in parse_numbers("Voltage", text)]


@pytest.mark.parametrize("text", ["0", "-7", "12.125", "0.000001", "999999999999999"])
def test_what_most_drivers_write_is_plain(text):
    assert is_plain(text)
