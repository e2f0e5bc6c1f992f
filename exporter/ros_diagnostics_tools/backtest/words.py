"""Faults, times and durations as people read them."""

from __future__ import annotations

from datetime import datetime, timezone

from ros_diagnostics_exporter.durations import written
from ros_diagnostics_exporter.events import Event


def place(fault: Event) -> str:
    """What the fault is about, without its robot."""
    if fault.scope == "site":
        return f"site {fault.site or '(none)'}"
    if fault.scope == "common":
        return f"{fault.component} on many robots"
    if fault.check:
        return fault.check if fault.scope == "capability" else f"check {fault.check}"
    if fault.scope == "robot":
        return "robot"
    if fault.scope == "value":
        return f"{fault.component}: {fault.key} too {fault.bound}"
    return fault.component


def state(fault: Event) -> str:
    """What is wrong with it."""
    if fault.state == "many":
        return f"many components {fault.severity}"
    return fault.state.replace("_", " ")


def duration(seconds: float) -> str:
    """Seconds, rounded as it suits their size: 0.5s, 12s, 3m5s, 2d4h."""
    if seconds < 10:
        return f"{seconds:.1f}".removesuffix(".0") + "s"
    for size, unit in ((864_000, 3600), (36_000, 60)):
        if seconds >= size:
            return written(round(seconds / unit) * unit)
    return written(round(seconds))


def moment(wall: float) -> str:
    """Unix time as a date and time of this machine's time zone."""
    return datetime.fromtimestamp(wall, timezone.utc).astimezone().strftime("%Y-%m-%d %H:%M:%S")


def iso(wall: float) -> str:
    """Unix time in UTC, to the millisecond, for programs."""
    text = datetime.fromtimestamp(wall, timezone.utc).isoformat(timespec="milliseconds")
    return text.replace("+00:00", "Z")


def count(number: int, noun: str) -> str:
    """A number with its noun: 1 fault, 2 faults."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"
