"""A received status as an analyzer stores it, and its name in the aggregated array."""

from __future__ import annotations

from typing import NamedTuple

from virtual_robots.model import ERROR, STALE, Status

MESSAGE_OF_LEVEL = ("OK", "Warning", "Error", "Stale")


class StatusItem(NamedTuple):
    """The last status of one name, and when it was received (seconds)."""

    status: Status
    level: int
    received: float

    def to_status(self, path: str, *, stale: bool) -> Status:
        """Return the item's row in the aggregated array: below ``path``, STALE if ``stale``."""
        base = "" if path == "/" else path
        name = f"{base}/{output_name(self.status.name)}"
        return self.status._replace(name=name, level=STALE if stale else self.level)


def received_item(status: Status, now: float) -> StatusItem:
    """Return the item of a received status; a level outside 0..3 counts as ERROR."""
    return StatusItem(status, status.level if status.level <= STALE else ERROR, now)


def missing_item(name: str, now: float, message: str = "Missing") -> StatusItem:
    """Return the item of a name of which nothing was received yet."""
    return StatusItem(Status(STALE, name, message), STALE, now)


def output_name(name: str) -> str:
    """Return a component's name below its group: each slash becomes a blank."""
    return name.replace("/", " ")


def without_prefix(full_name: str, prefix: str) -> str:
    """Take ``prefix``, then one colon, then all blanks off the last part of a full name.

    As upstream: only if the prefix occurs first in that last part, so a prefix that is also in the
    group's path stays.
    """
    if not prefix:
        return full_name
    start = full_name.rfind("/") + 1
    if full_name.find(prefix) == start:
        full_name = full_name[:start] + full_name[start + len(prefix) :]
    base, rest = full_name[:start], full_name[start:]
    return base + rest.removeprefix(":").lstrip(" ")
