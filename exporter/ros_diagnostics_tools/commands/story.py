"""``ros-diagnostics story``: what failed of a robot in the last week, in sentences."""

from __future__ import annotations

from itertools import groupby
from operator import itemgetter
from urllib.parse import quote

import click

from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import print_json, with_output


@click.command(epilog="Example: ros-diagnostics story robot_3")
@click.argument("robot")
@with_output()
@with_servers
def command(servers: Servers, output: str, robot: str) -> None:
    """Show what failed of ROBOT in the last week, in sentences: what lasts first."""
    path = f"/api/v1/robots/{quote(robot, safe='')}/story"
    found = servers.exporter.get(path)
    if not isinstance(found, dict) or "sentences" not in found:
        raise UnreachableError(f"{servers.exporter.url}{path} is not a ROS diagnostics exporter")
    if output == "json":
        print_json(found)
        return
    for _about, sentences in groupby(found["sentences"], key=itemgetter("about")):
        print(one_line(" ".join(each["text"] for each in sentences)))  # noqa: T201
