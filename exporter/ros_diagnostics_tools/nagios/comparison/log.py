"""Nagios' log: nagios.log and its archives, in any order.

Its lines are `[UNIX TIME] WHAT: FIELD;FIELD...`
(https://assets.nagios.com/downloads/nagioscore/docs/nagioscore/4/en/logging.html). A line that is
damaged is counted, one that is in two files counts once.
"""

from __future__ import annotations

import re
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from contextlib import nullcontext
from dataclasses import dataclass, field
from math import inf
from pathlib import Path
from typing import BinaryIO

from ros_diagnostics_exporter.texts import printable
from ros_diagnostics_tools.nagios.comparison.notice import HOST, STATES, Notice

LONGEST = 64 * 1024  # bytes of a line; Nagios cuts a plug-in's output at 8 kB
STANDARD_INPUT = Path("-")
_LINE = re.compile(r"\[(\d{1,11})\] (.*)")
_NOTIFICATION = re.compile(r"(SERVICE|HOST) NOTIFICATION: (.*)")
_STATE = re.compile(r"([A-Z]+)(?: \(\w+\))?")


class LogError(Exception):
    """A file cannot be read, or is no log of Nagios; the text names it."""


@dataclass
class Log:
    """What the files say. ``begin`` and ``end`` are the times of the first and the last line.

    ``skipped`` counts notifications of kinds that are not compared, ``damaged`` the lines that are
    none of Nagios', of which ``first_damaged`` names the first.
    """

    notices: list[Notice] = field(default_factory=list)
    begin: float = inf
    end: float = -inf
    skipped: Counter[str] = field(default_factory=Counter)
    damaged: int = 0
    first_damaged: str = ""


def read(paths: Iterable[Path]) -> Log:
    """What all files together say.

    Raises:
        LogError: One cannot be read, or no line of it is one of Nagios' log.
    """
    log, seen = Log(), set[str]()
    for path in paths:
        try:
            known = _read_file(log, path, seen)
        except OSError as error:
            raise LogError(f"{path}: {error.strerror or error}") from error
        if not known:
            raise LogError(
                f"{path}: no line is one of Nagios' log, as [1700000000] HOST ALERT: ...; unpack "
                "a compressed archive: zcat FILE | ros-diagnostics-compare -"
            )
    log.notices.sort(key=lambda notice: notice.time)
    return log


def _read_file(log: Log, path: Path, seen: set[str]) -> int:
    """Add a file; how many of its lines are Nagios'."""
    known = 0
    opened = nullcontext(sys.stdin.buffer) if path == STANDARD_INPUT else path.open("rb")
    with opened as file:
        for number, text in enumerate(_lines(file), 1):
            found = _LINE.fullmatch(text)
            if found is not None:
                known += 1
                _add(log, float(found[1]), found[2], seen)
            elif text.strip():
                log.damaged += 1
                log.first_damaged = log.first_damaged or f"{path}:{number}: {printable(text):.80}"
    return known


def _lines(file: BinaryIO) -> Iterator[str]:
    """The lines; of one that is too long, the first part, and the others as lines of their own."""
    while line := file.readline(LONGEST):
        yield _decoded(line.rstrip(b"\r\n"))


def _decoded(line: bytes) -> str:
    """As UTF-8, or else as Latin-1, which older sites write their files in."""
    try:
        return line.decode()
    except UnicodeDecodeError:
        return line.decode("latin-1")


def _add(log: Log, time: float, text: str, seen: set[str]) -> None:
    log.begin, log.end = min(log.begin, time), max(log.end, time)
    found = _NOTIFICATION.fullmatch(text)
    if found is None:
        return
    key = f"{time:.0f} {text}"
    if key in seen:
        return
    seen.add(key)
    notice = _notice(time, found[1], found[2].split(";"))
    if isinstance(notice, Notice):
        log.notices.append(notice)
    else:
        log.skipped[notice] += 1


def _notice(time: float, scope: str, fields: list[str]) -> Notice | str:
    """CONTACT;HOST;SERVICE;STATE;COMMAND;OUTPUT, without SERVICE for a host; or its kind."""
    needed = 5 if scope == "SERVICE" else 4
    if len(fields) < needed:
        return "damaged"
    host, service = fields[1], fields[2] if scope == "SERVICE" else HOST
    state = _STATE.match(fields[needed - 2])
    if state is None:
        return "damaged"
    if state[1] not in STATES:
        return state[1]
    return Notice(time, host, service, state[1], ";".join(fields[needed:]))
