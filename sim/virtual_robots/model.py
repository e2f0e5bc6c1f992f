"""Levels and statuses of diagnostic_msgs, without ROS: only virtual_robots.ros needs it."""

from __future__ import annotations

from typing import NamedTuple

OK, WARN, ERROR, STALE = 0, 1, 2, 3

LEVEL_NAMES = {"ok": OK, "warn": WARN, "error": ERROR, "stale": STALE}


class Status(NamedTuple):
    """One diagnostic_msgs/DiagnosticStatus; ``level`` is the byte on the wire (0..255)."""

    level: int
    name: str
    message: str = ""
    hardware_id: str = ""
    values: tuple[tuple[str, str], ...] = ()
