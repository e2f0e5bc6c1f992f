"""Whether all programs run, and when to give up on one that does not."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence

from testbed.servers import Server


class ProgramEndedError(Exception):
    """A program ended and nobody started it again in time."""


class Liveness:
    """Checks the programs; it restarts none, so that the reader sees what the others do."""

    def __init__(self, servers: Sequence[Server], patience: float) -> None:
        """A program that has ended may be started again by hand within ``patience`` seconds."""
        self._servers = servers
        self._patience = patience
        self._down_since: dict[str, float] = {}

    @property
    def all_up(self) -> bool:
        """Whether all were up at the last check."""
        return not self._down_since

    def check(self, now: float) -> Iterator[str]:
        """Yield a line for each program that has ended or is back since the last check.

        Args:
            now: Monotonic seconds.

        Raises:
            ProgramEndedError: One has been down for longer than ``patience``.
        """
        for server in self._servers:
            if server.is_up():
                if self._down_since.pop(server.name, None) is not None:
                    yield f"{server.name} is back"
                continue
            if server.name not in self._down_since:
                self._down_since[server.name] = now
                yield f"{_how(server)}; the demo gives up if it is not back in {self._patience:g} s"
            if now - self._down_since[server.name] >= self._patience:
                raise ProgramEndedError(f"{_how(server)} and did not come back")

    def down(self) -> list[str]:
        """Return a line for each program that is not up now."""
        return [_how(server) for server in self._servers if not server.is_up()]


def _how(server: Server) -> str:
    code = server.process.exit_code
    if code is not None and code < 0:
        return f"{server.name} was killed by {signal.Signals(-code).name}"
    return f"{server.name} ended with exit code {code}"
