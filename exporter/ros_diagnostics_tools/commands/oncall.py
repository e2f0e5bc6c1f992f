"""``ros-diagnostics-oncall``: who is on call, from oncall.yml, for Alertmanager and for people.

    build       write Alertmanager's configuration with the people on call
    check       whether oncall.yml is right, and whether what was built is up to date
    who         who is on call, now or at a time
    icalendar   print the duties as an iCalendar file

Exit codes: 0; 1 where what was built ends soon or is out of date; 2 for a file that is not right.
"""

from __future__ import annotations

import argparse
import hashlib
import os
import sys
import tempfile
from collections.abc import Sequence
from datetime import datetime, timedelta, timezone
from pathlib import Path

import yaml
from rich.table import Table

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.config.errors import (
    ConfigError,
    Problem,
    WrongValueError,
    quoted,
    suggestion,
)
from ros_diagnostics_exporter.config.scalars import moment
from ros_diagnostics_exporter.files import read_regular
from ros_diagnostics_exporter.texts import printable
from ros_diagnostics_tools.oncall.build import build, built_until
from ros_diagnostics_tools.oncall.calendar import NoCalendarError, calendar
from ros_diagnostics_tools.oncall.file import OnCall, load
from ros_diagnostics_tools.oncall.rota import instant
from ros_diagnostics_tools.terminal import cells, make_console

EXIT_WARNING = 1
EXIT_USAGE = 2  # also for an invalid file, as argparse for an invalid flag
MOST_BYTES = 64 * 1024 * 1024
_DIGEST = "# sha256 of the two: "


def main(arguments: Sequence[str] | None = None, now: datetime | None = None) -> int:
    """Run one of the commands; the exit code. ``now`` is the clock's time unless it is given."""
    options = _parser().parse_args(arguments)
    commands = {"build": _build, "check": _check, "who": _who, "icalendar": _icalendar}
    now = (now or datetime.now(timezone.utc)).replace(second=0, microsecond=0)
    try:
        return commands[options.command](options, load(options.file), now)
    except ConfigError as error:
        print(error, file=sys.stderr)  # noqa: T201
    except (NoCalendarError, OSError) as error:
        print(f"ros-diagnostics-oncall: {printable(str(error))}", file=sys.stderr)  # noqa: T201
    return EXIT_USAGE


def _build(options: argparse.Namespace, oncall: OnCall, now: datetime) -> int:
    base, output, until = options.config, options.output, (now + options.weeks).replace(minute=0)
    if output.resolve() == base.resolve() or output.resolve().parent != base.resolve().parent:
        what = f"{output} cannot be the output"
        remedy = f"name another file in the folder of {base.name}, as its templates are there"
        raise ConfigError([Problem(base, None, "", what, remedy)])
    header = "\n".join(
        [
            f"# Built by ros-diagnostics-oncall {__version__} from {base} and {options.file}:",
            "# edit those and build it again. After the end of the last duty all people of a level",
            f"# are notified, from {oncall.local(until)} on.",
            _digest(options),
        ]
    )
    built = build(oncall, oncall.duties(now, until), base, until, header)
    _write(output, built, base.stat().st_mode)
    if options.rules:
        _write(options.rules, _rules(oncall, until, options.days), 0o644)
    print(f"{output}: on call until {oncall.local(until)}")  # noqa: T201
    return 0


def _check(options: argparse.Namespace, oncall: OnCall, now: datetime) -> int:
    oncall.duties(now, now + options.weeks)
    print(f"{options.file}: valid until {oncall.local(now + options.weeks)}")  # noqa: T201
    if options.built is None:
        return 0
    content = read_regular(options.built, MOST_BYTES).decode("utf-8", "replace")
    until = built_until(content)
    if until is None:
        print(f"{options.built}: was not built by ros-diagnostics-oncall")  # noqa: T201
        return EXIT_WARNING
    print(f"{options.built}: on call until {oncall.local(until)}")  # noqa: T201
    warnings = []
    if _digest(options) not in content.splitlines():
        warnings.append(f"{options.file} or {options.config} has changed since; build it again")
    if until < now + timedelta(days=options.days):
        warnings.append(f"ends in less than {options.days} days; build it again")
    for warning in warnings:
        print(f"{options.built}: {warning}", file=sys.stderr)  # noqa: T201
    return EXIT_WARNING if warnings else 0


def _who(options: argparse.Namespace, oncall: OnCall, now: datetime) -> int:
    at = _instant(options.at, oncall) if options.at else now
    table = Table("Team", "Level", "On call", "Email", "Phone", "Until", "Then", box=None)
    for level, duties in oncall.duties(at, at + options.weeks).items():
        duty, then = duties[0], duties[1].person if len(duties) > 1 else ""
        end = oncall.local(duty.end) if then else ""
        person = oncall.people[duty.person]
        reached = (person.name, person.email, person.phone)
        table.add_row(*cells((level.team, level.name, *reached, end, then)))
    print(f"on call at {oncall.local(at)}")  # noqa: T201
    make_console().print(table)
    return 0


