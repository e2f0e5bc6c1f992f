"""A zenoh router, and a session that offers more robots than there can be."""

from __future__ import annotations

from bench.actors.pace import ticks
from support.zenoh_robots import Bridge, session

RATE = 2_000  # robots a second


def route(endpoint: str, seconds: float) -> None:
    """Be a router at this endpoint."""
    router = session("router", listen=[endpoint])
    print("ready", flush=True)
    for _ in ticks(1, seconds):
        pass
    router.close()


def offer_keys(endpoint: str, seconds: float) -> None:
    """Declare publishers of ever more robots, which never publish."""
    hostile = Bridge(endpoint)
    for tick, _ in ticks(RATE, seconds):
        hostile.offer(f"/hostile_{tick}/diagnostics_agg")
        if tick % RATE == 0:
            print(f"{tick} robots offered", flush=True)
    hostile.close()
