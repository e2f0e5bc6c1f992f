"""How available robots were: shares of the seconds that Prometheus recorded, as dashboards show.

Seconds are given by part of `robot:ros_diagnostics_part_seconds:sum5m`. Available are ok and
warning; maintenance, pending and what is undetermined count neither way.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import NamedTuple
from urllib.parse import urlencode

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.texts import escape

DAY = 86_400.0
AVAILABLE = {"ok", "warning"}
UNCOUNTED = {"maintenance", "pending", "undetermined"}


class Availability(NamedTuple):
    """The seconds that count, and those of them in which robots were available."""

    counted: float
    available: float

    @property
    def share(self) -> float | None:
        """0..1; None where nothing counts."""
        return self.available / self.counted if self.counted else None

    def budget(self, target: float) -> float:
        """The seconds that are left until the share is below ``target`` (0..1); negative: it is."""
        return (1 - target) * self.counted - (self.counted - self.available)


def availability(seconds: Mapping[str, float]) -> Availability:
    """The availability in these seconds by part."""
    counted = sum(number for part, number in seconds.items() if part not in UNCOUNTED)
    return Availability(counted, sum(seconds.get(part, 0.0) for part in AVAILABLE))


class Recorded:
    """What Prometheus recorded of a fleet.

    Args:
        prometheus: Where it is asked.
        fleet: The fleet's name.

    Attributes:
        fleet: As given.
    """

    def __init__(self, prometheus: Client, fleet: str) -> None:
        self._prometheus = prometheus
        self.fleet = fleet

    def of_fleet(self, end: float, days: int) -> Availability:
        """The availability of all robots in the ``days`` until ``end`` (Unix time)."""
        return self._ask("fleet", (), end, days).get((), Availability(0.0, 0.0))

    def of_robots(self, end: float, days: int) -> dict[str, Availability]:
        """The availability of each robot in the ``days`` until ``end`` (Unix time)."""
        found = self._ask("robot", ("robot",), end, days)
        return {robot: each for (robot,), each in found.items()}

    def of_capabilities(self, end: float, days: int) -> dict[tuple[str, str], dict[str, float]]:
        """(robot, capability) -> seconds by part: able, lost, unknown; robot "" is the fleet."""
        found = self._seconds("capability", ("robot", "capability"), end, days)
        return {(robot, capability): each for (robot, capability), each in found.items()}

    def _ask(
        self, record: str, by: tuple[str, ...], end: float, days: int
    ) -> dict[tuple[str, ...], Availability]:
        found = self._seconds(record, by, end, days)
        return {key: availability(parts) for key, parts in found.items()}

    def _seconds(
        self, record: str, by: tuple[str, ...], end: float, days: int
    ) -> dict[tuple[str, ...], dict[str, float]]:
        """The seconds of each part, by these labels."""
        series = f"{record}:ros_diagnostics_part_seconds:sum5m"
        seconds: dict[tuple[str, ...], dict[str, float]] = {}
        for (*key, part), number in self.sums(series, (*by, "part"), end, days).items():
            seconds.setdefault(tuple(key), {})[part] = number
        return seconds

    def sums(
        self, series: str, by: tuple[str, ...], end: float, days: int
    ) -> dict[tuple[str, ...], float]:
        """What a series of the fleet adds up to in the ``days`` until ``end``, by these labels.

        Raises:
            UnreachableError: Prometheus does not answer, or it is none.
        """
        of_fleet = f'{series}{{fleet="{escape(self.fleet)}"}}'
        expr = f"sum by ({', '.join(by)}) (sum_over_time({of_fleet}[{days}d]))"
        return {
            tuple(labels.get(name, "") for name in by): number
            for labels, number in self._samples(expr, end)
        }

    def _samples(self, expr: str, end: float) -> Iterable[tuple[dict[str, str], float]]:
        query = urlencode({"query": expr, "time": f"{end:.3f}"})
        path = f"/api/v1/query?{query}"
        found = self._prometheus.get(path)
        try:
            return [(each["metric"], float(each["value"][1])) for each in found["data"]["result"]]
        except (KeyError, TypeError, ValueError, IndexError) as error:
            raise UnreachableError(f"{self._prometheus.url} is not a Prometheus") from error
