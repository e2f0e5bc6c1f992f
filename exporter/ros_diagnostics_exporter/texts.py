"""Makes texts of robots, files and people safe to display: one function for each place.

    printable   error messages and logs of the configuration: exact, in one line
    one_line    terminals and the landing page: exact but for blanks
    to_json     logs, the event log and JSON on a terminal
    encodable   what is stored or compared: as others get it

Prometheus and the API get every name as it was published. Here, characters that control a terminal,
change the direction of writing or take no space (control and format characters, separators, lone
surrogates, unassigned code points) become visible escapes, so that different names look different.
"""

from __future__ import annotations

import json
import re
from collections import Counter
from collections.abc import Collection, Iterable, Sequence
from difflib import get_close_matches
from itertools import islice
from math import isfinite
from typing import Any

MOST_COMPARED = 1000  # names among which the nearest is looked for: a comparison is expensive

# Drivers use these as a space: the blanks of all scripts, tabs and line ends.
_SPACES = dict.fromkeys(
    (*b"\t\n\r", 0xA0, 0x1680, *range(0x2000, 0x200B), 0x202F, 0x205F, 0x3000), " "
)
_TO_ESCAPE = re.compile(r'[\\"\n]')
_ESCAPES = {"\\": r"\\", '"': r"\"", "\n": r"\n"}


def printable(text: str) -> str:
    """``text`` in one line; unprintable characters and all blanks but the space escaped."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else ascii(char)[1:-1] for char in text)


def one_line(text: str) -> str:
    """As ``printable``, but blanks, tabs and line ends become spaces."""
    return printable(text.translate(_SPACES))


def escape(text: str) -> str:
    """``text`` between the quotes of a label value or matcher; invalid Unicode is replaced."""
    return _TO_ESCAPE.sub(lambda match: _ESCAPES[match[0]], encodable(text))


def encodable(text: str) -> str:
    """``text`` as UTF-8 has it, and thus Prometheus, SQLite: lone surrogates are replaced."""
    return text if text.isascii() else text.encode("utf-8", "replace").decode()


def as_sample(value: float) -> str:
    """A sample's value: the shortest digits that mean the same float."""
    if isfinite(value):
        return repr(value)
    return "NaN" if value != value else ("+Inf" if value > 0 else "-Inf")  # noqa: PLR0124


def to_json(content: Any) -> str:
    """JSON in one line, safe for a terminal; letters of all scripts stay readable."""
    text = json.dumps(content, ensure_ascii=False)
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else _json_escape(char) for char in text)


def natural(name: str) -> tuple[list[tuple[int, str]], str]:
    """A sort key that puts robot_2 before robot_10, for any text.

    Text and ASCII digits alternate in it; digits of other scripts are text. The length of a number
    comes before its digits, so none is converted to an int, whose number of digits is limited.
    """
    parts = re.split(r"([0-9]+)", name)
    for index in range(1, len(parts), 2):
        parts[index] = parts[index].lstrip("0")
    return [(len(part) if index % 2 else 0, part) for index, part in enumerate(parts)], name


def _json_escape(char: str) -> str:
    """The JSON escape; "?" for a lone surrogate, whose escape not every reader accepts.

    DEL is the only unprintable character that json.dumps leaves as it is.
    """
    if "\ud800" <= char <= "\udfff":
        return "?"
    return "\\u007f" if char == "\x7f" else json.dumps(char)[1:-1]


def without_node(component: str) -> str:
    """A component's name without the node that diagnostic_updater puts in front.

    "motors: Motor 2" is "Motor 2".
    """
    return component.rpartition(": ")[2].strip()


def unique_without_node(components: Collection[str]) -> dict[str, str]:
    """Component -> its name without the node, where no other component has that."""
    number = Counter(map(without_node, components))
    return {name: rest for name in components for rest in [without_node(name)] if number[rest] == 1}


def first_few(texts: Sequence[str], most: int, between: str = ", ") -> str:
    """At most so many of the texts, and how many more there are, as "a, b and 3 more"."""
    more = len(texts) - most
    return between.join(texts[:most]) + (f" and {more} more" if more > 0 else "")


def nearest(text: str, names: Iterable[str]) -> str:
    """The name that is most similar to a text, case ignored; "" if none of the first 1,000 is."""
    known = {each.casefold(): each for each in islice(dict.fromkeys(names), MOST_COMPARED) if each}
    close = get_close_matches(text.casefold(), known, 1)
    return known[close[0]] if close else ""
