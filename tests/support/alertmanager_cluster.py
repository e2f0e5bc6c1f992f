"""Two Alertmanagers that know each other, as docs/notifications.md says to start them."""

from __future__ import annotations

from testbed import http as asking

PEER_TIMEOUT = 2  # seconds that the second waits for the first to have mailed


def clustered(argv: list[str], mine: str, other: str) -> list[str]:
    """Return the command line of one that talks to the other at these addresses."""
    return [
        *(part for part in argv if not part.startswith("--cluster.")),
        f"--cluster.listen-address={mine}",
        f"--cluster.peer={other}",
        f"--cluster.peer-timeout={PEER_TIMEOUT}s",
    ]


def sees_two(address: str) -> bool:
    """Whether it has found the other and settled."""
    try:
        cluster = asking.get_json(address, "/api/v2/status")["cluster"]
    except asking.Unanswered:
        return False
    return cluster["status"] == "ready" and len(cluster["peers"]) == 2
