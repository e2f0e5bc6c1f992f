"""Listen addresses as Prometheus' exporters take them: ``host:port``, ``:port``, ``[::1]:port``."""

from __future__ import annotations

import contextlib
import socket
from collections.abc import Sequence

BACKLOG = 1024


class ListenError(OSError):
    """An address cannot be listened on; the text names it and the way out."""


class AddressError(ListenError):
    """What should be an address is none."""


def bind_all(addresses: Sequence[str]) -> list[socket.socket]:
    """Listening sockets for all ``addresses``, or for none.

    Raises:
        ListenError: The first address that cannot be listened on.
    """
    with contextlib.ExitStack() as opened:
        sockets = [opened.enter_context(bind(address)) for address in addresses]
        opened.pop_all()
    return sockets


def bind(address: str) -> socket.socket:
    """A listening socket for ``address``; without a host on all interfaces, IPv6 and IPv4.

    Raises:
        ListenError: The address is malformed, unknown here, or taken.
    """
    host, port = parse_address(address)
    try:
        return _bind_everywhere(port) if host in {"", "::"} else _bind_one(host, port)
    except (OSError, UnicodeError) as error:  # UnicodeError: no host can have that name
        why = getattr(error, "strerror", None) or error
        raise ListenError(
            f"cannot listen on {address}: {why}; stop the program that holds the port, or choose "
            "another with --web.listen-address"
        ) from error


def parse_address(address: str) -> tuple[str, int]:
    """``host:port`` in its two parts; brackets around an IPv6 host are taken off.

    Raises:
        AddressError: There is no port, or the host is an IPv6 address without brackets.
    """
    host, colon, port = address.rpartition(":")
    bare = host[1:-1] if host.startswith("[") and host.endswith("]") else host
    if not colon or not port.isascii() or not port.isdigit() or int(port) > 65535:
        raise AddressError(
            f"listen address {address!r} has no port 0..65535; write host:port, :port or [::1]:port"
        )
    if ":" in host and bare == host:
        raise AddressError(f"listen address {address!r} has an IPv6 host; write it as [host]:port")
    return bare, int(port)


def name_of(sock: socket.socket) -> str:
    """The address that ``sock`` really listens on, as ``host:port``."""
    host, port = sock.getsockname()[:2]
    return f"[{host}]:{port}" if ":" in host else f"{host}:{port}"


def _bind_everywhere(port: int) -> socket.socket:
    if socket.has_dualstack_ipv6():
        return socket.create_server(
            ("::", port), family=socket.AF_INET6, dualstack_ipv6=True, backlog=BACKLOG
        )
    return socket.create_server(("", port), backlog=BACKLOG)


def _bind_one(host: str, port: int) -> socket.socket:
    found = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE)
    # A name with addresses of both families (localhost) means the IPv4 one, as in Go.
    family, *_, where = min(found, key=lambda each: each[0] != socket.AF_INET)
    return socket.create_server(where[:2], family=family, backlog=BACKLOG)
