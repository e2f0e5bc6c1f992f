"""Asks Alertmanager for silences and alerts, and makes silences."""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import quote, urlencode

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.model import Downtime, Instant
from ros_diagnostics_exporter.silences import (
    ESCALATION,
    Acknowledgement,
    Alert,
    Forgotten,
    Silence,
    clean,
    read,
    read_downtimes,
    read_forgotten,
    valid,
)
from ros_diagnostics_exporter.texts import escape

log = logging.getLogger(__name__)

EXPLAINED = 50  # alerts of a robot, and silences
SENTENCE_LENGTH = 1000
_PARTS = ("component", "check", "key", "step")  # what an alert is about
_Answer = TypeVar("_Answer")
_UUID = re.compile(r"[0-9a-f-]{36}")


class Alertmanager:
    """One Alertmanager, or a cluster, of which the first that answers is used."""

    INTERVAL = 5.0  # seconds between two requests
    TIMEOUT = 5.0  # seconds that an answer may take
    FRESH = 20.0  # seconds after which an answer is old, as when a request hangs
    SIZE = 4 * 1024 * 1024  # bytes; some thousand silences
    FIRING_SIZE = 32 * 1024 * 1024  # bytes; some ten thousand alerts

    def __init__(
        self,
        urls: Sequence[str],
        *,
        user: str | None = None,
        password_file: Path | None = None,
        ca_file: Path | None = None,
    ) -> None:
        self._clients = [
            Client(
                url, timeout=self.TIMEOUT, user=user, password_file=password_file, ca_file=ca_file
            )
            for url in urls
        ]
        self._acknowledgements: list[Acknowledgement] = []
        # Those that are planned, present and future ones; None before the first answer.
        self.downtimes: list[Downtime] | None = None
        self.forgotten: list[Forgotten] = []
        self._answered_at = float("-inf")
        self._answers: bool | None = None  # None: has not been asked

    def known(self, wall: float) -> list[Acknowledgement]:
        """The acknowledgements in force at this Unix time."""
        return [each for each in self._acknowledgements if each.at <= wall < each.until]

    def answers(self, now: Instant) -> bool:
        """Whether the last successful request is fresh."""
        return bool(self._answers) and now.mono - self._answered_at < self.FRESH

    def explain(self, fleet: str, robot: str, component: str | None) -> list[str]:
        """Of each alert of a robot now: to whom it is sent, or what inhibits or who silences it.

        Raises:
            UnreachableError: No Alertmanager answers.
        """
        labels = {"fleet": fleet, "robot": robot, "component": component}
        return self._first(lambda client: _explain(client, labels, self.SIZE))[1]

    def firing(self, fleet: str) -> list[Alert]:
        """The alerts of a fleet's faults that fire, silenced and inhibited ones too.

        Raises:
            UnreachableError: No Alertmanager answers.
        """
        return self._first(lambda client: _faults(client, fleet, self.FIRING_SIZE))[1]

    def alerts(self, fleet: str) -> list[Alert]:
        """All alerts of a fleet that fire.

        Raises:
            UnreachableError: No Alertmanager answers.
        """
        return self._first(lambda client: _alerts(client, {"fleet": fleet}, self.FIRING_SIZE))[1]

    def silences(self, fleet: str) -> list[Silence]:
        """The silences of a fleet's escalations, that are as Alertmanager makes them.

        Raises:
            UnreachableError: No Alertmanager answers.
        """
        return self._first(lambda client: _silences(client, fleet, self.SIZE))[1]

    def add(self, silence: dict[str, Any]) -> None:
        """Make a silence.

        Raises:
            UnreachableError: No Alertmanager answers, or it rejects the silence.
        """
        self._first(lambda client: client.post("/api/v2/silences", silence))

    def end(self, silence: str) -> None:
        """End a silence of this id, or never begin it.

        Raises:
            UnreachableError: No Alertmanager answers, or it rejects that.
        """
        path = f"/api/v2/silence/{quote(silence, safe='')}"
        self._first(lambda client: client.delete(path))

    def update(self, fleet: str, now: Instant) -> None:
        """Request the silences once; log when Alertmanager stops and starts to answer."""
        try:
            url, silences = self._first(lambda client: _silences(client, fleet, self.SIZE))
        except UnreachableError as error:
            if self._answers is not False:
                log.error(
                    "acknowledgements and downtimes are not followed: Alertmanager does not "
                    "answer: %s",
                    error,
                )
            self._answers = False
            return
        if not self._answers:
            log.info("acknowledgements and downtimes are read from Alertmanager at %s", url)
        self._acknowledgements = read(silences, fleet)
        self.downtimes = read_downtimes(silences, fleet)
        self.forgotten = read_forgotten(silences, fleet)
        self._answers, self._answered_at = True, now.mono

    def _first(self, ask: Callable[[Client], _Answer]) -> tuple[str, _Answer]:
        """The URL of the first that answers, and its answer.

        Raises:
            UnreachableError: None does; the text says why of each.
        """
        whys: list[str] = []
        for client in self._clients:
            try:
                return client.url, ask(client)
            except UnreachableError as error:  # noqa: PERF203 - of each, until one answers
                whys.append(str(error))
            except ValueError as error:
                whys.append(f"{client.url} is not an Alertmanager: {error!s:.120}")
        raise UnreachableError("; ".join(whys))


