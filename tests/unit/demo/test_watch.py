"""A program that dies is told of at once, and given up when nobody starts it again."""

from __future__ import annotations

import http.server
import threading

import pytest

from demo.liveness import GoneForGoodError, Watch
from testbed.polling import until
from testbed.processes import Process
from testbed.stack import Server


@pytest.fixture
def sleeper(start_process) -> Process:
    return start_process("sleeper", ["sleep", "600"])


def test_a_living_program_is_no_news(sleeper):
    watch = Watch([Server(sleeper)], patience=20)

    assert list(watch.look(0.0)) == []
    assert watch.all_live
    assert watch.still_gone() == []


def test_a_killed_program_is_told_once_and_given_up_after_the_patience(sleeper):
    watch = Watch([Server(sleeper)], patience=20)
    sleeper.kill()

    told = [*watch.look(100.0), *watch.look(119.0)]

    assert told == ["sleeper was killed by SIGKILL; the demo gives up if it is not back in 20 s"]
    assert not watch.all_live
    with pytest.raises(GoneForGoodError, match="sleeper was killed by SIGKILL and did not come"):
        list(watch.look(120.0))


def test_a_program_started_again_is_back(sleeper):
    watch = Watch([Server(sleeper)], patience=20)
    sleeper.kill()
    list(watch.look(100.0))

    sleeper.start()

    assert list(watch.look(119.0)) == ["sleeper is back"]
    assert watch.all_live


def test_a_program_that_somebody_else_started_at_its_address_is_back(start_process, free_port):
    ended = start_process("exporter", ["sh", "-c", "exit 3"])
    until(lambda: not ended.alive, "its end")

    class Healthy(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.end_headers()

        def log_message(self, *args: object) -> None:
            """Say nothing."""

    port = free_port()
    watch = Watch([Server(ended, f"127.0.0.1:{port}")], patience=20)
    assert list(watch.look(0.0)) == [
        "exporter ended with exit code 3; the demo gives up if it is not back in 20 s"
    ]
    with http.server.HTTPServer(("127.0.0.1", port), Healthy) as other:
        thread = threading.Thread(target=other.serve_forever)
        thread.start()
        told = list(watch.look(1.0))
        other.shutdown()
        thread.join()

    assert told == ["exporter is back"]
