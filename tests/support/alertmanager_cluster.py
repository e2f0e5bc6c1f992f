"""A cluster of two Alertmanagers, started as in docs/notifications.md."""

from testbed import http

PEER_TIMEOUT = 2  # seconds that the second waits for the first, as docs/notifications.md says


def clustered(argv: list[str], mine: str, other: str) -> list[str]:
    """Return the command line of one half; ``mine`` and ``other`` are the cluster addresses."""
    return [
        *(part for part in argv if not part.startswith("--cluster.")),
        f"--cluster.listen-address={mine}",
        f"--cluster.peer={other}",
        f"--cluster.peer-timeout={PEER_TIMEOUT}s",
    ]


def sees_two(address: str) -> bool:
    """Whether the Alertmanager is in a cluster of two and ready."""
    try:
        cluster = http.get_json(address, "/api/v2/status")["cluster"]
    except http.Unanswered:
        return False
    return cluster["status"] == "ready" and len(cluster["peers"]) == 2
