"""``ros-diagnostics-downtime``: plan a downtime of a robot, or of one component of it.

No fault of it begins in a downtime, and none escalates; what is still wrong at the end is a fault
then. A fault that lasted before goes on, and its recovery is sent at the end. The page,
ros-diagnostics-status and ros-diagnostics-why show who planned it, and why.
"""

# A downtime is a silence of the escalation in Alertmanager, as an acknowledgement is, which
# exporters read (see alertmanager.py): all of a pair follow it, and it outlives any restart.

from __future__ import annotations

import argparse
import re
import sys
import time
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from typing import Any, NamedTuple
from urllib.parse import quote, urlencode

from rich.table import Table

from ros_diagnostics_exporter import __version__, durations
from ros_diagnostics_exporter.alertmanager import (
    COMMENT_LENGTH,
    ESCALATION,
    NAME_LENGTH,
    clean,
    downtime_matchers,
    downtime_of,
    silence,
)
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.model import Downtime
from ros_diagnostics_exporter.severity import clock
from ros_diagnostics_exporter.texts import escape, nearest, one_line, printable
from ros_diagnostics_tools.commands.ack import DEFAULT_URL, current_user
from ros_diagnostics_tools.connection_flags import (
    EXPORTER_URL,
    INTERRUPTED,
    add_arguments,
    make_client,
)
from ros_diagnostics_tools.terminal import cells, make_console

FOLLOWED = 20.0  # seconds in which an exporter has read a new downtime; it asks every 5 s
LONGEST = 3650 * 86_400.0  # seconds
_TIME_OF_DAY = re.compile(r"\d\d:\d\d(:\d\d)?")


class Planned(NamedTuple):
    """A downtime as Alertmanager has it."""

    silence: str  # the silence's id
    fleet: str
    downtime: Downtime


def main(arguments: Sequence[str] | None = None) -> int:
    """Plan, list or cancel; exit code 0, or 1 where that failed."""
    parser = _parser()
    options = parser.parse_intermixed_args(arguments)
    _check(parser, options)
    try:
        client = make_client(options)
        if options.list:
            return _list(client, options.fleet)
        return _cancel(client, options) if options.cancel else _plan(client, options)
    except UnreachableError as error:
        print(f"ros-diagnostics-downtime: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return 1
    except KeyboardInterrupt:
        return INTERRUPTED


def _check(parser: argparse.ArgumentParser, options: argparse.Namespace) -> None:
    """Take the positional arguments apart; a usage error where they are not what they should."""
    given = list(options.what)
    options.seconds = None
    if options.list:
        if given:
            parser.error("--list takes no ROBOT")
        return
    if not options.cancel:
        if len(given) not in (2, 3):
            parser.error("give ROBOT [COMPONENT] DURATION and a --comment; or --list or --cancel")
        options.seconds = _duration(parser, given.pop())
        if not (options.comment or "").strip():
            parser.error("say with --comment what the downtime is for")
        if not options.author:
            parser.error("give your name with --author: this user has no entry in passwd")
    if len(given) not in (1, 2):
        parser.error("--cancel needs ROBOT [COMPONENT]")
    options.robot, options.component = given[0], given[1] if len(given) > 1 else ""
    if not options.robot or max(map(len, given)) > NAME_LENGTH:
        parser.error(f"a name has 1 to {NAME_LENGTH} characters")


def _duration(parser: argparse.ArgumentParser, text: str) -> float:
    try:
        seconds = durations.parse(text)
    except ValueError:
        parser.error(f"{text!r} is not a duration such as 1h or 1h30m, which comes last")
    if not 0 < seconds <= LONGEST:
        parser.error(f"{text!r} is not a duration above 0 and of ten years at most")
    return seconds


def start(text: str, now: datetime | None = None) -> datetime:
    """The moment that --from names: 2h (from now), 14:30 (the next), 2027-01-31T14:30.

    A time without a zone is that of this machine's.

    Raises:
        argparse.ArgumentTypeError: It is none, or has passed.
    """
    now = now or datetime.now().astimezone()
    try:
        return now + timedelta(seconds=durations.parse(text))
    except (ValueError, OverflowError):
        pass
    try:
        if _TIME_OF_DAY.fullmatch(text):
            then = datetime.fromisoformat(f"{now.date()} {text}").astimezone(now.tzinfo)
            return then + timedelta(days=then < now)
        then = datetime.fromisoformat(text).astimezone()
    except (ValueError, OverflowError) as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no time; write it as 2h, 14:30 or 2027-01-31T14:30"
        ) from error
    if then < now:
        raise argparse.ArgumentTypeError(f"{text!r} has passed")
    return then


def _plan(client: Client, options: argparse.Namespace) -> int:
    exporter = Client(options.exporter, timeout=options.timeout, ca_file=options.ca_file)
    fleet = options.fleet
    try:
        known = exporter.fleet((options.robot,))
    except UnreachableError as error:
        known = None
        if fleet is None:
            hint = "name it with --exporter; or name the fleet with --fleet"
            raise UnreachableError(f"no exporter to ask for the robot: {error}; {hint}") from error
    if known is not None:
        _check_names(exporter, known, options)
        fleet = known["fleet"]
    downtime = _make(client, fleet, options)
    print(f"planned: {_text(fleet, downtime)}")  # noqa: T201
    if known is None:
        note = f"not checked: no exporter answers at {options.exporter}"
        print(f"ros-diagnostics-downtime: {printable(note)}", file=sys.stderr)  # noqa: T201
    elif downtime.holds(time.time() + 1) and not _is_followed(exporter, options):
        raise UnreachableError(
            f"the exporter at {options.exporter} does not follow it: it has to run with "
            f"--alertmanager.url, of the Alertmanager at {client.url}"
        )
    return 0


