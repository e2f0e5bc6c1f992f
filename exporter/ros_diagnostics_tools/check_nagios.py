"""``check_ros_diagnostics``: a Nagios plug-in that checks one robot through the exporter.

For sites that keep Nagios. It prints what the plug-in of the 2014 master's thesis printed, which
polled the robot itself: the sensors by state. Its output and exit codes follow
https://www.monitoring-plugins.org/doc/guidelines.html.

A sensor counts by what was last received of it, because Nagios has soft and hard states of its own;
whether the exporter has confirmed the problem is in the text. With --confirmed it counts only then.
Planned STALE and maintenance are listed and do not count.
"""

from __future__ import annotations

import argparse
import contextlib
import math
import signal
import sys
from collections.abc import Iterable, Iterator, Sequence
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple, NoReturn

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.fleet_texts import maintenance_text, span
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_exporter.severity import (
    STATE_OF_LEVEL,
    ShownProblem,
    as_planned,
    component_path,
    is_bad,
    shown_problems,
    silent_text,
)
from ros_diagnostics_exporter.texts import first_few, one_line

OK, WARNING, CRITICAL, UNKNOWN = range(4)  # exit codes
LISTS = ("CRITICAL", "STALE", "WARNING", "OK")  # in the order of the output, worst first
# Nagios cuts a plug-in's output at 8 kB, and the performance data come last.
MAX_TEXT = 4_000  # characters before them
MAX_LISTED = 20  # sensors of one list
MAX_MESSAGE = 80  # characters of a sensor's message
MAX_VALUES = 50  # in the performance data
MAX_PERFORMANCE = 3_900  # characters of them
FILES = {
    "--password-file": "the user's password, in one line",
    "--ca-file": "CA of the exporter's certificate",
    "--cert-file": "client certificate, with --key-file",
    "--key-file": "key of --cert-file",
}
CONNECTION = ("url", "timeout", "user", "password_file", "ca_file", "cert_file", "key_file")
# Units that the guidelines know for performance data; any other goes into the label.
UNITS = {"s": "s", "ms": "ms", "us": "us", "%": "%", "B": "B", "kB": "KB", "MB": "MB", "TB": "TB"}


class Sensor(NamedTuple):
    """A component, or a check that misses some, as it is listed: ``entry`` is its text."""

    list_name: str
    entry: str
    counts: bool


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Wrong arguments are UNKNOWN; argparse's own code 2 would be CRITICAL."""
        print(f"UNKNOWN - {_clean(message)}")  # noqa: T201
        sys.exit(UNKNOWN)


def main(arguments: Sequence[str] | None = None) -> int:
    """Check once, print one line, return the exit code."""
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGALRM, _too_late)
    signal.setitimer(signal.ITIMER_REAL, options.timeout)
    try:
        code, line = check(
            Client(**{name: getattr(options, name) for name in CONNECTION}).fleet((options.robot,)),
            options.robot,
            options.name,
            confirmed=options.confirmed,
        )
    except UnreachableError as error:
        code, line = UNKNOWN, f"UNKNOWN - {_clean(str(error))}"
    except _TooLateError:
        code, line = (
            UNKNOWN,
            f"UNKNOWN - no answer from {_clean(options.url)} in {options.timeout:g} s",
        )
    except Exception as error:  # noqa: BLE001 - Python's own exit code 1 would be WARNING
        what = "the exporter's answer is not as expected; is it of the same version?"
        code, line = UNKNOWN, f"UNKNOWN - {what} ({_clean(repr(error))})"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    print(line)  # noqa: T201
    return code


def check(
    fleet: dict[str, Any], name: str, pattern: str, *, confirmed: bool = False
) -> tuple[int, str]:
    """Exit code and output for the sensors of robot ``name`` whose path contains ``pattern``.

    With ``confirmed`` only problems count that the exporter has confirmed.
    """
    robot = next((each for each in fleet["robots"] if each["robot"] == name), None)
    if robot is None:
        return UNKNOWN, f"UNKNOWN - the exporter knows no robot {_clean(name)!r}"
    now = fleet["time"]
    code, text = _state(robot, pattern, now, confirmed=confirmed)
    if robot["maintenance"]:
        code, text = OK, f"in {maintenance_text(robot, now, local=True)}: {text}"
    return code, f"{('OK', 'WARNING', 'CRITICAL', 'UNKNOWN')[code]} - {text}"


