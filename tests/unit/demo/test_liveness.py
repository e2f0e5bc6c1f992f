"""A program that ends is reported at once, and ends the demo if nobody starts it again."""

import pytest

from demo.liveness import Liveness, ProgramEndedError
from support.loopback import replying
from testbed.polling import until
from testbed.processes import Process
from testbed.servers import Server


@pytest.fixture
def sleeper(start_process) -> Process:
    return start_process("sleeper", ["sleep", "600"])


def test_a_killed_program_is_reported_once_and_an_error_after_the_patience(sleeper):
    liveness = Liveness([Server(sleeper)], patience=20)
    sleeper.kill()

    lines = [*liveness.check(100.0), *liveness.check(119.0)]

    assert lines == ["sleeper was killed by SIGKILL; the demo gives up if it is not back in 20 s"]
    assert not liveness.all_up
    with pytest.raises(ProgramEndedError, match="sleeper was killed by SIGKILL and did not come"):
        list(liveness.check(120.0))


def test_a_program_started_again_is_back(sleeper):
    liveness = Liveness([Server(sleeper)], patience=20)
    sleeper.kill()
    list(liveness.check(100.0))

    sleeper.start()

    assert list(liveness.check(119.0)) == ["sleeper is back"]
    assert liveness.all_up


def test_a_program_that_somebody_else_started_at_its_address_is_back(start_process, free_port):
    ended = start_process("exporter", ["sh", "-c", "exit 3"])
    until(lambda: not ended.alive, "its end")

    port = free_port()
    liveness = Liveness([Server(ended, f"127.0.0.1:{port}")], patience=20)
    assert list(liveness.check(0.0)) == [
        "exporter ended with exit code 3; the demo gives up if it is not back in 20 s"
    ]
    with replying(lambda _request: b"", port):
        assert list(liveness.check(1.0)) == ["exporter is back"]
