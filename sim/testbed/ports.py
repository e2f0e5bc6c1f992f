"""TCP ports on 127.0.0.1 for the servers that demo and tests start."""

from __future__ import annotations

import random
import socket

from testbed.locks import claim

# Above Linux' ephemeral ports (to 60999), so that no outgoing connection takes one in the meantime.
PORTS = range(61_000, 65_000)


def free_port() -> int:
    """Return a free port, reserved for this process until it ends.

    Raises:
        RuntimeError: All ports are taken.
    """
    for port in random.sample(PORTS, len(PORTS)):
        holder = claim(f"tcp-port/{port}")
        if holder is None:
            continue
        if _is_free(port):
            holder.detach()  # stays open, and the port reserved, until this process ends
            return port
        holder.close()
    raise RuntimeError(f"all TCP ports from {PORTS[0]} to {PORTS[-1]} are in use")


def _is_free(port: int) -> bool:
    with socket.socket(socket.AF_INET, socket.SOCK_STREAM) as probe:
        try:
            probe.bind(("127.0.0.1", port))
        except OSError:
            return False
    return True
