"""The sockets of a .socket unit: systemd listens, and passes them when it starts the service.

Source: sd_listen_fds(3). Prometheus' exporter-toolkit has the same flag.
"""

from __future__ import annotations

import os
import socket

from ros_diagnostics_exporter.web.server import ListenError

FLAG = "--web.systemd-socket"
_FIRST = 3  # SD_LISTEN_FDS_START


def passed_sockets() -> list[socket.socket]:
    """The sockets that this process was started with; they are not passed on.

    Raises:
        ListenError: There are none, or one is no TCP socket.
    """
    number, process = (os.environ.pop(name, "") for name in ("LISTEN_FDS", "LISTEN_PID"))
    if process != str(os.getpid()) or not number.isdecimal() or int(number) == 0:
        remedy = "start ros-diagnostics-exporter.socket in place of the service, or omit the flag"
        raise ListenError(f"{FLAG}: systemd has passed no socket; {remedy}")
    return [_passed(_FIRST + each) for each in range(int(number))]


def _passed(descriptor: int) -> socket.socket:
    os.set_inheritable(descriptor, False)
    try:
        found = socket.socket(fileno=descriptor)
    except OSError as error:
        raise ListenError(f"{FLAG}: file {descriptor} is no socket: {error.strerror}") from error
    if found.family not in (socket.AF_INET, socket.AF_INET6) or found.type != socket.SOCK_STREAM:
        raise ListenError(f"{FLAG}: a socket is not TCP; write ListenStream=9877 into the unit")
    found.setblocking(True)
    return found
