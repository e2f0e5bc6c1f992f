"""Whose connection it is, and whose is closed first when there are too many.

A client that makes no progress is closed before one that does, one that has not logged in before
one that has, and where one address has more than its share, its connections are closed before all
others'. So whoever opens connections without end closes their own.
"""

from __future__ import annotations

import ipaddress
from collections import Counter
from collections.abc import Callable

from ros_diagnostics_exporter.web.protocol import GuardedProtocol

LEAST = 5  # connections, however few files there are
SHARE = 10  # a client may have a tenth of all connections before its own are closed first


def address_of(host: str) -> str:
    """The client that ``host`` (an IP address) counts as: IPv6 by its /64, which one host owns."""
    try:
        address = ipaddress.ip_address(host.partition("%")[0])
    except ValueError:
        return host
    if isinstance(address, ipaddress.IPv4Address):
        return str(address)
    if address.ipv4_mapped is not None:  # from a socket that listens on both
        return str(address.ipv4_mapped)
    return str(ipaddress.ip_network((address, 64), strict=False))


class Connections:
    """All open connections, TLS handshakes included; never more than ``limit``."""

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self._open: set[GuardedProtocol] = set()

    def __len__(self) -> int:
        """How many there are."""
        return len(self._open)

    def add(self, connection: GuardedProtocol) -> None:
        """Count a new connection; if there are too many, another one is closed."""
        while self._open and len(self._open) >= self.limit:
            self.close_worst()
        self._open.add(connection)

    def discard(self, connection: GuardedProtocol) -> None:
        """A connection has ended."""
        self._open.discard(connection)

    def shrink(self) -> None:
        """There are more than the process can hold: from now on allow fewer than now."""
        self.limit = max(LEAST, len(self._open) - 2)
        while len(self._open) > self.limit:
            self.close_worst()

    def close_worst(self) -> None:
        """Close the connection that is the last in the order."""
        worst = max(self._open, key=self.order())
        self._open.discard(worst)  # now: the loop may accept many more before it closes it
        worst.abort()

    def order(self) -> Callable[[GuardedProtocol], tuple[bool, int, bool, float]]:
        """A key to sort connections by: the last one is to be closed first."""
        number = Counter(each.address for each in self._open)
        share = self.limit // SHARE
        return lambda each: (
            not each.known,
            max(0, number[each.address] - share),
            each.pipelines,  # of a busy server's clients, who keeps it busy
            each.waited(),
        )
