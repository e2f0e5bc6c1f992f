"""The JSON endpoints: the fleet, what happened, service discovery, and what changes something.

Every error is a JSON object with one sentence under ``error``.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping
from typing import Any

from starlette.requests import Request
from starlette.responses import Response

from ros_diagnostics_exporter.diagnostics import Level
from ros_diagnostics_exporter.events import KINDS, Wanted

from .calls import Calls
from .doors import Doors

FLEET_AGE = 1.0  # seconds that one look at the fleet serves all who ask
MAX_EVENTS = 10_000
CLOSED = "the lifecycle API is not enabled; start the exporter with --web.enable-lifecycle"
FOREIGN = "a page of another site may not change anything here"
_NUMBER = re.compile(r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?")


class RefusedError(Exception):
    """A request that is answered with an error: HTTP status and sentence."""

    def __init__(self, status: int, error: str) -> None:
        super().__init__(error)
        self.status = status


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
        fleet = await self._calls.share(FLEET_AGE, self._doors.fleet)
        names = frozenset(request.query_params.getlist("robot"))
        return _json_bytes(await self._calls.run(_encode_fleet, fleet, names))

    async def events(self, request: Request) -> Response:
        """What happened, newest first, by the filters in the query."""
        wanted = _wanted(request)
        return _json({"events": await self._calls.run(self._doors.events, wanted)})

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
        """Refuse where the API is closed, and a request that some other site's page sent.

        Browsers say so themselves: https://www.w3.org/TR/fetch-metadata/#sec-fetch-site-header.
        """
        if not self._lifecycle:
            raise RefusedError(403, CLOSED)
        if request.headers.get("sec-fetch-site", "none") not in {"none", "same-origin"}:
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
    _only(request, "kind", "robot", "component", "level", "since", "until", "limit")
    query = request.query_params
    return Wanted(
        kind=_word(query, "kind", KINDS),
        robot=query.get("robot"),
        component=query.get("component"),
        level=_word(query, "level", Level.__members__),
        since=_number(query, "since"),
        until=_number(query, "until"),
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


def _encode_fleet(fleet: dict[str, Any], names: frozenset[str]) -> bytes:
    return "".join(_fleet_pieces(fleet, names)).encode("utf-8", "replace")


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
