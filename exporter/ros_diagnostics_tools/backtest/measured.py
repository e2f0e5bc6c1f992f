"""What Prometheus measured while something was recorded: the queries of fleet.yml, asked then.

Asked in pieces, so that neither a long recording nor a short interval makes an answer too large.
"""

from __future__ import annotations

import heapq
from collections.abc import Callable, Iterable, Iterator
from operator import itemgetter

from ros_diagnostics_exporter.config.fleet import Fleet, Query
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources.prometheus import Element, Measured, QueryError, ask_range
from ros_diagnostics_tools.backtest.recordings import Period

STEPS = 500  # of one answer
_Answer = tuple[float, int, list[Element]]  # Unix time, number of the query, elements


class Past:
    """The answers to the queries of one configuration, in order of time.

    ``client`` is of the Prometheus that has the series; None: no query is answered, as by an
    exporter without ``--prometheus.url``.
    """

    def __init__(self, client: Client | None, fleet: Fleet, periods: Iterable[Period]) -> None:
        self._queries = fleet.queries if client is not None else ()
        hysteresis = fleet.faults.value_hysteresis
        self._measured = [Measured(each, fleet.name, hysteresis) for each in self._queries]
        self._errors: dict[str, str] = {}
        self._found = dict.fromkeys((each.name for each in self._queries), 0)
        self._answers: Iterator[_Answer] = iter(())
        if client is not None:
            asked = (self._ask(client, n, list(periods)) for n in range(len(self._queries)))
            self._answers = heapq.merge(*asked, key=itemgetter(0, 1))
        self._next = next(self._answers, None)

    def _ask(self, client: Client, number: int, periods: list[Period]) -> Iterator[_Answer]:
        """All answers to one query; none after the first that failed."""
        query = self._queries[number]
        try:
            for period in periods:
                for begin, steps in _pieces(query, period):
                    end = begin + (steps - 1) * query.interval
                    found = ask_range(client, query.expr, begin, end, query.interval)
                    known = {round(at, 3): rows for at, rows in found.items()}
                    for step in range(steps):
                        at = round(begin + step * query.interval, 3)
                        yield at, number, known.get(at, [])
        except QueryError as error:
            self._errors[query.name] = str(error)

    def deliver(self, state: FleetState, until: float, at: Callable[[float], Instant]) -> None:
        """Pass on all answers up to ``until`` (Unix time), each as of its time."""
        while self._next is not None and self._next[0] <= until:
            wall, number, rows = self._next
            statuses, skipped = self._measured[number].statuses(rows, state.addresses())
            query = self._queries[number]
            self._found[query.name] += len(rows) - skipped
            state.receive_answer(query.feed, statuses, at(wall))
            self._next = next(self._answers, None)

    def warnings(self) -> list[str]:
        """Which queries were not judged, and why."""
        failed = [f"query {name}: {why}" for name, why in self._errors.items()]
        empty = [name for name, number in self._found.items() if not number]
        return failed + [f"query {name}: no series" for name in empty if name not in self._errors]


def _pieces(query: Query, period: Period) -> Iterator[tuple[float, int]]:
    """When each piece of a period begins, and how many times are asked for."""
    left = int((period.end - period.begin) // query.interval) + 1
    begin = period.begin
    while left > 0:
        steps = min(left, STEPS)
        yield round(begin, 3), steps
        begin, left = begin + steps * query.interval, left - steps
