"""Processes that run at the same time never get the same domain or port."""

import socket
import subprocess
import sys

import pytest

from testbed import domains

HOLD_A_LEASE = (
    "import sys; from testbed import domains; lease = domains.lease();"
    "print(lease.__enter__(), flush=True); sys.stdin.read()"
)


def test_a_lease_ends_with_the_process_that_was_killed():
    argv = [sys.executable, "-c", HOLD_A_LEASE]
    with subprocess.Popen(argv, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as other:
        taken = int(other.stdout.readline())
        held = domains.claim(f"ros-domain/{taken}")
        other.kill()
        other.wait()
        freed = domains.claim(f"ros-domain/{taken}")

    assert held is None
    assert freed is not None
    freed.close()


def test_a_domain_with_a_participant_without_a_lease_is_skipped(monkeypatch):
    with domains.lease() as domain_id:
        pass
    monkeypatch.setattr(domains, "DOMAINS", range(domain_id, domain_id + 1))
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as participant:
        participant.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        participant.bind(("", 7400 + 250 * domain_id))

        with pytest.raises(RuntimeError, match="in use"), domains.lease():
            pass
