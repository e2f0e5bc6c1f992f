"""The JSON endpoints: the fleet, what happened, service discovery, and what changes something.

Every error is a JSON object with one sentence under ``error``.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from ros_diagnostics_exporter.events import KINDS, Wanted
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.web.backend import Doors
from ros_diagnostics_exporter.web.origin import is_foreign
from ros_diagnostics_exporter.web.workers import Calls

FLEET_AGE = 1.0  # seconds that one look at the fleet serves all who ask
MAX_EVENTS = 10_000
MAX_ID = 2**53  # of an event: the largest number that JSON tells exactly
PAGE = 4 * 1024 * 1024  # bytes of events in one answer
CLOSED = "the lifecycle API is not enabled; start the exporter with --web.enable-lifecycle"
FOREIGN = (
    "a page of another site may not change anything here, nor may a browser that knows this host "
    "by a domain name; use its address"
)
_NUMBER = re.compile(r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?")


class RefusedError(Exception):
    """A request that is answered with an error: HTTP status and sentence."""

    def __init__(self, status: int, error: str) -> None:
        super().__init__(error)
        self.status = status


@dataclass(frozen=True, eq=False)  # compared by identity: what is made of one look is shared
class Look:
    """The fleet at one moment."""

    fleet: dict[str, Any]


def look_at(doors: Doors) -> Look:
    """The fleet as it is now."""
    return Look(doors.fleet())


class Api:
    """Endpoints that answer JSON.

    Args:
        doors: What is asked.
        calls: How it is asked.
        lifecycle: Whether what changes something is open.
    """

    def __init__(self, doors: Doors, calls: Calls, lifecycle: bool) -> None:
        self._doors = doors
        self._calls = calls
        self._lifecycle = lifecycle

    async def fleet(self, request: Request) -> Response:
        """The fleet, at most a second old; ``?robot=`` (repeatable) picks robots by name."""
        _only(request, "robot")
        look = await self._calls.share(FLEET_AGE, look_at, self._doors)
        names = frozenset(request.query_params.getlist("robot"))
        if names:
            return _json_bytes(await self._calls.run(_encode_fleet, look, names))
        return _json_bytes(await self._calls.share(FLEET_AGE, _encode_fleet, look, names))

    async def events(self, request: Request) -> Response:
        """What happened, newest first, by the filters in the query; ``next`` if there is more."""
        return _json_bytes(await self._calls.run(self._page, _wanted(request)))

    def _page(self, wanted: Wanted) -> bytes:
        """The newest of the events that fit on a page, which has one at least."""
        pieces, size, last = list[bytes](), 0, 0
        for event in self._doors.events(wanted):
            piece = _dump(event).encode("utf-8", "replace")
            size += len(piece) + len(b", ")
            if pieces and size > PAGE:
                return b'{"events": [%b], "next": %d}\n' % (b", ".join(pieces), last)
            pieces.append(piece)
            last = event["id"]
        return b'{"events": [%b]}\n' % b", ".join(pieces)

    async def targets(self, request: Request) -> Response:
        """Prometheus' http_sd list of a job; ``?port=`` for another port than the usual one."""
        _only(request, "port")
        job, port = request.path_params["job"], _whole(request.query_params, "port", 65535)
        try:
            found = await self._calls.run(self._doors.targets, job, port)
        except LookupError as error:
            raise RefusedError(404, _text(error)) from error
        except ValueError as error:
            raise RefusedError(400, str(error)) from error
        return _json(found)

    async def reload(self, request: Request) -> Response:
        """Read the config again; 400 with every error when it is refused."""
        self._may_change(request)
        try:
            await self._calls.run(self._doors.reload)
        except ValueError as error:
            raise RefusedError(400, str(error)) from error
        self._calls.renew()
        return _json({"reloaded": True})

    async def forget(self, request: Request) -> Response:
        """Take out a robot or one of its components; the answer says how many components went."""
        self._may_change(request)
        _only(request, "robot", "component")
        robot = request.query_params.get("robot")
        if not robot:
            raise RefusedError(400, "the query must name a robot: /-/forget?robot=NAME")
        component = request.query_params.get("component")
        try:
            gone = await self._calls.run(self._doors.forget, robot, component)
        except LookupError as error:
            raise RefusedError(404, _text(error)) from error
        self._calls.renew()
        return _json({"forgotten": gone})

    def _may_change(self, request: Request) -> None:
        """Refuse where the API is closed, and a request that some other site's page sent."""
        if not self._lifecycle:
            raise RefusedError(403, CLOSED)
        if is_foreign(request.headers, request.url.scheme):
            raise RefusedError(403, FOREIGN)


