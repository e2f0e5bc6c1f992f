"""What a result was measured on: machine, versions, commit; written beside every result."""

from __future__ import annotations

import os
import platform
import re
import subprocess
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from testbed.programs import MissingProgram, distributed

CHECKOUT = Path(__file__).resolve().parents[2]


def describe() -> dict[str, str]:
    """Return the machine's hardware, the versions of what runs, the commit and the date (UTC)."""
    return {
        "CPU": f"{_cpu_model()}, {os.cpu_count()} cores",
        "memory": f"{_memory_gigabytes():.0f} GB",
        "system": f"{_distribution()}, Linux {platform.release()}",
        "Python": platform.python_version(),
        "rclpy": _rclpy_version(),
        "Prometheus": _server_version("prometheus"),
        "Alertmanager": _server_version("prometheus-alertmanager", "alertmanager"),
        "commit": commit(),
        "date": datetime.now(timezone.utc).strftime("%Y-%m-%d %H:%M UTC"),
    }


def commit() -> str:
    """Return the commit of this checkout, with a mark where tracked files differ from it."""
    argv = ["git", "-C", str(CHECKOUT), "describe", "--always", "--dirty= with changes"]
    try:
        return subprocess.run(argv, check=True, capture_output=True, text=True).stdout.strip()
    except (OSError, subprocess.CalledProcessError):
        return "not a git checkout"


def _cpu_model() -> str:
    found = re.search(r"^model name\s*: (.+)$", Path("/proc/cpuinfo").read_text(), re.MULTILINE)
    return found[1] if found else platform.machine()


def _memory_gigabytes() -> float:
    return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES") / 1e9


def _distribution() -> str:
    found = re.search(r'^PRETTY_NAME="(.+)"$', Path("/etc/os-release").read_text(), re.MULTILINE)
    return found[1] if found else platform.system()


def _rclpy_version() -> str:
    try:
        return version("ros-jazzy-rclpy")
    except PackageNotFoundError:
        return f"of ROS 2 {os.environ.get('ROS_DISTRO', '')}".rstrip()


def _server_version(*names: str) -> str:
    try:
        argv = [distributed(*names), "--version"]
    except MissingProgram:
        return "not installed"
    done = subprocess.run(argv, check=False, capture_output=True, text=True)
    found = re.search(r"version (\S+)", done.stdout + done.stderr)
    return found[1] if found else "unknown"
