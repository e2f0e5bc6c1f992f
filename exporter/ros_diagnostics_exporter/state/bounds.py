"""What keeps the state finite: label lengths, the series of each robot and of all of them."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Literal

from ros_diagnostics_exporter.state.reasons import Rejection

# Called with the reason of what is rejected, and its name.
Reject = Callable[[Rejection, str], None]
SeriesLimit = Literal["series_limit", "robot_series_limit"]


def bounded(text: str, length: int) -> str:
    """``text`` if it has at most ``length`` characters; else its begin and a hash of the whole.

    Two long names stay two names. What is no valid Unicode is replaced.
    """
    if not text.isascii():
        text = text.encode("utf-8", "replace").decode()
    if len(text) <= length:
        return text
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return f"{text[: max(0, length - 9)]}~{digest}"


def own_name(name: str, taken: dict[str, int], mark: str) -> str:
    """The name, numbered behind ``mark`` where it is taken: the second "Error" is "Error#2".

    ``taken`` has for each name the last number that it was given. Numbering goes on from there, and
    a name that stands in the way of one does so once: n names cost n steps, whatever they are.
    """
    number = taken.get(name)
    if number is None:
        taken[name] = 1
        return name
    own = name
    while own in taken:
        number += 1
        own = f"{name}{mark}{number}"
    taken[name] = number
    taken[own] = 1
    return own


class Budget:
    """How many series the values of one robot, or the whole exporter, may have.

    What is taken is given back when it goes. ``whole`` is the exporter's, of which a robot's is a
    part.
    """

    __slots__ = ("_whole", "limit", "used")

    def __init__(self, limit: int, whole: Budget | None = None) -> None:
        self.limit = limit
        self.used = 0
        self._whole = whole

    def lacks(self, series: int) -> SeriesLimit | None:
        """The limit that leaves no place for so many more series; None where there is one."""
        if self.used + series > self.limit:
            return "series_limit" if self._whole is None else "robot_series_limit"
        return None if self._whole is None else self._whole.lacks(series)

    def take(self, series: int) -> SeriesLimit | None:
        """Take ``series``; where they do not fit take nothing, and return the limit."""
        limit = self.lacks(series)
        if limit is None:
            self.used += series
            if self._whole is not None:
                self._whole.used += series
        return limit

    def give(self, series: int) -> None:
        """Give back what was taken."""
        self.used -= series
        if self._whole is not None:
            self._whole.used -= series
