"""Which checks are ROS plug-ins, and what their arguments say."""

from __future__ import annotations

import re
import shlex
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import PurePath

# A plug-in whose file name has one of these words: ros-diagnostics_agg.py, check_ros_diagnostics.
_WORDS = re.compile(r"(?:^|[^a-z])(?:ros[12]?|rosdiag[a-z]*|robots?|diagnostics?)(?:$|[^a-z])")
_NAME = ("-N", "--name", "--component", "--sensor")
_HOST = ("-H", "--host", "--hostname", "--robot")
_DOMAIN = ("--domain", "--domain-id", "--domain_id")
_NAMESPACE = ("--namespace",)
_KNOWN = {
    **dict.fromkeys(_NAME, "words"),
    **dict.fromkeys(_HOST, "host"),
    **dict.fromkeys(_DOMAIN, "domain_id"),
    **dict.fromkeys(_NAMESPACE, "namespace"),
}
EVERYTHING = ("", "all", "*")  # of -N: no filter


@dataclass(frozen=True)
class Check:
    """The arguments of a ROS plug-in; ``rest`` is what this does not know."""

    words: str = ""
    host: str = ""
    domain_id: str = ""
    namespace: str = ""
    rest: tuple[str, ...] = ()


def is_ros(command: str, line: str, plugins: tuple[str, ...]) -> bool:
    """Whether a command runs a ROS plug-in: one of ``plugins`` (with *), or by its file's name."""
    programs = [PurePath(each).name for each in _programs(line)]
    if plugins:
        return any(fnmatchcase(each, glob) for each in (command, *programs) for glob in plugins)
    return any(_WORDS.search(each.lower()) for each in programs)


def _programs(line: str) -> list[str]:
    """The words of a command line up to its first option: interpreter, program."""
    found = []
    for each in _arguments(line):
        if each.startswith("-"):
            break
        if "=" not in each:
            found.append(each)
    return found


def parse(line: str) -> Check:
    """The arguments of a plug-in's command line."""
    found: dict[str, str] = {}
    rest: list[str] = []
    arguments = _arguments(line)
    for each in arguments:
        if match := re.fullmatch(r"ROS_DOMAIN_ID=(\d+)", each):
            found["domain_id"] = match[1]
    waiting = iter(arguments[len([*_leading(arguments)]) :])
    for each in waiting:
        option, equals, value = each.partition("=")
        if option in _KNOWN:
            found[_KNOWN[option]] = value if equals else next(waiting, "")
        elif each[:2] in ("-N", "-H") and len(each) > 2:
            found[_KNOWN[each[:2]]] = each[2:]
        else:
            rest.append(each)
    return Check(**found, rest=tuple(rest))


def _leading(arguments: list[str]) -> list[str]:
    number = next((at for at, each in enumerate(arguments) if each.startswith("-")), len(arguments))
    return arguments[:number]


def _arguments(line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError:  # an unclosed quote, which Nagios' shell would complain about
        return line.split()
