"""A history of the simulation for real programs: scenario, fleet.yml, the subjects of mails.

A tick of the simulation, a minute, is two seconds here: thirty times as fast. So are fleet.yml's
durations; Prometheus' and Alertmanager's configuration is as shipped.
"""

from collections import Counter
from collections.abc import Iterator
from datetime import datetime, timezone
from typing import Any

import yaml

from ros_diagnostics_exporter.faults.model import Identity
from simulation.hours import Ledger
from simulation.story import (
    COMPONENTS,
    ERROR,
    OK,
    STALE,
    TICK,
    WARN,
    Event,
    Story,
    robot_name,
    site_of,
)
from simulation.world import (
    BATTERY,
    CONFIRM_AFTER,
    FLAP_INTERVAL,
    GRACE,
    LOW,
    PENDING_AFTER,
    SETTINGS,
    STALE_AFTER,
)

FASTER = 30
SECONDS = TICK / FASTER  # of a tick
START = 20.0  # seconds from the robots' start to the history's; all are OK by then
ACTS = {"restart", "maintenance", "declared"}  # what happens to the exporter, not to robots
KIND = {
    "description": "ten components of the simulation",
    "components": [
        {
            "name": name,
            "error": "failed",
            "warn": "worn",
            "variables": {"charge": {"walk": 0, "start": 80, "low": 60, "high": 100}},
            "values": {"charge": "{charge:.1f}"} if name == BATTERY else {},
            "faults": {f"charge_{to}": {"drive": "charge", "to": to, "over": 1} for to in (5, 15)},
        }
        for name in COMPONENTS
    ],
    "analyzers": "simulated.analyzers.yaml",
}
_GROUP = {"type": "diagnostic_aggregator/GenericAnalyzer", "path": "g", "contains": ["part"]}
ANALYZERS = {"/**": {"ros__parameters": {"pub_rate": 1.0, "g": {**_GROUP, "timeout": 3.0}}}}
_WORDS = {OK: "ok", WARN: "warn", ERROR: "error", STALE: "stale"}


# -- robots ------------------------------------------------------------------------------------


def scenario(story: Story, kind: str) -> str:
    """The scenario of the virtual robots, of the kind in the file ``kind``."""
    names = [robot_name(number) for number in range(story.robots)]
    events = [*_of_parts(story), *_of_presence(story)]
    return yaml.safe_dump(
        {
            "robots": [{"kind": kind, "name": name} for name in names],
            "events": sorted(events, key=lambda each: each["at"]),
        }
    )


def _of_parts(story: Story) -> Iterator[dict[str, Any]]:
    """What components report: their level, or nothing while they are mute."""
    levels: dict[tuple[str, str], str] = {}
    mute: set[tuple[str, str]] = set()
    for event in story.events:
        part = event.who, str(event.how[0]) if event.how else ""
        if event.what == "level":
            levels[part] = _WORDS[int(str(event.how[1]))]
        elif event.what == "mute":
            (mute.add if event.how[1] else mute.discard)(part)
        elif event.what == "charge":
            charge = float(str(event.how[0]))
            part = event.who, BATTERY
            levels[part] = f"charge_{charge:.0f}" if charge < LOW["warning"] else "ok"
        else:
            continue
        what = "silent" if part in mute else levels.get(part, "ok")
        yield {"at": _at(event), "robot": part[0], "component": part[1], "what": what}


def _of_presence(story: Story) -> Iterator[dict[str, Any]]:
    """When robots publish nothing: switched off, or their site cut off."""
    gone: dict[str, set[str]] = {}
    for event in story.events:
        if event.what not in {"off", "partition"}:
            continue
        names = map(robot_name, range(story.robots))
        robots = [name for name in names if event.who in (name, site_of(name))]
        for name in robots:
            reasons = gone.setdefault(name, set())
            before = bool(reasons)
            (reasons.add if event.how[0] else reasons.discard)(event.what)
            if bool(reasons) != before:
                what = "hang" if reasons else "resume"
                yield {"at": _at(event), "robot": name, "what": what}


def _at(event: Event) -> float:
    return START + event.at * SECONDS


# -- exporter ----------------------------------------------------------------------------------


def fleet_config(story: Story, domain_id: int, done: list[tuple[Event, float]]) -> str:
    """fleet.yml after these events happened, each with its Unix time."""
    undeclared = {each.who for each, _at in done if each.what == "declared" and not each.how[0]}
    undeclared -= {each.who for each, _at in done if each.what == "declared" and each.how[0]}
    windows = [_window(each, at) for each, at in done if each.what == "maintenance"]
    thresholds = {"low": dict(LOW)}
    return yaml.safe_dump(
        {
            "fleet": "f",
            "profiles": {
                "default": {
                    "stale_after": _shorter(STALE_AFTER),
                    "confirm_after": _shorter(CONFIRM_AFTER),
                    "flap_interval": _shorter(FLAP_INTERVAL),
                    "values": [{"key": "charge", "thresholds": thresholds}],
                }
            },
            "robots": [
                _robot(number, domain_id)
                for number in range(story.robots)
                if robot_name(number) not in undeclared
            ],
            "faults": {
                "restart_grace": _shorter(GRACE),
                "confirm_after": _shorter(SETTINGS.confirm_after),
                "pending_after": _shorter(PENDING_AFTER),
                "site": {"robots": SETTINGS.site.number, "share": SETTINGS.site.share},
            },
            "maintenance": windows,
        }
    )


def _robot(number: int, domain_id: int) -> dict[str, Any]:
    name = robot_name(number)
    return {
        "name": name,
        "namespace": f"/{name}",
        "domain_id": domain_id,
        "source": "agg" if number % 2 else "raw",
        "labels": {"site": site_of(name)},
    }


def _window(event: Event, at: float) -> dict[str, Any]:
    """A maintenance window, which has whole seconds in fleet.yml."""
    end = at + int(str(event.how[0])) * SECONDS
    start, until = (
        datetime.fromtimestamp(each, timezone.utc).isoformat(timespec="seconds")
        for each in (at, end)
    )
    selector = {"site": event.who}
    return {
        "name": f"m{event.at}", "selector": selector, "comment": "w", "start": start, "end": until,
    }  # fmt: skip


def _shorter(seconds: float) -> str:
    return f"{seconds / FASTER * 1000:.0f}ms"


# -- mails -------------------------------------------------------------------------------------


def subjects(ledger: Ledger) -> Counter[str]:
    """The subjects of the simulation's mails."""
    found: Counter[str] = Counter()
    for (what, key), count in ledger.items():
        found[_subject(what, Identity(*key))] += count  # type: ignore[arg-type]
    return found


def _subject(what: str, identity: Identity) -> str:
    about = f"f/{' '.join(filter(None, (identity.robot, identity.component, identity.key)))}"
    if identity.scope == "site":
        about = f"f site {identity.site}"
    elif identity.scope == "common":
        about = f"f {identity.component} of many robots"
    if what == "REMOVED":
        return f"** REMOVED ** {about} is no longer monitored"
    ended = what == "RECOVERY"
    if identity.state == "flapping":
        return f"** FLAPPING ** {about} {'stopped' if ended else 'started'} flapping"
    state = identity.state.value.upper()
    if identity.scope == "value":
        state += f": too {identity.bound}"
    elif identity.state == "many":
        state = f"{identity.severity.upper()} in many components"
    elif identity.state == "pending":
        state += ": never received"
    return f"** {what} ** {about} is {'no longer ' if ended else ''}{state}"
