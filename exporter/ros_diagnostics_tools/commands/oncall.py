"""``ros-diagnostics oncall``: who is on call, from oncall.yml, for Alertmanager and for people."""

from __future__ import annotations

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import click
import yaml

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.config.errors import ConfigError, Finding, quoted, suggestion
from ros_diagnostics_exporter.config.scalars import DAYS
from ros_diagnostics_exporter.durations import written
from ros_diagnostics_exporter.files import read_regular
from ros_diagnostics_tools.errors import NO, UnusableError
from ros_diagnostics_tools.flag_types import PATH
from ros_diagnostics_tools.oncall.build import build, built_until, check
from ros_diagnostics_tools.oncall.calendar import NoCalendarError, calendar
from ros_diagnostics_tools.oncall.file import Level, OnCall, load
from ros_diagnostics_tools.oncall.rota import Duty, instant
from ros_diagnostics_tools.terminal import cells, make_console, make_table, print_json, with_output
from ros_diagnostics_tools.times import Duration, moment

MOST_BYTES = 64 * 1024 * 1024
COLUMNS = ("Team", "Level", "On call", "Email", "Phone", "Until", "Then")
_DIGEST = "# sha256 of the two: "


@dataclass(frozen=True)
class Rota:
    """The rota that a subcommand is about, and how far it looks ahead."""

    file: Path
    oncall: OnCall
    now: datetime
    ahead: timedelta


def _now() -> datetime:
    return datetime.now(timezone.utc)


@click.group(epilog="Example: ros-diagnostics oncall who --at 2026-12-24T20:00")
def command() -> None:
    """Who is on call: build Alertmanager's configuration from oncall.yml, check it, show it."""


