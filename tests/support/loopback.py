"""Small servers on a port of this machine, in threads of their own."""

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer
from typing import NamedTuple

from testbed.ports import free_port


class Request(NamedTuple):
    """What a client asks for, or posts."""

    path: str
    headers: dict[str, str]
    body: bytes


Reply = bytes | tuple[int, bytes]  # 200, or with its status


class _Server(ThreadingHTTPServer):
    request_queue_size = 1024  # many clients at once; the default of 5 lets them try again


@contextmanager
def answering(handler: type[BaseHTTPRequestHandler], port: int | None = None) -> Iterator[str]:
    """Answer with ``handler`` while the context lasts; it logs no requests. Yields HOST:PORT."""
    quiet = type("Quiet", (handler,), {"log_message": lambda *_: None})
    with serving(_Server(("127.0.0.1", port or free_port()), quiet)) as address:
        yield address


@contextmanager
def replying(reply: Callable[[Request], Reply], port: int | None = None) -> Iterator[str]:
    """Answer each request with what ``reply`` makes of it, as text. Yields HOST:PORT."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
            found = reply(Request(self.path, dict(self.headers), body))
            status, content = found if isinstance(found, tuple) else (200, found)
            self.send_response(status)
            self.send_header("Content-Type", "text/plain; version=0.0.4; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            with suppress(ConnectionError):  # the client ends before us
                self.wfile.write(content)

        do_POST = do_GET  # noqa: N815

    with answering(Handler, port) as address:
        yield address


@contextmanager
def serving(server: TCPServer) -> Iterator[str]:
    """Let a server serve while the context lasts, which closes it. Yields HOST:PORT."""
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        host, port = server.server_address[:2]
        yield f"{host!s}:{port}"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()
