"""``ros-diagnostics downtime``: plan a downtime of robots, or of one component of a robot.

No fault of them begins in a downtime, and none escalates; what is still wrong at the end is a fault
then. A fault that lasted before goes on, and its recovery is sent at the end. The page, ``status``
and ``why`` show who planned it, and why.
"""

# A downtime is a silence of the escalation in Alertmanager, as an acknowledgement is, which
# exporters read (see silences.py): all of a pair follow it, and it outlives any restart.

from __future__ import annotations

import sys
import time
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple
from urllib.parse import quote, urlencode

import click

from ros_diagnostics_exporter.fleet_texts import clock
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.model import Downtime
from ros_diagnostics_exporter.silences import (
    COMMENT_LENGTH,
    ESCALATION,
    NAME_LENGTH,
    Silence,
    clean,
    downtime_matchers,
    downtime_of,
    silence,
)
from ros_diagnostics_exporter.texts import escape, one_line, printable
from ros_diagnostics_tools.errors import NotDoneError
from ros_diagnostics_tools.flag_types import NamedPair
from ros_diagnostics_tools.names import hint, meant, no_robot
from ros_diagnostics_tools.servers import Servers, listed, with_servers
from ros_diagnostics_tools.terminal import (
    cells,
    check_comment,
    make_console,
    make_table,
    print_json,
    with_author,
    with_output,
)
from ros_diagnostics_tools.times import Duration, Moment

FOLLOWED = 20.0  # seconds in which an exporter has read a new downtime; it asks every 5 s
COLUMNS = ("Fleet", "Robot", "Component", "From", "To", "By", "Comment")


class Planned(NamedTuple):
    """A downtime as Alertmanager has it."""

    silence: str  # the silence's id
    fleet: str
    downtime: Downtime


class WantedDowntime(NamedTuple):
    """Whose downtime: one robot, perhaps one component of it, or all robots with these labels."""

    robot: str
    component: str
    labels: dict[str, str]

    def __str__(self) -> str:
        """As it was written."""
        names = (self.robot, self.component, *(f"{key}={of}" for key, of in self.labels.items()))
        return " ".join(filter(None, names))


@click.command(
    epilog="""\b
Examples:
  ros-diagnostics downtime robot_3 "Motor 1" 1h30m --comment "new gears"
  ros-diagnostics downtime --site hall 2h --from 22:00 --comment "network is replaced"
"""
)
@click.argument("what", nargs=-1, metavar="[ROBOT [COMPONENT]] DURATION")
@click.option("--site", help="All robots of this site, instead of ROBOT.")
@click.option(
    "--selector",
    type=NamedPair("label", "LABEL=VALUE, such as team=arms"),
    multiple=True,
    metavar="LABEL=VALUE",
    help="All robots with this label. If you repeat it, robots that have all of the labels.",
)
@click.option("--comment", help="What it is for.")
@click.option(
    "--from",
    "start",
    type=Moment(ahead=True),
    metavar="TIME",
    help="When it begins: 2h (from now), 14:30, 2027-01-31T14:30.  [default: now]",
)
@click.option("--list", "lists", is_flag=True, help="List the present and the planned downtimes.")
@click.option("--cancel", is_flag=True, help="End or cancel a downtime; takes no DURATION.")
@click.option("--fleet", help="The robots' fleet.  [default: the exporter's]")
@with_author
@with_output()
@with_servers
def command(
    *,
    servers: Servers,
    output: str,
    what: tuple[str, ...],
    site: str | None,
    selector: tuple[tuple[str, str], ...],
    comment: str | None,
    start: datetime | None,
    fleet: str | None,
    author: str,
    lists: bool,
    cancel: bool,
) -> None:
    """Plan a downtime of ROBOT, of its COMPONENT, or of all robots of a site or with a label.

    No fault begins in it, and none escalates. It begins now, or --from a time, and lasts DURATION.
    """
    if lists and (what or cancel):
        raise click.UsageError("--list takes no ROBOT, and no --cancel")
    if lists:
        _list(servers.alertmanager, fleet, output)
        return
    given, labels = list(what), dict(selector) | ({} if site is None else {"site": site})
    lasts = None if cancel else _duration(given)
    wanted = _wanted(given, labels)
    if lasts is None:
        done = _cancel(servers, fleet, wanted)
    else:
        about = check_comment(author, comment, "what the downtime is for")
        begin = start or datetime.now(timezone.utc)
        times = begin.timestamp(), begin.timestamp() + lasts
        planned = Downtime("", "", *times, author, clean(about, COMMENT_LENGTH))
        done = _plan(servers, fleet, wanted, planned)
    if output == "json":
        print_json(list(map(_fields, done)))
        return
    for each in done:
        print(f"{'cancelled' if cancel else 'planned'}: {_text(each)}")  # noqa: T201


