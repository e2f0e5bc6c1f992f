"""Limits: the length of texts, and the number of series of each robot and of the exporter.

A diagnostic array has no limits: a text in it may be as long as a message can be. What the exporter
does with a text (keep it, log it, split it at its slashes) must stay cheap all the same.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

from ros_diagnostics_exporter.decode.cdr import KeyValues
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.robots.rejections import SeriesLimitReason

MAX_TEXT = 4096  # characters of a name, hardware_id, message, key or value


def truncate(text: str, length: int) -> str:
    """``text`` if it has at most ``length`` characters; else its start and a hash of the whole.

    Two long names stay two names. Invalid Unicode is replaced.
    """
    if not text.isascii():
        text = text.encode("utf-8", "replace").decode()
    if len(text) <= length:
        return text
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return f"{text[: max(0, length - 9)]}~{digest}"


def truncate_statuses(statuses: Sequence[Status]) -> Sequence[Status]:
    """The statuses with every text of at most MAX_TEXT characters; themselves where all are."""
    if not any(map(_is_too_long, statuses)):
        return statuses
    return tuple(map(_truncate_status, statuses))


def _is_too_long(status: Status) -> bool:
    # Written out: every array of every robot passes here.
    _level, name, message, hardware_id, values = status
    if len(name) > MAX_TEXT or len(message) > MAX_TEXT or len(hardware_id) > MAX_TEXT:
        return True
    if isinstance(values, KeyValues) and values.size <= MAX_TEXT:
        return False
    for key, text in values:  # noqa: SIM110 - a generator costs three times as much
        if len(key) > MAX_TEXT or len(text) > MAX_TEXT:
            return True
    return False


def _truncate_status(status: Status) -> Status:
    return Status(
        status.level,
        truncate(status.name, MAX_TEXT),
        truncate(status.message, MAX_TEXT),
        truncate(status.hardware_id, MAX_TEXT),
        tuple((truncate(key, MAX_TEXT), truncate(text, MAX_TEXT)) for key, text in status.values),
    )


def unique_name(name: str, taken: dict[str, int], mark: str) -> str:
    """The name, numbered after ``mark`` where it is taken: the second "Error" is "Error#2".

    ``taken`` maps each name to the last number that it was given, and is updated. A name that
    collides with a numbered one does so once: n names cost n steps, whatever they are.
    """
    number = taken.get(name)
    if number is None:
        taken[name] = 1
        return name
    unique = name
    while unique in taken:
        number += 1
        unique = f"{name}{mark}{number}"
    taken[name] = number
    taken[unique] = 1
    return unique


class SeriesLimit:
    """How many series the values of one robot, new robots, or the whole exporter, may have.

    ``parent`` is the limit of more of them, which these series count against, too; ``reason`` is
    why what is beyond is rejected.
    """

    __slots__ = ("_parent", "_reason", "limit", "used")

    def __init__(
        self,
        limit: int,
        parent: SeriesLimit | None = None,
        reason: SeriesLimitReason = "series_limit",
    ) -> None:
        self.limit = limit
        self.used = 0
        self._parent, self._reason = parent, reason

    def exceeded_by(self, series: int) -> SeriesLimitReason | None:
        """The limit that so many more series would exceed; None where they fit."""
        if self.used + series > self.limit:
            return self._reason
        return None if self._parent is None else self._parent.exceeded_by(series)

    def add(self, series: int) -> SeriesLimitReason | None:
        """Count ``series``; where they do not fit count nothing, and return the limit."""
        limit = self.exceeded_by(series)
        if limit is None:
            self.remove(-series)
        return limit

    def remove(self, series: int) -> None:
        """Count ``series`` less."""
        self.used -= series
        if self._parent is not None:
            self._parent.remove(series)
