"""The command lines of the programs."""

from __future__ import annotations

import os
import shutil
import sysconfig
from pathlib import Path

FOREVER = 1e9  # seconds: the robots run until they are stopped


class MissingProgram(Exception):  # noqa: N818 - says what is wrong, as FileNotFoundError does
    """A program is not installed; the text says how to get it."""


def own(name: str) -> str:
    """Return the path of a command that this project installs.

    Raises:
        MissingProgram: This Python environment does not have it.
    """
    path = Path(sysconfig.get_path("scripts")) / name
    if not path.exists():
        raise MissingProgram(f"{path}: no such command; ./run installs it")
    return str(path)


def distributed(*names: str) -> str:
    """Return the path of a server that the distribution packages, by the first name found.

    Raises:
        MissingProgram: None of the names is in PATH.
    """
    for name in names:
        if path := shutil.which(name):
            return path
    raise MissingProgram(f"{names[0]}: no such program in PATH; ./run installs it with apt")


def virtual_robots(
    robots: int, seed: int, domain_id: int, scenario: Path | None = None
) -> list[str]:
    """Return the command that publishes the diagnostics of ``robots`` robots, or of a scenario.

    A scenario's robots keep running after its duration.
    """
    fleet = ["--robots", str(robots), "--seed", str(seed)]
    if scenario is not None:
        fleet = ["--scenario", str(scenario), "--duration", str(FOREVER)]
    return [own("virtual-robots"), *fleet, "--domain-id", str(domain_id)]


def fault(robot: str, component: str, level: str, message: str, domain_id: int) -> list[str]:
    """Return the command that sets a component's level on a virtual robot (`ok`: no fault)."""
    text = ["--message", message] if message else []
    where = ["--domain-id", str(domain_id)]
    return [own("virtual-robots"), "fault", robot, component, level, *text, *where]


def exporter(config: Path, address: str, storage: Path, alertmanager: str = "") -> list[str]:
    """Return the command that serves the fleet of ``config`` at ``address``.

    ``alertmanager`` is the address of the one that it asks, "" for none.
    """
    asked = [f"--alertmanager.url=http://{alertmanager}"] if alertmanager else []
    return [
        own("ros-diagnostics-exporter"),
        f"--config.file={config}",
        f"--web.listen-address={address}",
        f"--storage.path={storage}",
        *asked,
    ]


def prometheus(config: Path, address: str, storage: Path) -> list[str]:
    """Return the command of Prometheus, or of the program that $PROMETHEUS names."""
    return [
        os.environ.get("PROMETHEUS") or distributed("prometheus"),
        f"--config.file={config}",
        f"--storage.tsdb.path={storage}",
        "--rules.alert.resend-delay=30s",  # these two as docs/alerts.md says
        "--rules.alert.for-grace-period=1m",
        f"--web.listen-address={address}",
        f"--web.external-url=http://{address}/",  # what links in alerts begin with
        "--log.level=warn",
    ]


def alertmanager(config: Path, address: str, storage: Path, cluster: str = "") -> list[str]:
    """Return the command of an Alertmanager; ``cluster`` is its address in one, "" for none."""
    return [
        distributed("prometheus-alertmanager", "alertmanager"),
        f"--config.file={config}",
        f"--storage.path={storage}",
        f"--web.listen-address={address}",
        f"--web.external-url=http://{address}/",
        f"--cluster.listen-address={cluster}",
        "--log.level=warn",
    ]
