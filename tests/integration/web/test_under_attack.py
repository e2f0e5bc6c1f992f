"""Slow and hostile clients of the real exporter, while robots publish."""

import contextlib
import socket

from support.exposition import samples
from testbed.polling import until

ROBOTS = 3
GET = b"GET /metrics HTTP/1.1\r\nHost: x\r\n"


def messages(site) -> dict[str, float]:
    """Robot -> messages received, by a scrape like Prometheus'."""
    found = samples(site.address, "robot_messages_total")
    return {each.labels["robot"]: each.value for each in found}


def test_ingest_and_scrapes_continue(site):
    exporter = site.serve()
    site.start_robots(ROBOTS)
    exporter.wait_for_output("serving fleet")
    until(lambda: len(messages(site)) == ROBOTS, exporter.describe)
    with contextlib.ExitStack() as crowd:

        def connect(*sent: bytes) -> socket.socket:
            sock = socket.create_connection(("127.0.0.1", site.port), timeout=20)
            crowd.enter_context(sock)
            for piece in sent:
                sock.sendall(piece)
            return sock

        # Together more than the exporter accepts at once, and fewer than an ordinary user's 1,024
        # open files, of which a worker keeps some hundred: by them no other takes its ports.
        for _ in range(300):
            connect()
        slow = [connect(GET) for _ in range(120)]
        for _ in range(30):
            connect((GET + b"\r\n") * 20)  # pipelines, and reads nothing
            connect(b"GET /api/v1/fleet HTTP/1.1\r\nHost: x\r\n\r\n" * 20)
            connect(b"POST /-/reload HTTP/1.1\r\nHost: x\r\nContent-Length: 1000000000\r\n\r\n")
            connect(GET + b"X: " + b"a" * 20_000)
        before = messages(site)

        def received_more() -> bool:
            for sock in slow:
                with contextlib.suppress(OSError):
                    sock.sendall(b"a")
            now = messages(site)
            return all(now[robot] >= before[robot] + 5 for robot in before)

        # Each poll is a scrape; a failed one ends the test.
        until(received_more, lambda: f"five messages of each robot since {before}", every=0.5)
    assert "Traceback" not in exporter.output()
