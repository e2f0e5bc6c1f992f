"""The JSON endpoints: the fleet, faults, events, service discovery, reload and forget.

Every error is a JSON object with one sentence under ``error``.
"""

from __future__ import annotations

import json
import math
import re
import time
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from starlette.requests import Request
from starlette.responses import Response

from ros_diagnostics_exporter import durations
from ros_diagnostics_exporter.events import KINDS, Wanted
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.web.backend import Backend
from ros_diagnostics_exporter.web.middleware import is_cross_site
from ros_diagnostics_exporter.web.responses import BusyError, Workers

SNAPSHOT_AGE = 1.0  # seconds for which a snapshot of the fleet is shared
MAX_EVENTS = 10_000
MAX_ID = 2**53  # of an event: above it, JSON numbers are not exact
MAX_BODY = 1 << 20  # bytes of a message of Alertmanager, which has some thousand an alert
MAX_BODIES = 16 << 20  # ... of all that are being received
PAGE_BYTES = 4 << 20  # of events in one response
LIFECYCLE_DISABLED = (
    "the lifecycle API is not enabled; start the exporter with --web.enable-lifecycle"
)
FORGET_DISABLED = (
    "forget and watch/accept need a login (basic_auth_users of --web.config.file), a request from "
    "the exporter's own machine, or --web.enable-lifecycle"
)
LOOPBACK = {"127.0.0.1", "::/64"}  # as `client_address` names them
FORWARDED = {"forwarded", "x-forwarded-for", "x-real-ip", "via"}  # of a proxy on this machine
CROSS_SITE = (
    "requests from pages of another site are rejected, and so are those of a browser that uses a "
    "domain name for this host; use its address"
)
_NUMBER = re.compile(r"[+-]?[0-9]+(\.[0-9]*)?([eE][+-]?[0-9]+)?")
T = TypeVar("T")


class ApiError(Exception):
    """An error response: HTTP status and sentence."""

    def __init__(self, status: int, error: str) -> None:
        super().__init__(error)
        self.status = status


@dataclass(frozen=True, eq=False)  # compared by identity, as a key of shared results
class Snapshot:
    """The fleet at one moment."""

    fleet: dict[str, Any]


def take_faults(backend: Backend) -> bytes:
    """The faults that last, as JSON."""
    return _encode(backend.faults())


def take_snapshot(backend: Backend) -> Snapshot:
    """The fleet as it is now."""
    return Snapshot(backend.fleet_snapshot())


