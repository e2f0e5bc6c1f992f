"""Where ROS is absent, a sentence says so and what to do; nothing is made up."""

import re
import subprocess
import sys
from urllib.error import URLError
from urllib.request import urlopen

import pytest

from ros_diagnostics_exporter.extras import install_command
from support.called import called
from testbed.polling import until

WITHOUT = """
import sys
sys.modules["rclpy"] = None  # as if it were not installed
from ros_diagnostics_exporter.cli.main import main
sys.exit(main(sys.argv[1:]))
"""


@pytest.fixture
def fleet_file(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: f\nrobots: [{name: r, namespace: /r}]\n")
    return path


def run(*arguments, absent=WITHOUT, code=1):
    address = ("--web.listen-address", "127.0.0.1:0")
    return called([sys.executable, "-c", absent, *arguments, *address], code=code, timeout=60)


def test_without_rclpy_the_exporter_says_what_to_do_and_exits_1(fleet_file):
    ended = run("--config.file", str(fleet_file))

    assert "source it (source /opt/ros/jazzy/setup.bash)" in ended.stderr
    assert install_command("ros") in ended.stderr
    assert "Traceback" not in ended.stderr


def test_a_config_can_be_checked_without_ros(fleet_file):
    run("--config.file", str(fleet_file), "--config.check", code=0)


def test_a_middleware_that_is_not_installed_is_named_instead_of_ros(fleet_file, monkeypatch):
    """Also by a wheel's own rcl, which ends the process while it is imported."""
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_nonsense_cpp")
    with_ros = WITHOUT.replace('sys.modules["rclpy"] = None', "")
    ended = run("--config.file", str(fleet_file), absent=with_ros)

    assert "RMW_IMPLEMENTATION is 'rmw_nonsense_cpp'" in ended.stderr
    assert "unset it, or install" in ended.stderr
    assert "source it" not in ended.stderr


def test_an_exporter_of_robots_behind_zenoh_alone_runs_without_ros(tmp_path, free_port):
    path = tmp_path / "fleet.yml"
    path.write_text(
        f"fleet: f\nzenoh: {{routers: [tcp/127.0.0.1:{free_port()}]}}\n"
        "robots: [{name: r, zenoh: /, namespace: /r}]\n"
    )
    port = free_port()
    arguments = ["--config.file", str(path), "--storage.path", "none"]
    with subprocess.Popen(
        [sys.executable, "-c", WITHOUT, *arguments, "--web.listen-address", f"127.0.0.1:{port}"]
    ) as exporter:
        try:

            def metrics() -> str:
                try:
                    with urlopen(f"http://127.0.0.1:{port}/metrics", timeout=5) as answer:
                        return answer.read().decode()
                except URLError:
                    return ""

            silent = 'robot="r",reason="domain_unreachable"} 1'
            found = until(lambda: silent in (text := metrics()) and text, "the robot is silent")
        finally:
            exporter.terminate()
        assert exporter.wait(60) == 0
    assert re.search(r'exporter_domain_error_info\{.*domain_id="zenoh",.*reason="no router', found)
    assert re.search(r'exporter_build_info\{.*rmw="",ros_distro="",', found)


def test_without_eclipse_zenoh_the_exporter_says_what_to_do_and_exits_1(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text(
        "fleet: f\nzenoh: {routers: [tcp/centre:7447]}\n"
        "robots: [{name: r, zenoh: /, namespace: /r}]\n"
    )

    ended = run("--config.file", str(path), absent=WITHOUT.replace("rclpy", "zenoh"))

    assert install_command("zenoh") in ended.stderr
    assert "Traceback" not in ended.stderr
