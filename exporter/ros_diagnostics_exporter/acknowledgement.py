"""What an acknowledgement is: a silence in Alertmanager of one fault's escalation.

It names since when the fault has been, so it belongs to that fault and to no later one. Knows the
labels that prometheus/rules/escalation.yml gives and Alertmanager's silences
(https://github.com/prometheus/alertmanager/blob/v0.25.0/api/v2/openapi.yaml); asks nobody.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from datetime import datetime
from typing import Any, NamedTuple

ESCALATION = "RosDiagnosticsUnacknowledged"
# What tells one fault from all others; `since` tells it from the next one of the same component.
IDENTITY = ("fleet", "robot", "group", "component", "state")
ALL = {"alertname", "since", "of", *IDENTITY}

# What a page or a label bears of words that anybody who reaches Alertmanager may have written.
AUTHOR_LENGTH = 64
COMMENT_LENGTH = 200
NAME_LENGTH = 1024  # what is longer is no robot and no component
MOST = 1000  # acknowledgements; the newest are kept

# 2026-01-01 10:00:00.123 +0000 UTC as rules print it, 2026-01-01T10:00:00.123Z as Alertmanager does
_MOMENT = re.compile(
    r"(\d{4}-\d\d-\d\d)[T ](\d\d:\d\d:\d\d)(?:\.(\d{1,9}))?(?: \+0000 UTC|Z|([+-]\d\d:\d\d))"
)


class Acknowledgement(NamedTuple):
    """Somebody takes care of one fault; times are Unix times.

    ``group``, ``component`` and ``state`` are empty where a whole robot is silent. ``since`` is
    when the fault began, ``at`` when it was acknowledged, ``until`` when that ends at the latest.
    """

    robot: str
    group: str
    component: str
    state: str
    since: float
    author: str
    comment: str
    at: float
    until: float


def read(silences: Any, fleet: str) -> list[Acknowledgement]:
    """The acknowledgements of a fleet among Alertmanager's silences, for each fault the newest.

    Silences that are something else, belong to another fleet or make no sense are passed over:
    whoever reaches Alertmanager may have made them.

    Raises:
        ValueError: What was answered is no list of silences.
    """
    if not isinstance(silences, list):
        raise ValueError("it answered no list of silences")  # noqa: TRY004 - no bug of the caller
    found = [each for silence in silences if (each := _one(silence, fleet)) is not None]
    found.sort(key=lambda each: each.at)
    newest = {(each.robot, each.group, each.component, each.state): each for each in found[-MOST:]}
    return list(newest.values())


def _one(silence: Any, fleet: str) -> Acknowledgement | None:
    try:
        if silence["status"]["state"] != "active":
            return None
        named = _matched(silence["matchers"])
        if named is None or (named["alertname"], named["fleet"]) != (ESCALATION, fleet):
            return None
        whole_robot = named.get("of") == "robot"
        if whole_robot == ("component" in named):
            return None
        return Acknowledgement(
            named["robot"],
            named.get("group", ""),
            named.get("component", ""),
            named.get("state", ""),
            since=moment(named["since"]),
            author=clean(silence["createdBy"], AUTHOR_LENGTH) or "?",
            comment=clean(silence["comment"], COMMENT_LENGTH),
            at=moment(silence["startsAt"]),
            until=moment(silence["endsAt"]),
        )
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError):
        return None  # no silence as Alertmanager makes them


def _matched(matchers: Iterable[Mapping[str, Any]]) -> dict[str, str] | None:
    """Label -> value where a silence asks for just these values; None where it asks otherwise."""
    named: dict[str, str] = {}
    for each in matchers:
        name, value = each["name"], each["value"]
        if each["isRegex"] or not each.get("isEqual", True) or name not in ALL:
            return None
        if not isinstance(value, str) or len(value) > NAME_LENGTH:
            return None
        value.encode()  # lone surrogates, which two names could share when shown, are refused
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
