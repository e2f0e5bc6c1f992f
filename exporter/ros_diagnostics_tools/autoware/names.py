"""Paths of units -> names of capabilities, as short as they can be and each only once."""

from __future__ import annotations

import re
from collections.abc import Iterable

_MOST = 40  # characters of a capability's name


def names_of(paths: Iterable[str]) -> dict[str, str]:
    """Of each path the last words that no other has: `/autoware/modes/local` -> `modes local`."""
    words = {path: _words(path) for path in paths}
    found: dict[str, str] = {}
    for path, own in words.items():
        others = [each for other, each in words.items() if other != path]
        lengths = range(1, len(own) + 1)
        unique = [n for n in lengths if all(own[-n:] != each[-n:] for each in others)]
        name = " ".join(own[-unique[0] :] if unique else own)
        found[path] = _free(name, set(found.values()))
    return found


def _words(path: str) -> list[str]:
    """The parts of a path, each with the characters only that a name may have."""
    parts = (" ".join(re.findall(r"[^\W_]+", part)) for part in path.split("/"))
    return list(filter(None, parts)) or ["unit"]


def _free(name: str, taken: set[str]) -> str:
    number, found = 1, name[-_MOST:].strip()
    while found in taken:
        number += 1
        found = f"{name[-(_MOST - 5) :].strip()} {number}"
    return found
