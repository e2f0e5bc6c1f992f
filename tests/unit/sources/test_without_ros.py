"""Where ROS is absent, a sentence says so and what to do; nothing is made up."""

from __future__ import annotations

import os
import subprocess
import sys

WITHOUT = """
import sys
sys.modules["rclpy"] = None  # as if it were not installed
from ros_diagnostics_exporter.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


def run(*arguments):
    return subprocess.run(
        [sys.executable, "-c", WITHOUT, *arguments],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


def test_without_rclpy_the_exporter_says_what_to_do_and_exits_1(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: f\nrobots: [{name: r, namespace: /r}]\n")

    ended = run("--config.file", str(path), "--web.listen-address", "127.0.0.1:0")

    assert ended.returncode == 1
    assert "source it (source /opt/ros/jazzy/setup.bash)" in ended.stderr
    assert "pip install 'ros-diagnostics-exporter[ros]'" in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_config_can_be_checked_without_ros(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: f\nrobots: [{name: r, namespace: /r}]\n")

    assert run("--config.file", str(path), "--config.check").returncode == 0


def test_a_middleware_that_is_not_installed_is_named_instead_of_ros(tmp_path):
    """Also by a wheel's own rcl, which ends the process while it is imported."""
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: f\nrobots: [{name: r, namespace: /r}]\n")

    ended = subprocess.run(
        [sys.executable, "-m", "ros_diagnostics_exporter.cli.main", "--config.file", str(path)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "RMW_IMPLEMENTATION": "rmw_nonsense_cpp"},
    )

    assert ended.returncode == 1
    assert "RMW_IMPLEMENTATION is 'rmw_nonsense_cpp'" in ended.stderr
    assert "unset it, or install" in ended.stderr
    assert "source it" not in ended.stderr