def _icalendar(options: argparse.Namespace, oncall: OnCall, now: datetime) -> int:
    known = sorted({name for level in oncall.levels for name in level.everybody()})
    if options.person not in (None, *known):
        what, remedy = (
            f"{quoted(options.person)} is never on call",
            suggestion(options.person, known),
        )
        raise ConfigError([Problem(Path("--person"), None, "", what, remedy)])
    people = {options.person} if options.person else set(known)
    duties = oncall.duties(now, now + options.weeks)
    sys.stdout.buffer.write(calendar(duties, now, people))
    return 0


def _instant(written: str, oncall: OnCall) -> datetime:
    """A time on the command line; without an offset in the file's time zone."""
    try:
        found = moment(written)
    except WrongValueError as error:
        raise ConfigError([Problem(Path("--at"), None, "", error.what, error.remedy)]) from None
    return found.astimezone(timezone.utc) if found.tzinfo else instant(found, oncall.zone)


def _digest(options: argparse.Namespace) -> str:
    """The line of the header that changes with what it was built from."""
    found = hashlib.sha256()
    for path in (options.config, options.file):
        found.update(hashlib.sha256(read_regular(path, MOST_BYTES)).digest())
    return _DIGEST + found.hexdigest()


def _rules(oncall: OnCall, until: datetime, days: int) -> str:
    """A rule that fires ``days`` before the end. The time is in it: nothing has to be scraped."""
    end = until - timedelta(days=days)
    alert = {
        "alert": "RosDiagnosticsOnCallEnds",
        "expr": f"vector(time()) > {end.timestamp():.0f}",
        "labels": {"severity": "warning"},
        "annotations": {
            "summary": f"The rota in Alertmanager ends on {oncall.local(until)}.",
            "description": "Run ros-diagnostics-oncall build and reload Alertmanager and "
            "Prometheus. After the end all people of a level are notified at the same time.",
        },
    }
    rules = {"groups": [{"name": "ros-diagnostics-oncall", "rules": [alert]}]}
    header = f"# Built by ros-diagnostics-oncall {__version__}.\n"
    return header + yaml.safe_dump(rules, sort_keys=False, allow_unicode=True)


def _write(path: Path, content: str, mode: int) -> None:
    """Write a file at once, so that nobody reads half of it."""
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            file.write(content)
        Path(name).chmod(mode & 0o777)
        Path(name).replace(path)
    except BaseException:
        Path(name).unlink(missing_ok=True)
        raise


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="ros-diagnostics-oncall",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"%(prog)s {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    helps = {
        "build": "write Alertmanager's configuration with the people on call",
        "check": "check oncall.yml, and what was built",
        "who": "print who is on call",
        "icalendar": "print the duties as an iCalendar file",
    }
    command = {name: commands.add_parser(name, help=text) for name, text in helps.items()}
    for each in command.values():
        _common(each)
    for name in ("build", "check"):
        _add_path(command[name], "--config", "alertmanager.yml", "Alertmanager's configuration")
        command[name].add_argument(
            "--days",
            type=_count,
            default=14,
            help="how long before its end to warn (default: %(default)s)",
        )
    what = "what to write; in the same folder as --config"
    _add_path(command["build"], "--output", "alertmanager-oncall.yml", what)
    _add_path(command["build"], "--rules", None, "also write a rule for Prometheus: it ends soon")
    _add_path(command["check"], "--built", None, "also check this output of build")
    at = "such as 2026-12-24T20:00; without an offset in the file's time zone (default: now)"
    command["who"].add_argument("--at", metavar="TIME", help=at)
    command["icalendar"].add_argument("--person", help="only this person's duties")
    return parser


def _common(parser: argparse.ArgumentParser) -> None:
    _add_path(parser, "--file", "oncall.yml", "the rota")
    parser.add_argument(
        "--weeks",
        type=lambda text: timedelta(weeks=_count(text)),
        default=timedelta(weeks=13),
        help="how far to look ahead (default: 13)",
    )


def _add_path(parser: argparse.ArgumentParser, flag: str, default: str | None, what: str) -> None:
    text = f"{what} (default: {default})" if default else what
    parser.add_argument(
        flag, type=Path, metavar="FILE", default=Path(default) if default else None, help=text
    )


def _count(text: str) -> int:
    if text.isdecimal() and 1 <= int(text) <= 520:
        return int(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from 1 to 520")
