"""The version of the package, in the files that name it: `__version__` is the one place.

Releases are three numbers: what follows the project's name, and keys of their own.
"""

from __future__ import annotations

import re
from pathlib import Path

from ros_diagnostics_exporter import __version__

CHECKOUT = Path(__file__).resolve().parents[1]
FILES = (
    "compose.yaml",
    "docs/install-ansible.md",
    "docs/install-container.md",
    "docs/kubernetes.md",
    "exporter/package.xml",
    "packaging/ansible/roles/ros_diagnostics_exporter/defaults/main.yml",
    "packaging/chart/Chart.yaml",
    "packaging/kubernetes/base/exporter.yaml",
    "sim/pyproject.toml",
)
PLACE = re.compile(
    r"((?:ros-diagnostics-exporter|virtual-robots)[:_]|<version>|newTag: |^version = .|"
    r"^version: |^appVersion: )"
    r"\d+\.\d+\.\d+",
    re.MULTILINE,
)


def files() -> dict[Path, str]:
    """Each file, with the package's version."""
    paths = [CHECKOUT / name for name in FILES]
    return {path: PLACE.sub(rf"\g<1>{__version__}", path.read_text()) for path in paths}
