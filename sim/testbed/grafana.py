"""Grafana with the shipped dashboards, where it is installed."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import yaml

from testbed.configuration import CHECKOUT, Addresses

SHIPPED = CHECKOUT / "grafana" / "dashboards"
BINARIES = ("grafana", "grafana-server")  # the second: up to Grafana 9
PACKAGED_HOME = Path("/usr/share/grafana")
SOLID = (9, 5)  # the first that colours a number's background evenly
HOME_DASHBOARD = "ros-diagnostics-fleet"
ABSENT = (
    "no Grafana in PATH: install it (https://grafana.com/grafana/download) and start again,"
    " or import grafana/dashboards/*.json into yours"
)


def command() -> list[str] | None:
    """Return Grafana's command line; None where it is not installed.

    The variable GRAFANA has the path of another than that in PATH.
    """
    for name in BINARIES:
        chosen = os.environ.get("GRAFANA", "")
        if found := shutil.which(chosen if Path(chosen).name == name else name):
            home = _home(Path(found))
            # A package's command is a script that reads /etc/grafana/grafana.ini,
            # which an ordinary user may not read.
            packaged = home / "bin" / name
            server = ["server"] if name == "grafana" else []
            binary = str(packaged) if packaged.exists() else found
            return [binary, *server, f"--homepath={home}"]
    return None


def _home(found: Path) -> Path:
    """Return the folder with Grafana's web pages: two above an unpacked archive's binary."""
    unpacked = found.resolve().parent.parent
    return unpacked if (unpacked / "conf" / "defaults.ini").exists() else PACKAGED_HOME


def write_provisioning(folder: Path, addresses: Addresses) -> None:
    """Copy the shipped provisioning to ``folder``; with this run's servers."""
    shutil.copytree(CHECKOUT / "grafana" / "provisioning", folder)
    if _version() < SOLID:  # an older one would show no colour at all
        _graded(folder / "boards")
    sources = folder / "datasources" / "ros-diagnostics.yml"
    content = yaml.safe_load(sources.read_text())
    urls = {"prometheus": addresses.prometheus, "alertmanager": addresses.alertmanager}
    for each in content["datasources"]:
        each["url"] = f"http://{urls[each['type']]}"
    sources.write_text(yaml.safe_dump(content))
    boards = folder / "dashboards" / "ros-diagnostics.yml"
    content = yaml.safe_load(boards.read_text())
    for provider in content["providers"]:
        provider["options"]["path"] = str(_dashboards(folder))
    boards.write_text(yaml.safe_dump(content))


def environment(folder: Path, address: str) -> dict[str, str]:
    """Return the environment of a Grafana with its data in ``folder`` and without login."""
    host, port = address.split(":")
    return {
        **os.environ,
        "GF_PATHS_DATA": str(folder / "data"),
        "GF_PATHS_LOGS": str(folder / "log"),
        "GF_PATHS_PLUGINS": str(folder / "plugins"),
        "GF_PATHS_PROVISIONING": str(folder / "provisioning"),
        "GF_SERVER_HTTP_ADDR": host,
        "GF_SERVER_HTTP_PORT": port,
        "GF_AUTH_ANONYMOUS_ENABLED": "true",  # it listens on 127.0.0.1 only
        "GF_ANALYTICS_REPORTING_ENABLED": "false",
        "GF_ANALYTICS_CHECK_FOR_UPDATES": "false",
        "GF_DASHBOARDS_DEFAULT_HOME_DASHBOARD_PATH": str(
            _dashboards(folder / "provisioning") / f"{HOME_DASHBOARD}.json"
        ),
    }


def _version() -> tuple[int, int]:
    """Return the version of the Grafana that `command` finds."""
    found = command()
    if found is None:
        return SOLID
    output = subprocess.run([found[0], "-v"], capture_output=True, text=True, check=False).stdout
    version = re.search(r"(\d+)\.(\d+)\.", output)
    return (int(version[1]), int(version[2])) if version else SOLID


def _graded(folder: Path) -> None:
    """Copy the dashboards, with the graded backgrounds that any Grafana has."""
    folder.mkdir()
    for path in SHIPPED.glob("*.json"):
        text = path.read_text(encoding="utf-8")
        (folder / path.name).write_text(text.replace("background_solid", "background"), "utf-8")


def _dashboards(provisioning: Path) -> Path:
    graded = provisioning / "boards"
    return graded if graded.exists() else SHIPPED
