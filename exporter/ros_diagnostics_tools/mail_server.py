"""Where Alertmanager delivers mails: aiosmtpd's server, with limits.

A mail of Alertmanager is small, comes at once, and is the only one of its connection.
"""

from __future__ import annotations

import asyncio
import logging
from typing import Any

from aiosmtpd.controller import Controller
from aiosmtpd.smtp import SMTP

from ros_diagnostics_tools.mail_relay import Relay, end

LARGEST = 2_000_000  # bytes of a mail
CONNECTIONS = 32  # at the same time
IDLE = 60.0  # seconds without a command
LIFETIME = 300.0  # seconds of a connection in all


class _Connection(SMTP):  # type: ignore[misc]  # the library has no types
    """One client. Beyond `CONNECTIONS` the oldest that has no recipients yet is closed."""

    def __init__(self, relay: Relay, opened: dict[_Connection, Any], **limits: Any) -> None:
        self._opened = opened
        super().__init__(relay, **limits)

    def connection_made(self, transport: Any) -> None:
        super().connection_made(transport)
        self._end = asyncio.get_running_loop().call_later(LIFETIME, transport.abort)
        self._opened[self] = transport
        if len(self._opened) > CONNECTIONS:
            idle = (each for each in self._opened if not each.envelope.rcpt_tos)
            self._opened.pop(next(idle)).abort()

    def connection_lost(self, error: Exception | None) -> None:
        self._opened.pop(self, None)
        self._end.cancel()
        asyncio.get_running_loop().run_in_executor(None, end, self.session)
        super().connection_lost(error)


class Server(Controller):  # type: ignore[misc]  # the library has no types
    """Listens for mails, in a thread of its own."""

    def __init__(self, relay: Relay, host: str, port: int) -> None:
        self._opened: dict[_Connection, Any] = {}
        logging.getLogger("mail").setLevel(logging.WARNING)  # else each line of each client
        super().__init__(
            relay,
            hostname=host,
            port=port,
            ready_timeout=30,
            data_size_limit=LARGEST,
            timeout=IDLE,
        )

    def factory(self) -> SMTP:
        """One client's connection."""
        return _Connection(self.handler, self._opened, **self.SMTP_kwargs)