def _check_names(exporter: Client, known: dict[str, Any], options: argparse.Namespace) -> None:
    """Raise UnreachableError for a fleet, robot or component that the exporter does not know."""
    if options.fleet not in (None, known["fleet"]):
        raise UnreachableError(f"{options.exporter} is of fleet {known['fleet']!r}")
    if not known["robots"]:
        names = [each["robot"] for each in exporter.fleet()["robots"]]
        raise UnreachableError(f"no robot {options.robot!r}{_hint(options.robot, names)}")
    names = [each["component"] for each in known["robots"][0]["components"]]
    if options.component and options.component not in names:
        near = _hint(options.component, names)
        raise UnreachableError(f"{options.robot} has no component {options.component!r}{near}")


def _hint(name: str, names: list[str]) -> str:
    near = nearest(name, names)
    return f"; the nearest is {near!r}" if near else ""


def _make(client: Client, fleet: str, options: argparse.Namespace) -> Downtime:
    begin = options.start or datetime.now(timezone.utc)
    end = begin + timedelta(seconds=options.seconds)
    comment = clean(options.comment, COMMENT_LENGTH)
    matchers = downtime_matchers(fleet, options.robot, options.component)
    client.post("/api/v2/silences", silence(matchers, begin, end, options.author, comment))
    times = begin.timestamp(), end.timestamp()
    return Downtime(options.robot, options.component, *times, options.author, comment)


def _is_followed(exporter: Client, options: argparse.Namespace) -> bool:
    """Wait until the exporter shows the downtime."""
    deadline = time.monotonic() + FOLLOWED
    while time.monotonic() < deadline:
        robots = exporter.fleet((options.robot,))["robots"]
        found = robots[0].get("downtimes", ()) if robots else ()
        if any(each["component"] == options.component for each in found):
            return True
        time.sleep(0.5)
    return False


def _cancel(client: Client, options: argparse.Namespace) -> int:
    planned = _planned(client, options.fleet)
    wanted = (options.robot, options.component)
    found = [each for each in planned if each.downtime[:2] == wanted]
    if not found:
        names = ", ".join(_name(each.fleet, each.downtime) for each in planned) or "none"
        of = " ".join(filter(None, wanted))
        raise UnreachableError(f"no downtime is planned for {of!r}; planned: {names}")
    for each in found:
        client.delete(f"/api/v2/silence/{quote(each.silence, safe='')}")
        print(f"cancelled: {_text(each.fleet, each.downtime)}")  # noqa: T201
    return 0


def _list(client: Client, fleet: str | None) -> int:
    """Print the downtimes that hold or lie ahead, the next first."""
    now = time.time()
    table = Table("Fleet", "Robot", "Component", "From", "To", "By", "Comment", box=None)
    for each in _planned(client, fleet):
        planned = each.downtime
        times = (clock(unix, now, local=True) for unix in (planned.start, planned.end))
        about = (each.fleet, planned.robot, planned.component or "all")
        table.add_row(*cells((*about, *times, planned.author, planned.comment)))
    make_console().print(table)
    return 0


def _planned(client: Client, fleet: str | None) -> list[Planned]:
    """The downtimes that are not over, in the order of their begin."""
    query = [("filter", f'alertname="{ESCALATION}"')]
    if fleet:
        query.append(("filter", f'fleet="{escape(fleet)}"'))
    silences = client.get(f"/api/v2/silences?{urlencode(query)}")
    if not isinstance(silences, list):
        raise UnreachableError(f"{client.url} is not an Alertmanager")
    found = []
    for each in silences:
        downtime = downtime_of(each)
        if downtime is not None:
            matched = {of["name"]: of["value"] for of in each["matchers"]}
            found.append(Planned(each["id"], matched["fleet"], downtime))
    return sorted(found, key=lambda each: (each.downtime.start, each))


def _name(fleet: str, downtime: Downtime) -> str:
    return one_line(f"{fleet}/{' '.join(filter(None, downtime[:2]))}")


def _text(fleet: str, downtime: Downtime) -> str:
    now = time.time()
    begin, end = (clock(unix, now, local=True) for unix in (downtime.start, downtime.end))
    return f"{_name(fleet, downtime)} from {begin} to {end} ({one_line(downtime.comment)})"


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-downtime",
        usage="%(prog)s [options] ROBOT [COMPONENT] DURATION --comment TEXT\n"
        "       %(prog)s [options] --list\n"
        "       %(prog)s [options] --cancel ROBOT [COMPONENT]",
        description=__doc__.partition(": ")[2],
        epilog='example: ros-diagnostics-downtime robot_3 "Motor 1" 1h30m --comment "new gears"',
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="ROBOT [COMPONENT] DURATION",
        help="which robot, or which of its components, and for how long: 90m, 1h30m, 2d",
    )
    parser.add_argument("--comment", help="what it is for")
    parser.add_argument(
        "--from",
        dest="start",
        type=start,
        metavar="TIME",
        help="when it begins: 2h (from now), 14:30, 2027-01-31T14:30 (default: now)",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--list", action="store_true", help="list those that hold or lie ahead")
    what.add_argument("--cancel", action="store_true", help="end it now, or never begin it")
    parser.add_argument("--fleet", help="the robot's fleet (default: the exporter's)")
    parser.add_argument(
        "--author",
        default=current_user(),
        help="who plans it (default: the current user, %(default)s)",
    )
    parser.add_argument(
        "--exporter",
        default=EXPORTER_URL,
        metavar="URL",
        help="the exporter, which knows the robots and has to follow (default: %(default)s)",
    )
    add_arguments(parser, "Alertmanager", DEFAULT_URL)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
