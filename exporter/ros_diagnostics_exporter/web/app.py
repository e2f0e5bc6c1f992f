"""The application behind the port: which path is answered by what, and with which headers."""

from __future__ import annotations

from dataclasses import dataclass

from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.requests import Request
from starlette.responses import HTMLResponse, JSONResponse, PlainTextResponse, Response
from starlette.routing import Route

from .api import FLEET_AGE, Api, RefusedError, refuse
from .calls import BusyError, Calls
from .doors import Doors
from .headers import SecurityHeaders
from .openapi import describe
from .pages import landing
from .scrape import Scrape


@dataclass(frozen=True)
class Pages:
    """Endpoints for people, and for the supervision of the exporter itself."""

    doors: Doors
    calls: Calls
    telemetry_path: str

    async def landing(self, _request: Request) -> Response:
        """The fleet at a glance."""
        fleet = await self.calls.share(FLEET_AGE, self.doors.fleet)
        return HTMLResponse(await self.calls.run(landing, fleet, self.telemetry_path))

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


def build(
    doors: Doors, scrapes: Calls, others: Calls, telemetry_path: str, lifecycle: bool
) -> Starlette:
    """The application.

    Args:
        doors: What is served.
        scrapes: The threads that render metrics, and nothing else, so that nothing delays them.
        others: The threads for all other requests.
        telemetry_path: Where the metrics are; first, so that it may be "/".
        lifecycle: Whether /-/reload and /-/forget are open.
    """
    pages = Pages(doors, others, telemetry_path)
    api = Api(doors, others, lifecycle)
    changing = ["POST", "PUT"]
    routes = [
        Route(telemetry_path, Scrape(doors.metrics, scrapes), methods=["GET"]),
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
    return Starlette(
        routes=routes, exception_handlers=errors, middleware=[Middleware(SecurityHeaders)]
    )


async def _busy(_request: Request, _error: Exception) -> Response:
    return JSONResponse({"error": "too many requests wait"}, 503, {"Retry-After": "1"})


async def _http_error(_request: Request, error: Exception) -> Response:
    """No such path, or no such method there."""
    if not isinstance(error, HTTPException):
        raise error
    return JSONResponse({"error": error.detail}, error.status_code, error.headers)
