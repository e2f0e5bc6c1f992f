"""The exporter builds in a colcon workspace and is found there."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from support.called import called

CHECKOUT = Path(__file__).parents[3]
COLCON = ("colcon-ros", "colcon-python-setup-py", "colcon-recursive-crawl", "setuptools<80")
# Prints the warnings of the parser that bloom and rosdep use; an error ends it.
VALIDATE = """
import sys
from catkin_pkg.package import parse_package
warnings = []
parse_package(sys.argv[1]).validate(warnings=warnings)
print(*warnings)
"""


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_exporter_builds_and_runs_in_a_colcon_workspace(tmp_path):
    venv = tmp_path / "venv"
    subprocess.run([sys.executable, "-m", "venv", venv], check=True)
    subprocess.run([venv / "bin/python", "-m", "pip", "install", "-q", *COLCON], check=True)
    source = tmp_path / "src" / "ros_diagnostics_exporter"
    shutil.copytree(CHECKOUT / "exporter", source)
    validate = [venv / "bin/python", "-c", VALIDATE, source / "package.xml"]
    assert subprocess.check_output(validate, text=True).strip() == ""
    path = f"{venv / 'bin'}:{os.environ['PATH']}"

    subprocess.run(
        [venv / "bin/colcon", "build"], cwd=tmp_path, env={**os.environ, "PATH": path}, check=True
    )

    installed = tmp_path / "install" / "ros_diagnostics_exporter"
    commands = {each.name for each in (installed / "lib/ros_diagnostics_exporter").iterdir()}
    project = (CHECKOUT / "pyproject.toml").read_text()
    scripts = re.findall(r'^(\S+) = "ros_diagnostics_', project, re.MULTILINE)
    assert commands == set(scripts)
    index = installed / "share/ament_index/resource_index/packages/ros_diagnostics_exporter"
    assert index.exists()
    assert (installed / "share/ros_diagnostics_exporter/launch/exporter.launch.py").exists()
    (packages,) = installed.glob("lib/python*/site-packages")
    shipped = {each.name for each in packages.rglob("*") if each.suffix in (".json", ".yaml")}
    ours = {
        each.name
        for each in (CHECKOUT / "exporter/ros_diagnostics_exporter").rglob("*")
        if each.suffix in (".json", ".yaml")
    }
    assert shipped == ours
    # The other dependencies, and ROS, come from this environment, as from a sourced one.
    version = called(
        [sys.executable, "-m", "ros_diagnostics_exporter.cli.main", "--version"],
        env={**os.environ, "PYTHONPATH": str(packages)},
        cwd=tmp_path,
    )
    assert version.stdout.startswith("ros-diagnostics-exporter ")
