"""``nagios2fleet``: Nagios' object files -> fleet.yml, routes for Alertmanager, and a report.

For sites that come from Nagios. It writes files and changes nothing else; each line of Nagios'
files is in the report, with where it went or what to do.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.config.errors import WrongValueError
from ros_diagnostics_exporter.config.scalars import name, time_zone
from ros_diagnostics_tools.nagios.importer.convert import REPORT, Converted, Options, convert
from ros_diagnostics_tools.nagios.importer.files import NagiosError

EPILOG = """\
  nagios2fleet /etc/nagios4/nagios.cfg --output new
  ros-diagnostics-exporter --config.file new/fleet.yml --config.check

A robot is a host with a service whose plug-in has ros, robot or diagnostics in its file name;
--plugin names another one. Exit codes: 0 written, 1 nothing is written, 2 wrong arguments.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Convert; exit code 0, or 1 where files cannot be read or written."""
    options = _parser().parse_args(arguments)
    try:
        converted = convert(
            options.files, Options(options.fleet, tuple(options.plugin), options.time_zone)
        )
        _write(converted, options.output, force=options.force)
    except (NagiosError, OSError) as error:
        print(f"nagios2fleet: {error}", file=sys.stderr)  # noqa: T201
        return 1
    lost = len(converted.ledger.lost_rows)
    print(  # noqa: T201
        f"{converted.robots} robots; {', '.join(converted.texts)} written to {options.output}/; "
        f"{lost} lines have no full equivalent: see {REPORT}"
    )
    if not converted.robots:
        commands = ", ".join(converted.commands) or "none"
        print(  # noqa: T201
            "nagios2fleet: no service checks a robot: name the ROS plug-in with --plugin, by its "
            f"command or its file (commands of services: {commands})",
            file=sys.stderr,
        )
    return 0


def _write(converted: Converted, folder: Path, *, force: bool) -> None:
    there = [each for each in converted.texts if (folder / each).exists()]
    if there and not force:
        raise NagiosError(
            f"{folder} has {', '.join(there)} already; choose another --output, or overwrite them "
            "with --force"
        )
    folder.mkdir(parents=True, exist_ok=True)
    for each, text in converted.texts.items():
        (folder / each).write_text(text, encoding="utf-8")


def _fleet(text: str) -> str:
    return _checked(name, text)


def _time_zone(text: str) -> str:
    return _checked(time_zone, text)


def _checked(check: object, text: str) -> str:
    try:
        return str(check(text)) if callable(check) else text
    except WrongValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="nagios2fleet",
        description="Translate Nagios' object files to fleet.yml and routes for Alertmanager.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILE",
        help="nagios.cfg, object files, or folders of object files",
    )
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("nagios2fleet"),
        metavar="DIR",
        help="the folder to write to (default: %(default)s)",
    )
    parser.add_argument("--force", action="store_true", help="overwrite the files that are there")
    parser.add_argument(
        "--fleet", type=_fleet, default="nagios", help="the fleet's name (default: %(default)s)"
    )
    parser.add_argument(
        "--plugin",
        action="append",
        default=[],
        metavar="NAME",
        help="a command or program that checks robots, with * for anything; may be repeated",
    )
    parser.add_argument(
        "--time-zone",
        type=_time_zone,
        default="UTC",
        metavar="ZONE",
        help="the time zone of Nagios' host, for its timeperiods (default: %(default)s)",
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    return parser


if __name__ == "__main__":
    sys.exit(main())
