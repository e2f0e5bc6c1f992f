"""Which checks are ROS plug-ins, and what their arguments say."""

from __future__ import annotations

import re
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import PurePath

# A plug-in whose file name has one of these words: ros-diagnostics_agg.py, check_ros_diagnostics.
_WORDS = re.compile(r"(?:^|[^a-z])(?:ros[12]?|rosdiag[a-z]*|robots?|diagnostics?)(?:$|[^a-z])")
_NAME = ("-N", "--name", "--component", "--sensor")
_HOST = ("-H", "--host", "--hostname", "--robot")
_DOMAIN = ("--domain", "--domain-id", "--domain_id")
_NAMESPACE = ("--namespace",)
_KNOWN = {
    **dict.fromkeys(("-k", "--key"), "key"),
    **dict.fromkeys(("-w", "--warning"), "warning"),
    **dict.fromkeys(("-c", "--critical"), "critical"),
    **dict.fromkeys(("-t", "--timeout"), "timeout"),
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
    key: str = ""
    warning: str = ""
    critical: str = ""
    timeout: str = ""
    rest: tuple[str, ...] = ()

    def without(self, values: Iterable[str]) -> list[str]:
        """The rest without what the host says too, and without the options of that."""
        known, left = {each.strip("/") for each in values}, list[str]()
        for each in self.rest:
            if each.strip("/") not in known:
                left.append(each)
            elif left and left[-1].startswith("-"):
                left.pop()
        return left


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
        elif each[:2] in _KNOWN and len(each) > 2 and each[1] != "-":
            found[_KNOWN[each[:2]]] = each[2:]
        else:
            rest.append(each)
    return Check(**found, rest=tuple(rest))


def options(line: str) -> tuple[str, dict[str, str]]:
    """The program of a command line, and the values of its options: long ones by first letter."""
    words = [*_arguments(line), "", ""]
    found: dict[str, str] = {}
    for each, following in pairwise(words[1:]):
        _option, equals, value = each.partition("=")
        if each.startswith("--"):
            found[each[1:3]] = value if equals else following
        elif each.startswith("-"):
            found[each[:2]] = each[2:] or following
    return words[0], found


_RANGE = re.compile(r"(?:(~|-?[\d.]+)?:)?(-?[\d.]+)?")


def thresholds(warning: str, critical: str) -> dict[str, dict[str, float]] | None:
    """Ranges of plug-ins (``20:``, ``80``, ``10:90``) as fleet.yml has them; None: it cannot.

    Without a colon it is the upper limit: below 0 plug-ins alert, too.
    """
    found: dict[str, dict[str, float]] = {}
    for severity, text in (("warning", warning), ("critical", critical)):
        match = _RANGE.fullmatch(text)
        if match is None:
            return None
        try:
            for bound, number in (("low", match[1]), ("high", match[2])):
                if number not in (None, "~"):
                    found.setdefault(bound, {})[severity] = float(number)
        except ValueError:
            return None
    return found if _are_ordered(found) else None


def _are_ordered(thresholds: dict[str, dict[str, float]]) -> bool:
    low, high = thresholds.get("low", {}), thresholds.get("high", {})
    values = [low.get("critical"), low.get("warning"), high.get("warning"), high.get("critical")]
    given = [each for each in values if each is not None]
    return bool(given) and given == sorted(given)


def _leading(arguments: list[str]) -> list[str]:
    number = next((at for at, each in enumerate(arguments) if each.startswith("-")), len(arguments))
    return arguments[:number]


def _arguments(line: str) -> list[str]:
    try:
        return shlex.split(line)
    except ValueError:  # an unclosed quote, which Nagios' shell would complain about
        return line.split()
