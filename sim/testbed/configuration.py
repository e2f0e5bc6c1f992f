"""The configuration of one run: the shipped folders copied, with this run's addresses written in.

The same edits that a site makes. Rules, routes, templates and clocks stay as shipped, but for what
is asked for.
"""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from testbed import short_clocks

CHECKOUT = Path(__file__).resolve().parents[2]
KINDS = CHECKOUT / "sim" / "virtual_robots" / "simulation" / "kinds"
FLEET = "demo"  # in fleet.yml
BRIDGED = "/hall"  # the namespace of the zenoh bridge
NOTIFICATIONS = "/api/v1/notifications"  # of the exporter


@dataclass(frozen=True)
class Addresses:
    """Where each server of the run listens, as HOST:PORT; ``grafana`` is "" where there is none."""

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
    """Write the configuration of the demo to ``folder``.

    Args:
        folder: Where to.
        domain_id: The robots' ROS domain.
        addresses: Of the servers.
        clocks: For fleet.yml.
        zenoh: The endpoint of a router that brings the robots instead, "" for none.

    Raises:
        LookupError: The shipped configuration lacks what is edited here.
    """
    return Configs(
        fleet(folder, domain_id, clocks, zenoh),
        prometheus(folder, [addresses.exporter], addresses),
        alertmanager(folder, addresses, recorder=addresses.exporter, links=True),
    )


def prometheus(
    folder: Path,
    exporters: Sequence[str],
    addresses: Addresses,
    *,
    interval: int | None = None,
    tenth: bool = False,
) -> Path:
    """Copy the shipped folder; return its prometheus.yml.

    Args:
        folder: Where to.
        exporters: HOST:PORT of each.
        addresses: Of Prometheus and Alertmanager.
        interval: Seconds between two scrapes and two evaluations, in place of the shipped ones.
        tenth: Whether ranges, offsets and holds last a tenth of what is shipped.
    """
    copy = folder / "prometheus"
    shutil.copytree(CHECKOUT / "prometheus", copy)
    for job, targets in {
        "ros-diagnostics": exporters,
        "prometheus": [addresses.prometheus],
        "alertmanager": [addresses.alertmanager],
    }.items():
        path = copy / "targets" / f"{job}.yml"
        if not path.exists():  # else Prometheus would read another file
            raise LookupError(f"prometheus/targets/{path.name} is no longer shipped")
        path.write_text(yaml.safe_dump([{"targets": list(targets)}]))
    if interval is not None:
        short_clocks.set_interval(copy, interval)
    if tenth:
        short_clocks.scale(copy / "rules")
    return copy / "prometheus.yml"


def alertmanager(
    folder: Path,
    addresses: Addresses,
    *,
    recorder: str = "",
    links: bool = False,
    edit: Callable[[dict[str, Any]], object] = lambda _: None,
) -> Path:
    """Copy the shipped folder; return its alertmanager.yml.

    Args:
        folder: Where to.
        addresses: Of the mail server, and of what the links lead to.
        recorder: The exporter to whose webhook it posts what was sent, "" for none.
        links: Whether the links in notifications lead to this run's servers.
        edit: Changes the content, before the addresses are set.
    """
    copy = folder / "alertmanager"
    shutil.copytree(CHECKOUT / "alertmanager", copy)
    if links:
        _set_links(copy / "templates" / "site.tmpl", addresses)

    def change(content: dict[str, Any]) -> None:
        edit(content)
        _set_addresses(content, addresses.smtp, recorder)

    short_clocks.edit(copy / "alertmanager.yml", change)
    return copy / "alertmanager.yml"


def fleet(folder: Path, domain_id: int, clocks: Clocks, zenoh: str) -> Path:
    """Write a fleet.yml that finds every robot of one ROS domain, or router, by its topic.

    Robots without diagnostics are not found through a router, whose bridge brings nothing else.
    """

    def change(content: dict[str, Any]) -> None:
        profile = content["profiles"]["default"]
        profile["stale_after"] = f"{clocks.stale_after}s"
        profile["confirm_after"] = f"{clocks.confirm_after}s"
        where: dict[str, Any] = {"domain_ids": [domain_id]}
        if zenoh:
            content["zenoh"] = {"routers": [zenoh]}
            where = {"zenoh": BRIDGED.strip("/")}
            content["discovery"] = [each for each in content["discovery"] if "source" not in each]
        for each in content["discovery"]:
            each.update(where)

    shutil.copytree(KINDS / "msg", folder / "msg", dirs_exist_ok=True)
    path = folder / "fleet.yml"
    shutil.copyfile(Path(__file__).with_name("fleet.yml"), path)
    short_clocks.edit(path, change)
    return path


def _set_addresses(content: dict[str, Any], smtp: str, recorder: str) -> None:
    """Set the mail server, and the exporter that what was sent is posted to, "" for none."""
    content["global"]["smtp_smarthost"] = smtp
    for receiver in content["receivers"]:
        for webhook in list(receiver.get("webhook_configs", ())):
            if not webhook["url"].endswith(NOTIFICATIONS):
                continue
            if recorder:
                webhook["url"] = f"http://{recorder}{NOTIFICATIONS}"
            else:
                receiver["webhook_configs"].remove(webhook)


def _set_links(site: Path, addresses: Addresses) -> None:
    """Set the links in notifications to this run's servers."""
    exporter, grafana = f"http://{addresses.exporter}", f"http://{addresses.grafana}"
    path = '{{ template "ros_diagnostics.dashboard_path" . }}'
    links = {"site.exporter_url": exporter}
    if addresses.grafana:
        links["site.dashboard.text"] = f"Dashboard:  {grafana}{path}\n"
        links["site.dashboard.html"] = f'<a href="{grafana}{path}">Dashboard</a> &middot; '
    text = site.read_text()
    for name, link in links.items():
        define = re.compile(
            rf'^\{{\{{ define "{re.escape(name)}" \}}\}}.*?\{{\{{ end \}}\}}$', re.MULTILINE
        )
        new = f'{{{{ define "{name}" }}}}{link}{{{{ end }}}}'
        text, found = define.subn(new.replace("\\", r"\\"), text)
        if found != 1:
            raise LookupError(f"alertmanager/templates/site.tmpl no longer defines {name}")
    site.write_text(text)
