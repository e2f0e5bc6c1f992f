"""A client that guesses passwords, and a server that answers slowly."""

from __future__ import annotations

import http.client
import socket
from base64 import b64encode
from contextlib import suppress

from bench.actors.pace import ticks

GUESSES = 10  # a second
PACE = 2  # bytes of a header a second
BEGIN = b"HTTP/1.1 200 OK\r\nX-Slow: "


def guess_passwords(port: int, seconds: float) -> None:
    """Log in with wrong passwords, and count the answers by their status."""
    answers: dict[int, int] = {}
    for number, _late in ticks(GUESSES, seconds):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=10)
        login = b64encode(f"bench:wrong {number}".encode()).decode()
        connection.request("GET", "/metrics", headers={"Authorization": f"Basic {login}"})
        status = connection.getresponse().status
        connection.close()
        answers[status] = answers.get(status, 0) + 1
        print(f"answered by status: {answers}", flush=True)


def answer_slowly(address: str, seconds: float) -> None:
    """Accept every connection, and send each a header one byte at a time."""
    host, _, port = address.rpartition(":")
    held: list[socket.socket] = []
    accepted = 0
    with socket.create_server((host, int(port))) as listener:
        listener.setblocking(False)
        for _ in ticks(PACE, seconds):
            with suppress(BlockingIOError):
                while True:
                    each = listener.accept()[0]
                    accepted += 1
                    each.sendall(BEGIN)
                    held.append(each)
            held = [each for each in held if _is_fed(each)]
            print(f"{len(held)} of {accepted} connections held", flush=True)


def _is_fed(connection: socket.socket) -> bool:
    """Send one byte more; False where the client has gone."""
    try:
        connection.sendall(b"x")
    except OSError:
        connection.close()
        return False
    return True
