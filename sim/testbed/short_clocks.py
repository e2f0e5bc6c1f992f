"""Shortens the clocks of Prometheus' configuration and rules, in a test's own copy of them.

`set_interval` lets it scrape and evaluate as often as a test wants. `scale` divides the length of
ranges, offsets, `for` and the long intervals by ten.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import yaml

FASTER = 10
MILLISECONDS = {"ms": 1, "s": 1000, "m": 60_000, "h": 3_600_000, "d": 86_400_000}
# The length of a range or an offset; not a name or a number that only looks like a duration.
DURATION = re.compile(r"(?:(?<=\[)|(?<=\d[smhd]:)|(?<=offset ))(\d+)(ms|s|m|h|d)\b")
# Seconds that are numbers in an expression: file, the rule's name, as shipped, scaled.
SECONDS = (
    ("availability.yml", "robot:ros_diagnostics_part_seconds:sum5m", "300", "30"),
    ("monitoring.yml", "RosDiagnosticsLimitHit", "600", "60"),
    ("pairs.yml", "exporter_fault:ros_diagnostics_fault:missed", "300", "30"),
)
FILES = ("faults", "pairs", "states", "availability", "monitoring")
SCALED = tuple(f"{name}.yml" for name in FILES)
SLOTS = (  # they count the evaluations of states.yml
    "robot:ros_diagnostics_part_seconds:sum5m",
    "capability:ros_diagnostics_part_seconds:sum5m",
)


def scale(rules: Path) -> None:
    """Divide the durations of the rules in the folder ``rules`` by ten, but for short intervals.

    Raises:
        LookupError: The rules have no such duration any more.
    """
    for name in SCALED:
        edit(rules / name, partial(_scale_file, name=name))


def set_interval(prometheus: Path, seconds: int) -> None:
    """Let a copy of the folder prometheus scrape and evaluate every so many seconds."""
    edit(prometheus / "prometheus.yml", lambda config: _set_scrapes(config, f"{seconds}s"))
    for path in (prometheus / "rules").glob("*.yml"):
        edit(path, lambda document: _set_intervals(document, seconds))
    for slot in SLOTS:
        change = partial(_set_number, name=slot, shipped="10", wanted=str(seconds))
        edit(prometheus / "rules" / "availability.yml", change)


def set_escalation(rules: Path, after: Mapping[str, str]) -> None:
    """Change the `for` of escalation.yml's alerts: step -> duration."""

    def change(document: dict[str, Any]) -> None:
        for rule in document["groups"][0]["rules"]:
            step = rule.get("labels", {}).get("step")
            if step in after:
                rule["for"] = after[step]

    edit(rules / "escalation.yml", change)


def edit(path: Path, change: Callable[[Any], object]) -> None:
    """Change the content of a YAML file."""
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content, sort_keys=False))


def duration(text: str) -> str:
    """A tenth of a duration, in milliseconds: `1m` -> `6000ms`."""
    return f"{_milliseconds(text) // FASTER}ms"


def expression(text: str) -> str:
    """An expression with a tenth of each range and offset."""
    return DURATION.sub(lambda found: duration(found[0]), text)


def _milliseconds(text: str) -> int:
    found = re.fullmatch(r"(\d+)(ms|s|m|h|d)", text)
    if found is None:
        raise LookupError(f"{text!r} is not a duration of one unit")
    return int(found[1]) * MILLISECONDS[found[2]]


def _set_scrapes(config: dict[str, Any], interval: str) -> None:
    config["global"].update(scrape_interval=interval, evaluation_interval=interval)
    for job in config["scrape_configs"]:
        job.pop("scrape_interval", None)


def _set_intervals(document: dict[str, Any], seconds: int) -> None:
    """Intervals of a minute at most become ``seconds``."""
    for group in document["groups"]:
        if _milliseconds(group["interval"]) <= MILLISECONDS["m"]:
            group["interval"] = f"{seconds}s"


def _scale_file(document: dict[str, Any], name: str) -> None:
    for group in document["groups"]:
        if _milliseconds(group["interval"]) >= MILLISECONDS["m"]:
            group["interval"] = duration(group["interval"])
        for rule in group["rules"]:
            rule["expr"] = expression(rule["expr"])
            for clock in rule.keys() & {"for", "keep_firing_for"}:
                rule[clock] = duration(rule[clock])
    for file, rule_name, shipped, scaled in SECONDS:
        if file == name:
            _set_number(document, rule_name, shipped, scaled)


def _set_number(document: dict[str, Any], name: str, shipped: str, wanted: str) -> None:
    number = re.compile(rf"(?<![\w.]){shipped}(?![\w.])")
    rules = [rule for group in document["groups"] for rule in group["rules"]]
    named = [rule for rule in rules if name in (rule.get("record"), rule.get("alert"))]
    found = [rule for rule in named if number.search(rule["expr"])]
    if len(found) != 1:
        raise LookupError(f"{name}: {len(found)} of its rules have the number {shipped}")
    found[0]["expr"] = number.sub(wanted, found[0]["expr"])
