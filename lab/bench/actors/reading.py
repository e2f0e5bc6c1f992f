"""Clients that send requests and do not read the answers, in one thread."""

from __future__ import annotations

import resource
import select
import socket
from contextlib import suppress

from bench.actors.pace import ticks

TURNS = 20  # a second
PACE = 10  # connections opened in one turn, at most
BUFFER = 4096  # bytes of the receive buffer, the smallest there is
# As on Ethernet. With the loopback interface's 64 kB the server's kernel takes megabytes of an
# answer, and to the server it looks read.
SEGMENT = 1460
SPARE_FILES = 30  # for the process itself


def allowed_connections(wanted: int) -> int:
    """As many of the ``wanted`` as the hard limit of open files allows; the soft one is raised."""
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    needed = wanted + SPARE_FILES
    if soft < needed:
        soft = min(needed, hard)
        resource.setrlimit(resource.RLIMIT_NOFILE, (soft, hard))
    return min(wanted, soft - SPARE_FILES)


def hold_unread(port: int, path: str, wanted: int, seconds: float) -> None:
    """Keep so many connections with an unread answer; one that is closed is opened again."""
    count = allowed_connections(wanted)
    held = _Held(port, f"GET {path} HTTP/1.1\r\nHost: localhost\r\n\r\n".encode())
    for tick, _ in ticks(TURNS, seconds):
        held.open(min(PACE, count - len(held.sockets)))
        if tick % TURNS == 0:
            held.probe()
            few = "" if count == wanted else f" (of {wanted}: open files are limited)"
            print(f"{len(held.sockets)}{few} held, {held.opened} opened", flush=True)
        held.drop_closed()


class _Held:
    """Connections by their file descriptor."""

    def __init__(self, port: int, request: bytes) -> None:
        self.sockets: dict[int, socket.socket] = {}
        self.opened = 0
        self._port = port
        self._request = request
        self._poll = select.poll()

    def open(self, count: int) -> None:
        """Open so many, with a request on each; after a failed one the rest is not tried."""
        for _ in range(count):
            each = socket.socket()
            each.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, BUFFER)
            each.setsockopt(socket.IPPROTO_TCP, socket.TCP_MAXSEG, SEGMENT)
            each.settimeout(0.2)
            try:
                each.connect(("127.0.0.1", self._port))
                each.sendall(self._request)
            except OSError:
                each.close()
                return
            each.setblocking(False)
            self.sockets[each.fileno()] = each
            self._poll.register(each, select.POLLRDHUP)
            self.opened += 1

    def probe(self) -> None:
        """Send the begin of a next request on each.

        A server that has closed the connection answers that with a reset. Its end of the stream
        alone never arrives: it is behind the unread answer.
        """
        for each in self.sockets.values():
            with suppress(OSError):  # closed (poll reports it) or full
                each.send(b"G")

    def drop_closed(self) -> None:
        """Forget those that the server has closed."""
        for number, _ in self._poll.poll(0):
            self._poll.unregister(number)
            self.sockets.pop(number).close()
