"""Acknowledgements and downtimes: silences in Alertmanager of escalations, read regularly.

Prometheus does not know silences; what is read here is exported for it. An acknowledgement names
since when the fault has been, so it belongs to that fault and to no later one. A downtime names a
robot, or one component of it, and no fault: nothing of it escalates, and the exporter begins none.
The labels are those of prometheus/rules/escalation.yml; the silences as in
https://github.com/prometheus/alertmanager/blob/v0.25.0/api/v2/openapi.yaml.
"""

from __future__ import annotations

import logging
import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from datetime import datetime
from pathlib import Path
from typing import Any, NamedTuple, TypeVar
from urllib.parse import quote, urlencode

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.model import Downtime, Instant
from ros_diagnostics_exporter.texts import escape

log = logging.getLogger(__name__)

ESCALATION = "RosDiagnosticsUnacknowledged"
# A label that no alert has: the matcher `downtime=""` is always true, and marks a downtime.
DOWNTIME = "downtime"
# The label `of` of an escalation names an alert, and none has this name: it matches no escalation.
FORGOTTEN = "forgotten"
# What identifies a fault; `since` distinguishes it from the next one of the same part.
IDENTITY = (
    *("fleet", "scope", "state", "severity", "site"),
    *("robot", "group", "component", "check", "key", "bound"),
)

# Anybody who reaches Alertmanager may have written these texts.
AUTHOR_LENGTH = 64
COMMENT_LENGTH = 200
NAME_LENGTH = 1024  # of a robot or a component
SENTENCE_LENGTH = 1000
EXPLAINED = 50  # alerts of a robot, and silences
MOST = 1000  # acknowledgements, of which the newest are kept, and downtimes, the next ones
SAME = 1.0  # seconds by which an acknowledgement may differ from when its fault began

# 2026-01-01 10:00:00.123 +0000 UTC as rules print it, 2026-01-01T10:00:00.123Z as Alertmanager does
_MOMENT = re.compile(
    r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(?: \+0000 UTC|Z|([+-]\d\d:\d\d))"
)
_PARTS = ("component", "check", "key", "step")  # what an alert is about
_Answer = TypeVar("_Answer")
_UUID = re.compile(r"[0-9a-f-]{36}")


def identity_of(labels: Mapping[str, str]) -> tuple[str, ...]:
    """Which fault these labels name, as comparable texts; what does not apply is ""."""
    return tuple(labels.get(name, "") for name in IDENTITY)


class Acknowledgement(NamedTuple):
    """Somebody takes care of one fault; times are Unix times.

    ``fault`` is its `identity_of`. ``since`` is when the fault began, ``at`` when it was
    acknowledged, ``until`` when that ends at the latest.
    """

    fault: tuple[str, ...]
    since: float
    author: str
    comment: str
    at: float
    until: float

    def is_of(self, since: float) -> bool:
        """Whether it is of the fault that began then, not of an earlier or later one."""
        return abs(self.since - since) <= SAME


class Forgotten(NamedTuple):
    """A person had an exporter forget a robot, or a component of it, at a Unix time."""

    robot: str
    component: str  # "": all of the robot
    at: float


def read_forgotten(silences: Any, fleet: str) -> list[Forgotten]:
    """What was forgotten of a fleet, by Alertmanager's silences; others are skipped, as by `read`.

    Raises:
        ValueError: The response is no list of silences.
    """
    listed = _listed(silences, "silences")
    return [each for silence in listed if (each := _forgotten(silence, fleet)) is not None][:MOST]


def forgotten_matchers(fleet: str, robot: str, component: str, at: str) -> dict[str, str]:
    """What the silence of something forgotten matches, label -> value; ``at`` is a moment."""
    part = {"component": component} if component else {}
    marks = {"alertname": ESCALATION, "of": FORGOTTEN, "since": at}
    return {**marks, "fleet": fleet, "robot": robot, **part}


def _forgotten(silence: Any, fleet: str) -> Forgotten | None:
    try:
        named = _matched(silence["matchers"]) or {}
        robot, component, since = named["robot"], named.get("component", ""), named["since"]
        is_active = silence["status"]["state"] == "active"
        if not is_active or named != forgotten_matchers(fleet, robot, component, since):
            return None
        return Forgotten(robot, component, moment(since))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None  # no silence as exporters make them


def read_downtimes(silences: Any, fleet: str) -> list[Downtime]:
    """The downtimes of a fleet among Alertmanager's silences, of which some may lie ahead.

    Other silences, those of other fleets and invalid ones are skipped, as by `read`.

    Raises:
        ValueError: The response is no list of silences.
    """
    listed = _listed(silences, "silences")
    found = [each for silence in listed if (each := downtime_of(silence, fleet)) is not None]
    # None of them is over, so the first to begin are those in force, then the next ones.
    return sorted(found, key=lambda each: each.start)[:MOST]


