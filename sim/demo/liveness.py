"""Whether all programs of the road live, and when to give up on one that does not."""

from __future__ import annotations

import signal
from collections.abc import Iterator, Sequence

from testbed.stack import Server


class GoneForGoodError(Exception):
    """A program ended and nobody started it again in time."""


class Watch:
    """Looks after the programs; restarts none: the reader may want to see what comes of it."""

    def __init__(self, servers: Sequence[Server], patience: float) -> None:
        """Give a program that has ended ``patience`` seconds to be started again by hand."""
        self._servers = servers
        self._patience = patience
        self._gone_since: dict[str, float] = {}

    @property
    def all_live(self) -> bool:
        """Whether all lived at the last look."""
        return not self._gone_since

    def look(self, now: float) -> Iterator[str]:
        """Yield a sentence for each program that has ended or come back since the last look.

        Args:
            now: Monotonic seconds.

        Raises:
            GoneForGoodError: One has been gone for longer than the patience.
        """
        for server in self._servers:
            if server.lives():
                if self._gone_since.pop(server.name, None) is not None:
                    yield f"{server.name} is back"
                continue
            if server.name not in self._gone_since:
                self._gone_since[server.name] = now
                yield f"{_how(server)}; the demo gives up if it is not back in {self._patience:g} s"
            if now - self._gone_since[server.name] >= self._patience:
                raise GoneForGoodError(f"{_how(server)} and did not come back")

    def still_gone(self) -> list[str]:
        """Return a sentence for each program that does not live now."""
        return [_how(server) for server in self._servers if not server.lives()]


def _how(server: Server) -> str:
    code = server.process.exit_code
    if code is not None and code < 0:
        return f"{server.name} was killed by {signal.Signals(-code).name}"
    return f"{server.name} ended with exit code {code}"
