"""The web application: its routes, middleware and worker threads."""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any
from urllib.parse import quote

import yaml
from starlette.applications import Starlette
from starlette.convertors import PathConvertor, register_url_convertor
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import ClientDisconnect, Request
from starlette.responses import (
    HTMLResponse,
    JSONResponse,
    PlainTextResponse,
    RedirectResponse,
    Response,
)
from starlette.routing import Route

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.events import MOMENTS, Wanted
from ros_diagnostics_exporter.web.actions import Actions
from ros_diagnostics_exporter.web.api import (
    SNAPSHOT_AGE,
    Api,
    ApiError,
    Snapshot,
    error_response,
    take_snapshot,
)
from ros_diagnostics_exporter.web.backend import Backend
from ros_diagnostics_exporter.web.changes import ChangeStreams
from ros_diagnostics_exporter.web.connections import Connections
from ros_diagnostics_exporter.web.grafana import Grafana
from ros_diagnostics_exporter.web.middleware import AccessControl, Logins
from ros_diagnostics_exporter.web.mission_section import (
    MOST_MOMENTS,
    MissionSection,
    mission_section,
)
from ros_diagnostics_exporter.web.pages import (
    EVENTS,
    Acting,
    fault_page,
    landing,
    missing_fault,
    missing_robot,
    missing_runbook,
    robot_page,
    runbook_page,
)
from ros_diagnostics_exporter.web.responses import (
    BusyError,
    ResponseLimit,
    ResponseLimiter,
    Workers,
    busy_response,
)
from ros_diagnostics_exporter.web.runbooks import alert_of, link_to
from ros_diagnostics_exporter.web.scrape import Scrape
from ros_diagnostics_exporter.web.webconfig import LiveWebConfig

MAX_QUERY = 200  # characters of a search


@cache
def openapi(telemetry_path: str) -> dict[str, Any]:
    """openapi.yaml as the description of a server with its metrics at ``telemetry_path``."""
    text = (resources.files(__package__) / "openapi.yaml").read_text("utf-8")
    description: dict[str, Any] = yaml.safe_load(text)
    description["info"]["version"] = __version__
    paths = description["paths"]
    metrics = paths.pop("/metrics")
    paths[telemetry_path] = metrics  # at / in place of the landing page
    return description


class _AnyText(PathConvertor):
    """Line breaks too, so that the answer is the page that says there is no such robot."""

    regex = "(?s:.*)"


register_url_convertor("text", _AnyText())


