"""``ros-diagnostics watch``: what the exporter expects of the robots' ROS graph."""

from __future__ import annotations

from urllib.parse import urlencode

import click

from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import print_json, with_output


@click.group(epilog="Example: ros-diagnostics watch accept robot_3")
def command() -> None:
    """What is expected of robots in the ROS graph, for their silent faults."""


@command.command(epilog="Example: ros-diagnostics watch accept robot_3")
@click.argument("robot")
@with_output()
@with_servers
def accept(servers: Servers, output: str, robot: str) -> None:
    """Accept ROBOT's present nodes and topics as the expected ones.

    Its silent faults end, and its first week, in which nobody is notified of them, is over.
    """
    found = servers.exporter.post(f"/-/watch/accept?{urlencode({'robot': robot})}", {})
    if output == "json":
        print_json(found)
    else:
        print(f"accepted: {one_line(robot)}, {found['expected']} nodes are expected")  # noqa: T201
