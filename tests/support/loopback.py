"""Small servers on a port of this machine, in threads of their own."""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from socketserver import TCPServer

from testbed.ports import free_port


class _Server(ThreadingHTTPServer):
    request_queue_size = 1024  # many clients at once; the default of 5 lets them try again


@contextmanager
def answering(handler: type[BaseHTTPRequestHandler]) -> Iterator[str]:
    """Answer with ``handler`` while the context lasts; it logs no requests. Yields HOST:PORT."""
    quiet = type("Quiet", (handler,), {"log_message": lambda *_: None})
    with serving(_Server(("127.0.0.1", free_port()), quiet)) as address:
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
