"""The fleets of the scenarios: their robots, their fleet.yml and the durations.

All robots are in one process and one ROS domain. Each fleet has its own exporter, so that the
scenarios in which an exporter or half of a fleet stops do not disturb the others.
"""

from pathlib import Path
from typing import Any

import yaml

INTERVAL = 2  # seconds, of scrapes and evaluations

FAULTS = {
    "restart_grace": "10s",
    "pending_after": "40s",
    "confirm_after": "6s",
    "intermittent": {"within": "1m"},
    "falling": {"over": "90s", "ahead": "10m"},
}
DURATIONS = {"stale_after": "5s", "confirm_after": "6s", "flap_interval": "1s"}

# Addresses with a port that is open or closed, in place of pings: this machine answers pings to all
# of 127.0.0.0/8.
WEDGED, DARK, UPLINK = "127.0.0.2", "127.0.0.3", "127.0.0.4"

HALL = {
    "worsens": {},
    "dozes": {},
    "patient": {"profile": "patient"},
    "strict": {"profile": "strict"},
    "flaps": {"profile": "restless"},
    "loose": {"profile": "loose"},
    "late": {},
    "serviced": {},
    "mute": {},
    "short": {"profile": "equipped"},
    "crowded": {},
    "ahead": {},
    "tender": {"profile": "thresholds"},
    "drains": {"profile": "watched"},
    "collapses": {},
    "unsteady": {},
    "wedged": {"address": WEDGED},
    "dark": {"address": DARK},
    "far_1": {"labels": {"uplink": "ap_9"}},
    "far_2": {"labels": {"uplink": "ap_9"}},
}
SOLD = {"name": "sold", "namespace": "/sold"}
PROFILES: dict[str, Any] = {
    "default": DURATIONS,
    # Long beside confirm_after, but until the longest of the fleet is over, no fault ends: the
    # exporter has no state of a former process, and may not know what was a fault then.
    "patient": {"components": [{"match": "Sensor 2", "confirm_after": "90s"}]},
    "strict": {
        "stale_is_critical": True,
        "components": [{"match": "Cam", "planned_stale": True}],
    },
    "restless": {"flap_interval": "2s"},
    "loose": {"flap_interval": "500ms"},
    "equipped": {
        "checks": {
            "lasers": {"match": ["Laser"], "expect": 2},
            "cameras": {"match": ["Cam"], "expect": 1},
        }
    },
    "thresholds": {
        "values": [
            {"key": "Charge", "thresholds": {"low": {"warning": 30, "critical": 15}}},
            {"key": "Temperature*", "thresholds": {"high": {"warning": 70, "critical": 90}}},
        ]
    },
    "watched": {"values": [{"key": "Charge", "thresholds": {"low": {"critical": 15}}}]},
}
EAST = tuple(f"east_{n}" for n in range(1, 26))
WEST = tuple(f"west_{n}" for n in range(26, 51))
SHAFT = ("gap", "lost")
FLEETS = ("hall", "shaft", "yard")

# Settings of a thesis robot: too few components, enough, too many.
SHORT = {"number_of_lasers": 1, "number_of_cameras": 0}
COMPLETE = {"number_of_lasers": 2, "number_of_cameras": 1}
CROWDED = {"number_of_motors": 30}


def write_hall(folder: Path, domain_id: int, components: int = 25) -> Path:
    """Write the fleet of most scenarios; ``components`` is how many a robot may have."""
    robots = [
        {"name": name, "namespace": f"/{name}", "domain_id": domain_id, **more}
        for name, more in HALL.items()
    ]
    return _write(
        folder,
        {
            "fleet": "hall",
            "limits": {"components": components},
            "profiles": PROFILES,
            "robots": [*robots, {"name": "ap_9", "source": "queries", "address": UPLINK}],
            "discovery": [_found(domain_id, "scrapped")],
            "queries": [_probed("uplink", uplink=True), _probed("ping")],
        },
    )


