"""The source of what Prometheus measures: each query of fleet.yml, asked in a loop of its own.

So a query that is slow, wrong or too large harms no other, and a Prometheus that hangs nothing but
the queries. What is not answered is not passed on: the state has its components become STALE after
their time, and without an answer that lacks them their absence is no fault.
"""

from __future__ import annotations

import json
import logging
import math
import threading
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol, TypeVar
from urllib.parse import urlencode

from ros_diagnostics_exporter.config.fleet import Fleet, Query
from ros_diagnostics_exporter.config.queries import component_name
from ros_diagnostics_exporter.http_client import AnsweredError, Client, UnreachableError
from ros_diagnostics_exporter.loops import Loop
from ros_diagnostics_exporter.model import Feed, Instant, Level, Status
from ros_diagnostics_exporter.texts import encodable, one_line

log = logging.getLogger(__name__)

TIMEOUT = 5.0  # seconds for one answer
MAX_BYTES = 8 << 20  # of one answer
MAX_ROWS = 10_000  # elements of one answer
MAX_ERROR = 300  # characters of why a query has no answer
OWN_PREFIX = "ros_diagnostics_"
_SEVERITY = {"warning": Level.WARN, "critical": Level.ERROR}
NO_URL = "the exporter runs without --prometheus.url"
_Read = TypeVar("_Read")


class AnswerReceiver(Protocol):
    """What the source reports to; all methods are called from its threads."""

    def receive_answer(
        self, feed: Feed, statuses: Mapping[str, Sequence[Status]], now: Instant
    ) -> None:
        """Take an answer: the statuses of each robot, by its name."""

    def addresses(self) -> Mapping[str, str]:
        """The address of each robot by its name, "" where it has none."""


class QueryError(Exception):
    """A query has no usable answer; the text says why, where possible in Prometheus' words."""


@dataclass(frozen=True)
class Outcome:
    """How a query was answered last. ``rows`` of the answer are components, ``skipped`` are not.

    ``error`` is why there is no answer, "" where there is one, None before the first.
    """

    query: Query
    error: str | None = None
    rows: int = 0
    skipped: int = 0


class Element(NamedTuple):
    """An element of a vector."""

    labels: dict[str, str]
    number: float


class Prometheus:
    """An `ArraySource` that asks one Prometheus; without a client every query has an error."""

    name = "prometheus"

    def __init__(
        self, receiver: AnswerReceiver, client: Client | None, clocks: Callable[[], Instant]
    ) -> None:
        self._receiver = receiver
        self._client = client
        self._clocks = clocks
        self._asked: dict[str, _Asked] = {}
        self._configuring = threading.Lock()

    def configure(self, fleet: Fleet, _now: Instant) -> None:
        """Ask the queries of this config; those that it leaves unchanged go on."""
        with self._configuring:
            wanted = {
                each.name: (each, fleet.name, fleet.faults.value_hysteresis)
                for each in fleet.queries
            }
            kept = {}
            for name, asked in self._asked.items():
                if asked.settings == wanted.get(name):
                    kept[name] = asked
                else:
                    asked.end()
            new = {
                name: _Asked(settings, self._receiver, self._client, self._clocks)
                for name, settings in wanted.items()
                if name not in kept
            }
            self._asked = {name: kept.get(name) or new[name] for name in wanted}
            for asked in new.values():
                asked.loop.start()

    def stop(self) -> None:
        """Ask nothing more, and pass on no answer that is under way."""
        with self._configuring:
            for asked in self._asked.values():
                asked.end()
            self._asked = {}

    @property
    def loops(self) -> list[Loop]:
        """One for each query."""
        return [asked.loop for asked in self._asked.values()]

    def outcomes(self) -> list[Outcome]:
        """How each query was answered last, in the order of the config."""
        return [asked.outcome for asked in self._asked.values()]


