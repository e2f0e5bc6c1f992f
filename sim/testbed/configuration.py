"""The configuration of one run: the shipped folders copied, with this run's addresses written in.

The same edits that a site makes. Rules, routes, templates and clocks stay as shipped.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

CHECKOUT = Path(__file__).resolve().parents[2]
FLEET = "demo"
BRIDGED = "/hall"  # the namespace of the zenoh bridge
NOTIFICATIONS = "/api/v1/notifications"  # of the exporter


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


def write(
    folder: Path, domain_id: int, addresses: Addresses, clocks: Clocks, zenoh: str = ""
) -> Configs:
    """Write the configuration of one run to ``folder``.

    Args:
        folder: Where to.
        domain_id: The robots' ROS domain.
        addresses: Of the servers.
        clocks: For fleet.yml.
        zenoh: The endpoint of a router that brings the robots instead, "" for none.

    Raises:
        LookupError: The shipped configuration lacks what is edited here.
    """
    fleet = folder / "fleet.yml"
    fleet.write_text(_fleet(domain_id, clocks, zenoh))
    shutil.copytree(CHECKOUT / "prometheus", folder / "prometheus")
    _list_targets(folder / "prometheus" / "targets", addresses)
    shutil.copytree(CHECKOUT / "alertmanager", folder / "alertmanager")
    _set_links(folder / "alertmanager" / "templates" / "site.tmpl", addresses)
    alertmanager = folder / "alertmanager" / "alertmanager.yml"
    _edit(alertmanager, lambda it: set_addresses(it, addresses))
    return Configs(fleet, folder / "prometheus" / "prometheus.yml", alertmanager)


def _fleet(domain_id: int, clocks: Clocks, zenoh: str) -> str:
    """Return a fleet.yml that finds every robot of one ROS domain, or router, by its topic."""
    where, routers = f"domain_ids: [{domain_id}]", ""
    if zenoh:
        where, routers = f"zenoh: {BRIDGED.strip('/')}", f"zenoh: {{routers: [{zenoh}]}}\n"
    return f"""\
fleet: {FLEET}
{routers}\
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
    {where}
    include: ["robot_*"]
    profile: thesis
    labels: {{site: hall}}
  - topic: "/{{robot}}/diagnostics_agg"        # other names in a scenario
    {where}
    exclude: ["robot_*"]
    labels: {{site: hall}}
"""


def _list_targets(folder: Path, addresses: Addresses) -> None:
    targets: dict[str, dict[str, Any]] = {
        "ros-diagnostics": {"targets": [addresses.exporter]},
        "prometheus": {"targets": [addresses.prometheus]},
        "alertmanager": {"targets": [addresses.alertmanager]},
    }
    for job, group in targets.items():
        path = folder / f"{job}.yml"
        if not path.exists():  # else Prometheus would read another file
            raise LookupError(f"prometheus/targets/{path.name} is no longer shipped")
        path.write_text(yaml.safe_dump([group]))


def set_addresses(alertmanager: dict[str, Any], addresses: Addresses) -> None:
    """Set the mail server, and the exporter that records who was notified."""
    alertmanager["global"]["smtp_smarthost"] = addresses.smtp
    for receiver in alertmanager["receivers"]:
        for webhook in receiver.get("webhook_configs", ()):
            if webhook["url"].endswith(NOTIFICATIONS):
                webhook["url"] = f"http://{addresses.exporter}{NOTIFICATIONS}"


def _set_links(site: Path, addresses: Addresses) -> None:
    """Set the links in notifications to this run's servers; Prometheus serves the runbooks."""
    grafana, exporter = f"http://{addresses.grafana}", f"http://{addresses.exporter}"
    fault = exporter + '{{ template "ros_diagnostics.fault_path" . }}'
    path = '{{ template "ros_diagnostics.dashboard_path" . }}'
    text = site.read_text()
    for name, link in {
        "site.runbooks_url": f"http://{addresses.prometheus}/user/alerts",
        "site.dashboard.text": f"Dashboard:  {grafana}{path}\n",
        "site.dashboard.html": f'<a href="{grafana}{path}">Dashboard</a> &middot; ',
        "site.exporter.text": f"Fault:      {fault}\n",
        "site.exporter.html": f'<a href="{fault}">Fault</a> &middot; ',
    }.items():
        define = re.compile(
            rf'^\{{\{{ define "{re.escape(name)}" \}}\}}.*?\{{\{{ end \}}\}}$', re.MULTILINE
        )
        new = f'{{{{ define "{name}" }}}}{link}{{{{ end }}}}'
        text, found = define.subn(new.replace("\\", r"\\"), text)
        if found != 1:
            raise LookupError(f"alertmanager/templates/site.tmpl no longer defines {name}")
    site.write_text(text)


def _edit(path: Path, change: Callable[[dict[str, Any]], None]) -> None:
    content = yaml.safe_load(path.read_text())
    change(content)
    path.write_text(yaml.safe_dump(content, sort_keys=False))
