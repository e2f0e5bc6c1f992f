"""``ros-diagnostics-why``: why somebody was notified of a robot's faults, or nobody."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from datetime import datetime, timedelta
from typing import Any
from urllib.parse import urlencode

from rich.table import Table
from rich.text import Text

from ros_diagnostics_exporter import __version__, durations
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.severity import clock
from ros_diagnostics_exporter.texts import one_line, printable
from ros_diagnostics_tools.connection_flags import INTERRUPTED, add_arguments, make_client
from ros_diagnostics_tools.terminal import cells, make_console

_TIME_OF_DAY = re.compile(r"\d\d:\d\d(:\d\d)?")


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the ledger; exit code 0, or 1 if the exporter does not know the robot or respond."""
    options = _parser().parse_args(arguments)
    query = {"robot": options.robot, "component": options.component, "at": options.at}
    given = urlencode({key: value for key, value in query.items() if value is not None})
    try:
        _print(_ask(make_client(options), f"/api/v1/why?{given}"))
    except UnreachableError as error:
        print(f"ros-diagnostics-why: {printable(str(error))}", file=sys.stderr)  # noqa: T201
        return 1
    except KeyboardInterrupt:
        return INTERRUPTED
    return 0


def _ask(client: Client, path: str) -> dict[str, Any]:
    found = client.get(path)
    if not isinstance(found, dict) or not {"entries", "now", "time"} <= found.keys():
        raise UnreachableError(f"{client.url}{path} is not a ROS diagnostics exporter")
    return found


def _print(found: dict[str, Any]) -> None:
    console = make_console()
    table = Table("Time", "What happened", box=None, pad_edge=False)
    for each in found["entries"]:
        moment = clock(each["time"], found["time"], local=True)
        table.add_row(*cells((moment, each["text"])))
    console.print(table if found["entries"] else Text("No fault and no event at that time."))
    console.print(Text(f"\nNow, {clock(found['time'], found['time'], local=True)}:"))
    for sentence in found["now"] or ["no problem"]:
        console.print(Text(f"  {one_line(sentence)}"))


def moment(text: str, now: datetime | None = None) -> str:
    """A time of --at as the API takes it: a Unix time, or a duration such as 10m.

    A time without a zone is that of this machine's; a time of day is the last such time.

    Raises:
        argparse.ArgumentTypeError: It is neither.
    """
    try:
        durations.parse(text)
    except ValueError:
        pass
    else:
        return text
    now = now or datetime.now().astimezone()
    try:
        if _TIME_OF_DAY.fullmatch(text):
            then = datetime.fromisoformat(f"{now.date()} {text}").astimezone()
            return str((then - timedelta(days=then > now)).timestamp())
        return str(datetime.fromisoformat(text).timestamp())
    except ValueError as error:
        raise argparse.ArgumentTypeError(
            f"{text!r} is no time; write it as 10m, 14:30 or 2027-01-31T14:30"
        ) from error


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-why",
        description=__doc__.partition(": ")[2],
        epilog='example: ros-diagnostics-why robot_3 "Motor 1" --at 14:30',
    )
    parser.add_argument("robot", metavar="ROBOT", help="its name")
    parser.add_argument(
        "component", nargs="?", metavar="COMPONENT", help="only this component's faults"
    )
    parser.add_argument(
        "--at",
        type=moment,
        metavar="TIME",
        help="the faults that lasted then or had just ended, or the last one: 10m (ago), 14:30, "
        "2027-01-31T14:30 (default: now)",
    )
    add_arguments(parser)
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