class Api:
    """Endpoints that return JSON.

    Args:
        backend: What is served.
        workers: Where the backend is called.
        asking: Where it is called for what Alertmanager is asked, which may hang.
        lifecycle: Whether reload is enabled, and forget for everybody.
    """

    def __init__(
        self, backend: Backend, workers: Workers, asking: Workers, lifecycle: bool
    ) -> None:
        self._backend = backend
        self._workers = workers
        self._asking = asking
        self._lifecycle = lifecycle
        self._receiving = 0  # bytes of bodies

    async def fleet(self, request: Request) -> Response:
        """The fleet, at most a second old; ``?robot=`` (repeatable) selects robots by name."""
        _allow_only(request, "robot")
        snapshot = await self._workers.run_shared(SNAPSHOT_AGE, take_snapshot, self._backend)
        names = frozenset(request.query_params.getlist("robot"))
        if names:
            return _json_bytes(await self._workers.run(_encode_fleet, snapshot, names))
        body = await self._workers.run_shared(SNAPSHOT_AGE, _encode_fleet, snapshot, names)
        return _json_bytes(body)

    async def faults(self, request: Request) -> Response:
        """The faults that last, at most a second old."""
        _allow_only(request)
        body = await self._workers.run_shared(SNAPSHOT_AGE, take_faults, self._backend)
        return _json_bytes(body)

    async def fault(self, request: Request) -> Response:
        """Each time that a fault lasted, as far as the event log has it."""
        _allow_only(request)
        fault = request.path_params["fault"]
        found = await self._workers.run(self._backend.fault_history, fault)
        if not found["occurrences"]:
            raise ApiError(404, f"the event log has no fault {fault!r:.40}")
        return _json(found)

    async def recording(self, request: Request) -> Response:
        """What was received around the begin of a fault."""
        _allow_only(request, "so_far")
        fault = request.path_params["fault"]
        so_far = _choice(request.query_params, "so_far", ("true", "false")) == "true"
        content = await _found(self._workers, self._backend.recording, fault, so_far)
        name = {"Content-Disposition": f'attachment; filename="{fault}.mcap"'}
        return Response(content, media_type="application/octet-stream", headers=name)

    async def events(self, request: Request) -> Response:
        """The events that match the query, newest first; ``next`` if there are more."""
        return _json_bytes(await self._workers.run(self._events_page, _event_filter(request)))

    def _events_page(self, wanted: Wanted) -> bytes:
        """The newest events that fit on a page, at least one."""
        encoded, size, last = list[bytes](), 0, 0
        for event in self._backend.find_events(wanted):
            event_json = _dump(event).encode("utf-8", "replace")
            size += len(event_json) + len(b", ")
            if encoded and size > PAGE_BYTES:
                return b'{"events": [%b], "next": %d}\n' % (b", ".join(encoded), last)
            encoded.append(event_json)
            last = event["id"]
        return b'{"events": [%b]}\n' % b", ".join(encoded)

    async def targets(self, request: Request) -> Response:
        """Prometheus' http_sd list of a job; ``?port=`` replaces the job's usual port."""
        _allow_only(request, "port")
        job, port = request.path_params["job"], _integer(request.query_params, "port", 65535)
        try:
            return _json(await _found(self._workers, self._backend.targets, job, port))
        except ValueError as error:
            raise ApiError(400, str(error)) from error

    async def reload(self, request: Request) -> Response:
        """Reload the configuration; 400 with every error if it is invalid."""
        if not self._lifecycle:
            raise ApiError(403, LIFECYCLE_DISABLED)
        _check_site(request)
        try:
            await self._workers.run(self._backend.reload)
        except ValueError as error:
            raise ApiError(400, str(error)) from error
        self._workers.invalidate()
        return _json({"reloaded": True})

    async def forget(self, request: Request) -> Response:
        """Remove a robot or one of its components; returns the number of components removed."""
        self._check_may_forget(request)
        _allow_only(request, "robot", "component")
        given = _named_robot(request), request.query_params.get("component")
        removed, passed_on = await _found(self._workers, self._backend.forget, *given)
        self._workers.invalidate()
        return _json({"forgotten": removed, "passed_on": passed_on})

    async def accept_graph(self, request: Request) -> Response:
        """Take what the ROS graph shows of a robot as expected; the number of expected nodes."""
        self._check_may_forget(request)
        _allow_only(request, "robot")
        robot = _named_robot(request)
        expected = await _found(self._workers, self._backend.accept_graph, robot)
        self._workers.invalidate()
        return _json({"expected": expected})

    async def why(self, request: Request) -> Response:
        """The history of a robot's faults: why somebody was notified, or nobody."""
        _allow_only(request, "robot", "component", "at")
        query = request.query_params
        given = _named_robot(request), query.get("component"), _moment(query, "at")
        return _json(await _found(self._asking, self._backend.why, *given))

    async def capabilities(self, request: Request) -> Response:
        """What a robot or the fleet can do: the expressions of fleet.yml with their states."""
        _allow_only(request, "robot")
        robot = request.query_params.get("robot")
        return _json(await _found(self._workers, self._backend.capabilities, robot))

    async def missions(self, request: Request) -> Response:
        """How the goals of a robot, or of all robots, ended."""
        _allow_only(request, "robot")
        robot = request.query_params.get("robot")
        return _json(await _found(self._workers, self._backend.missions, robot))

    async def notifications(self, request: Request) -> Response:
        """Record what Alertmanager's webhook sends; the numbers recorded and ignored."""
        _check_site(request)
        _allow_only(request)
        body = await self._body(request)
        try:
            recorded, ignored = await self._workers.run(self._backend.notified, body)
        except ValueError as error:
            raise ApiError(400, str(error)) from error
        self._workers.invalidate()
        return _json({"recorded": recorded, "ignored": ignored})

    async def _body(self, request: Request) -> bytes:
        """The body of a request; ApiError or BusyError if it is, or all are, too large."""
        chunks, size = list[bytes](), 0
        try:
            async for chunk in request.stream():
                chunks.append(chunk)
                size += len(chunk)
                self._receiving += len(chunk)
                if size > MAX_BODY:
                    raise ApiError(413, f"the body has more than {MAX_BODY} bytes")
                if self._receiving > MAX_BODIES:
                    raise BusyError
            return b"".join(chunks)
        finally:
            self._receiving -= size

    def _check_may_forget(self, request: Request) -> None:
        """Raise ApiError unless a person may end faults: on this machine, or logged in."""
        connection = request.scope["state"]["connection"]
        is_local = connection.address in LOOPBACK and FORWARDED.isdisjoint(request.headers)
        if not (self._lifecycle or connection.authenticated or is_local):
            raise ApiError(403, FORGET_DISABLED)
        _check_site(request)


