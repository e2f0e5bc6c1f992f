"""Cuts what a robot sends to a size that can be kept. Pure.

A diagnostic array has no bound: a text of it may be as long as a message can be, and what the
exporter does with a text (keep it, log it, part it at its slashes) must stay cheap all the same.
"""

from __future__ import annotations

from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_exporter.state.bounds import bounded

MOST_TEXT = 4096  # characters of a name, hardware_id, message, key or value


def trimmed(array: Array) -> Array:
    """The array with every text of at most MOST_TEXT characters; itself where all are."""
    if array.size <= MOST_TEXT or not any(map(_too_long, array.statuses)):
        return array  # in the first case no text of it is longer than the whole
    return array._replace(statuses=tuple(map(_trimmed, array.statuses)))


def _too_long(status: Status) -> bool:
    # Written out: every array of every robot passes here.
    _level, name, message, hardware_id, values = status
    if len(name) > MOST_TEXT or len(message) > MOST_TEXT or len(hardware_id) > MOST_TEXT:
        return True
    for key, text in values:  # noqa: SIM110 - a generator costs three times as much
        if len(key) > MOST_TEXT or len(text) > MOST_TEXT:
            return True
    return False


def _trimmed(status: Status) -> Status:
    return Status(
        status.level,
        bounded(status.name, MOST_TEXT),
        bounded(status.message, MOST_TEXT),
        bounded(status.hardware_id, MOST_TEXT),
        tuple((bounded(key, MOST_TEXT), bounded(text, MOST_TEXT)) for key, text in status.values),
    )
