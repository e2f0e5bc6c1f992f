"""Shortens the durations of the rules, in a test's own copy of them.

`set_durations` changes those in rules/settings.yml. `scale` also divides the length of ranges,
`for` and `interval` by ten.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import yaml

FASTER = 10
MILLISECONDS = {"ms": 1, "s": 1000, "m": 60_000, "h": 3_600_000}
# The length of a range or an offset; not a name or a number that only looks like a duration.
DURATION = re.compile(r"(?:(?<=\[)|(?<=\d[smh]:)|(?<=offset ))(\d+)(ms|s|m|h)\b")
# Durations that are numbers in an expression: file, the rule's record, seconds.
SECONDS = (
    ("values.yml", "component:ros_diagnostics_unseen:count", "600"),
    ("availability.yml", "robot:ros_diagnostics_part_seconds:sum5m", "300"),
)
SCALED = ("states.yml", "alerts.yml", "values.yml", "availability.yml")


def scale(rules: Path, settings: Mapping[str, float]) -> None:
    """Divide the durations of the rules by ten, and set those of settings.yml.

    Args:
        rules: A copy of prometheus/rules.
        settings: As for `set_durations`.

    Raises:
        LookupError: The rules have no such setting or duration any more.
    """
    for name in SCALED:
        edit(rules / name, lambda document, name=name: _scale_file(document, name))
    set_durations(rules, settings)


def set_durations(rules: Path, settings: Mapping[str, float]) -> None:
    """Change settings.yml.

    Args:
        rules: A copy of prometheus/rules.
        settings: Names in settings.yml (`restart_grace`) -> value.

    Raises:
        LookupError: The rules have no such setting any more.
    """
    edit(rules / "settings.yml", lambda document: _set(document, dict(settings)))


def set_scrape_interval(prometheus: Path, seconds: int) -> None:
    """Let a copy of the folder prometheus scrape and evaluate every so many seconds."""
    intervals = {"scrape_interval": f"{seconds}s", "evaluation_interval": f"{seconds}s"}
    edit(prometheus / "prometheus.yml", lambda config: config["global"].update(intervals))


def edit(path: Path, change: Callable[[Any], object]) -> None:
    """Change the content of a YAML file."""
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content, sort_keys=False))


def duration(text: str) -> str:
    """A tenth of a duration, in milliseconds: `1m` -> `6000ms`."""
    found = re.fullmatch(r"(\d+)(ms|s|m|h)", text)
    if found is None:
        raise LookupError(f"{text!r} is not a duration of one unit")
    return f"{int(found[1]) * MILLISECONDS[found[2]] // FASTER}ms"


def expression(text: str) -> str:
    """An expression with a tenth of each range and offset."""
    return DURATION.sub(lambda found: duration(found[0]), text)


def _scale_file(document: dict[str, Any], name: str) -> None:
    for group in document["groups"]:
        if "interval" in group:
            group["interval"] = duration(group["interval"])
        for rule in group["rules"]:
            rule["expr"] = expression(rule["expr"])
            for clock in rule.keys() & {"for", "keep_firing_for"}:
                rule[clock] = duration(rule[clock])
    for file, record, seconds in SECONDS:
        if file == name:
            _scale_number(document, record, seconds)


def _scale_number(document: dict[str, Any], record: str, seconds: str) -> None:
    number = re.compile(rf"(?<![\w.]){seconds}(?![\w.])")
    rules = [rule for group in document["groups"] for rule in group["rules"]]
    found = [r for r in rules if r.get("record") == record and number.search(r["expr"])]
    if len(found) != 1:
        raise LookupError(f"{record}: {len(found)} of its rules have the {seconds} s in seconds")
    found[0]["expr"] = number.sub(str(int(seconds) // FASTER), found[0]["expr"])


def _set(document: dict[str, Any], settings: dict[str, float]) -> None:
    for rule in (rule for group in document["groups"] for rule in group["rules"]):
        name = rule["record"].split(":")[1]
        if name in settings:
            rule["expr"] = f"vector({settings.pop(name)})"
    if settings:
        raise LookupError(f"rules/settings.yml has no {', '.join(settings)} any more")
