"""Arguments that launch_ros appends are ROS', all others ours."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.sources.ros_environment import split_arguments


@pytest.mark.parametrize(
    ("arguments", "own", "for_ros"),
    [
        (["--config.file", "f"], ["--config.file", "f"], ()),
        (
            ["--config.file", "f", "--ros-args", "-e", "/monitor"],
            ["--config.file", "f"],
            ("--ros-args", "-e", "/monitor"),
        ),
        (
            ["--ros-args", "-e", "/monitor", "--", "--version"],
            ["--version"],
            ("--ros-args", "-e", "/monitor", "--"),
        ),
        ([], [], ()),
    ],
)
def test_the_arguments_are_parted_at_ros_args(arguments, own, for_ros):
    assert split_arguments(arguments) == (own, for_ros)