def _state(robot: dict[str, Any], pattern: str, now: float, *, confirmed: bool) -> tuple[int, str]:
    """Exit code and output without the first word, as if there were no maintenance."""
    problems, _number = shown_problems(robot, now, len(robot["problems"]), local=True)
    if not robot["up"]:
        silent = [each for each in problems if each.problem["scope"] == "robot"]
        reason = silent_text(robot["silent_reason"])
        text = f"robot {_clean(robot['robot'])} is silent: {reason}"
        counts = not confirmed or any(map(_is_confirmed, silent))
        return UNKNOWN if counts else OK, f"{text}{_details(silent, now, '')}"
    components = [each for each in robot["components"] if _matches(component_path(each), pattern)]
    missing = list(_missing(robot, problems, pattern, now, confirmed=confirmed))
    if not components and not missing:
        return CRITICAL, f"no sensor matches '{_clean(pattern)}'"
    by_name: dict[tuple[str, str], list[ShownProblem]] = {}
    for shown in problems:
        name = (shown.problem["group"], shown.problem["component"])
        by_name.setdefault(name, []).append(shown)
    sensors = [
        _sensor(
            each,
            by_name.get((each["group"], each["component"]), []),
            robot,
            now,
            confirmed=confirmed,
        )
        for each in components
    ]
    text = ", ".join(_list_texts([*missing, *sensors]))
    text = text if len(text) <= MAX_TEXT else f"{text[:MAX_TEXT]}…"
    performance = " ".join(_performance(sensors, components))
    return _exit_code([*missing, *sensors]), f"{text} | {performance}"


def _sensor(
    component: dict[str, Any],
    problems: list[ShownProblem],
    robot: dict[str, Any],
    now: float,
    *,
    confirmed: bool,
) -> Sensor:
    """A component of a robot with its problems and those of its values."""
    hard = [each.state for each in problems if _is_confirmed(each)]
    words = ["OK" if component.get("suppressed_because") else STATE_OF_LEVEL[component["level"]]]
    of_values = (each for each in problems if each.problem["scope"] == "value")
    words += [each.state for each in of_values if is_bad(each.problem)]
    planned = as_planned(component)
    words = hard if confirmed and hard else words
    words = ["WARNING" if each == "FLAPPING" else each for each in words]
    message = "" if component["level"] == "OK" else component["message"]
    details = " (planned)" if planned else _details(problems, now, message)
    path = _clean(component_path(component))
    in_downtime = any(
        each["component"] == component["component"] for each in robot.get("downtimes", ())
    )
    counts = not (planned or in_downtime) and (bool(hard) or not confirmed)
    return Sensor(min(words, key=LISTS.index), path + details, counts)


def _is_confirmed(shown: ShownProblem) -> bool:
    return shown.problem["confirmed"] is not None


def _missing(
    robot: dict[str, Any],
    problems: list[ShownProblem],
    pattern: str,
    now: float,
    *,
    confirmed: bool,
) -> Iterator[Sensor]:
    """The checks that miss components which the pattern may mean: by its name or its patterns."""
    for each in robot["short_checks"]:
        if any(_matches(text, pattern) for text in (each["check"], *each["patterns"])):
            text = f"check {each['check']} finds {each['found']} of {each['expected']}"
            own = [shown for shown in problems if shown.problem["check"] == each["check"]]
            counts = not confirmed or any(map(_is_confirmed, own))
            yield Sensor("CRITICAL", _clean(text) + _details(own, now, ""), counts)


def _details(problems: Iterable[ShownProblem], now: float, message: str) -> str:
    """How the problems stand, since when, and the driver's message: in brackets, or ""."""
    parts = []
    for each in problems:
        since = f"{each.standing}, for {span(now - each.since)}"
        of_value = each.problem["scope"] == "value"
        parts.append(f"{each.problem['key']} {each.message}: {since}" if of_value else since)
    texts = [_clean("; ".join(parts)), _clean(message[:MAX_MESSAGE])]
    details = ": ".join(filter(None, texts))
    return f" ({details})" if details else ""


def _list_texts(sensors: list[Sensor]) -> Iterator[str]:
    for name in LISTS:
        entries = sorted(each.entry for each in sensors if each.list_name == name)
        if entries:
            yield f"{name} sensor(s) list: {first_few(entries, MAX_LISTED)}"


