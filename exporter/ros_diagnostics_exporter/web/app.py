"""The application behind the port: which path is answered by what."""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from concurrent.futures import Executor
from typing import Any

from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, PlainTextResponse, Response
from starlette.routing import Route

from .doors import Doors
from .pages import landing
from .scrape import Scrape

CLOSED = "the lifecycle API is not enabled; start the exporter with --web.enable-lifecycle\n"


class Endpoints:
    """Answers to all but the scrape.

    Args:
        doors: What is asked; in ``executor``, beside the event loop.
        executor: Where the doors are called.
        telemetry_path: Where the landing page finds the metrics.
        lifecycle: Whether what changes something is open.
    """

    def __init__(
        self, doors: Doors, executor: Executor, telemetry_path: str, lifecycle: bool
    ) -> None:
        self._doors = doors
        self._executor = executor
        self._telemetry_path = telemetry_path
        self._lifecycle = lifecycle

    async def landing(self, _request: Request) -> Response:
        """The fleet at a glance."""
        fleet = await self._call(self._doors.fleet)
        return HTMLResponse(landing(fleet, self._telemetry_path))

    async def healthy(self, _request: Request) -> Response:
        """200 as long as the process answers at all."""
        return PlainTextResponse("healthy\n")

    async def ready(self, _request: Request) -> Response:
        """200 when messages are subscribed to, else 503 and why not."""
        why_not = await self._call(self._doors.ready)
        if why_not is None:
            return PlainTextResponse("ready\n")
        return PlainTextResponse(f"not ready: {why_not}\n", status_code=503)

    async def reload(self, _request: Request) -> Response:
        """Read the config again; 400 with every error when it is refused."""
        if not self._lifecycle:
            return PlainTextResponse(CLOSED, status_code=403)
        try:
            await self._call(self._doors.reload)
        except ValueError as error:
            return PlainTextResponse(f"{error}\n", status_code=400)
        return PlainTextResponse("reloaded\n")

    async def _call(self, function: Callable[..., Any], *arguments: Any) -> Any:
        loop = asyncio.get_running_loop()
        return await loop.run_in_executor(self._executor, function, *arguments)


def build(doors: Doors, executor: Executor, telemetry_path: str, lifecycle: bool) -> Starlette:
    """The application; ``executor`` runs what the doors do, beside the event loop."""
    answer = Endpoints(doors, executor, telemetry_path, lifecycle)
    routes = [
        Route(telemetry_path, Scrape(doors.metrics, executor), methods=["GET"]),
        Route("/-/healthy", answer.healthy),
        Route("/-/ready", answer.ready),
        Route("/-/reload", answer.reload, methods=["POST", "PUT"]),
        Route("/", answer.landing),
    ]
    return Starlette(routes=routes)
