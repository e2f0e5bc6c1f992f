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
    package_data={"": ["*.json", "*.xml", "*.yaml", "py.typed", "templates/*"]},
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["ros_launch/exporter.launch.py"]),
    ],
    zip_safe=True,
    entry_points={
        "console_scripts": [
            f"check_ros_diagnostics = {TOOLS}.check_nagios:main",
            f"ros-diagnostics = {TOOLS}.main:main",
            f"ros-diagnostics-exporter = {NAME}.cli.main:main",
        ],
    },
)
