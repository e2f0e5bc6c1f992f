"""The exporter's own log on standard error: logfmt for people and Loki, JSON for the rest."""

from __future__ import annotations

import atexit
import json
import logging
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TextIO

from ros_diagnostics_exporter.texts import to_json

FORMATS = ("logfmt", "json")
LINE_BYTES = 2_000  # of a line that is wrapped; what is longer becomes several records
DRAIN_SECONDS = 5.0  # at the end, for the lines that are still to be wrapped
_COLOR = re.compile(r"\x1b\[[\d;]*m")
# The program of the other process: no site packages, only this package from where it stands.
_WRAPPER = """
import sys
sys.path.append(sys.argv[1])
from ros_diagnostics_exporter import logs
logs.wrap_lines()
"""


def set_up(level: str, form: str, stream: TextIO | None = None) -> None:
    """Log from ``level`` (debug, info, warning, error) upwards, in ``form`` (logfmt, json).

    Args:
        level: The lowest that is written.
        form: One of FORMATS.
        stream: Where to; None: standard error.
    """
    handler = logging.StreamHandler(sys.stderr if stream is None else stream)
    handler.setFormatter(_Formatter(as_json=form == "json"))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


def wrap_output() -> TextIO:
    """Make JSON records of whatever this process writes to its standard output and error.

    The middleware (C++) writes lines of its own there, past Python. Another process reads them:
    a thread could not while the writer holds the interpreter's lock, and would be lost, with the
    last lines, when the middleware aborts this process.

    Returns:
        The real standard error, for the log.

    Raises:
        OSError: That process cannot be started.
    """
    log = os.fdopen(os.dup(2), "w", buffering=1)
    source, sink = os.pipe()
    # Whatever ends us (Ctrl-C, systemd) goes to the other process too: it ends after us.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGTERM, signal.SIGINT, signal.SIGHUP})
    try:
        command = [sys.executable, "-I", "-S", "-c", _WRAPPER, str(Path(__file__).parents[1])]
        wrapper = subprocess.Popen(command, stdin=source, stdout=subprocess.DEVNULL)  # noqa: S603
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        os.close(source)
    _redirect(sink)
    os.close(sink)
    atexit.register(_unwrap, log, wrapper)
    return log


def _unwrap(log: TextIO, wrapper: subprocess.Popen[bytes]) -> None:
    """Wait until the last line is wrapped; who holds its pipe open for longer is not waited for."""
    _redirect(log.fileno())
    try:
        wrapper.wait(DRAIN_SECONDS)
    except subprocess.TimeoutExpired:
        logging.getLogger(__name__).warning("the last lines of the middleware may be missing")


def _redirect(target: int) -> None:
    for stream in (sys.stdout, sys.stderr):
        stream.flush()
    for number in (1, 2):
        os.dup2(target, number)


def wrap_lines() -> None:
    """Write each line of standard input as a record, until its last writer has ended."""
    logging.raiseExceptions = False  # where nobody reads the log, the pipe is emptied all the same
    set_up("info", "json")
    output = logging.getLogger("output")
    for line in iter(lambda: sys.stdin.buffer.readline(LINE_BYTES), b""):
        if text := _COLOR.sub("", line.decode(errors="replace")).rstrip():
            output.warning("%s", text)


class _Formatter(logging.Formatter):
    """One line a record, whatever it says: what a robot sends must not forge lines of the log."""

    def __init__(self, *, as_json: bool) -> None:
        super().__init__()
        self._as_json = as_json

    def format(self, record: logging.LogRecord) -> str:
        """The record as one line."""
        fields = {
            "ts": _moment(record.created),
            "level": record.levelname.lower(),
            "logger": record.name,
            "msg": record.getMessage(),
        }
        if record.exc_info:
            fields["error"] = self.formatException(record.exc_info)
        if self._as_json:
            return json.dumps(fields).replace("\x7f", "\\u007f")  # DEL: all else is ASCII by then
        return " ".join(f"{key}={_quoted(value)}" for key, value in fields.items())


def _quoted(value: str) -> str:
    """As logfmt quotes: only where it has to be, invisible characters escaped."""
    plain = value.isascii() and value.isprintable() and not set(value) & set(' ="\\')
    return value if plain and value else to_json(value)


def _moment(created: float) -> str:
    whole = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(created))
    return f"{whole}.{int(created % 1 * 1000):03d}Z"
