"""For colcon workspaces only; everywhere else pyproject.toml above builds the package."""

from __future__ import annotations

import re
from pathlib import Path

from setuptools import find_packages, setup

NAME = "ros_diagnostics_exporter"
TOOLS = "ros_diagnostics_tools"
HERE = Path(__file__).parent
VERSION = re.search(r'__version__ = "([^"]+)"', (HERE / NAME / "__init__.py").read_text())

setup(
    name=NAME,
    version=VERSION[1] if VERSION else "0",
    packages=find_packages(include=[NAME, f"{NAME}.*", TOOLS, f"{TOOLS}.*"]),
    package_data={"": ["*.json", "*.xml", "*.yaml", "py.typed"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
    ],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            f"check_ros_diagnostics = {TOOLS}.check_nagios:main",
            f"nagios2fleet = {TOOLS}.commands.nagios_import:main",
            f"ros-diagnostics-ack = {TOOLS}.commands.ack:main",
            f"ros-diagnostics-backtest = {TOOLS}.commands.backtest:main",
            f"ros-diagnostics-compare = {TOOLS}.commands.nagios_compare:main",
            f"ros-diagnostics-downtime = {TOOLS}.commands.downtime:main",
            f"ros-diagnostics-exporter = {NAME}.cli.main:main",
            f"ros-diagnostics-oncall = {TOOLS}.commands.oncall:main",
            f"ros-diagnostics-status = {TOOLS}.commands.status:main",
            f"ros-diagnostics-why = {TOOLS}.commands.why:main",
        ],
    },
)
