"""The address outside of the site: an HTTP server that notes when it was posted to."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

from support.loopback import Request, replying


class Heartbeat:
    """What a service for heartbeats knows; ``url`` is where it is posted to."""

    def __init__(self, url: str, beats: list[float]) -> None:
        self.url = url
        self.beats = beats  # monotonic times

    @property
    def quiet(self) -> float:
        """Seconds since the last one."""
        return time.monotonic() - self.beats[-1]


@contextmanager
def listening() -> Iterator[Heartbeat]:
    """Listen on a port of this machine while the context lasts."""
    beats: list[float] = []

    def reply(_request: Request) -> bytes:
        beats.append(time.monotonic())
        return b""

    with replying(reply) as address:
        yield Heartbeat(f"http://{address}/heartbeat", beats)