class _Asked:
    """One query: asks it, judges the rows, passes them on.

    ``settings`` are (query, name of the fleet, hysteresis).
    """

    def __init__(
        self,
        settings: tuple[Query, str, float],
        receiver: AnswerReceiver,
        client: Client | None,
        clocks: Callable[[], Instant],
    ) -> None:
        self.settings = settings
        self._query = settings[0]
        self._measured = Measured(*settings)
        self._receiver = receiver
        self._client = client
        self._clocks = clocks
        self._passing = threading.Lock()  # held while an answer is passed on
        self._ended = False
        self.outcome = Outcome(self._query)
        self.loop = Loop(f"query {self._query.name}", self._query.interval, self._turn)

    def end(self) -> None:
        """Ask no more; what is answered after this is not passed on."""
        self.loop.ask_to_stop()
        with self._passing:
            self._ended = True

    def _turn(self) -> None:
        now = self._clocks()  # before it is asked: what is measured is no younger
        try:
            rows = ask(self._client, self._query.expr)
        except QueryError as error:
            self._fail(str(error))
            return
        statuses, skipped = self._measured.statuses(rows, self._receiver.addresses())
        query = self._query
        with self._passing:
            if not self._ended:
                self._receiver.receive_answer(query.feed, statuses, now)
        if self.outcome.error:
            log.info("query %r is answered again", query.name)
        self.outcome = Outcome(query, "", len(rows) - skipped, skipped)

    def _fail(self, why: str) -> None:
        if why != self.outcome.error and not self._ended:
            log.warning("query %r has no answer: %s", self._query.name, why)
        self.outcome = Outcome(self._query, why)


class Measured:
    """What the answers of one query say of robots; a level ends beyond ``hysteresis`` only."""

    def __init__(self, query: Query, fleet: str, hysteresis: float) -> None:
        self._query, self._fleet, self._hysteresis = query, fleet, hysteresis
        self._levels: dict[tuple[str, str], Level] = {}  # those that were not OK

    def statuses(
        self, rows: Sequence[Element], addresses: Mapping[str, str]
    ) -> tuple[dict[str, list[Status]], int]:
        """The statuses of each robot by an answer, and how many rows are of no robot.

        ``addresses`` are the robots' by their names, "" where one has none.
        """
        worst: dict[tuple[str, str], float] = {}
        find = self._finder(addresses)
        skipped = 0
        for row in rows:
            robots = find(row.labels)
            skipped += not robots
            component = component_name(self._query.component, row.labels)
            for robot in robots:
                key = robot, component
                worst[key] = self._worse(row.number, worst.get(key, row.number))
        found: dict[str, list[Status]] = {}
        for (robot, component), number in worst.items():
            status = self._status(robot, component, number)
            found.setdefault(robot, []).append(status)
        return found, skipped

    def _finder(self, addresses: Mapping[str, str]) -> Callable[[Mapping[str, str]], list[str]]:
        """What finds the robots that an element's labels name."""
        by_address: dict[str, list[str]] = {}
        for robot, address in addresses.items():
            by_address.setdefault(address, []).append(robot)
        label = self._query.address

        def find(labels: Mapping[str, str]) -> list[str]:
            if labels.get("fleet", self._fleet) != self._fleet:
                return []
            if labels.get("__name__", "").startswith(OWN_PREFIX):
                return []
            if label is not None:
                return by_address.get(_host(labels.get(label, ""), by_address), [])
            robot = labels.get(self._query.robot or "", "")
            return [robot] if robot in addresses else []

        return find

    def _worse(self, one: float, other: float) -> float:
        thresholds = self._query.thresholds
        if thresholds and all(each.bound == "low" for each in thresholds):
            return min(one, other)
        if all(each.bound == "high" for each in thresholds):
            return max(one, other)
        return max(one, other, key=lambda number: self._level(number, Level.OK)[0])

    def _status(self, robot: str, component: str, number: float) -> Status:
        before = self._levels.pop((robot, component), Level.OK)
        level, bound = self._level(number, before)
        if level is not Level.OK:
            if len(self._levels) >= MAX_ROWS:
                self._levels.clear()  # of names that are invented without end
            self._levels[robot, component] = level
        key = f"value ({self._query.unit})" if self._query.unit else "value"
        message = f"{number:.6g}{self._unit}{bound}"
        if self._query.uplink and level is not Level.OK:
            message = "it does not answer"
        return Status(int(level), component, message, "", ((key, repr(number)),))

    @property
    def _unit(self) -> str:
        return f" {self._query.unit}" if self._query.unit else ""

    def _level(self, number: float, before: Level) -> tuple[Level, str]:
        """The level of a number, and beyond which threshold it is, in words."""
        found, words = Level.OK, ""
        for each in self._query.thresholds:
            level = _SEVERITY[each.severity]
            margin = self._hysteresis if before >= level else 0.0
            if level > found and each.is_beyond(number, margin):
                side = "below" if each.bound == "low" else "above"
                beyond = f"{side} the {each.severity} threshold of {each.value:g}{self._unit}"
                found, words = level, f", {beyond}"
                if not each.is_beyond(number):
                    words = f", not yet back from {beyond}"
        return found, words


