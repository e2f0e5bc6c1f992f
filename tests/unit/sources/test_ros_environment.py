"""What ROS gets: its arguments, profiles of Fast DDS, and a folder for logs."""

import re
import sys
from pathlib import Path

import pytest

from ros_diagnostics_exporter.sources.ros_environment import (
    ros_distribution,
    split_arguments,
    use_log_folder,
    use_profiles,
)
from support.called import called

VARIABLES = ("FASTDDS_DEFAULT_PROFILES_FILE", "FASTRTPS_DEFAULT_PROFILES_FILE")


@pytest.mark.parametrize(
    ("own", "for_ros", "more_own"),
    [
        (["--config.file", "f"], [], []),
        (["--config.file", "f"], ["--ros-args", "-e", "/monitor"], []),
        ([], ["--ros-args", "-e", "/monitor", "--"], ["--version"]),
    ],
)
def test_the_arguments_are_parted_at_ros_args(own, for_ros, more_own):
    assert split_arguments(own + for_ros + more_own) == (own + more_own, tuple(for_ros))


def test_each_fast_dds_uses_the_file_that_is_installed(tmp_path):
    environment: dict[str, str] = {}
    use_profiles(environment, tmp_path)

    (path,) = {environment[name] for name in VARIABLES}
    assert re.search("<allocated_samples>1<", Path(path).read_text())
    assert environment["RMW_FASTRTPS_USE_QOS_FROM_XML"] == "1"  # else not all of it holds


@pytest.mark.parametrize("name", VARIABLES)
def test_a_file_that_the_user_names_is_used_by_each_fast_dds(tmp_path, name):
    environment = {name: "/etc/dds.xml"}
    use_profiles(environment, tmp_path)

    assert environment == dict.fromkeys(VARIABLES, "/etc/dds.xml")


@pytest.mark.parametrize("name", ["DEFAULT_FASTDDS_PROFILES.xml", "DEFAULT_FASTRTPS_PROFILES.xml"])
def test_the_user_s_file_in_the_working_directory_stays(tmp_path, name):
    (tmp_path / name).touch()
    environment: dict[str, str] = {}
    use_profiles(environment, tmp_path)

    assert not environment


@pytest.mark.parametrize(
    ("environment", "packages", "distribution"),
    [
        ({}, ["rclpy", "ros-rclpy", "ros-kilted-rclpy"], "kilted"),
        ({}, ["ros-jazzy-rclpy"], "jazzy"),
        ({"ROS_DISTRO": "rolling"}, ["ros-jazzy-rclpy"], "rolling"),
        ({}, ["rclpy"], ""),
    ],
)
def test_the_distribution_of_ros_is_named_where_something_says_it(
    environment, packages, distribution
):
    assert ros_distribution(environment, packages) == distribution


def test_a_log_folder_that_can_be_made_is_left_to_ros(tmp_path):
    environment = {"HOME": str(tmp_path)}

    assert use_log_folder(environment) is None
    assert environment == {"HOME": str(tmp_path)}
    assert list((tmp_path / ".ros" / "log").iterdir()) == []


@pytest.mark.parametrize("name", ["HOME", "ROS_HOME", "ROS_LOG_DIR", ""])
def test_where_ros_cannot_log_it_logs_to_a_temporary_folder(tmp_path, caplog, name):
    (tmp_path / "file").touch()
    environment = {name: str(tmp_path / "file")} if name else {}
    folder = use_log_folder(environment)

    assert folder is not None
    assert environment["ROS_LOG_DIR"] == folder.name
    assert Path(folder.name).is_dir()
    assert f"ROS logs to {folder.name}, because its own folder cannot be used: " in caplog.text
    folder.cleanup()


FREED = """
import re, sys
from pathlib import Path
from ros_diagnostics_exporter.sources.ros_environment import free_large_blocks_at_once

def kilobytes():
    return int(re.search(r"RssAnon:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

if sys.argv[1] == "ours":
    free_large_blocks_at_once()
bytearray(b"x" * (16 << 20)).clear()  # from here on the library keeps such blocks
before = kilobytes()
large, small = [], []
for _ in range(50):
    large.append(b"x" * (1 << 20))
    small.append(bytearray(5_000))  # what keeps the end of the heap where it is
del large
print(kilobytes() - before)
"""


@pytest.mark.parametrize(
    ("whose", "least", "most"), [("theirs", 40 << 10, 60 << 10), ("ours", 0, 2 << 10)]
)
def test_what_large_messages_needed_is_returned_to_the_system(whose, least, most):
    assert least <= int(called([sys.executable, "-c", FREED, whose]).stdout) <= most


def test_ros_reads_messages_without_what_generates_their_classes():
    program = """
import sys
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.serialization import deserialize_message, serialize_message
from ros_diagnostics_exporter.sources.ros_environment import leave_out_generator

leave_out_generator()
array = DiagnosticArray()
assert deserialize_message(serialize_message(array), DiagnosticArray) == array
print({"lark", "em"} & sys.modules.keys())
"""
    assert called([sys.executable, "-c", program]).stdout == "set()\n"
