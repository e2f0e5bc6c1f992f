"""One received status as an analyzer keeps it, and how the aggregator names it.

Owns names: slashes become blanks, leading prefixes can be taken off.
"""

from __future__ import annotations

from typing import NamedTuple

from virtual_robots.model import ERROR, STALE, Status

MESSAGE_OF_LEVEL = ("OK", "Warning", "Error", "Stale")


class Item(NamedTuple):
    """The last status of one name, and when it was received (seconds)."""

    status: Status
    level: int
    received: float


def received_item(status: Status, now: float) -> Item:
    """Keep a received status; a level outside 0..3 counts as ERROR."""
    return Item(status, status.level if status.level <= STALE else ERROR, now)


def missing_item(name: str, now: float, message: str = "Missing") -> Item:
    """What stands for a name of which nothing was received yet."""
    return Item(Status(STALE, name, message), STALE, now)


def output_name(name: str) -> str:
    """A component's name as it appears below its group: each slash is a blank."""
    return name.replace("/", " ")


def listed(item: Item, path: str, *, stale: bool) -> Status:
    """The item as a row of the aggregated array: below ``path``, STALE if ``stale``."""
    base = "" if path == "/" else path
    return item.status._replace(
        name=f"{base}/{output_name(item.status.name)}", level=STALE if stale else item.level
    )


def without_prefix(full_name: str, prefix: str) -> str:
    """Take ``prefix``, then one colon, then all blanks off the last part of a full name.

    The prefix counts only where its first occurrence in the whole name is that last part: this is
    what the real one does, and why a prefix that is also in the group's path stays.
    """
    if not prefix:
        return full_name
    start = full_name.rfind("/") + 1
    if full_name.find(prefix) == start:
        full_name = full_name[:start] + full_name[start + len(prefix) :]
    base, rest = full_name[:start], full_name[start:]
    return base + rest.removeprefix(":").lstrip(" ")
