"""ROS domains, leased to one run at a time: runs do not see one another's robots."""

from __future__ import annotations

import os
import socket
from collections.abc import Iterator
from contextlib import contextmanager

from testbed.locks import claim

# Above 101 the UDP ports of a domain overlap with Linux' ephemeral ports (ROS 2 documentation,
# "The ROS_DOMAIN_ID").
DOMAINS = range(1, 102)


@contextmanager
def lease() -> Iterator[int]:
    """Yield a ROS domain id that no other lease holds and no participant on this machine uses.

    Raises:
        RuntimeError: All domains are taken.
    """
    for domain_id in _rotated():
        holder = claim(f"ros-domain/{domain_id}")
        if holder is None:
            continue
        with holder:
            if not _in_use(domain_id):
                yield domain_id
                return
    raise RuntimeError(f"all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use")


# UDP, as between machines. With the range LOCALHOST rmw_fastrtps takes shared memory too, whatever
# FASTDDS_BUILTIN_TRANSPORTS says; there an exporter that got no CPU for seconds once stayed deaf.
BETWEEN_MACHINES = {"ROS_AUTOMATIC_DISCOVERY_RANGE": "SUBNET"}


def environment(domain_id: int) -> dict[str, str]:
    """Return this process' environment for a program that uses ROS on this machine only.

    UDP is asked for, because Fast DDS' shared memory outlives a killed process; within the range
    LOCALHOST it is used all the same. Variables that lead to another network (a discovery server,
    a user's profile) are removed.
    """
    removed = {
        "CYCLONEDDS_URI",
        "FASTDDS_DEFAULT_PROFILES_FILE",
        "FASTRTPS_DEFAULT_PROFILES_FILE",
        "ROS_DISCOVERY_SERVER",
        "ROS_LOCALHOST_ONLY",  # where set, it overrules the discovery range
        "ROS_STATIC_PEERS",
    }
    kept = {name: value for name, value in os.environ.items() if name not in removed}
    return kept | {
        "ROS_DOMAIN_ID": str(domain_id),
        "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
        "FASTDDS_BUILTIN_TRANSPORTS": "UDPv4",
    }


def _rotated() -> list[int]:
    """Return all domains, from a start that differs between processes."""
    first = os.getpid() % len(DOMAINS)
    return [*DOMAINS[first:], *DOMAINS[:first]]


def _in_use(domain_id: int) -> bool:
    """Return whether a participant without a lease is in the domain.

    Each binds the domain's discovery port, 7400 + 250 x domain (RTPS 2.2, section 9.6.1.1), shared
    with others of its kind; a socket that does not share can only have it while none is there.
    """
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        try:
            probe.bind(("", 7400 + 250 * domain_id))
        except OSError:
            return True
    return False
