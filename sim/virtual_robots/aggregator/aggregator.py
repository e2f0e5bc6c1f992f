"""The aggregator: receives arrays, publishes the aggregated array and the top-level state.

Owns the root of the tree, `Other`, the period, `critical`, and the top-level state.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from virtual_robots.aggregator.analyzer_group import build_group, rolled_up
from virtual_robots.aggregator.analyzers import OtherAnalyzer
from virtual_robots.aggregator.parameters import AnalyzerConfigError, Parameters
from virtual_robots.aggregator.status_item import received_item
from virtual_robots.model import ERROR, OK, STALE, Status

VERSIONS = ("4.2.7", "4.2.6")


class Report(NamedTuple):
    """One publication: /diagnostics_agg and /diagnostics_toplevel_state."""

    statuses: tuple[Status, ...]
    toplevel: Status


class Aggregator:
    """A diagnostic_aggregator that read its parameters at ``now``.

    ``version`` is one of VERSIONS. Raises AnalyzerConfigError where the real program aborts.
    ``warnings`` lists the analyzers that it rejects and runs without.
    """

    def __init__(self, parameters: Parameters, now: float, version: str = VERSIONS[0]) -> None:
        if version not in VERSIONS:
            raise AnalyzerConfigError(f"version {version!r} is not one of {', '.join(VERSIONS)}")
        self._old = version == "4.2.6"
        self.period = _period(parameters)
        self._critical = _flag(parameters, "critical")
        self._publish_values = self._old or _flag(parameters, "publish_values", default=True)
        path = parameters.text("path") if "path" in parameters else ""
        base = f"/{path}" if path else ""
        self._group = build_group(base, "", parameters, now, stale_is_error=self._old)
        self.warnings = tuple(dict.fromkeys(self._group.warnings))
        self._other = OtherAnalyzer(
            f"{base}/Other",
            "Other",
            discard_stale=True,
            as_errors=_flag(parameters, "other_as_errors"),
        )
        self._last_toplevel = STALE

    def receive(self, statuses: Iterable[Status], now: float) -> Report | None:
        """Receive an array of /diagnostics; with `critical`, return a report if it is worse."""
        worse = False
        for status in statuses:
            item = received_item(status, now)
            analyzed = self._group.match(status.name) and self._group.analyze(item)
            if not analyzed:
                self._other.analyze(item)
            worse = worse or item.level > self._last_toplevel
        return self.publish(now) if self._critical and worse else None

    def publish(self, now: float) -> Report:
        """Return the report to publish every ``period`` seconds."""
        statuses = (*self._group.report(now), *self._other.report(now))
        toplevel = self._toplevel(statuses)
        self._last_toplevel = toplevel.level
        if not self._publish_values:
            statuses = tuple(status._replace(values=()) for status in statuses)
        return Report(statuses, toplevel)

    def _toplevel(self, statuses: tuple[Status, ...]) -> Status:
        if not statuses:
            return Status(ERROR if self._old else STALE, "toplevel_state")
        levels = [status.level for status in statuses]
        level = rolled_up(levels, stale_is_error=self._old)
        if self._old or level == OK:
            return Status(level, "toplevel_state")
        # The highest number counts here, STALE above ERROR, so this can be about another component
        # than the one that gave the level. Upstream does the same.
        highest = [status for status in statuses if status.level == max(levels)]
        shown = max(highest, key=lambda status: status.name.count("/"))
        message = f"{shown.name}: {shown.message}"
        return Status(level, "toplevel_state", message, shown.hardware_id, shown.values)


def _flag(parameters: Parameters, name: str, *, default: bool = False) -> bool:
    return parameters.flag(name) if name in parameters else default


def _period(parameters: Parameters) -> float:
    """Seconds between publications: whole milliseconds, as the real timer has it."""
    rate = parameters.number("pub_rate") if "pub_rate" in parameters else 1.0
    if not 0 < rate <= 1000:
        raise AnalyzerConfigError(
            f"{parameters.source}: pub_rate: is {rate}, must be above 0.0 and at most 1000.0"
        )
    return int(1000 / rate) / 1000
