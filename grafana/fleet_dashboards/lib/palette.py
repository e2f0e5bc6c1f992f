"""The words and colours of states, Grafana's ids of units, and mappings of values to words.

People with any of the three kinds of colour blindness can distinguish the colours (a test simulates
them), and a word is always shown with the colour.
"""

from __future__ import annotations

from typing import NamedTuple

from grafana_foundation_sdk.models import dashboard


class State(NamedTuple):
    """A state of a robot or component; ``rank`` is its number in the recorded states."""

    rank: int
    word: str
    colour: str


PENDING = State(-1, "PENDING", "#D0D0D0")
OK = State(0, "OK", "#2BA884")
WARNING = State(1, "WARNING", "#FFD92F")
STALE = State(2, "STALE", "#A06CD5")
CRITICAL = State(3, "CRITICAL", "#C1121F")
UNKNOWN = State(4, "UNKNOWN", "#1D3F8F")
STATES = (PENDING, OK, WARNING, STALE, CRITICAL, UNKNOWN)  # in the order of their ranks
WORST_FIRST = (CRITICAL, UNKNOWN, STALE, WARNING, OK, PENDING)

# The other parts of the availability report.
MAINTENANCE_COLOUR = "#8C6D46"
UNREACHABLE_COLOUR = "#7FB2E5"
UNDETERMINED_COLOUR = "#6E6E6E"
NEUTRAL = "#5794F2"

# The label "unit" of a value -> Grafana's id of the unit.
UNITS = {
    "%": "percent",
    "degC": "celsius",
    "degF": "fahrenheit",
    "K": "kelvin",
    "V": "volt",
    "mV": "mvolt",
    "kV": "kvolt",
    "A": "amp",
    "mA": "mamp",
    "W": "watt",
    "mW": "mwatt",
    "kW": "kwatt",
    "Wh": "watth",
    "kWh": "kwatth",
    "Ah": "amph",
    "mAh": "mamph",
    "ohm": "ohm",
    "s": "s",
    "ms": "ms",
    "us": "µs",
    "ns": "ns",
    "min": "m",
    "h": "h",
    "d": "d",
    "Hz": "hertz",
    "rpm": "rotrpm",
    "m": "lengthm",
    "mm": "lengthmm",
    "km": "lengthkm",
    "m/s": "velocityms",
    "km/h": "velocitykmh",
    "m/s^2": "accMS2",
    "rad": "radian",
    "rad/s": "rotrads",
    "deg": "degree",
    "deg/s": "rotdegs",
    "N": "forceN",
    "Nm": "forceNm",
    "kg": "masskg",
    "g": "massg",
    "hPa": "pressurehpa",
    "kPa": "pressurekpa",
    "bar": "pressurebar",
    "mbar": "pressurembar",
    "psi": "pressurepsi",
    "B": "decbytes",
    "kB": "deckbytes",
    "MB": "decmbytes",
    "GB": "decgbytes",
    "KiB": "kbytes",
    "MiB": "mbytes",
    "GiB": "gbytes",
    "bit/s": "bps",
    "kbit/s": "Kbits",
    "Mbit/s": "Mbits",
    "B/s": "Bps",
    "kB/s": "KBs",
    "MB/s": "MBs",
    "dB": "dB",
    "dBm": "dBm",
    "lx": "lux",
    "ppm": "ppm",
    "l": "litre",
}


def state_mappings() -> list[dashboard.ValueMapping]:
    """Show a rank as its word, in its colour."""
    return _words({str(state.rank): (state.word, state.colour) for state in STATES})


def yes(word: str, colour: str, *, otherwise: str = "") -> list[dashboard.ValueMapping]:
    """Show 1 as ``word``, and 0 or nothing as ``otherwise``."""
    return [
        *_words({"1": (word, colour), "0": (otherwise, "transparent")}),
        dashboard.SpecialValueMap(
            dashboard.DashboardSpecialValueMapOptions(
                match=dashboard.SpecialValueMatch.NULL,
                result=dashboard.ValueMappingResult(text=otherwise, color="transparent"),
            )
        ),
    ]


def up_mappings() -> list[dashboard.ValueMapping]:
    """Show whether a server answers."""
    return _words({"1": ("up", OK.colour), "0": ("down", CRITICAL.colour)})


def success_mappings() -> list[dashboard.ValueMapping]:
    """Show whether the last attempt succeeded."""
    return _words({"1": ("succeeded", OK.colour), "0": ("failed", CRITICAL.colour)})


def clock_mappings() -> list[dashboard.ValueMapping]:
    """Show whether a computer's clock is synchronized."""
    return _words({"1": ("synchronized", OK.colour), "0": ("free-running", WARNING.colour)})


def severity_mappings() -> list[dashboard.ValueMapping]:
    """Colour an alert's severity."""
    colours = {"critical": CRITICAL.colour, "warning": WARNING.colour, "info": NEUTRAL}
    return _words({word: (word, colour) for word, colour in colours.items()})


def _words(shown: dict[str, tuple[str, str]]) -> list[dashboard.ValueMapping]:
    results = {
        value: dashboard.ValueMappingResult(text=text, color=colour, index=index)
        for index, (value, (text, colour)) in enumerate(shown.items())
    }
    return [dashboard.ValueMap(results)]