def ask(client: Client | None, expr: str) -> list[Element]:
    """The elements of an instant vector, without those that are no number.

    Raises:
        QueryError: there is no answer, or no such vector.
    """
    if client is None:
        raise QueryError(NO_URL)
    return _asked(client, "query", {"query": expr}, _rows)


def ask_range(
    client: Client, expr: str, begin: float, end: float, step: float
) -> dict[float, list[Element]]:
    """What `ask` would have found at ``begin`` and each ``step`` seconds later, up to ``end``.

    Times are Unix times; those at which there was nothing are not among them.

    Raises:
        QueryError: there is no answer, or no such vectors.
    """
    given = {"query": expr, "start": f"{begin:.3f}", "end": f"{end:.3f}", "step": f"{step:g}"}
    return _asked(client, "query_range", given, _rows_by_time)


def _asked(
    client: Client, api: str, given: Mapping[str, str], read: Callable[[Any], _Read]
) -> _Read:
    parameters = urlencode({**given, "timeout": f"{TIMEOUT:g}s"})
    try:
        answer = client.get(f"/api/v1/{api}?{parameters}", limit=MAX_BYTES)
    except AnsweredError as error:
        raise QueryError(_own_words(error, client.url)) from error
    except UnreachableError as error:
        raise QueryError(_line(f"no answer of {client.url}: {error.__cause__ or error}")) from error
    try:
        return read(answer["data"])
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise QueryError(_line(f"{client.url} is no Prometheus: {error!r}")) from error


def _own_words(error: AnsweredError, url: str) -> str:
    """What Prometheus says about a query."""
    try:
        return _line(f"{url} answered {error.status}: {json.loads(error.body)['error']}")
    except (ValueError, KeyError, TypeError, RecursionError):
        return _line(f"{url} answered {error.status}")


def _line(text: str) -> str:
    return one_line(encodable(text))[:MAX_ERROR]


def _rows(data: Any) -> list[Element]:
    elements = _elements(data, "vector")
    pairs = ((_labels(each), each["value"][1]) for each in elements if "value" in each)
    numbers = ((labels, float(text)) for labels, text in pairs)
    return [Element(labels, number) for labels, number in numbers if not math.isnan(number)]


def _rows_by_time(data: Any) -> dict[float, list[Element]]:
    found: dict[float, list[Element]] = {}
    for each in _elements(data, "matrix"):
        labels = _labels(each)
        for at, text in each.get("values", ()):  # without: native histograms
            if not math.isnan(number := float(text)):
                found.setdefault(float(at), []).append(Element(labels, number))
    return found


def _elements(data: Any, wanted: str) -> list[Any]:
    kind, elements = str(data["resultType"]), data["result"]
    if kind != wanted:
        raise QueryError(
            _line(f"the result is a {kind}, not an instant vector of robots' elements")
        )
    if len(elements) > MAX_ROWS:
        what = f"the result has {len(elements)} elements, above the limit of {MAX_ROWS}"
        raise QueryError(f"{what}: aggregate it by robot")
    return list(elements)


def _labels(element: Any) -> dict[str, str]:
    return {encodable(str(name)): encodable(str(text)) for name, text in element["metric"].items()}


def _host(text: str, known: Mapping[str, Sequence[str]]) -> str:
    """The host in "host", "host:port" or "[IPv6]:port"."""
    if text in known and text:
        return text
    host, _colon, _port = text.rpartition(":")
    return host.removeprefix("[").removesuffix("]") or "\0"
