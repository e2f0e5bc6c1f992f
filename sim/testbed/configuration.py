"""The configuration of one run: the shipped folders copied, with this run's addresses written in.

The same edits that a site makes. Rules, routes, templates and clocks stay as shipped.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

CHECKOUT = Path(__file__).resolve().parents[2]
FLEET = "demo"


@dataclass(frozen=True)
class Addresses:
    """Where each server of the run listens, as HOST:PORT."""

    exporter: str
    prometheus: str
    alertmanager: str
    smtp: str
    grafana: str


@dataclass(frozen=True)
class Clocks:
    """How soon a robot counts as silent, and a problem as confirmed; seconds, for fleet.yml."""

    stale_after: int = 5
    confirm_after: int = 10


@dataclass(frozen=True)
class Configs:
    """The main config file of each program that has one."""

    fleet: Path
    prometheus: Path
    alertmanager: Path


def write(folder: Path, domain_id: int, addresses: Addresses, clocks: Clocks) -> Configs:
    """Write the configuration of one run to ``folder``.

    Raises:
        LookupError: The shipped configuration lacks what is edited here.
    """
    fleet = folder / "fleet.yml"
    fleet.write_text(_fleet(domain_id, clocks))
    shutil.copytree(CHECKOUT / "prometheus", folder / "prometheus")
    _list_targets(folder / "prometheus" / "targets", addresses)
    _edit(folder / "prometheus" / "rules" / "settings.yml", lambda it: _set_links(it, addresses))
    shutil.copytree(CHECKOUT / "alertmanager", folder / "alertmanager")
    alertmanager = folder / "alertmanager" / "alertmanager.yml"
    _edit(alertmanager, lambda it: it["global"].update(smtp_smarthost=addresses.smtp))
    return Configs(fleet, folder / "prometheus" / "prometheus.yml", alertmanager)


def _fleet(domain_id: int, clocks: Clocks) -> str:
    """Return a fleet.yml that discovers every robot of one ROS domain by its topic."""
    return f"""\
fleet: {FLEET}
profiles:
  default: {{stale_after: {clocks.stale_after}s, confirm_after: {clocks.confirm_after}s}}
  thesis:
    checks:
      motors: {{match: [Motor], expect: 3}}
      batteries: {{match: [Battery], expect: 2}}
    values:
      - component: Battery
        key: Level
        metric: ros_battery_charge_ratio
        unit: ratio
        scale: 0.01
discovery:
  - topic: "/{{robot}}/diagnostics_agg"
    domain_ids: [{domain_id}]
    include: ["robot_*"]
    profile: thesis
    labels: {{site: hall}}
  - topic: "/{{robot}}/diagnostics_agg"        # other names in a scenario
    domain_ids: [{domain_id}]
    exclude: ["robot_*"]
    labels: {{site: hall}}
"""


def _list_targets(folder: Path, addresses: Addresses) -> None:
    targets: dict[str, dict[str, Any]] = {
        "ros-diagnostics": {"targets": [addresses.exporter], "labels": {"fleet": FLEET}},
        "prometheus": {"targets": [addresses.prometheus]},
        "alertmanager": {"targets": [addresses.alertmanager]},
    }
    for job, group in targets.items():
        path = folder / f"{job}.yml"
        if not path.exists():  # else Prometheus would read another file
            raise LookupError(f"prometheus/targets/{path.name} is no longer shipped")
        path.write_text(yaml.safe_dump([group]))


def _set_links(settings: dict[str, Any], addresses: Addresses) -> None:
    """Set the links in alerts to this run's servers; Prometheus serves the runbooks."""
    rules = [rule for group in settings["groups"] for rule in group["rules"]]
    site = next((each for each in rules if each["record"] == "ros_diagnostics:site:info"), None)
    if site is None:
        raise LookupError("rules/settings.yml no longer has ros_diagnostics:site:info")
    site["labels"] = {
        "grafana_url": f"http://{addresses.grafana}",
        "runbooks_url": f"http://{addresses.prometheus}/user/alerts",
    }


def _edit(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content, sort_keys=False))
