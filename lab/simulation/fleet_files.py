"""fleet.yml files of a few robots, drawn at random from what changes the judgement of faults."""

from __future__ import annotations

from datetime import datetime, timezone
from random import Random
from typing import Any

FLEET = "f"
ROBOTS = ("r1", "r2", "r3")
COMPONENTS = ("Motor", "Lidar A", "Lidar B", "Camera", "Board", "Battery", "Mode")
SHARED = ("Board", "Motor")  # on which others depend
CONDITION = {"component": "Mode", "key": "mode", "equals": "auto"}
RULES: tuple[dict[str, Any], ...] = (
    {"planned_stale": True},
    {"planned_stale": True, "depends_on": ["Board"]},
    *({"depends_on": [name]} for name in SHARED),
    {"levels": {"WARN": "OK"}},
    {"levels": {"ERROR": "WARN"}},
    {"levels": {"STALE": "ERROR"}},
    {"levels": {"ERROR": "WARN", "WARN": "OK"}},
    {"confirm_after": "25s"},
    {"when": CONDITION},
    {"unless": CONDITION},
    {"ignore": True},
    {"reports": "on_change"},
    {"stale_after": "30s"},
)
NEEDS: dict[str, tuple[Any, ...]] = {
    "view": ({"any": ["Lidar A", "Lidar B"]},),
    "driving": (
        {"all": ["Motor", {"component": "Battery", "key": "Charge"}]},
        ["Motor"],
        {"all": ["Motor", "Board"], "when": CONDITION},
        {"all": ["Motor", "Camera"]},
    ),
    "docking": (["Camera"], {"at_least": {"k": 2, "of": ["Camera", "Lidar A", "Lidar B"]}}),
}
THRESHOLDS = (
    {"low": {"warning": 20, "critical": 10}},
    {"low": {"critical": 15}},
    {"low": {"warning": 30}},
    {"high": {"critical": 45}},
)
CHARGED = 40  # beyond none of them


def random_document(random: Random, wall: float, *, discovered: bool) -> dict[str, Any]:
    """A fleet.yml, which may not be valid: two components may depend on each other."""
    places = {name: random.choice(("hall", "hall", "dock")) for name in ROBOTS}
    document: dict[str, Any] = {"fleet": FLEET, "profiles": {"default": _profile(random)}}
    if discovered:
        labels = {"site": places["r1"]}
        found = {"topic": "/{robot}/diagnostics", "source": "raw", "labels": labels}
        document["discovery"] = [found]
    else:
        document["robots"] = [
            {"name": name, "namespace": f"/{name}", "source": "raw", "labels": {"site": site}}
            for name, site in places.items()
        ]
    if "driving" in document["profiles"]["default"]["capabilities"] and random.random() < 0.5:
        two = {"at_least": {"k": 2, "of": [{"can": "driving"}]}}
        document["capabilities"] = {"transport": two}
    larger: dict[str, dict[str, float]] = {
        "many": {"components": random.choice((3, 4)), "share": 0.3},
        "site": {"robots": 2, "share": 0.5},
        "common": {"robots": 2, "share": 0.5},
    }
    document["faults"] = {name: each for name, each in larger.items() if random.random() < 0.5}
    if random.random() < 0.4:
        begin, end = random.choice((-20, 0, 1, 10, 30)), random.choice((40, 60, 90))
        times = {"start": _text(wall + begin), "end": _text(wall + end)}
        selector = {"robot": random.choice(("r1", "*", ["r1", "r2"]))}
        window = {"name": "m", "comment": "c", "selector": selector, **times}
        document["maintenance"] = [window]
    return document


def _profile(random: Random) -> dict[str, Any]:
    rules = [
        {"match": name, **random.choice([each for each in RULES if _may_have(name, each)])}
        for name in random.sample(COMPONENTS[:6], random.randrange(6))
    ]
    capabilities = {name: random.choice(of) for name, of in NEEDS.items() if random.random() < 0.6}
    if "view" in capabilities and random.random() < 0.6:
        capabilities["way finding"] = {"all": [{"capability": "view"}, "Motor"]}
    profile: dict[str, Any] = {
        "stale_after": "8s",
        "confirm_after": random.choice(("10s", "10s", "0s", "20s")),
        "boot_grace": random.choice(("0s", "0s", "20s")),
        "stale_is_critical": random.random() < 0.2,
        "components": rules,
        "capabilities": capabilities,
        "graph": {"mode": "off"},
    }
    if random.random() < 0.6:
        charge = {"component": "Battery", "key": "Charge", "thresholds": random.choice(THRESHOLDS)}
        condition = {random.choice(("when", "unless")): CONDITION} if random.random() < 0.3 else {}
        profile["values"] = [charge | condition]
    if random.random() < 0.4:
        profile["checks"] = {"lidars": {"match": ["Lidar"], "expect": random.choice((2, 3))}}
    return profile


def _may_have(name: str, rule: dict[str, Any]) -> bool:
    return name not in rule.get("depends_on", ())


def _text(wall: float) -> str:
    return datetime.fromtimestamp(int(wall), timezone.utc).isoformat()