def _silences(client: Client, fleet: str, size: int) -> list[Silence]:
    wanted = [("filter", f'alertname="{ESCALATION}"'), ("filter", f'fleet="{escape(fleet)}"')]
    return valid(Silence, client.get(f"/api/v2/silences?{urlencode(wanted)}", limit=size))


def _faults(client: Client, fleet: str, size: int) -> list[Alert]:
    filters = (f'fleet="{escape(fleet)}"', f'alertname!="{ESCALATION}"', 'scope!=""', 'state!=""')
    wanted = urlencode([("filter", each) for each in filters])
    return valid(Alert, client.get(f"/api/v2/alerts?{wanted}", limit=size))


def _explain(client: Client, labels: Mapping[str, str | None], size: int) -> list[str]:
    """A sentence for each alert with these labels; those that are None may be any."""
    alerts = _alerts(client, labels, size)[:EXPLAINED]
    known = {each.fingerprint: each for each in alerts}
    inhibiting = {name for each in alerts for name in each.status.inhibited_by}
    if inhibiting - known.keys():  # one of no robot
        of_fleet = _alerts(client, {"fleet": labels["fleet"]}, size)
        known |= {each.fingerprint: each for each in of_fleet}
    silencing = {name for each in alerts for name in each.status.silenced_by[:EXPLAINED]}
    silences = {name: _silence(client, name, size) for name in sorted(silencing)[:EXPLAINED]}
    return [_about(each, known, silences) for each in alerts]


def _alerts(client: Client, labels: Mapping[str, str | None], size: int) -> list[Alert]:
    """The alerts with these labels; those that are None may be any."""
    wanted = [("filter", f'{key}="{escape(text)}"') for key, text in labels.items() if text]
    return valid(Alert, client.get(f"/api/v2/alerts?{urlencode(wanted)}", limit=size))


def _silence(client: Client, name: str, size: int) -> str:
    """Who made a silence, why, and until when."""
    if _UUID.fullmatch(name) is None:
        raise ValueError(f"{name!r:.60} is no silence")
    found = valid(Silence, [client.get(f"/api/v2/silence/{name}", limit=size)])
    if not found:
        return name
    end = datetime.fromtimestamp(found[0].ends_at, timezone.utc)
    return f"{found[0].author} until {end:%Y-%m-%d %H:%M} UTC: {found[0].words}"


def _about(alert: Alert, known: Mapping[str, Alert], silences: Mapping[str, str]) -> str:
    """One alert, and what became of it."""
    status = alert.status
    silenced = [f"silenced by {silences.get(name, name)}" for name in status.silenced_by]
    inhibited = [
        f"inhibited by {_named(known[name]) if name in known else name}"
        for name in status.inhibited_by
    ]
    receivers = ", ".join(each.name for each in alert.receivers)
    fate = "; ".join(silenced + inhibited) or f"{status.state}, for {receivers}"
    return clean(f"alert {_named(alert)}: {fate}", SENTENCE_LENGTH)


def _named(alert: Alert) -> str:
    """An alert by its name, and what it is about."""
    labels = alert.labels
    names = ("alertname", "robot" if labels.get("robot") else "site", *_PARTS)
    return " ".join(labels[name] for name in names if labels.get(name))


def explained(
    alertmanager: Alertmanager | None, fleet: str, robot: str, component: str | None
) -> list[str]:
    """What Alertmanager says of the alerts of a robot, or of a component; or why nothing."""
    if alertmanager is None:
        return ["Alertmanager is not asked: the exporter runs without --alertmanager.url"]
    try:
        found = alertmanager.explain(fleet, robot, component)
    except UnreachableError as error:
        return [f"Alertmanager does not answer: {error}"]
    return found or ["Alertmanager has no alert about it now"]