def _with_rota(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the flags for the rota; the function gets it as ``rota``."""

    def run(file: Path, ahead: float, **given: Any) -> Any:
        now = _now().replace(second=0, microsecond=0)
        try:
            return function(rota=Rota(file, load(file), now, timedelta(seconds=ahead)), **given)
        except NoCalendarError as error:
            raise UnusableError(str(error)) from error

    options = (
        click.option("--file", type=PATH, default=Path("oncall.yml"), help="The rota."),
        click.option("--ahead", type=Duration(), default="13w", help="How far to look ahead."),
    )
    run.__doc__ = function.__doc__
    decorated: Callable[..., Any] = run
    for option in options:
        decorated = option(decorated)
    return decorated


def _with_config(function: Callable[..., Any]) -> Callable[..., Any]:
    """Add the flags of what is built: Alertmanager's configuration, and when to warn."""
    before = click.option(
        "--warn-before", type=Duration(), default="14d", help="How long before its end to warn."
    )
    config = click.option(
        "--config",
        type=PATH,
        default=Path("alertmanager.yml"),
        help="Alertmanager's configuration.",
    )
    return config(before(function))


@command.command(
    "build",
    epilog="Example: ros-diagnostics oncall build --to alertmanager-oncall.yml",
)
@click.option(
    "--to",
    type=PATH,
    default=Path("alertmanager-oncall.yml"),
    help="What to write; in the same folder as --config.",
)
@click.option("--rules", type=PATH, help="Also write a rule that fires before the rota ends.")
@_with_config
@with_output()
@_with_rota
def _build(
    *, rota: Rota, config: Path, to: Path, rules: Path | None, warn_before: float, output: str
) -> None:
    """Write Alertmanager's configuration with the people on call."""
    oncall, until = rota.oncall, (rota.now + rota.ahead).replace(minute=0)
    if to.resolve() == config.resolve() or to.resolve().parent != config.resolve().parent:
        what = f"{to} cannot be the output"
        remedy = f"name another file in the folder of {config.name}, as its templates are there"
        raise ConfigError([Finding(config, None, "", what, remedy)])
    header = "\n".join(
        [
            f"# Built by ros-diagnostics oncall {__version__} from {config} and {rota.file}:",
            "# edit those and build it again. After the end of the last duty all people of a level",
            f"# are notified, from {oncall.local(until)} on.",
            _digest(config, rota.file),
        ]
    )
    _print_warnings(map(str, (*oncall.warnings(), *check(oncall, config))))
    built = build(oncall, oncall.duties(rota.now, until), config, until, header)
    _write(to, built, config.stat().st_mode)
    if rules:
        _write(rules, _rules(oncall, until, timedelta(seconds=warn_before)), 0o644)
    if output == "json":
        print_json({"file": str(to), "until": until.isoformat()})
    else:
        print(f"{to}: on call until {oncall.local(until)}")  # noqa: T201


@command.command(
    "check", epilog="Example: ros-diagnostics oncall check --built alertmanager-oncall.yml"
)
@click.option("--built", type=PATH, help="Also check this file, which build wrote.")
@_with_config
@with_output()
@_with_rota
def _check(rota: Rota, config: Path, built: Path | None, warn_before: float, output: str) -> int:
    """Check oncall.yml with Alertmanager's configuration, and what was built.

    Exit code 1 where a receiver gets less than before, a daily handover divides the hours of a
    day, or what was built ends soon or is out of date. Where people share days, it prints who gets
    which.
    """
    oncall = rota.oncall
    duties = oncall.duties(rota.now, rota.now + rota.ahead)
    warnings = [str(each) for each in (*oncall.warnings(), *check(oncall, config))]
    lines = [f"{rota.file}: valid until {oncall.local(rota.now + rota.ahead)}"]
    lines += [line for level in duties for line in _days(rota, level, duties[level])]
    if built is not None:
        content = read_regular(built, MOST_BYTES).decode("utf-8", "replace")
        until = built_until(content)
        if until is None:
            warnings.append(f"{built}: was not built by ros-diagnostics oncall")
        else:
            lines.append(f"{built}: on call until {oncall.local(until)}")
            if _digest(config, rota.file) not in content.splitlines():
                warnings.append(
                    f"{built}: {rota.file} or {config} has changed since; build it again"
                )
            if until < rota.now + timedelta(seconds=warn_before):
                left = written(warn_before)
                warnings.append(f"{built}: ends in less than {left}; build it again")
    if output == "json":
        print_json({"found": lines, "warnings": warnings})
    else:
        print(*lines, sep="\n")  # noqa: T201
        _print_warnings(warnings)
    return NO if warnings else 0


def _print_warnings(warnings: Iterable[str]) -> None:
    for each in warnings:
        print(each, file=sys.stderr)  # noqa: T201


def _days(rota: Rota, level: Level, duties: list[Duty]) -> Iterator[str]:
    """Of how many Mondays and so on each person has a part, where several share hours of a week."""
    if not any(shift.hours and len(shift.people) > 1 for shift in level.shifts):
        return
    yield f"days of {level.title} until then:"
    for name in level.everybody():
        found = rota.oncall.days(duties, name, rota.now)
        days = [f"{day} {found[day]}" for day in DAYS if found[day]]
        yield f"  {name}: {', '.join(days) or 'none'}"


@command.command("who", epilog="Example: ros-diagnostics oncall who --at 14:30")
@click.option(
    "--at",
    metavar="TIME",
    help="When: 2h (from now), 14:30, 2026-12-24T20:00; without an offset in the file's time zone. "
    " [default: now]",
)
@with_output()
@_with_rota
def _who(rota: Rota, at: str | None, output: str) -> None:
    """Show who is on call, now or at a time."""
    oncall, then = rota.oncall, _instant(at, rota) if at else rota.now
    rows = []
    for level, duties in oncall.duties(then, then + rota.ahead).items():
        duty, following = duties[0], duties[1].person if len(duties) > 1 else ""
        end = oncall.local(duty.end) if following else ""
        person = oncall.people[duty.person]
        reached = (person.name, person.email, person.phone)
        rows.append((level.team, level.name, *reached, end, following))
    if output == "json":
        names = [title.lower().replace(" ", "_") for title in COLUMNS]
        print_json(
            {"at": then.isoformat(), "levels": [dict(zip(names, row, strict=True)) for row in rows]}
        )
        return
    table = make_table(*COLUMNS)
    for row in rows:
        table.add_row(*cells(row))
    print(f"on call at {oncall.local(then)}")  # noqa: T201
    make_console().print(table)


@command.command("icalendar", epilog="Example: ros-diagnostics oncall icalendar --person anna")
@click.option("--person", help="Only this person's duties.")
@_with_rota
def _icalendar(rota: Rota, person: str | None) -> None:
    """Print the duties as an iCalendar file."""
    known = sorted({name for level in rota.oncall.levels for name in level.everybody()})
    if person not in (None, *known):
        what, remedy = f"{quoted(person)} is never on call", suggestion(person or "", known)
        raise ConfigError([Finding(Path("--person"), None, "", what, remedy)])
    people = {person} if person else set(known)
    duties = rota.oncall.duties(rota.now, rota.now + rota.ahead)
    sys.stdout.buffer.write(calendar(duties, rota.now, people))


def _instant(text: str, rota: Rota) -> datetime:
    """A time on the command line; without an offset in the file's time zone."""
    zone = rota.oncall.zone
    try:
        found = moment(
            text, rota.now.astimezone(zone), ahead=True, localize=lambda naive: instant(naive, zone)
        )
    except ValueError as error:
        raise click.UsageError(f"--at: {error}") from None
    return found.astimezone(timezone.utc)


def _digest(config: Path, file: Path) -> str:
    """The line of the header that changes with what it was built from."""
    found = hashlib.sha256()
    for path in (config, file):
        found.update(hashlib.sha256(read_regular(path, MOST_BYTES)).digest())
    return _DIGEST + found.hexdigest()


def _rules(oncall: OnCall, until: datetime, before: timedelta) -> str:
    """A rule that fires so long before the end. The time is in it: nothing has to be scraped."""
    end = until - before
    alert = {
        "alert": "RosDiagnosticsOnCallEnds",
        "expr": f"vector(time()) > {end.timestamp():.0f}",
        "labels": {"severity": "warning"},
        "annotations": {
            "summary": f"The rota in Alertmanager ends on {oncall.local(until)}.",
            "description": "Run ros-diagnostics oncall build and reload Alertmanager and "
            "Prometheus. After the end all people of a level are notified at the same time.",
        },
    }
    rules = {"groups": [{"name": "ros-diagnostics-oncall", "rules": [alert]}]}
    header = f"# Built by ros-diagnostics oncall {__version__}.\n"
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
