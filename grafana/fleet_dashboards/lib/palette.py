"""The words and colours of states, Grafana's ids of units, and mappings of values to words.

People with any of the three kinds of colour blindness can distinguish the colours (a test simulates
them), and a word is always shown with the colour. The colours are backgrounds, never those of text:
no colour has a contrast of 4.5:1 as text in the dark and in the light theme. On them Grafana writes
white or black, with that contrast (tested, too).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

from grafana_foundation_sdk.models import dashboard


class State(NamedTuple):
    """A state of a robot or component; ``rank`` is its number in the recorded states."""

    rank: float
    word: str
    colour: str


PENDING = State(-1, "PENDING", "#D0D0D0")
OK = State(0, "OK", "#1F7F63")
WARNING = State(1, "WARNING", "#FFD92F")
FLAPPING = State(1.5, "FLAPPING", "#FFA55A")
STALE = State(2, "STALE", "#9350C9")
UNREACHABLE = State(3, "UNREACHABLE", "#90BEF8")  # its uplink fails: that is the fault
UNKNOWN = State(4, "UNKNOWN", "#3D3D3D")  # its exporter does not answer
SILENT = State(5, "SILENT", "#1B3A86")
CRITICAL = State(6, "CRITICAL", "#C1121F")
STATES = (  # by rank
    *(PENDING, OK, WARNING, FLAPPING, STALE),
    *(UNREACHABLE, UNKNOWN, SILENT, CRITICAL),
)
WORST_FIRST = STATES[::-1]

# The other parts of the availability report.
MAINTENANCE_COLOUR = "#8C6D46"
UNDETERMINED_COLOUR = "#6E6E6E"
NEUTRAL = "#3871C9"  # of a word that is neither good nor bad
TEXT = "text"  # Grafana's name for the colour of text in the present theme
# Behind what needs no attention, and where nothing is known: Grafana's name for the background. On
# "transparent" it would write white in the light theme, too.
NOTHING = "panel-bg"

SEVERITIES = {"critical": CRITICAL.colour, "warning": WARNING.colour, "info": NEUTRAL}

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
    return words({str(state.rank): (state.word, state.colour) for state in STATES})


def able_mappings() -> list[dashboard.ValueMapping]:
    """Show what a capability's state is: its number of OK, NO RESERVE, DEGRADED, LOST, UNKNOWN."""
    return words(
        {
            "0": (OK.word, OK.colour),
            "1": ("NO RESERVE", WARNING.colour),
            "2": ("DEGRADED", WARNING.colour),
            "3": ("LOST", CRITICAL.colour),
            "4": (UNKNOWN.word, UNKNOWN.colour),
        }
    )


# From which share of the time on, in which colour: those of the weekly report.
SHARES = ((0.9995, OK.colour), (0.99, "#8FD3BD"), (0.95, WARNING.colour), (0.0, CRITICAL.colour))


def share_mappings() -> list[dashboard.ValueMapping]:
    """Show an availability on the colour that says how good it is."""
    above = [*(least for least, _colour in SHARES[:0:-1]), SHARES[0][0], 2.0]
    return [
        dashboard.RangeMap(
            dashboard.DashboardRangeMapOptions(
                from_val=least, to=end, result=dashboard.ValueMappingResult(color=colour)
            )
        )
        for (least, colour), end in zip(reversed(SHARES), above[1:], strict=True)
    ]


def yes(word: str, colour: str, *, otherwise: str = "") -> list[dashboard.ValueMapping]:
    """Show 1 as ``word``, and 0 or nothing as ``otherwise``."""
    return [
        *words({"1": (word, colour), "0": (otherwise, NOTHING)}),
        special(dashboard.SpecialValueMatch.NULL, otherwise),
    ]


def up_mappings() -> list[dashboard.ValueMapping]:
    """Show whether a server answers."""
    return words({"1": ("up", OK.colour), "0": ("down", CRITICAL.colour)})


# Why a robot is silent: the label "reason", and the evidence of its fault.
SILENT_REASONS = {
    "never_seen": "never received: not switched on, or another name, namespace or DDS domain",
    "publisher_gone": "its publisher is gone: the program has ended, or the network is down",
    "mute": "its publisher is there, but sends nothing: the program hangs",
    "undecodable": "its messages cannot be decoded",
    "wrong_type": "its topic has another message type",
    "incompatible_qos": "the QoS of its publishers matches no subscription of ROS",
    "unreachable": "what connected it by zenoh is gone: its bridge, or the network",
    "domain_unreachable": "its DDS domain could not be joined, or no zenoh router answers",
    "uplink_down": "its uplink does not answer",
    "limit": "not received: the limit of robots is reached",
    "just_started": "not received since the exporter started",
}


# The same, short enough to be large.
SHORT_REASONS = {
    "never_seen": "never received",
    "publisher_gone": "publisher gone",
    "mute": "sends nothing",
    "undecodable": "not decodable",
    "wrong_type": "wrong type",
    "incompatible_qos": "QoS differs",
    "unreachable": "not connected",
    "domain_unreachable": "domain down",
    "uplink_down": "uplink down",
    "limit": "over the limit",
    "just_started": "not known yet",
}


def words(shown: Mapping[str, tuple[str, str | None]]) -> list[dashboard.ValueMapping]:
    """Show each value as a word on a colour; without one, on that of the column or panel."""
    results = {
        value: dashboard.ValueMappingResult(text=text, color=colour, index=index)
        for index, (value, (text, colour)) in enumerate(shown.items())
    }
    return [dashboard.ValueMap(results)]


def rewritten(regexp: str, text: str, colour: str | None = None) -> list[dashboard.ValueMapping]:
    """Show a text that matches otherwise, with $1, $2, ... of the match."""
    result = dashboard.ValueMappingResult(text=text, color=colour)
    options = dashboard.DashboardRegexMapOptions(pattern=regexp, result=result)
    return [dashboard.RegexMap(options)]


def special(
    match: dashboard.SpecialValueMatch, text: str, colour: str = NOTHING
) -> dashboard.ValueMapping:
    """Show what is no number (null, NaN) as a text."""
    result = dashboard.ValueMappingResult(text=text, color=colour)
    options = dashboard.DashboardSpecialValueMapOptions(match=match, result=result)
    return dashboard.SpecialValueMap(options)


# A number that is not known.
UNKNOWN_NUMBER = [special(dashboard.SpecialValueMatch.NULL_AND_NAN, "?")]
