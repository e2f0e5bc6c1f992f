"""``ros-diagnostics forget``: take a robot or a component out of the exporter's state."""

from __future__ import annotations

from urllib.parse import urlencode

import click

from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.errors import NO
from ros_diagnostics_tools.names import hint, meant
from ros_diagnostics_tools.servers import Servers, with_servers
from ros_diagnostics_tools.terminal import print_json, with_output

ALONE = (
    "Only this exporter has forgotten it, as it reaches no Alertmanager: repeat it at each other "
    "exporter of the fleet, with --url."
)


@click.command(epilog='Example: ros-diagnostics forget robot_3 "Motor 1"')
@click.argument("robot")
@click.argument("component", required=False)
@with_output()
@with_servers
def command(servers: Servers, output: str, robot: str, component: str | None) -> int:
    """Remove ROBOT, or its COMPONENT, that is gone for good: its faults end.

    All exporters of the fleet that read the same Alertmanager remove it.

    It comes back when it is received again. A robot that fleet.yml names stays in the list. Exit
    code 1 where no robot of this name is known.
    """
    known = servers.exporter.fleet((robot,))["robots"]
    if component:
        names = (each["component"] for of in known for each in of["components"])
        component = meant(component, names, by_part=False)
    query = {"robot": robot} if component is None else {"robot": robot, "component": component}
    found = servers.exporter.post(f"/-/forget?{urlencode(query)}", {})
    if output == "json":
        print_json(found)
    else:
        print(_of_known(query, found["forgotten"]) if known else _of_unknown(robot, servers))  # noqa: T201
        if not found["passed_on"]:
            print(ALONE)  # noqa: T201
    return 0 if known else NO


def _of_known(query: dict[str, str], components: int) -> str:
    counted = f", with {components} component{'' if components == 1 else 's'}"
    counted = "" if "component" in query else counted
    return one_line(f"{' '.join(query.values())} is forgotten{counted}")


def _of_unknown(robot: str, servers: Servers) -> str:
    near = hint(robot, (each["robot"] for each in servers.exporter.fleet()["robots"]))
    held = "if alerts still fire for a robot of this name, they end"
    return one_line(f"no robot is called {robot!r}{near}; {held}")
