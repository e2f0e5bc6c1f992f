"""What the extras of pyproject.toml install, and the command that installs it."""

from __future__ import annotations

import shlex
import sys

# Here too, because an ament_python package has no extras.
EXTRAS = {
    "backtest": ("rosbags>=0.10,<0.12",),
    "icalendar": ("icalendar>=6.1,<8",),
    "mail": ("aiosmtpd>=1.4.6,<2",),
    "mcp": ("mcp>=2.3,<3",),
    "ros": ("ros-jazzy-common-interfaces>=5.3,<6", "ros-jazzy-rclpy[fastrtps]>=7.1.5,<7.2"),
    "zenoh": ("eclipse-zenoh>=1.10,<2",),
}


def install_command(extra: str) -> str:
    """The command that installs an extra's libraries beside the package, with or without checkout.

    It does not name the package, which is on no index.
    """
    return shlex.join([sys.executable, "-m", "pip", "install", *EXTRAS[extra]])
