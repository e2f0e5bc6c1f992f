"""The address outside of the site: an HTTP server that notes when it was posted to."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

from testbed.ports import free_port


class Heartbeat:
    """What a service for heartbeats knows; ``url`` is where it is posted to."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.beats: list[float] = []  # monotonic times

    @property
    def quiet(self) -> float:
        """Seconds since the last one."""
        return time.monotonic() - self.beats[-1]


@contextmanager
def listening() -> Iterator[Heartbeat]:
    """Listen on a port of this machine while the context lasts."""
    port = free_port()
    heartbeat = Heartbeat(f"http://127.0.0.1:{port}/heartbeat")

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            self.rfile.read(int(self.headers["Content-Length"]))
            heartbeat.beats.append(time.monotonic())
            self.send_response(200)
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Say nothing of every beat."""

    server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield heartbeat
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
