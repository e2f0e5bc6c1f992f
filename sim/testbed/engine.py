"""Prometheus' HTTP API, which vmalert and VictoriaMetrics answer too."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from testbed import http


class Sample(NamedTuple):
    """One element of an instant vector."""

    labels: dict[str, str]
    value: float


@dataclass(frozen=True)
class Engine:
    """What evaluates expressions and rules at HOST:PORT.

    All methods raise http.Unanswered where it does not answer, and ValueError with its reason where
    it rejects the expression.
    """

    address: str

    def query(self, expr: str, at: float | None = None) -> list[Sample]:
        """The elements of an instant vector, now or at a Unix time."""
        return [Sample(each["metric"], float(each["value"][1])) for each in self.series(expr, at)]

    def value(self, expr: str) -> float:
        """The value of the one element; 0 where there is none."""
        found = self.query(expr)
        if len(found) > 1:
            raise ValueError(f"{len(found)} elements: {expr}")
        return found[0].value if found else 0.0

    def series(self, expr: str, at: float | None = None) -> list[dict[str, Any]]:
        """The series of an instant vector or range vector as JSON; a scalar's has no labels."""
        found = self._ask("query", query=expr, **({} if at is None else {"time": at}))
        if found["resultType"] == "scalar":
            return [{"metric": {}, "value": found["result"]}]
        result: list[dict[str, Any]] = found["result"]
        return result

    def query_range(self, expr: str, start: float, end: float, step: float) -> list[dict[str, Any]]:
        """The series between two Unix times as JSON, a sample every ``step`` seconds."""
        found = self._ask("query_range", query=expr, start=start, end=end, step=step)
        result: list[dict[str, Any]] = found["result"]
        return result

    def alerts(self) -> list[dict[str, Any]]:
        """All alerts that are pending or firing, with annotations."""
        found = http.get_json(self.address, "/api/v1/alerts", 60.0)["data"]["alerts"]
        return found or []  # vmalert's is null while there is none

    def firing(self) -> list[dict[str, str]]:
        """The labels of all alerts that fire."""
        return [each["labels"] for each in self.alerts() if each["state"] == "firing"]

    def _ask(self, what: str, **form: object) -> Any:
        return http.ask(self.address, f"/api/v1/{what}", form)["data"]
