"""A whole fleet.yml for each key that there is, with the example that its description has."""

from collections.abc import Callable
from typing import Any

from config_schema import schema
from ros_diagnostics_exporter.config.fleet import Fleet

FLEET = schema(Fleet)

# The required keys of each kind of entry, and its place in fleet.yml.
DOWNTIME = {"name": "x", "comment": "x", "selector": {"robot": "*"}}
PROFILE = {"default": {}, "turtlebot4": {}, "wheeled": {}, "arm": {}}
LIFTING = {"default": {"capabilities": {"lifting": ["Lift"]}}}


def default(**keys: Any) -> dict[str, Any]:
    """A file whose profile has these keys."""
    return {"profiles": {"default": keys}}


def needed(entry: dict[str, Any], needs: dict[str, Any], *keys: str) -> dict[str, Any]:
    """What an entry needs that has none of these keys."""
    return {} if {*keys} & {*entry} else needs


def condition(entry: dict[str, Any]) -> dict[str, Any]:
    """A condition that has these keys, and what it needs beside them."""
    limits = {"equals", "below", "above"} & {*entry}
    return {
        **needed(entry, {"component": "x"}, "key"),
        **({"key": "x"} if limits else {}),
        **({"equals": "x"} if "key" in entry else {}),
        **needed(entry, {"level": "OK"}, "key", "equals", "below", "above"),
        **entry,
    }


WHOLE: dict[str, Callable[[dict[str, Any]], dict[str, Any]]] = {
    "Fleet": lambda entry: entry,
    "Robot": lambda entry: {"robots": [{"name": "r", **entry}]},
    "Discovery": lambda entry: {"discovery": [entry]},
    "Shared": lambda entry: {"shared": [{"topic": "/diagnostics", **entry}]},
    "Profile": lambda entry: {"profiles": {**PROFILE, "x": entry}},
    "Check": lambda entry: default(checks={"x": entry}),
    "ComponentRule": lambda entry: default(
        components=[
            {"match": "x", **({"reports": "on_change"} if "ends_after" in entry else {}), **entry}
        ]
    ),
    "Condition": lambda entry: default(components=[{"match": "x", "unless": condition(entry)}]),
    "ValueRule": lambda entry: default(
        values=[{**({"thresholds": {}} if {"when", "unless"} & {*entry} else {}), **entry}]
    ),
    "TopicEntry": lambda entry: default(
        topics=[
            {
                "topic": "t",
                "component": "c",
                **needed(entry, {"field": "data"}, "field", "fields"),
                **({"field": "data"} if {"levels", "error_when"} & {*entry} else {}),
                **entry,
            }
        ]
    ),
    "Capability": lambda entry: default(
        capabilities={
            "front view": ["Camera"],
            "x": {**needed(entry, {"all": "Motor"}, "all", "any", "at_least"), **entry},
        }
    ),
    "FleetCapability": lambda entry: {
        "profiles": LIFTING,
        "capabilities": {
            "x": {**needed(entry, {"all": [{"can": "lifting"}]}, "all", "any", "at_least"), **entry}
        },
    },
    "Thresholds": lambda entry: default(values=[{"thresholds": entry}]),
    "Bound": lambda entry: default(values=[{"thresholds": {"low": entry}}]),
    "FaultSettings": lambda entry: {"faults": entry},
    "Flapping": lambda entry: {"faults": {"flapping": entry}},
    "Intermittent": lambda entry: {"faults": {"intermittent": entry}},
    "RecordingSettings": lambda entry: {"recordings": entry},
    "Falling": lambda entry: {"faults": {"falling": entry}},
    "Many": lambda entry: {"faults": {"many": entry}},
    "Site": lambda entry: {"faults": {"site": entry}},
    "Common": lambda entry: {"faults": {"common": entry}},
    "WarningHours": lambda entry: {
        "faults": {"warning_hours": {"weekly": ["daily 06:00-18:00"], **entry}}
    },
    "Graph": lambda entry: default(graph=entry),
    "Watched": lambda entry: default(graph={"watch": entry}),
    "ActionRule": lambda entry: default(actions=[{"match": "x", **entry}]),
    "TooMany": lambda entry: default(
        actions=[{"match": "x", "started": {**needed(entry, {"critical": 9}, "critical"), **entry}}]
    ),
    "Modes": lambda entry: default(
        modes={"component": "x", "key": "x", "autonomous": "x", **entry}
    ),
    "Limits": lambda entry: {"limits": entry},
    "Query": lambda entry: {"queries": [{"expr": "up", "component": "c", **entry}]},
    "Zenoh": lambda entry: {
        "zenoh": {
            "routers": ["tcp/a:7447"],
            **({"password_file": "/x"} if "user" in entry else {}),
            **({"user": "x"} if "password_file" in entry else {}),
            **({"key_file": "/x"} if "cert_file" in entry else {}),
            **({"cert_file": "/x"} if "key_file" in entry else {}),
            **entry,
        }
    },
    "Maintenance": lambda entry: {
        "maintenance": [{**DOWNTIME, **needed(entry, {"start": "2026-01-01"}, "end"), **entry}]
    },
}
DEFINITIONS = {"Fleet": FLEET, **FLEET["definitions"]}
PROPERTIES = [
    (name, key) for name, definition in DEFINITIONS.items() for key in definition["properties"]
]


def whole(name: str, entry: dict[str, Any]) -> dict[str, Any]:
    """A fleet.yml that loads, with an entry of this class that has these keys."""
    if name == "Discovery" and "type" not in entry:
        entry = {"topic": "/x" if "zenoh" in entry else "/{robot}/diagnostics", **entry}
    made = {"fleet": "x", **WHOLE[name](entry)}
    if name == "Fleet" and "capabilities" in entry and "profiles" not in entry:
        made["profiles"] = LIFTING
    if name in {"Robot", "Discovery", "Shared"} and "zenoh" in entry:
        made["zenoh"] = {"routers": ["tcp/a:7447"]}
    if "profiles" not in made:
        made["profiles"] = PROFILE
    return made