@dataclass(frozen=True)
class Pages:
    """The pages, the health checks and the API's description."""

    backend: Backend
    workers: Workers
    telemetry_path: str
    actions: Actions
    grafana: Grafana

    def _acting(self, request: Request) -> Acting | None:
        token = self.actions.token(request)
        return None if token is None else Acting(token, request.query_params.get("done", ""))

    async def landing(self, request: Request) -> Response:
        """The fleet at a glance; ``?q=`` only what has this text in it."""
        snapshot = await self.workers.run_shared(SNAPSHOT_AGE, take_snapshot, self.backend)
        query = request.query_params.get("q", "").strip()[:MAX_QUERY]
        if query:
            found = await self.workers.run(self._landing, snapshot, query)
            return HTMLResponse(found)
        page = await self.workers.run_shared(SNAPSHOT_AGE, self._landing, snapshot, "")
        return HTMLResponse(page)

    def _landing(self, snapshot: Snapshot, query: str) -> str:
        of = snapshot.fleet, self.telemetry_path, query
        return landing(*of, acts=self.actions.enabled, grafana=self.grafana)

    async def problem(self, request: Request) -> Response:
        """Lead to a problem by what a dashboard knows: ``fault`` its id, ``robot``, both or none.

        With ``scope`` and ``state`` to its runbook.
        """
        asked = request.query_params
        alert = alert_of(asked.get("scope", ""), asked.get("state", ""))
        if alert:
            return RedirectResponse(f"runbooks/{link_to(alert, asked)}", status_code=303)
        for name in ("fault", "robot"):
            if asked.get(name):
                page = f"{name}s/{quote(asked[name], safe='', errors='replace')}"
                return RedirectResponse(page, status_code=303)
        return RedirectResponse("./", status_code=303)

    async def runbook(self, request: Request) -> Response:
        """The runbook of an alert; the query has the names of what it is about."""
        alert = request.path_params["alert"].removesuffix(".html").removesuffix(".md")
        names = dict(request.query_params)
        snapshot = await self.workers.run_shared(SNAPSHOT_AGE, take_snapshot, self.backend)
        page = runbook_page(alert, {**_reached_by(snapshot, names.get("robot", "")), **names})
        if page is None:
            return HTMLResponse(missing_runbook(alert), status_code=404)
        return HTMLResponse(page)

    async def robot(self, request: Request) -> Response:
        """One robot; 404 for a name that no robot has."""
        snapshot = await self.workers.run_shared(SNAPSHOT_AGE, take_snapshot, self.backend)
        name = request.path_params["robot"]
        acting = self._acting(request)
        page = await self.workers.run(self._robot_page, snapshot, name, acting)
        if page is None:
            return HTMLResponse(missing_robot(snapshot.fleet, name), status_code=404)
        return HTMLResponse(page)

    def _robot_page(self, snapshot: Snapshot, name: str, acting: Acting | None) -> str | None:
        events = self.backend.find_events(Wanted(robot=name, limit=EVENTS))
        try:
            history = self.backend.why(name, None, None, ask=False)["entries"]
            section = _missions(self.backend, name, snapshot.fleet["time"])
        except LookupError:
            history, section = [], None  # there is no such robot, or it was removed just now
        of = snapshot.fleet, name, events, history
        return robot_page(*of, missions=section, acting=acting, grafana=self.grafana)

    async def fault(self, request: Request) -> Response:
        """One fault that lasts or has ended; 404 for an id of which nothing is known."""
        snapshot = await self.workers.run_shared(SNAPSHOT_AGE, take_snapshot, self.backend)
        fault = request.path_params["fault"]
        history = await self.workers.run(self.backend.fault_history, fault)
        acting = self._acting(request)
        of = snapshot.fleet, fault, history, acting, self.grafana
        page = await self.workers.run(fault_page, *of)
        if page is None:
            return HTMLResponse(missing_fault(snapshot.fleet, fault, history), status_code=404)
        return HTMLResponse(page)

    async def healthy(self, _request: Request) -> Response:
        """200 as long as the exporter works; 503 with what hangs where only a restart may help."""
        reason = self.backend.hanging_reason()
        if reason is None:
            return PlainTextResponse("healthy\n")
        return PlainTextResponse(f"unhealthy: {reason}\n", status_code=503)

    async def ready(self, _request: Request) -> Response:
        """200 when messages are subscribed to, else 503 with the reason."""
        reason = await self.workers.run(self.backend.not_ready_reason)
        if reason is None:
            return PlainTextResponse("ready\n")
        return PlainTextResponse(f"not ready: {reason}\n", status_code=503)

    async def openapi(self, _request: Request) -> Response:
        """The OpenAPI description, indented: people read it, too."""
        text = json.dumps(openapi(self.telemetry_path), indent=2, ensure_ascii=False)
        return Response(text + "\n", media_type="application/json")


def _reached_by(snapshot: Snapshot, name: str) -> dict[str, str]:
    """The DDS domain and the topic of a robot, for the commands of a runbook."""
    for robot in snapshot.fleet["robots"]:
        if robot["robot"] == name:
            known = {"domain": robot["domain_id"], "topic": robot["topic"]}
            return {place: str(value) for place, value in known.items() if value is not None}
    return {}


def _missions(backend: Backend, name: str, now: float) -> MissionSection | None:
    found = backend.missions(name)
    if not found["robots"]:
        return None
    wanted = (Wanted(kind=each, robot=name, limit=MOST_MOMENTS) for each in MOMENTS)
    moments = [event for each in wanted for event in backend.find_events(each)]
    return mission_section(found, moments, now)