def _duration(given: list[str]) -> float:
    """Take the duration off the end of the arguments."""
    if not given:
        raise click.UsageError(
            "give [ROBOT [COMPONENT]] DURATION and a --comment; or --list or --cancel"
        )
    last = given.pop()
    try:
        return Duration().convert(last, None, None)
    except click.BadParameter as error:
        raise click.UsageError(
            f"{error.format_message().removeprefix('Invalid value: ')}; the duration is the last "
            f"word: ros-diagnostics downtime {' '.join([*given, last])} 2h"
        ) from error


def _wanted(given: list[str], labels: dict[str, str]) -> WantedDowntime:
    if labels and given:
        raise click.UsageError("--site and --selector stand for ROBOT: give one or the other")
    if not labels and len(given) not in (1, 2):
        raise click.UsageError(
            "missing ROBOT: ros-diagnostics downtime ROBOT [COMPONENT] DURATION; with --cancel "
            "no DURATION"
        )
    robot, component = ("", "") if labels else (given[0], given[1] if len(given) > 1 else "")
    if not (robot or labels) or max(len(robot), len(component)) > NAME_LENGTH:
        raise click.UsageError(f"a name has 1 to {NAME_LENGTH} characters")
    return WantedDowntime(robot, component, labels)


def _plan(
    servers: Servers, fleet: str | None, wanted: WantedDowntime, planned: Downtime
) -> list[Planned]:
    """Plan it for each robot; wait until the exporter follows where it holds now."""
    exporter, checked, component = servers.exporter, True, wanted.component
    try:
        fleet, robots, component = _known(exporter, fleet, wanted)
    except UnreachableError as error:
        if fleet is None or wanted.labels:
            hint = "name it with --url" + ("" if wanted.labels else "; or the fleet with --fleet")
            raise UnreachableError(f"no exporter to ask for the robot: {error}; {hint}") from error
        robots, checked = [wanted.robot], False
    done = []
    for robot in robots:
        each = planned._replace(robot=robot, component=component)
        done.append(Planned(_make(servers.alertmanager, fleet, each), fleet, each))
    if not checked:
        note = f"the names were not checked: no exporter answers at {exporter.url}"
        print(f"ros-diagnostics: {printable(note)}", file=sys.stderr)  # noqa: T201
    elif planned.holds(time.time() + 1) and not _is_followed(exporter, done):
        raise NotDoneError(
            f"planned, but the exporter at {exporter.url} does not read it: start it with "
            f"--alertmanager.url={servers.alertmanager.url}"
        )
    return done


def _known(
    exporter: Client, fleet: str | None, wanted: WantedDowntime
) -> tuple[str, list[str], str]:
    """The fleet, the robots and the component that are meant.

    Raises:
        NotDoneError: The exporter does not know the fleet, the robot or the component.
    """
    known = exporter.fleet(() if wanted.labels else (wanted.robot,))
    if fleet not in (None, known["fleet"]):
        raise NotDoneError(f"{exporter.url} is of fleet {known['fleet']!r}")
    found = [each for each in known["robots"] if wanted.labels.items() <= each["labels"].items()]
    if not found and wanted.labels:
        raise NotDoneError(f"no robot has the labels {str(wanted)!r}")
    if not found:
        names = [each["robot"] for each in exporter.fleet()["robots"]]
        raise no_robot(wanted.robot, names)
    names = [each["component"] for each in found[0]["components"]]
    component = meant(wanted.component, names) if wanted.component else ""
    if component and component not in names:
        near = hint(component, names)
        raise NotDoneError(f"{wanted.robot} has no component {component!r}{near}")
    return known["fleet"], [each["robot"] for each in found], component


