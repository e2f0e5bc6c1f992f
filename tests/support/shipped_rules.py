"""The shipped rules and their tools."""

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import yaml

from ros_diagnostics_exporter.durations import parse as parse_duration
from support.called import called

ROOT = Path(__file__).resolve().parents[2]
PROMETHEUS = ROOT / "prometheus"
ALERTMANAGER = ROOT / "alertmanager"
RULE_FILES = sorted((PROMETHEUS / "rules").glob("*.yml"))  # of a site
CENTRE_RULE_FILES = sorted((PROMETHEUS / "centre" / "rules").glob("*.yml"))
PROMTOOL_TESTS = sorted((PROMETHEUS / "tests").glob("*.yml"))


@cache
def read_yaml(file: Path) -> Any:
    """What a shipped file has; not to be changed. Dozens of tests ask for each."""
    return yaml.load(file.read_bytes(), yaml.CSafeLoader)


def run_tool(name: str, *arguments: object, stdin: str = "") -> str:
    """Run promtool or amtool (`./run test` installs them); return what it printed to stdout."""
    return called([name, *map(str, arguments)], input=stdin, timeout=250).stdout


def rules() -> Iterator[dict[str, Any]]:
    """Every rule of every shipped file, in order; those of the centre last."""
    for file in (*RULE_FILES, *CENTRE_RULE_FILES):
        for group in read_yaml(file)["groups"]:
            yield from group["rules"]


def alerts() -> dict[str, list[dict[str, Any]]]:
    """The alerting rules by name; one name may have several rules."""
    found: dict[str, list[dict[str, Any]]] = {}
    for rule in rules():
        if "alert" in rule:
            found.setdefault(rule["alert"], []).append(rule)
    return found


def seconds_to_notify() -> dict[str, float]:
    """Each shipped clock between a confirmed fault and its mail, and how long it waits at most."""
    config = read_yaml(PROMETHEUS / "prometheus.yml")
    jobs = {each["job_name"]: each for each in config["scrape_configs"]}
    groups = read_yaml(PROMETHEUS / "rules" / "faults.yml")["groups"]
    route = read_yaml(ALERTMANAGER / "alertmanager.yml")["route"]
    return {
        "scrape_interval": parse_duration(jobs["ros-diagnostics-faults"]["scrape_interval"]),
        "evaluation interval": max(parse_duration(each["interval"]) for each in groups),
        "group_wait": parse_duration(route["group_wait"]),
    }
