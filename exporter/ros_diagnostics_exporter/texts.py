"""Texts of robots, files and people, made safe to show: one sanitizer for each place.

A name's identity is what was published, and goes to Prometheus and the API as it is; only what a
person reads is changed here. Characters that control a terminal, turn the direction of writing, or
take no space (control and format characters, separators, lone surrogates, what Unicode has not
assigned) become visible escapes: two names that differ look different, and one cannot pose as
another.
"""

from __future__ import annotations

import json
import re
from typing import Any

# What a driver may mean as a space: the blanks of all scripts, and line ends and tabs in a text.
_SPACES = dict.fromkeys(
    (*b"\t\n\r", 0xA0, 0x1680, *range(0x2000, 0x200B), 0x202F, 0x205F, 0x3000), " "
)


def printable(text: str) -> str:
    """``text`` in one line with everything invisible escaped, any blank but the space too."""
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() else ascii(sign)[1:-1] for sign in text)


def shown(text: str) -> str:
    """``text`` in one line as a terminal or a page may show it: blanks are spaces."""
    return printable(text.translate(_SPACES))


def to_json(content: Any) -> str:
    """JSON in one line that may be shown on a terminal; letters of all scripts stay readable."""
    text = json.dumps(content, ensure_ascii=False)
    if text.isprintable():
        return text
    return "".join(sign if sign.isprintable() else _json_escape(sign) for sign in text)


def natural(name: str) -> tuple[list[tuple[int, str]], str]:
    """A key that sorts robot_2 before robot_10, and takes any text.

    Texts and ASCII digits take turns in it; other scripts' digits are text. A number's length goes
    before its digits, so that none has to be made an int, which has a bound.
    """
    parts = re.split(r"([0-9]+)", name)
    for index in range(1, len(parts), 2):
        parts[index] = parts[index].lstrip("0")
    return [(len(part) if index % 2 else 0, part) for index, part in enumerate(parts)], name


def _json_escape(sign: str) -> str:
    """As JSON escapes it; half a surrogate pair is no text, and not every reader takes its escape.

    DEL is the only one that JSON itself leaves as it is.
    """
    if "\ud800" <= sign <= "\udfff":
        return "?"
    return "\\u007f" if sign == "\x7f" else json.dumps(sign)[1:-1]