@dataclass(frozen=True)
class Threads:
    """The worker threads, separate by kind of request, so that none delays another."""

    scrapes: Workers
    others: Workers
    asking: Workers  # of Alertmanager
    logins: Logins

    def close(self) -> None:
        """Wait for the running calls."""
        self.scrapes.close()
        self.others.close()
        self.asking.close()
        self.logins.close()


def start_threads() -> Threads:
    """Two threads render metrics, two answer everything else, one asks and one checks logins."""
    # Scrapes share few kinds of calls; the limit of connections is also one of waiting scrapes.
    scrapes, others = Workers("web-scrape", 2, 1_000), Workers("web", 2, 50)
    return Threads(scrapes, others, Workers("web-why", 1, 20), Logins())


def build(
    backend: Backend,
    threads: Threads,
    connections: Connections,
    changes: ChangeStreams,
    *,
    web_config: LiveWebConfig,
    telemetry_path: str,
    lifecycle: bool,
    actions: bool,
    grafana: Grafana,
) -> Starlette:
    """The application.

    Args:
        backend: What is served.
        threads: Where the backend is called.
        connections: The clients'.
        changes: Notifies open pages of changes.
        web_config: Users, rate limit and headers.
        telemetry_path: Where the metrics are; first, so that it may be "/".
        lifecycle: Whether /-/reload is enabled, and /-/forget for everybody.
        actions: Whether the pages have forms by which who has logged in acts.
        grafana: What the pages link.
    """
    acting = Actions(backend, threads.asking, enabled=actions)
    pages = Pages(backend, threads.others, telemetry_path, acting, grafana)
    api = Api(backend, threads.others, threads.asking, lifecycle)
    scrape = Scrape(backend, threads.scrapes, ResponseLimit(connections))
    write_methods = ["POST", "PUT"]
    routes = [
        Route(telemetry_path, scrape, methods=["GET"]),
        Route("/", pages.landing),
        Route("/robots/{robot:text}", pages.robot),
        Route("/problem", pages.problem),
        Route("/runbooks/{alert}", pages.runbook),
        Route("/faults/{fault}", pages.fault),
        Route("/-/changes", changes, methods=["GET"]),
        Route("/-/healthy", pages.healthy),
        Route("/-/ready", pages.ready),
        Route("/-/reload", api.reload, methods=write_methods),
        Route("/-/forget", api.forget, methods=write_methods),
        Route("/-/acknowledge", acting.acknowledge, methods=["POST"]),
        Route("/-/downtime", acting.downtime, methods=["POST"]),
        Route("/-/cancel-downtime", acting.cancel_downtime, methods=["POST"]),
        Route("/-/watch/accept", api.accept_graph, methods=write_methods),
        Route("/api/v1/fleet", api.fleet),
        Route("/api/v1/faults", api.faults),
        Route("/api/v1/faults/{fault}", api.fault),
        Route("/api/v1/faults/{fault}/recording.mcap", api.recording),
        Route("/api/v1/events", api.events),
        Route("/api/v1/why", api.why),
        Route("/api/v1/capabilities", api.capabilities),
        Route("/api/v1/missions", api.missions),
        Route("/api/v1/notifications", api.notifications, methods=["POST"]),
        Route("/api/v1/openapi.json", pages.openapi),
        Route("/sd/{job}", api.targets),
    ]
    errors = {
        ApiError: error_response,
        BusyError: _busy,
        ClientDisconnect: _disconnected,
        HTTPException: _http_error,
    }
    middleware = [
        Middleware(AccessControl, web_config, threads.logins, backend.rejected_logins),
        Middleware(ResponseLimiter, limit=ResponseLimit(connections)),
    ]
    return Starlette(routes=routes, exception_handlers=errors, middleware=middleware)


async def _busy(_request: Request, _error: Exception) -> Response:
    return busy_response()


async def _disconnected(_request: Request, _error: Exception) -> Response:
    """The client has gone before its body was complete: nobody reads this."""
    return Response(status_code=400)


async def _http_error(_request: Request, error: Exception) -> Response:
    """No such path, or no such method there."""
    if not isinstance(error, HTTPException):
        raise error
    return JSONResponse({"error": error.detail}, error.status_code, error.headers)
