"""``check_ros_diagnostics``: a Nagios plug-in that checks one robot through the exporter.

For sites that keep Nagios. It prints what the plug-in of the 2014 master's thesis printed, which
polled the robot itself: the sensors by state, the aggregator's parents among them. Its output and
exit codes follow https://nagios-plugins.org/doc/guidelines.html.
"""

from __future__ import annotations

import argparse
import signal
import sys
from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Any, NoReturn

from ros_diagnostics_exporter import __version__
from ros_diagnostics_exporter.cli.connection_flags import add_arguments, make_client
from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_exporter.severity import as_planned
from ros_diagnostics_exporter.texts import one_line

OK, WARNING, CRITICAL, UNKNOWN = range(4)  # exit codes
# Level -> the name of its list, in the order of the lists, worst first.
LISTS = {"ERROR": "CRITICAL", "STALE": "STALE", "WARN": "WARNING", "OK": "OK"}
MAX_VALUES = 50  # in the performance data: Nagios cuts a plug-in's output at 8 kB
# Units that the guidelines know for performance data; any other goes into the label.
UNITS = {"s", "ms", "us", "%", "B", "KB", "MB", "TB", "c"}


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
            make_client(options).fleet((options.robot,)), options.robot, options.name
        )
    except UnreachableError as error:
        code, line = UNKNOWN, f"UNKNOWN - {_clean(str(error))}"
    except _TooLateError:
        code, line = (
            UNKNOWN,
            f"UNKNOWN - no answer from {_clean(options.url)} in {options.timeout:g} s",
        )
    except Exception as error:  # noqa: BLE001 - Python's own exit code 1 would be WARNING
        code, line = UNKNOWN, f"UNKNOWN - {type(error).__name__}: {_clean(str(error))}"
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
    print(line)  # noqa: T201
    return code


def check(fleet: dict[str, Any], name: str, pattern: str) -> tuple[int, str]:
    """Exit code and output for the sensors of robot ``name`` whose path contains ``pattern``."""
    robot = next((each for each in fleet["robots"] if each["robot"] == name), None)
    if robot is None:
        return UNKNOWN, f"UNKNOWN - the exporter knows no robot {_clean(name)!r}"
    if not robot["up"]:
        return UNKNOWN, f"UNKNOWN - robot {_clean(name)} is silent: {robot['silent_reason']}"
    components = [each for each in robot["components"] if _matches(_path(each), pattern)]
    groups = [each for each in robot["groups"] if _matches(each["group"], pattern)]
    if not components and not groups:
        return CRITICAL, f"CRITICAL - no sensor matches '{_clean(pattern)}'"
    lists = _lists(groups, components)
    code = _exit_code(_lists(groups, [each for each in components if not as_planned(each)]))
    word = ("OK", "WARNING", "CRITICAL")[code]
    listed = ", ".join(
        f"{LISTS[level]} sensor(s) list: {', '.join(paths)}"
        for level, paths in lists.items()
        if paths
    )
    return code, f"{word} - {listed} | {' '.join(_performance(lists, components))}"


def _lists(groups: list[dict[str, Any]], components: list[dict[str, Any]]) -> dict[str, list[str]]:
    """Paths by level, parents before their children."""
    found = [(each["group"], each["level"]) for each in groups]
    found += [(_path(each), each["level"]) for each in components]
    return {
        level: sorted(_clean(path) for path, its_level in found if its_level == level)
        for level in LISTS
    }


def _exit_code(lists: dict[str, list[str]]) -> int:
    """STALE is CRITICAL, as in the thesis: a sensor that sends nothing may hide any fault.

    Sensors that fleet.yml plans to be STALE are listed, but are not in ``lists`` here.
    """
    if lists["ERROR"] or lists["STALE"]:
        return CRITICAL
    return WARNING if lists["WARN"] else OK


def _path(component: dict[str, Any]) -> str:
    group = component["group"]
    return (
        f"{group.rstrip('/')}/{component['component'].lstrip('/')}"
        if group
        else str(component["component"])
    )


def _matches(path: str, pattern: str) -> bool:
    return pattern.casefold() in path.casefold()


def _performance(lists: dict[str, list[str]], components: list[dict[str, Any]]) -> Iterator[str]:
    """The length of each list and the sensors' numbers, without those of STALE (old) sensors."""
    for level, word in LISTS.items():
        yield f"{word.lower()}={len(lists[level])};;;0"
    numbers = (
        _datum(component, value)
        for component in components
        if component["level"] != "STALE"
        for value in component["values"]
        if value["number"] is not None
    )
    yield from islice(numbers, MAX_VALUES)


def _datum(component: dict[str, Any], value: dict[str, Any]) -> str:
    unit = value["unit"] or ""
    suffix = unit if unit in UNITS else ""
    bracket = f" [{unit}]" if unit and not suffix else ""
    label = _clean(f"{component['component']} {value['key']}{bracket}")
    # Within quotes a quote is doubled; an equals sign would end the label.
    label = label.replace("'", "''").replace("=", ":")
    return f"'{label}'={value['number']:.10g}{suffix}"


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
        epilog="Exit codes: 0 OK, 1 WARNING, 2 CRITICAL (also STALE that is not planned, "
        "and no sensor that matches), "
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
    parser.add_argument("-V", "--version", action="version", version=f"%(prog)s {__version__}")
    add_arguments(parser)
    return parser


if __name__ == "__main__":
    sys.exit(main())