def _exit_code(sensors: list[Sensor]) -> int:
    """STALE is CRITICAL, as in the thesis: a sensor that sends nothing may hide any fault."""
    words = {each.list_name for each in sensors if each.counts}
    if words & {"CRITICAL", "STALE"}:
        return CRITICAL
    return WARNING if "WARNING" in words else OK


def _matches(path: str, pattern: str) -> bool:
    return pattern.casefold() in path.casefold()


def _performance(sensors: list[Sensor], components: list[dict[str, Any]]) -> Iterator[str]:
    """The length of each list and the sensors' numbers, without those of STALE (old) sensors."""
    for name in LISTS:
        yield f"{name.lower()}={sum(each.list_name == name for each in sensors)};;;0"
    numbers = (
        _datum(component, value)
        for component in components
        if component["level"] != "STALE"
        for value in component["values"]
        if value["number"] is not None
    )
    size = 0
    for datum in islice(numbers, MAX_VALUES):
        size += len(datum) + 1
        if size > MAX_PERFORMANCE:
            return
        yield datum


def _datum(component: dict[str, Any], value: dict[str, Any]) -> str:
    unit = value["unit"] or ""
    suffix = UNITS.get(unit, "")
    bracket = f" [{unit}]" if unit and not suffix else ""
    label = _clean(f"{component['component']} {value['key']}{bracket}")
    # Within quotes a quote is doubled; an equals sign would end the label.
    label = label.replace("'", "''").replace("=", ":")
    warning, critical = (_range(value, severity) for severity in ("warning", "critical"))
    limits = f";{warning};{critical}" if warning or critical else ""
    return f"'{label}'={value['number']:.10g}{suffix}{limits}"


def _range(value: dict[str, Any], severity: str) -> str:
    """The range outside of which a value is in trouble, as the guidelines write it; "" for none."""
    bounds = {
        each["bound"]: f"{each['value']:.10g}"
        for each in value.get("thresholds", ())
        if each["severity"] == severity
    }
    return f"{bounds.get('low', '~')}:{bounds.get('high', '')}" if bounds else ""


def _clean(text: str) -> str:
    """Text for the one line of output; a bar would start the performance data."""
    return one_line(text).replace("|", "/")


class _TooLateError(Exception):
    """The timeout is over. Not a TimeoutError: that is an OSError, which the client handles."""


def _too_late(_number: int, _frame: object) -> NoReturn:
    raise _TooLateError


def _parser() -> argparse.ArgumentParser:
    parser = _Parser(
        prog="check_ros_diagnostics",
        description="Check the diagnostics of a robot that a ROS diagnostics exporter monitors.",
        epilog="Exit codes: 0 OK (also in maintenance), 1 WARNING, 2 CRITICAL (also STALE that is "
        "not planned, a check that misses components, and no sensor that matches), "
        "3 UNKNOWN (exporter or robot not reachable, wrong arguments).",
    )
    parser.add_argument(
        "-H", "--robot", "--hostname", required=True, help="the robot's name in fleet.yml"
    )
    parser.add_argument(
        "-N",
        "--name",
        default="",
        help="check the sensors whose path (/Group/Sensor) contains this, ignoring case "
        "(default: all)",
    )
    parser.add_argument(
        "--confirmed",
        action="store_true",
        help="only what the exporter has confirmed counts; for services with max_check_attempts 1",
    )
    parser.add_argument("-V", "--version", action="version", version=f"%(prog)s {__version__}")
    group = parser.add_argument_group("exporter")
    url = "http://127.0.0.1:9877"
    group.add_argument("-u", "--url", default=url, help="of the exporter (default: %(default)s)")
    group.add_argument("--user", help="for basic auth")
    for flag, text in FILES.items():
        group.add_argument(flag, type=Path, metavar="FILE", help=text)
    group.add_argument(
        "-t",
        "--timeout",
        type=_seconds,
        default=10.0,
        metavar="SECONDS",
        help="how long to wait for a response (default: %(default)g)",
    )
    return parser


def _seconds(text: str) -> float:
    """The value of a flag that takes seconds, above 0.

    Raises:
        argparse.ArgumentTypeError: It is not such a number.
    """
    with contextlib.suppress(ValueError):
        if 0 < (number := float(text)) < math.inf:
            return number
    raise argparse.ArgumentTypeError(f"{text!r} is not a duration; give seconds, as 10 or 0.5")


if __name__ == "__main__":
    sys.exit(main())
