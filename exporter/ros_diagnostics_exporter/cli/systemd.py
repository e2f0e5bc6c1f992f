"""Notifies systemd of the service's state, as sd_notify(3) does."""

from __future__ import annotations

import logging
import os
import socket
import time

_log = logging.getLogger(__name__)


def notify(state: str) -> None:
    """Send ``state``, for example ``READY=1``, to $NOTIFY_SOCKET if it is set."""
    path = os.environ.get("NOTIFY_SOCKET", "")
    if not path:
        return
    # "@" stands for the zero byte with which an abstract socket's name starts.
    address = "\0" + path[1:] if path.startswith("@") else path
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sock:
            sock.connect(address)
            sock.sendall(state.encode())
    except OSError as error:
        _log.warning("cannot notify systemd at %s: %s", path, error)


class Watchdog:
    """Notifies systemd that the service works, as often as WatchdogSec= of the unit needs it."""

    def __init__(self) -> None:
        microseconds = os.environ.get("WATCHDOG_USEC", "")
        self._interval = int(microseconds) / 4e6 if microseconds.isdecimal() else None
        self._beaten_at = float("-inf")

    def beat(self) -> None:
        """Notify, unless that was done a moment ago or nobody waits for it."""
        now = time.monotonic()
        if self._interval is not None and now - self._beaten_at >= self._interval:
            self._beaten_at = now
            notify("WATCHDOG=1")
