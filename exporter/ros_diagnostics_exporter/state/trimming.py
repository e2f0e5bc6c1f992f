"""Cuts what a robot sends to a size that can be kept. Pure.

A diagnostic array has no bound: a text of it may be as long as a message can be, and what the
exporter does with a text (keep it, log it, part it at its slashes) must stay cheap all the same.
"""

from __future__ import annotations

from itertools import chain

from ros_diagnostics_exporter.diagnostics import Array, Status
from ros_diagnostics_exporter.state.bounds import bounded

MOST_TEXT = 4096  # characters of a name, hardware_id, message, key or value


def trimmed(array: Array) -> Array:
    """The array with every text of at most MOST_TEXT characters; itself where all are."""
    if array.size <= MOST_TEXT:  # no text of it is longer than the whole
        return array
    statuses = tuple([_trimmed(status) for status in array.statuses])
    same = all(new is old for new, old in zip(statuses, array.statuses, strict=True))
    return array if same else array._replace(statuses=statuses)


def _trimmed(status: Status) -> Status:
    texts = (status.name, status.message, status.hardware_id, *chain(*status.values))
    longest = max(map(len, texts))
    if longest <= MOST_TEXT:
        return status
    return Status(
        status.level,
        bounded(status.name, MOST_TEXT),
        bounded(status.message, MOST_TEXT),
        bounded(status.hardware_id, MOST_TEXT),
        tuple((bounded(key, MOST_TEXT), bounded(text, MOST_TEXT)) for key, text in status.values),
    )
