"""The application behind the port: which path is answered by what, and with which headers."""

from __future__ import annotations

from dataclasses import dataclass

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from ros_diagnostics_exporter.web.answers import Answers, Counted, busy
from ros_diagnostics_exporter.web.api import FLEET_AGE, Api, Look, RefusedError, look_at, refuse
from ros_diagnostics_exporter.web.auth import Logins
from ros_diagnostics_exporter.web.backend import Doors
from ros_diagnostics_exporter.web.connections import Connections
from ros_diagnostics_exporter.web.live_config import Settings
from ros_diagnostics_exporter.web.middleware import Gate
from ros_diagnostics_exporter.web.openapi import describe
from ros_diagnostics_exporter.web.pages import landing
from ros_diagnostics_exporter.web.scrape import Scrape
from ros_diagnostics_exporter.web.workers import BusyError, Calls


@dataclass(frozen=True)
class Pages:
    """Endpoints for people, and for the supervision of the exporter itself."""

    doors: Doors
    calls: Calls
    telemetry_path: str

    async def landing(self, _request: Request) -> Response:
        """The fleet at a glance."""
        look = await self.calls.share(FLEET_AGE, look_at, self.doors)
        return HTMLResponse(await self.calls.share(FLEET_AGE, _page, look, self.telemetry_path))

    async def healthy(self, _request: Request) -> Response:
        """200 as long as the process answers at all."""
        return PlainTextResponse("healthy\n")

    async def ready(self, _request: Request) -> Response:
        """200 when messages are subscribed to, else 503 and why not."""
        why_not = await self.calls.run(self.doors.ready)
        if why_not is None:
            return PlainTextResponse("ready\n")
        return PlainTextResponse(f"not ready: {why_not}\n", status_code=503)

    async def openapi(self, _request: Request) -> Response:
        """The description of all this."""
        return JSONResponse(describe(self.telemetry_path))


def _page(look: Look, telemetry_path: str) -> str:
    return landing(look.fleet, telemetry_path)


@dataclass(frozen=True)
class Threads:
    """The threads behind the application, of a kind each, so that no kind delays another."""

    scrapes: Calls
    others: Calls
    logins: Logins

    def close(self) -> None:
        """Wait for the calls under way."""
        self.scrapes.close()
        self.others.close()
        self.logins.close()


def start_threads() -> Threads:
    """Two threads render metrics, two answer everything else, one checks logins."""
    # Scrapes share four kinds of calls, and connections bound who waits for them.
    return Threads(Calls("web-scrape", 2, 1_000), Calls("web", 2, 50), Logins())


def build(
    doors: Doors,
    threads: Threads,
    connections: Connections,
    *,
    settings: Settings,
    telemetry_path: str,
    lifecycle: bool,
) -> Starlette:
    """The application.

    Args:
        doors: What is served.
        threads: Where the doors are called, beside the event loop.
        connections: The clients'.
        settings: Who may ask.
        telemetry_path: Where the metrics are; first, so that it may be "/".
        lifecycle: Whether /-/reload and /-/forget are open.
    """
    pages = Pages(doors, threads.others, telemetry_path)
    api = Api(doors, threads.others, lifecycle)
    scrape = Scrape(doors.metrics, threads.scrapes, Answers(connections))
    changing = ["POST", "PUT"]
    routes = [
        Route(telemetry_path, scrape, methods=["GET"]),
        Route("/", pages.landing),
        Route("/-/healthy", pages.healthy),
        Route("/-/ready", pages.ready),
        Route("/-/reload", api.reload, methods=changing),
        Route("/-/forget", api.forget, methods=changing),
        Route("/api/v1/fleet", api.fleet),
        Route("/api/v1/events", api.events),
        Route("/api/v1/openapi.json", pages.openapi),
        Route("/sd/{job}", api.targets),
    ]
    errors = {RefusedError: refuse, BusyError: _busy, HTTPException: _http_error}
    middleware = [
        Middleware(Gate, settings=settings, logins=threads.logins),
        Middleware(Counted, answers=Answers(connections)),
    ]
    return Starlette(routes=routes, exception_handlers=errors, middleware=middleware)


async def _busy(_request: Request, _error: Exception) -> Response:
    return busy()


async def _http_error(_request: Request, error: Exception) -> Response:
    """No such path, or no such method there."""
    if not isinstance(error, HTTPException):
        raise error
    return JSONResponse({"error": error.detail}, error.status_code, error.headers)
