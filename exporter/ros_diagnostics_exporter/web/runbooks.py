"""The runbooks as pages, with the names of what they are about; which is that of a fault."""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Callable, Mapping
from functools import cache
from html import escape
from importlib import resources
from urllib.parse import urlencode

# (scope, state) -> the alert of such a fault, without its prefix; "" is any state of the scope.
_ALERTS = {
    ("component", "critical"): "ComponentCritical",
    ("component", "warning"): "ComponentWarning",
    ("component", "stale"): "ComponentStale",
    ("value", "critical"): "ValueCritical",
    ("value", "warning"): "ValueWarning",
    ("value", "falling"): "ValueFalling",
    ("check", ""): "CheckShort",
    ("capability", "lost"): "CapabilityLost",
    ("capability", "degraded"): "CapabilityDegraded",
    ("capability", "no_reserve"): "CapabilityNoReserve",
    ("flapping", "flapping"): "ComponentFlapping",
    ("flapping", "intermittent"): "ComponentIntermittent",
    ("robot", "many"): "ManyComponents",
    ("robot", "silent"): "RobotSilent",
    ("robot", "pending"): "RobotPending",
    ("robot", "flapping"): "RobotFlapping",
    ("robot", "clock"): "ClockOffset",
    ("site", ""): "FleetPartDown",
    ("common", ""): "CommonCause",
    ("exporter", ""): "ExporterFault",
}
# What a runbook writes for a name: its commands and queries have the names of the fault.
NAMES = ("robot", "component", "check", "site", "instance", "domain", "topic")
_PLACE = re.compile("|".join(rf"\b{name.upper()}\b" for name in NAMES))
_CODE = re.compile(r'(<code(?: class="language-(\w+)")?>)(.*?)</code>', re.DOTALL)


def alert_of(scope: str, state: str) -> str:
    """The alert that fires for a fault, by whose name its runbook is; "" where none does."""
    name = _ALERTS.get((scope, state)) or _ALERTS.get((scope, ""))
    return f"RosDiagnostics{name}" if name else ""


def link_to(alert: str, names: Mapping[str, object]) -> str:
    """The path of a runbook with the names that are known, below ``runbooks/``."""
    known = {name: names[name] for name in NAMES if names.get(name)}
    return f"{alert}?{urlencode(known, errors='replace')}" if known else alert


def filled_in(alert: str, names: Mapping[str, str]) -> str | None:
    """A runbook as HTML, its commands and queries with these names; None if there is none."""
    page = _pages().get(alert)
    return page and _CODE.sub(lambda code: _filled_in(code, names), page)


def _filled_in(code: re.Match[str], names: Mapping[str, str]) -> str:
    quote = _in_promql if code[2] == "promql" else shlex.quote
    text = _PLACE.sub(lambda place: _name(place[0], names, quote), code[3])
    return f"{code[1]}{text}</code>"


def _name(place: str, names: Mapping[str, str], quote: Callable[[str], str]) -> str:
    """The name as it is pasted: not one that could end the line, or that looks like a flag."""
    name = names.get(place.lower(), "")
    fits = name and name.isprintable() and not name.startswith("-")
    return escape(quote(name), quote=False) if fits else place


def _in_promql(name: str) -> str:
    return name.replace("\\", "\\\\").replace('"', '\\"')


@cache
def _pages() -> dict[str, str]:
    text = (resources.files(__package__) / "runbooks.json").read_text("utf-8")
    pages: dict[str, str] = json.loads(text)
    return pages
