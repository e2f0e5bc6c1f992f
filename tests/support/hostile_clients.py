"""Clients that send requests and do not read the responses; a program that runs until stopped.

Connections that the server closes are opened again at once, so their number stays the same.

    python hostile_clients.py PORT NUMBER SOURCE PATH
"""

import select
import socket
import sys
from contextlib import suppress

REQUESTS = 5  # on each connection


def connect(port: int, source: str, path: str) -> socket.socket:
    """A connection from ``source`` with requests for ``path``."""
    sock = socket.socket()
    sock.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
    sock.bind((source, 0))
    sock.settimeout(60)
    with suppress(OSError):  # closed again already, which poll() reports
        sock.connect(("127.0.0.1", port))
        sock.sendall(f"GET {path} HTTP/1.1\r\nHost: x\r\n\r\n".encode() * REQUESTS)
    return sock


def keep_open(port: int, number: int, source: str, path: str) -> None:
    """Keep ``number`` connections open, for ever."""
    poll, opened = select.poll(), {}

    def add() -> None:
        sock = connect(port, source, path)
        opened[sock.fileno()] = sock
        poll.register(sock, select.POLLRDHUP)  # not POLLIN: nothing is read

    for _ in range(number):
        add()
    print("ready", flush=True)
    while True:
        for fileno, _ in poll.poll():
            poll.unregister(fileno)
            opened.pop(fileno).close()
            add()


if __name__ == "__main__":
    keep_open(int(sys.argv[1]), int(sys.argv[2]), sys.argv[3], sys.argv[4])
