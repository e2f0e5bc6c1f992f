"""For colcon workspaces only; everywhere else pyproject.toml above builds the package."""

from __future__ import annotations

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "ros_diagnostics_exporter"
HERE = Path(__file__).parent
VERSION = re.search(r'__version__ = "([^"]+)"', (HERE / NAME / "__init__.py").read_text())

setup(
    name=NAME,
    version=VERSION[1] if VERSION else "0",
    packages=find_packages(include=[NAME, f"{NAME}.*"]),
    package_data={"": ["*.json", "*.xml", "*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            f"check_ros_diagnostics = {NAME}.cli.check_nagios:main",
            f"nagios2fleet = {NAME}.cli.nagios2fleet:main",
            f"ros-diagnostics-ack = {NAME}.cli.ack:main",
            f"ros-diagnostics-backtest = {NAME}.cli.backtest:main",
            f"ros-diagnostics-compare = {NAME}.cli.compare_nagios:main",
            f"ros-diagnostics-downtime = {NAME}.cli.downtime:main",
            f"ros-diagnostics-exporter = {NAME}.cli.main:main",
            f"ros-diagnostics-oncall = {NAME}.cli.oncall:main",
            f"ros-diagnostics-status = {NAME}.cli.status:main",
            f"ros-diagnostics-why = {NAME}.cli.why:main",
        ],
    },
)
