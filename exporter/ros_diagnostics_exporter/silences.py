"""Acknowledgements and downtimes: silences in Alertmanager of escalations, read regularly.

Prometheus does not know silences; what is read here is exported for it. An acknowledgement names
since when the fault has been, so it belongs to that fault and to no later one. A downtime names a
robot, or one component of it, and no fault: nothing of it escalates, and the exporter begins none.
The labels are those of prometheus/rules/escalation.yml. Anybody who reaches Alertmanager may have
made a silence or an alert: one that is not as Alertmanager and the rules make them is skipped.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from contextlib import suppress
from datetime import datetime
from typing import Annotated, Any, NamedTuple, TypeVar

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, ValidationError
from pydantic.alias_generators import to_camel

from ros_diagnostics_exporter.model import Downtime

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
MOST = 1000  # acknowledgements, of which the newest are kept, and downtimes, the next ones
SAME = 1.0  # seconds by which an acknowledgement may differ from when its fault began

# 2026-01-01 10:00:00.123 +0000 UTC as rules print it, 2026-01-01T10:00:00.123Z as Alertmanager does
_MOMENT = re.compile(
    r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(?: \+0000 UTC|Z|([+-]\d\d:\d\d))"
)


def moment(text: str) -> float | None:
    """Unix time of a moment as Prometheus' rules or Alertmanager write it; None of another text."""
    found = _MOMENT.fullmatch(text)
    if found is None:
        return None
    date, time, fraction, offset = found.groups()
    iso = f"{date}T{time}.{((fraction or '') + '000000')[:6]}{offset or '+00:00'}"
    try:
        return datetime.fromisoformat(iso).timestamp()
    except (ValueError, OverflowError):  # the 31st of February
        return None


_SINCE = re.compile(r"since ([^;\n]+)")


def since_text(annotations: Mapping[str, str]) -> str:
    """When the fault of an alert began, as the rules write it; "" where it is of no fault."""
    found = _SINCE.match(annotations.get("evidence", ""))
    return "" if found is None else found[1]


def clean(words: str, length: int) -> str:
    """One line of what a person wrote: nothing unprintable, no longer than ``length``."""
    line = " ".join("".join(each if each.isprintable() else " " for each in words).split())
    return line if len(line) <= length else f"{line[: length - 1]}…"


# -- Alertmanager's JSON, as its api/v2/openapi.yaml describes it ------------------------------


def _moment(text: object) -> float:
    if not isinstance(text, str) or (found := moment(text)) is None:
        raise ValueError("is no moment")
    return found


_Name = Annotated[str, Field(max_length=NAME_LENGTH)]
_Label = Annotated[str, Field(max_length=4 * NAME_LENGTH)]
_Time = Annotated[float, BeforeValidator(_moment)]


class _Model(BaseModel):
    model_config = ConfigDict(alias_generator=to_camel, populate_by_name=True)


class _Status(_Model):
    state: str = ""
    silenced_by: list[str] = []
    inhibited_by: list[str] = []


class _Matcher(_Model):
    name: _Name
    value: _Name
    is_regex: bool = False
    is_equal: bool = True


class Silence(_Model):
    """A silence as Alertmanager lists it."""

    id: str = ""
    status: _Status = _Status()
    matchers: list[_Matcher]
    starts_at: _Time
    ends_at: _Time
    created_by: str
    comment: str

    @property
    def author(self) -> str:
        """Who made it, as others see it."""
        return clean(self.created_by, AUTHOR_LENGTH) or "?"

    @property
    def words(self) -> str:
        """What for, as others see it."""
        return clean(self.comment, COMMENT_LENGTH)

    def exact(self, *, but_steps: bool = False) -> dict[str, str] | None:
        """Label -> value where it asks for just these values; None where it asks otherwise.

        ``but_steps``: but for the steps of an escalation that an acknowledgement leaves out.
        """
        asked = [m for m in self.matchers if not but_steps or m.name != "step" or m.is_equal]
        named = {each.name: each.value for each in asked}
        is_exact = all(each.is_equal and not each.is_regex for each in asked)
        return named if is_exact and len(named) == len(asked) else None