async def _found(workers: Workers, function: Callable[..., T], *arguments: Any) -> T:
    """What the backend answers; ApiError where there is no such robot, fault or job."""
    try:
        return await workers.run(function, *arguments)
    except LookupError as error:
        # str() of a KeyError would put the sentence in quotes.
        raise ApiError(404, str(error.args[0]) if error.args else "not found") from error


def _named_robot(request: Request) -> str:
    robot = request.query_params.get("robot")
    if not robot:
        raise ApiError(400, f"the query must name a robot: {request.url.path}?robot=NAME")
    return robot


def _check_site(request: Request) -> None:
    """Raise ApiError for a cross-site request."""
    if is_cross_site(request.headers, request.url.scheme):
        raise ApiError(403, CROSS_SITE)


async def error_response(_request: Request, error: Exception) -> Response:
    """The response to an ApiError."""
    status = error.status if isinstance(error, ApiError) else 500
    return _json({"error": str(error)}, status)


def _allow_only(request: Request, *known: str) -> None:
    for name in request.query_params:
        if name not in known:
            usable = f"known are {', '.join(known)}" if known else "there is none"
            raise ApiError(400, f"unknown parameter {name!r}; {usable}")


def _event_filter(request: Request) -> Wanted:
    _allow_only(request, "kind", "robot", "component", "level", "since", "until", "before", "limit")
    query = request.query_params
    return Wanted(
        kind=_choice(query, "kind", KINDS),
        robot=query.get("robot"),
        component=query.get("component"),
        level=_choice(query, "level", Level.__members__),
        since=_moment(query, "since"),
        until=_moment(query, "until"),
        before=_integer(query, "before", MAX_ID),
        limit=_integer(query, "limit", MAX_EVENTS) or 100,
    )


def _choice(query: Mapping[str, str], name: str, known: Collection[str]) -> str | None:
    value = query.get(name)
    if value is not None and value not in known:
        raise ApiError(400, f"{name} is {value!r}, not one of {', '.join(known)}")
    return value


def _number(query: Mapping[str, str], name: str) -> float | None:
    text = query.get(name)
    if text is None:
        return None
    # float() alone would take "1_000", "nan" and digits of other scripts.
    number = float(text) if _NUMBER.fullmatch(text) else math.inf
    if not math.isfinite(number):
        raise ApiError(400, f"{name} is {text!r}, not a number")
    return number


def _moment(query: Mapping[str, str], name: str) -> float | None:
    """A Unix time, or a duration such as 10m: so long ago."""
    text = query.get(name)
    if text is None or _NUMBER.fullmatch(text):
        return _number(query, name)
    try:
        ago = durations.parse(text)
    except ValueError as error:
        wanted = "neither a Unix time nor a duration such as 10m or 1h30m"
        raise ApiError(400, f"{name} is {text!r}, {wanted}") from error
    return max(0.0, time.time() - ago)


def _integer(query: Mapping[str, str], name: str, most: int) -> int | None:
    number = _number(query, name)
    if number is not None and not (number.is_integer() and 1 <= number <= most):
        raise ApiError(400, f"{name} is {query[name]!r}, not a whole number 1..{most}")
    return None if number is None else int(number)


def _encode_fleet(snapshot: Snapshot, names: frozenset[str]) -> bytes:
    return "".join(_fleet_json(snapshot.fleet, names)).encode("utf-8", "replace")


def _fleet_json(fleet: dict[str, Any], names: frozenset[str]) -> Iterator[str]:
    """The object robot by robot, so that other threads can run in between."""
    head = {key: value for key, value in fleet.items() if key != "robots"}
    yield _dump(head)[:-1] + ', "robots": ['
    wanted = (each for each in fleet["robots"] if not names or each["robot"] in names)
    for number, robot in enumerate(wanted):
        yield (", " if number else "") + _dump(robot)
    yield "]}\n"


def _dump(content: Any) -> str:
    try:
        return json.dumps(content, ensure_ascii=False, allow_nan=False)
    except ValueError:  # a robot sent "inf" or "nan", which JSON does not have
        return json.dumps(_finite(content), ensure_ascii=False, allow_nan=False)


def _finite(content: Any) -> Any:
    if isinstance(content, dict):
        return {key: _finite(value) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [_finite(each) for each in content]
    return None if isinstance(content, float) and not math.isfinite(content) else content


def _json(content: Any, status: int = 200) -> Response:
    return _json_bytes(_encode(content), status)


def _encode(content: Any) -> bytes:
    return (_dump(content) + "\n").encode("utf-8", "replace")


def _json_bytes(body: bytes, status: int = 200) -> Response:
    return Response(body, status, media_type="application/json")
