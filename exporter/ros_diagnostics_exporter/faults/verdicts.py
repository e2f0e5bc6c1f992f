"""What a level or a number says about each problem that may rest on it. Pure functions."""

from __future__ import annotations

from collections.abc import Container, Mapping
from math import isnan
from types import MappingProxyType

from ros_diagnostics_exporter.config.fleet import Threshold
from ros_diagnostics_exporter.faults.model import State, Verdict
from ros_diagnostics_exporter.faults.settings import ComponentSettings
from ros_diagnostics_exporter.model import Level

_WELL, _HELD, _ABSENT, _BAD = Verdict.WELL, Verdict.HELD, Verdict.ABSENT, Verdict.BAD
# WARNING goes on under STALE and CRITICAL, and STALE under CRITICAL: the worse is no recovery.
_OF_LEVEL: Mapping[Level, Mapping[State, Verdict]] = MappingProxyType(
    {
        Level.OK: {State.WARNING: _WELL, State.STALE: _WELL, State.CRITICAL: _WELL},
        Level.WARN: {State.WARNING: _BAD, State.STALE: _WELL, State.CRITICAL: _WELL},
        Level.ERROR: {State.WARNING: _HELD, State.STALE: _HELD, State.CRITICAL: _BAD},
    }
)
_NOTHING_KNOWN = {State.WARNING: _HELD, State.STALE: _HELD, State.CRITICAL: _HELD}


def of_component(
    level: Level, settings: ComponentSettings, known: Container[State]
) -> Mapping[State, Verdict]:
    """The verdict on each state of a component; ``known`` are those that it is in already."""
    if level is not Level.STALE:
        return _OF_LEVEL[level]
    if settings.planned_stale:
        return _NOTHING_KNOWN
    # An ERROR that no longer reports is still an ERROR, and a WARNING a WARNING.
    critical = settings.stale_is_critical or State.CRITICAL in known
    return {
        State.WARNING: _ABSENT if State.WARNING in known and not critical else _HELD,
        State.STALE: _ABSENT,
        State.CRITICAL: _ABSENT if critical else _HELD,
    }


def of_value(
    threshold: Threshold, number: float | None, hysteresis: float, *, in_trouble: bool
) -> Verdict:
    """The verdict on a value: in trouble beyond the threshold, and well again beyond hysteresis.

    ``hysteresis`` is a share of the threshold.
    """
    if number is None or isnan(number):
        return Verdict.HELD
    margin = abs(threshold.value) * hysteresis if in_trouble else 0.0
    if threshold.bound == "low":
        good = number >= threshold.value + margin
    else:
        good = number <= threshold.value - margin
    return Verdict.WELL if good else Verdict.BAD


def of_flapping(ratio: float, start: float, stop: float, *, in_trouble: bool) -> Verdict:
    """The verdict on a share of changes."""
    return Verdict.BAD if ratio >= (stop if in_trouble else start) else Verdict.WELL


def of_changes(number: int, most: int, level: Level, *, is_fault: bool) -> Verdict:
    """The verdict on a number of changes: intermittent from ``most`` on.

    A fault ends once fewer than half of that are left, and the component was received OK.
    """
    if number >= most:
        return Verdict.BAD
    lasts = is_fault and (2 * number >= most or level is not Level.OK)
    return Verdict.HELD if lasts else Verdict.WELL