class _Receiver(_Model):
    name: str


class Alert(_Model):
    """An alert as Alertmanager lists it."""

    labels: Annotated[dict[_Label, _Label], Field(max_length=100)]
    annotations: Annotated[dict[_Label, str], Field(max_length=100)] = {}
    starts_at: _Time = 0.0
    fingerprint: str = ""
    status: _Status = _Status()
    receivers: list[_Receiver] = []


Kind = TypeVar("Kind", Silence, Alert)


def valid(kind: type[Kind], answer: Any) -> list[Kind]:
    """Those of an answer that are as Alertmanager makes them.

    Raises:
        ValueError: It is no list.
    """
    if not isinstance(answer, list):
        raise ValueError(f"it answered no list of {kind.__name__.lower()}s")  # noqa: TRY004
    known: list[Kind] = []
    for each in answer:
        with suppress(ValidationError):
            known.append(kind.model_validate(each))
    return known


# -- what silences mean --------------------------------------------------------------------------


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


def read(silences: Iterable[Silence], fleet: str) -> list[Acknowledgement]:
    """The acknowledgements of a fleet among silences, the newest last."""
    found = filter(None, (_acknowledgement(each, fleet) for each in silences))
    return sorted(found, key=lambda each: each.at)[-MOST:]


def _acknowledgement(silence: Silence, fleet: str) -> Acknowledgement | None:
    named = silence.exact(but_steps=True) or {}
    wanted = named.pop("alertname", ""), named.get("fleet"), silence.status.state
    since = moment(named.pop("since", ""))
    is_of_fault = {"scope", "state"} <= named.keys() <= set(IDENTITY)
    if wanted != (ESCALATION, fleet, "active") or since is None or not is_of_fault:
        return None
    who, times = (silence.author, silence.words), (silence.starts_at, silence.ends_at)
    return Acknowledgement(identity_of(named), since, *who, *times)


def read_downtimes(silences: Iterable[Silence], fleet: str) -> list[Downtime]:
    """The downtimes of a fleet among silences, of which some may lie ahead."""
    found = filter(None, (downtime_of(each, fleet) for each in silences))
    # None of them is over, so the first to begin are those in force, then the next ones.
    return sorted(found, key=lambda each: each.start)[:MOST]


def downtime_matchers(fleet: str, robot: str, component: str) -> dict[str, str]:
    """What the silence of a downtime matches, label -> value; ``component`` "" for all."""
    part = {"component": component} if component else {}
    return {"alertname": ESCALATION, DOWNTIME: "", "fleet": fleet, "robot": robot, **part}


def downtime_of(silence: Silence, fleet: str | None = None) -> Downtime | None:
    """The downtime that a silence is; None for any other, for another fleet's, and one over."""
    named = silence.exact() or {}
    robot, component = named.get("robot", ""), named.get("component", "")
    wanted = downtime_matchers(named.get("fleet", "") if fleet is None else fleet, robot, component)
    if named != wanted or not robot or silence.status.state not in {"active", "pending"}:
        return None
    times = silence.starts_at, silence.ends_at
    return Downtime(robot, component, *times, silence.author, silence.words)


def read_forgotten(silences: Iterable[Silence], fleet: str) -> list[Forgotten]:
    """What was forgotten of a fleet, by silences that say so."""
    return [*filter(None, (_forgotten(each, fleet) for each in silences))][:MOST]


def forgotten_matchers(fleet: str, robot: str, component: str, at: str) -> dict[str, str]:
    """What the silence of something forgotten matches, label -> value; ``at`` is a moment."""
    part = {"component": component} if component else {}
    marks = {"alertname": ESCALATION, "of": FORGOTTEN, "since": at}
    return {**marks, "fleet": fleet, "robot": robot, **part}


def _forgotten(silence: Silence, fleet: str) -> Forgotten | None:
    named = silence.exact() or {}
    robot, component, since = (named.get(name, "") for name in ("robot", "component", "since"))
    at = moment(since)
    is_wanted = named == forgotten_matchers(fleet, robot, component, since)
    if not is_wanted or silence.status.state != "active" or at is None:
        return None
    return Forgotten(robot, component, at)