def _probed(what: str, *, uplink: bool = False) -> dict[str, Any]:
    """The query of docs/examples that judges the probes of a job."""
    return {
        "expr": f'min by (fleet, robot) (probe_success{{job="ros-diagnostics-{what}"}})',
        "component": what,
        "thresholds": {"low": {"critical": 0.5}},
        "interval": "5s",
        "confirm_after": "6s",
        "uplink": uplink,
    }


def write_shaft(folder: Path, domain_id: int) -> Path:
    """Write the fleet whose exporter stalls and is killed."""
    discovery = [_found(domain_id, *SHAFT)]
    return _write(
        folder, {"fleet": "shaft", "profiles": {"default": DURATIONS}, "discovery": discovery}
    )


def write_yard(folder: Path, domain_id: int) -> Path:
    """Write the fleet of fifty, half of them in the east."""
    discovery = [
        _found(domain_id, f"{site}_*", labels={"site": site, "robot_group": "light"})
        for site in ("east", "west")
    ]
    return _write(
        folder, {"fleet": "yard", "profiles": {"default": DURATIONS}, "discovery": discovery}
    )


def declare(folder: Path, domain_id: int) -> Path:
    """Declare the robot that will be removed, in its own file."""
    path = folder / "robots.d" / "sold.yml"
    path.parent.mkdir(exist_ok=True)
    path.write_text(yaml.safe_dump({**SOLD, "domain_id": domain_id}))
    return path


def plan_maintenance(folder: Path, robot: str) -> Path:
    """Plan a downtime of the robot, and of its name, that lasts until its file is removed."""
    path = folder / "maintenance.d" / f"{robot}.yml"
    path.parent.mkdir(exist_ok=True)
    downtime = {
        "name": robot,
        "comment": "planned maintenance",
        "selector": {"robot": robot},
        "weekly": ["daily 00:00-24:00"],
    }
    path.write_text(yaml.safe_dump(downtime))
    return path


def equip(folder: Path, robot: str, settings: dict[str, int]) -> None:
    """Give a robot with a settings file these numbers of components; it reads them at once."""
    (folder / f"{robot}.yaml").write_text(yaml.safe_dump(settings))


def write_scenario(folder: Path) -> Path:
    """Write the scenario of the virtual robots; its only events are those of a loose contact."""
    equip(folder, "short", SHORT)
    equip(folder, "crowded", CROWDED)
    here = Path(__file__).parent
    kinds = {"tender": str(here / "tender.yaml"), "drains": str(here / "tender.yaml")}
    robots: list[dict[str, Any]] = [
        {"name": name, "kind": kinds.get(name, "thesis")}
        for name in (*HALL, "sold", "scrapped", *SHAFT)
        if name not in {"late", "short", "crowded"}
    ]
    robots.append({"name": "late", "absent": True})
    robots += [{"name": name, "settings": f"{name}.yaml"} for name in ("short", "crowded")]
    light = str(here / "light.yaml")
    # {n} counts over all entries.
    robots = [
        {"name": "east_{n}", "kind": light, "count": 25},
        {"name": "west_{n}", "kind": light, "count": 25},
        *robots,
    ]
    contact = {"robot": "loose", "component": "Laser 1", "what": "error", "for": 1.0}
    events = [{"at": 5 + 7 * n, **contact} for n in range(11)]
    path = folder / "robots.yaml"
    path.write_text(yaml.safe_dump({"seed": 1, "robots": robots, "events": events}))
    return path


def _found(domain_id: int, *names: str, **more: Any) -> dict[str, Any]:
    return {
        "topic": "/{robot}/diagnostics_agg",
        "domain_ids": [domain_id],
        "include": list(names),
        **more,
    }


def _write(folder: Path, config: dict[str, Any]) -> Path:
    path = folder / "fleet.yml"
    path.write_text(yaml.safe_dump({**config, "faults": FAULTS}, sort_keys=False))
    return path
