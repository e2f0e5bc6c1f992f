"""Asks Alertmanager for the acknowledgements of a fleet, again and again.

Prometheus does not know of silences; what is found here is exported for it. Alertmanager may be
away, broken or hostile: then what was known holds on, and ``answers`` says that it is not fresh.
``look`` may block for a while and belongs into a thread of its own; all else answers at once.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from pathlib import Path
from urllib.parse import urlencode

from ros_diagnostics_exporter import acknowledgement
from ros_diagnostics_exporter.acknowledgement import ESCALATION, Acknowledgement
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.model import Instant

log = logging.getLogger(__name__)


class Alertmanager:
    """One Alertmanager, or the halves of a pair, of which the first that answers is believed."""

    INTERVAL = 5.0  # seconds between two looks
    TIMEOUT = 5.0  # seconds that an answer may take
    FRESH = 20.0  # seconds after which an answer is old: a look that hangs is no answer
    SIZE = 4 * 1024 * 1024  # bytes; some thousand silences

    def __init__(
        self,
        urls: Sequence[str],
        *,
        user: str | None = None,
        password_file: Path | None = None,
        ca_file: Path | None = None,
    ) -> None:
        self._ways = [
            Client(
                url, timeout=self.TIMEOUT, user=user, password_file=password_file, ca_file=ca_file
            )
            for url in urls
        ]
        self._acknowledgements: list[Acknowledgement] = []
        self._answered_at = float("-inf")
        self._answers: bool | None = None  # None: has not been asked

    def known(self, wall: float) -> list[Acknowledgement]:
        """The acknowledgements that hold at this Unix time, as far as is known."""
        return [each for each in self._acknowledgements if each.at <= wall < each.until]

    def answers(self, now: Instant) -> bool:
        """Whether what is known is fresh."""
        return bool(self._answers) and now.mono - self._answered_at < self.FRESH

    def look(self, fleet: str, now: Instant) -> None:
        """Ask once; log when it stops and when it begins to answer."""
        whys: list[str] = []
        for way in self._ways:
            answer = _ask(way, fleet, self.SIZE)
            if isinstance(answer, str):
                whys.append(answer)
                continue
            if not self._answers:
                log.info("acknowledgements are read from Alertmanager at %s", way.url)
            self._acknowledgements = answer
            self._answers, self._answered_at = True, now.mono
            return
        if self._answers is not False:
            log.error("no acknowledgements: Alertmanager does not answer: %s", "; ".join(whys))
        self._answers = False


def _ask(way: Client, fleet: str, size: int) -> list[Acknowledgement] | str:
    """The acknowledgements, or why there is no answer."""
    wanted = [("filter", f'alertname="{ESCALATION}"'), ("filter", f'fleet="{_escaped(fleet)}"')]
    try:
        silences = way.get(f"/api/v2/silences?{urlencode(wanted)}", limit=size)
        return acknowledgement.read(silences, fleet)
    except UnreachableError as error:
        return str(error)
    except ValueError as error:
        return f"{way.url} is not an Alertmanager: {error}"


def _escaped(value: str) -> str:
    return value.replace("\\", "\\\\").replace('"', '\\"').replace("\n", "\\n")