def _make(client: Client, fleet: str, planned: Downtime) -> str:
    """Make the silence; its id."""
    begin = datetime.fromtimestamp(planned.start, timezone.utc)
    end = begin + timedelta(seconds=planned.end - planned.start)
    matchers = downtime_matchers(fleet, planned.robot, planned.component)
    made = silence(matchers, begin, end, planned.author, planned.comment)
    return str((client.post("/api/v2/silences", made) or {}).get("silenceID", ""))


def _is_followed(exporter: Client, planned: list[Planned]) -> bool:
    """Wait until the exporter shows the downtimes."""
    wanted = {each.downtime[:2] for each in planned}
    deadline = time.monotonic() + FOLLOWED
    while time.monotonic() < deadline:
        robots = exporter.fleet(tuple({robot for robot, _ in wanted}))["robots"]
        found = {(of["robot"], each["component"]) for of in robots for each in of["downtimes"]}
        if wanted <= found:
            return True
        time.sleep(0.5)
    return False


def _cancel(servers: Servers, fleet: str | None, wanted: WantedDowntime) -> list[Planned]:
    planned = _planned(servers.alertmanager, fleet)
    robots = {wanted.robot}
    if wanted.labels:
        fleet, found, _ = _known(servers.exporter, fleet, wanted)
        planned, robots = [each for each in planned if each.fleet == fleet], set(found)
    planned_here = [each for each in planned if each.downtime.robot in robots]
    component = wanted.component
    if component:
        component = meant(component, (each.downtime.component for each in planned_here))
    done = [each for each in planned_here if each.downtime.component == component]
    if not done:
        names = ", ".join(_name(each) for each in planned) or "none"
        raise NotDoneError(f"no downtime is planned for {str(wanted)!r}; planned: {names}")
    for each in done:
        servers.alertmanager.delete(f"/api/v2/silence/{quote(each.silence, safe='')}")
    return done


def _list(client: Client, fleet: str | None, output: str) -> None:
    """Print the downtimes that hold or lie ahead, the next first."""
    now, table, found = time.time(), make_table(*COLUMNS), _planned(client, fleet)
    if output == "json":
        print_json(list(map(_fields, found)))
        return
    for each in found:
        planned = each.downtime
        times = (clock(unix, now, local=True) for unix in (planned.start, planned.end))
        about = (each.fleet, planned.robot, planned.component or "all")
        table.add_row(*cells((*about, *times, planned.author, planned.comment)))
    make_console().print(table)


def _fields(planned: Planned) -> dict[str, Any]:
    return {"fleet": planned.fleet, "silence": planned.silence, **planned.downtime._asdict()}


def _planned(client: Client, fleet: str | None) -> list[Planned]:
    """The downtimes that are not over, in the order of their begin."""
    query = [("filter", f'alertname="{ESCALATION}"')]
    if fleet:
        query.append(("filter", f'fleet="{escape(fleet)}"'))
    silences = listed(client, Silence, f"/api/v2/silences?{urlencode(query)}")
    found = [
        Planned(each.id, matched["fleet"], downtime)
        for each in silences
        if (downtime := downtime_of(each)) is not None and (matched := each.exact()) is not None
    ]
    return sorted(found, key=lambda each: (each.downtime.start, each))


def _name(planned: Planned) -> str:
    return one_line(f"{planned.fleet}/{' '.join(filter(None, planned.downtime[:2]))}")


def _text(planned: Planned) -> str:
    now, downtime = time.time(), planned.downtime
    begin, end = (clock(unix, now, local=True) for unix in (downtime.start, downtime.end))
    return f"{_name(planned)} from {begin} to {end} ({one_line(downtime.comment)})"