async def refuse(_request: Request, error: Exception) -> Response:
    """The answer to a RefusedError."""
    status = error.status if isinstance(error, RefusedError) else 500
    return _json({"error": str(error)}, status)


def _only(request: Request, *known: str) -> None:
    for name in request.query_params:
        if name not in known:
            raise RefusedError(400, f"unknown parameter {name!r}; known are {', '.join(known)}")


def _wanted(request: Request) -> Wanted:
    _only(request, "kind", "robot", "component", "level", "since", "until", "before", "limit")
    query = request.query_params
    return Wanted(
        kind=_word(query, "kind", KINDS),
        robot=query.get("robot"),
        component=query.get("component"),
        level=_word(query, "level", Level.__members__),
        since=_number(query, "since"),
        until=_number(query, "until"),
        before=_whole(query, "before", MAX_ID),
        limit=_whole(query, "limit", MAX_EVENTS) or 100,
    )


def _word(query: Mapping[str, str], name: str, known: Collection[str]) -> str | None:
    word = query.get(name)
    if word is not None and word not in known:
        raise RefusedError(400, f"{name} is {word!r}, not one of {', '.join(known)}")
    return word


def _number(query: Mapping[str, str], name: str) -> float | None:
    text = query.get(name)
    if text is None:
        return None
    # float() alone would take "1_000", "nan" and digits of other scripts.
    number = float(text) if _NUMBER.fullmatch(text) else math.inf
    if not math.isfinite(number):
        raise RefusedError(400, f"{name} is {text!r}, not a number")
    return number


def _whole(query: Mapping[str, str], name: str, most: int) -> int | None:
    number = _number(query, name)
    if number is not None and not (number.is_integer() and 1 <= number <= most):
        raise RefusedError(400, f"{name} is {query[name]!r}, not a whole number 1..{most}")
    return None if number is None else int(number)


def _encode_fleet(look: Look, names: frozenset[str]) -> bytes:
    return "".join(_fleet_pieces(look.fleet, names)).encode("utf-8", "replace")


def _fleet_pieces(fleet: dict[str, Any], names: frozenset[str]) -> Iterator[str]:
    """The object robot by robot: other threads come to their turn between two robots."""
    head = {key: value for key, value in fleet.items() if key != "robots"}
    yield _dump(head)[:-1] + ', "robots": ['
    wanted = (each for each in fleet["robots"] if not names or each["robot"] in names)
    for number, robot in enumerate(wanted):
        yield (", " if number else "") + _dump(robot)
    yield "]}\n"


def _dump(content: Any) -> str:
    try:
        return json.dumps(content, ensure_ascii=False, allow_nan=False)
    except ValueError:  # a robot said "inf" or "nan", which JSON does not know
        return json.dumps(_finite(content), ensure_ascii=False, allow_nan=False)


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_finite(each) for each in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _json(content: Any, status: int = 200) -> Response:
    return _json_bytes((_dump(content) + "\n").encode("utf-8", "replace"), status)


def _json_bytes(body: bytes, status: int = 200) -> Response:
    return Response(body, status, media_type="application/json")


def _text(error: LookupError) -> str:
    """The sentence of ``error``; str() of a KeyError would put it in quotes."""
    return str(error.args[0]) if error.args else "not found"
