"""Colour-blind people can distinguish the states; ranks and units match the exporter's."""

import itertools
import json
import re

import pytest

pytest.importorskip("grafana_foundation_sdk", reason="Grafana's SDK needs Python 3.11")

from fleet_dashboards.lib import palette
from ros_diagnostics_exporter.robots.units import _CANONICAL
from ros_diagnostics_exporter.severity import COLOURS
from support.committed_dashboards import BOARDS, panels

# Matrices for linear RGB: Machado, Oliveira, Fernandes 2009, severity 1.0.
VISION = {
    "normal": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "protanopia": (
        (0.152286, 1.052583, -0.204868),
        (0.114503, 0.786281, 0.099216),
        (-0.003882, -0.048116, 1.051998),
    ),
    "deuteranopia": (
        (0.367322, 0.860646, -0.227968),
        (0.280085, 0.672501, 0.047413),
        (-0.011820, 0.042940, 0.968881),
    ),
    "tritanopia": (
        (1.255528, -0.076749, -0.178779),
        (-0.078411, 0.930809, 0.147602),
        (0.004733, 0.691367, 0.303900),
    ),
}
DISTINCT = 20  # CIE 1976 difference; 2.3 is just noticeable side by side


def linear(colour: str) -> list[float]:
    parts = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    return [x / 12.92 if x <= 0.04045 else ((x + 0.055) / 1.055) ** 2.4 for x in parts]


def lab(colour: str, vision: str) -> tuple[float, float, float]:
    """CIE L*a*b* (D65) of a colour as people with that vision see it."""
    red, green, blue = (
        min(1.0, max(0.0, sum(a * b for a, b in zip(row, linear(colour), strict=True))))
        for row in VISION[vision]
    )
    x, y, z = (
        share ** (1 / 3) if share > 0.008856 else 7.787 * share + 16 / 116
        for share in (
            (0.4124 * red + 0.3576 * green + 0.1805 * blue) / 0.95047,
            0.2126 * red + 0.7152 * green + 0.0722 * blue,
            (0.0193 * red + 0.1192 * green + 0.9505 * blue) / 1.08883,
        )
    )
    return 116 * y - 16, 500 * (x - y), 200 * (y - z)


def difference(one: str, other: str, vision: str) -> float:
    pairs = zip(lab(one, vision), lab(other, vision), strict=True)
    return sum((a - b) ** 2 for a, b in pairs) ** 0.5


@pytest.mark.parametrize("vision", VISION)
def test_any_two_states_differ_in_colour(vision: str):
    close = [
        (one.word, other.word)
        for one, other in itertools.combinations(palette.STATES, 2)
        if difference(one.colour, other.colour, vision) < DISTINCT
    ]

    assert close == []


def luminance(colour: str) -> float:
    """Relative luminance: WCAG 2."""
    red, green, blue = linear(colour)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def text_on(background: str) -> str:
    """The colour of Grafana's text: getTextColorForBackground of @grafana/ui."""
    red, green, blue = (int(background[at : at + 2], 16) for at in (1, 3, 5))
    return "#202226" if 0.299 * red + 0.587 * green + 0.114 * blue > 180 else "#f7f8fa"


BACKGROUNDS = {
    **{state.word: state.colour for state in palette.STATES},
    "MAINTENANCE": palette.MAINTENANCE_COLOUR,
    "UNDETERMINED": palette.UNDETERMINED_COLOUR,
    "NEUTRAL": palette.NEUTRAL,
    **{f"from {least:.2%} on": colour for least, colour in palette.SHARES},
}


@pytest.mark.parametrize("background", BACKGROUNDS.values(), ids=BACKGROUNDS)
def test_text_on_a_colour_is_legible(background: str):
    """A contrast of at least 4.5:1: WCAG 2, level AA."""
    darker, lighter = sorted((luminance(background), luminance(text_on(background))))

    assert (lighter + 0.05) / (darker + 0.05) >= 4.5


def test_a_background_is_of_that_colour_in_both_themes():
    """The graded background of a number is lighter in the light theme: 2.7:1 for OK."""
    options = [panel.get("options", {}) for board in BOARDS.values() for panel in panels(board)]
    modes = {each["colorMode"] for each in options if "colorMode" in each}
    assert modes == {"background_solid", "value", "none"} & modes
    cells = re.findall(
        r'"mode": "(\w+)",\s*"type": "color-background"', json.dumps([*BOARDS.values()])
    )
    assert set(cells) == {"basic"}
    assert len(cells) > 10


def test_the_exporters_page_and_status_command_have_the_same_colours():
    assert {state.word: state.colour for state in palette.STATES} == {
        state: colour for state, (colour, _text) in COLOURS.items()
    }


@pytest.mark.parametrize("state", COLOURS)
def test_a_text_on_a_colour_has_the_contrast_that_wcag_wants(state: str):
    dark, bright = sorted(map(luminance, COLOURS[state]))
    assert (bright + 0.05) / (dark + 0.05) >= 4.5


def test_every_unit_of_the_palette_is_one_of_the_exporter():
    assert set(palette.UNITS) <= set(_CANONICAL.values())