def downtime_matchers(fleet: str, robot: str, component: str) -> dict[str, str]:
    """What the silence of a downtime matches, label -> value; ``component`` "" for all."""
    of = {"component": component} if component else {}
    return {"alertname": ESCALATION, DOWNTIME: "", "fleet": fleet, "robot": robot, **of}


def silence(
    matchers: Mapping[str, str], start: datetime, end: datetime, author: str, comment: str
) -> dict[str, Any]:
    """A silence as Alertmanager's API takes it; ``matchers`` label -> just this value."""
    return {
        "matchers": [
            {"name": name, "value": value, "isRegex": False, "isEqual": True}
            for name, value in matchers.items()
        ],
        "startsAt": start.isoformat(),
        "endsAt": end.isoformat(),
        "createdBy": author,
        "comment": comment,
    }


def downtime_of(silence: Any, fleet: str | None = None) -> Downtime | None:
    """The downtime that a silence is; None for any other, for another fleet's, and one over."""
    try:
        if silence["status"]["state"] not in {"active", "pending"}:
            return None
        named = _matched(silence["matchers"]) or {}
        robot, component = named["robot"], named.get("component", "")
        wanted = downtime_matchers(named["fleet"] if fleet is None else fleet, robot, component)
        if named != wanted or not robot:
            return None
        return Downtime(
            robot,
            component,
            moment(silence["startsAt"]),
            moment(silence["endsAt"]),
            clean(silence["createdBy"], AUTHOR_LENGTH) or "?",
            clean(silence["comment"], COMMENT_LENGTH),
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None  # no silence as Alertmanager makes them


def read(silences: Any, fleet: str) -> list[Acknowledgement]:
    """The acknowledgements of a fleet among Alertmanager's silences, the newest last.

    Other silences, those of other fleets and invalid ones are skipped: anybody who reaches
    Alertmanager may have made them.

    Raises:
        ValueError: The response is no list of silences.
    """
    listed = _listed(silences, "silences")
    found = [each for silence in listed if (each := _one(silence, fleet)) is not None]
    return sorted(found, key=lambda each: each.at)[-MOST:]


def _listed(answer: Any, what: str) -> list[Any]:
    if not isinstance(answer, list):
        raise ValueError(f"it answered no list of {what}")  # noqa: TRY004 - no bug of the caller
    return answer


def _one(silence: Any, fleet: str) -> Acknowledgement | None:
    try:
        if silence["status"]["state"] != "active":
            return None
        named = _matched(without_sent_steps(silence["matchers"]))
        if named is None or (named.pop("alertname"), named["fleet"]) != (ESCALATION, fleet):
            return None
        since = moment(named.pop("since"))
        if not {"scope", "state"} <= named.keys() <= set(IDENTITY):
            return None
        return Acknowledgement(
            identity_of(named),
            since=since,
            author=clean(silence["createdBy"], AUTHOR_LENGTH) or "?",
            comment=clean(silence["comment"], COMMENT_LENGTH),
            at=moment(silence["startsAt"]),
            until=moment(silence["endsAt"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None  # no silence as Alertmanager makes them


def without_sent_steps(matchers: Iterable[Mapping[str, Any]]) -> list[Mapping[str, Any]]:
    """The matchers but that for steps of escalation an acknowledgement leaves out."""
    return [each for each in matchers if each["name"] != "step" or each.get("isEqual", True)]


def _matched(matchers: Iterable[Mapping[str, Any]]) -> dict[str, str] | None:
    """Label -> value where a silence asks for just these values; None where it asks otherwise."""
    named: dict[str, str] = {}
    for each in matchers:
        name, value = each["name"], each["value"]
        if each["isRegex"] or not each.get("isEqual", True) or name in named:
            return None
        if not isinstance(value, str) or len(value) > NAME_LENGTH:
            return None
        value.encode()  # lone surrogates, which two names could share when shown, raise an error
        named[name] = value
    return named


def moment(text: str) -> float:
    """Unix time of a moment as Prometheus' rules or Alertmanager write it.

    Raises:
        ValueError: It is none.
    """
    found = _MOMENT.fullmatch(text)
    if found is None:
        raise ValueError(f"{text!r} is no moment")
    date, time, fraction, offset = found.groups()
    fraction = ((fraction or "") + "000000")[:6]
    return datetime.fromisoformat(f"{date}T{time}.{fraction}{offset or '+00:00'}").timestamp()


def clean(words: str, length: int) -> str:
    """One line of what a person wrote: nothing unprintable, no longer than ``length``."""
    line = " ".join("".join(each if each.isprintable() else " " for each in words).split())
    return line if len(line) <= length else f"{line[: length - 1]}…"


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

    def firing(self, fleet: str) -> list[Any]:
        """The alerts of a fleet's faults that fire, silenced and inhibited ones too.

        Raises:
            UnreachableError: No Alertmanager answers.
        """
        return self._first(lambda client: _faults(client, fleet, self.FIRING_SIZE))[1]

    def alerts(self, fleet: str) -> list[Any]:
        """All alerts of a fleet that fire.

        Raises:
            UnreachableError: No Alertmanager answers.
        """
        return self._first(lambda client: _alerts(client, {"fleet": fleet}, self.FIRING_SIZE))[1]

    def silences(self, fleet: str) -> list[Any]:
        """The silences of a fleet's escalations, as Alertmanager lists them.

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
            url, answer = self._first(lambda client: _ask(client, fleet, self.SIZE))
        except UnreachableError as error:
            if self._answers is not False:
                log.error(
                    "no acknowledgements and downtimes: Alertmanager does not answer: %s", error
                )
            self._answers = False
            return
        if not self._answers:
            log.info("acknowledgements and downtimes are read from Alertmanager at %s", url)
        self._acknowledgements, self.downtimes, self.forgotten = answer
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
            except (KeyError, TypeError, AttributeError) as error:
                whys.append(f"{client.url} is not an Alertmanager: {error!r:.120}")
        raise UnreachableError("; ".join(whys))


def _ask(
    client: Client, fleet: str, size: int
) -> tuple[list[Acknowledgement], list[Downtime], list[Forgotten]]:
    """The acknowledgements, the downtimes, and what people had forgotten."""
    silences = _silences(client, fleet, size)
    return read(silences, fleet), read_downtimes(silences, fleet), read_forgotten(silences, fleet)


def _silences(client: Client, fleet: str, size: int) -> list[Any]:
    wanted = [("filter", f'alertname="{ESCALATION}"'), ("filter", f'fleet="{escape(fleet)}"')]
    return _listed(client.get(f"/api/v2/silences?{urlencode(wanted)}", limit=size), "silences")


def _faults(client: Client, fleet: str, size: int) -> list[Any]:
    filters = (f'fleet="{escape(fleet)}"', f'alertname!="{ESCALATION}"', 'scope!=""', 'state!=""')
    wanted = urlencode([("filter", each) for each in filters])
    return _listed(client.get(f"/api/v2/alerts?{wanted}", limit=size), "alerts")


def _explain(client: Client, labels: Mapping[str, str | None], size: int) -> list[str]:
    """A sentence for each alert with these labels; those that are None may be any."""
    alerts = _alerts(client, labels, size)[:EXPLAINED]
    known = {each["fingerprint"]: each for each in alerts}
    inhibiting = {name for each in alerts for name in each["status"]["inhibitedBy"]}
    if inhibiting - known.keys():  # one of no robot
        of_fleet = _alerts(client, {"fleet": labels["fleet"]}, size)
        known |= {each["fingerprint"]: each for each in of_fleet}
    silencing = {name for each in alerts for name in each["status"]["silencedBy"][:EXPLAINED]}
    silences = {name: _silence(client, name, size) for name in sorted(silencing)[:EXPLAINED]}
    return [_about(each, known, silences) for each in alerts]


def _alerts(client: Client, labels: Mapping[str, str | None], size: int) -> list[dict[str, Any]]:
    """The alerts with these labels; those that are None may be any."""
    wanted = [("filter", f'{key}="{escape(text)}"') for key, text in labels.items() if text]
    return _listed(client.get(f"/api/v2/alerts?{urlencode(wanted)}", limit=size), "alerts")


def _silence(client: Client, name: str, size: int) -> str:
    """Who made a silence, why, and until when."""
    if _UUID.fullmatch(name) is None:
        raise ValueError(f"{name!r:.60} is no silence")
    found = client.get(f"/api/v2/silence/{name}", limit=size)
    author, comment = found["createdBy"], found["comment"]
    end = clean(found["endsAt"], NAME_LENGTH)[:16].replace("T", " ")
    return f"{clean(author, AUTHOR_LENGTH)} until {end} UTC: {clean(comment, COMMENT_LENGTH)}"


def _about(
    alert: Mapping[str, Any], known: Mapping[str, Mapping[str, Any]], silences: Mapping[str, str]
) -> str:
    """One alert, and what became of it."""
    status = alert["status"]
    silenced = [f"silenced by {silences.get(name, name)}" for name in status["silencedBy"]]
    inhibited = [
        f"inhibited by {_named(known[name]) if name in known else name}"
        for name in status["inhibitedBy"]
    ]
    receivers = ", ".join(each["name"] for each in alert["receivers"])
    fate = "; ".join(silenced + inhibited) or f"{status['state']}, for {receivers}"
    return clean(f"alert {_named(alert)}: {fate}", SENTENCE_LENGTH)


def _named(alert: Mapping[str, Any]) -> str:
    """An alert by its name, and what it is about."""
    labels = alert["labels"]
    names = ("robot" if labels.get("robot") else "site", *_PARTS)
    return " ".join([labels["alertname"], *(labels[name] for name in names if labels.get(name))])


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
    return found or ["Alertmanager has no alert of it now"]
