"""The units that drivers write, and the one spelling that each gets in a label.

A unit that is not in the table is not a unit: a word behind a number may be anything. Units are
not converted here; a value keeps the unit of its driver (promotion to base units is the config's).
"""

from __future__ import annotations

import re
from functools import lru_cache

# Of each unit the spelling used in the label, and what else is accepted for it.
_SPELLINGS = """
%, percent, Percent, pct, per cent;
degC, °C, ºC, ℃, C, celsius, Celsius, DegC, deg C, Deg C, degrees C;
degF, °F, fahrenheit, Fahrenheit, DegF; K, kelvin, Kelvin; V, v, volt, volts, Volt, Volts;
mV, millivolt, millivolts; kV; A, amp, amps, Amp, Amps, ampere, amperes, Ampere;
mA, milliamp, milliamps; W, watt, watts, Watt, Watts; mW; kW; Wh, wh; mWh; kWh; Ah, ah; mAh, mah;
ohm, Ohm, Ω, Ω; s, sec, secs, second, seconds, Sec, Seconds;
ms, msec, msecs, millisecond, milliseconds; us, µs, μs, usec, microsecond, microseconds;
ns, nsec, nanosecond, nanoseconds; min, mins, minute, minutes; h, hr, hrs, hour, hours;
d, day, days; Hz, hz, HZ, hertz, Hertz; kHz, khz; MHz, Mhz, mhz; GHz, Ghz, ghz;
rpm, RPM, r/min, rev/min; m, meter, meters, metre, metres; cm, centimeters;
mm, millimeter, millimeters; km, kilometers; m/s, mps; mm/s; km/h, kmh, kph; m/s^2, m/s², m/s2;
rad, radian, radians; rad/s, radps; deg, °, degree, degrees, Deg, Degrees; deg/s, °/s, dps; N;
Nm, N·m, N*m, N.m; kg; g; Pa; hPa; kPa; bar, Bar; mbar; psi, PSI; B, byte, bytes, Byte, Bytes;
kB, KB, kb, Ko, ko; MB, Mo; GB, Go; TB, To; KiB, kiB, Ki; MiB, Mi; GiB, Gi; TiB, Ti; G; M;
bit/s, bps, b/s, bits/s; kbit/s, kbps, Kbps, kb/s; Mbit/s, Mbps, mbps, Mb/s; Gbit/s, Gbps;
B/s, bytes/s, Bytes/s; kB/s, KB/s; MB/s; dB; dBm, dbm; fps, FPS, frames/s;
1/s, msg/s, msgs/s, messages/s; px, pixel, pixels; lx, lux; ppm; T; uT, µT, μT; mT;
l, L, liter, liters, litre, litres
"""
_CANONICAL = {
    spelling.strip(): unit.split(",")[0].strip()
    for unit in _SPELLINGS.split(";")
    for spelling in unit.split(",")
}
_LONGEST_IN_BRACKETS = 16  # characters of a unit in brackets
_LAST_WORD = re.compile(r"(.*)[ _.]([A-Za-z°µμ%][A-Za-z°µμ%/^0-9]{0,11})")
# One letter behind a key is rather a name ("Motor A"), unless the key says the quantity.
_QUANTITY_OF_LETTER = {
    "V": re.compile("volt", re.IGNORECASE),
    "A": re.compile("current", re.IGNORECASE),
    "W": re.compile("power", re.IGNORECASE),
    "C": re.compile("temp", re.IGNORECASE),
}
# Everyday words that end a key without being its unit ("Time of day", "Front bar").
_NO_UNIT_BEHIND_A_KEY = frozenset(
    {"bar", "Bar", "byte", "Byte", "day", "degree", "Go", "go", "hour", "Ko", "min", "minute", "Mo"}
    | {"Mi", "Ti", "To", "pixel", "second"}
)


@lru_cache(maxsize=4096)
def canonical_unit(text: str) -> str | None:
    """The label's spelling of a unit as a driver wrote it; None if it is no known unit."""
    return _CANONICAL.get(text.strip()) or _CANONICAL.get(_in_brackets(text.strip()))


def unit_in_name(name: str) -> str:
    """The unit in a key: in brackets at its end, or as its last word; "" where there is none.

    >>> unit_in_name("Voltage (V)"), unit_in_name("round_trip_time_ms"), unit_in_name("Motor A")
    ('V', 'ms', '')
    """
    bracketed = _in_brackets(name)
    if bracketed:
        return canonical_unit(bracketed) or ""
    if name.startswith("%") or name.lower() == "percent":
        return "%"
    words = _LAST_WORD.fullmatch(name)
    return "" if words is None else _unit_behind(words[1], words[2])


def _in_brackets(name: str) -> str:
    """What the brackets at the end of a key hold, "" where that is no unit.

    No regular expression: one that skips blanks on both sides of the unit needs the square of them.
    """
    if not name.endswith((")", "]", ">")):
        return ""
    opening = max(name.rfind(bracket, 0, -1) for bracket in "([<")
    inside = name[opening + 1 : -1]
    if opening < 0 or any(bracket in inside for bracket in ")]>"):
        return ""
    inside = inside.strip()
    return inside if len(inside) <= _LONGEST_IN_BRACKETS else ""


def _unit_behind(name: str, word: str) -> str:
    if word in _NO_UNIT_BEHIND_A_KEY:
        return ""
    if len(word) == 1 and word != "%":
        quantity = _QUANTITY_OF_LETTER.get(word.upper())
        if quantity is None or not quantity.search(name):
            return ""
        word = word.upper()
    return canonical_unit(word) or ""
