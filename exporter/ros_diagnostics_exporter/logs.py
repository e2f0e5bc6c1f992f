"""The exporter's own log on standard error: logfmt for people and Loki, JSON for the rest."""

from __future__ import annotations

import atexit
import json
import logging
import os
import queue
import re
import signal
import subprocess
import sys
import time
from logging.handlers import QueueHandler, QueueListener
from pathlib import Path
from typing import TextIO

from ros_diagnostics_exporter.texts import to_json

FORMATS = ("logfmt", "json")
LINE_BYTES = 2_000  # of a wrapped line; a longer one becomes several records
DRAIN_SECONDS = 5.0  # on exit, for the lines that are not yet wrapped
_COLOR = re.compile(r"\x1b\[[\d;]*m")
# The program of the wrapper process: it needs this package only, no site packages.
_WRAPPER = """
import sys
sys.path.append(sys.argv[1])
from ros_diagnostics_exporter import logs
logs.wrap_lines()
"""


def set_up(level: str, form: str, stream: TextIO | None = None) -> None:
    """Configure the log.

    Args:
        level: The lowest to write: debug, info, warning, error.
        form: One of FORMATS.
        stream: Where to; None: standard error.
    """
    handler = logging.StreamHandler(sys.stderr if stream is None else stream)
    handler.setFormatter(_Formatter(as_json=form == "json"))
    logging.basicConfig(level=level.upper(), handlers=[handler], force=True)


def write_aside(*loggers: str) -> QueueListener:
    """Have a thread write what these log, so that they wait for nobody who reads the log.

    For what is logged under a lock. The thread ends with the process, after the last line.
    """
    lines: queue.SimpleQueue[logging.LogRecord] = queue.SimpleQueue()
    listener = QueueListener(lines, *logging.getLogger().handlers)
    listener.start()
    for name in loggers:
        logger = logging.getLogger(name)
        logger.addHandler(QueueHandler(lines))
        logger.propagate = False
    atexit.register(listener.stop)
    return listener


def wrap_output() -> TextIO:
    """Make JSON records of everything this process writes to its standard output and error.

    The middleware (C++) writes lines there itself, bypassing Python's logging. A second process
    wraps them: a thread could not read while the writer holds the interpreter's lock, and would
    lose the last lines when the middleware aborts this process.

    Returns:
        The real standard error, for the log.

    Raises:
        OSError: The wrapper process cannot be started.
    """
    log = os.fdopen(os.dup(2), "w", buffering=1)
    source, sink = os.pipe()
    # Signals to the process group (Ctrl-C, systemd) reach the wrapper too; it must outlive us.
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
    """Wait until the last line is wrapped, at most DRAIN_SECONDS if the pipe stays open."""
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
    """Write each line of standard input as a record, until its last writer closes it."""
    logging.raiseExceptions = False  # keep emptying the pipe even if nobody reads the log
    set_up("info", "json")
    output = logging.getLogger("output")
    for line in iter(lambda: sys.stdin.buffer.readline(LINE_BYTES), b""):
        if text := _COLOR.sub("", line.decode(errors="replace")).rstrip():
            output.warning("%s", text)


class _Formatter(logging.Formatter):
    """One line per record: a robot's text must not be able to forge log lines."""

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
            return json.dumps(fields).replace("\x7f", "\\u007f")  # json escapes all others
        return " ".join(f"{key}={_quoted(value)}" for key, value in fields.items())


def _quoted(value: str) -> str:
    """A logfmt value: quoted only where needed, unprintable characters escaped."""
    plain = value.isascii() and value.isprintable() and not set(value) & set(' ="\\')
    return value if plain and value else to_json(value)


def _moment(created: float) -> str:
    whole = time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(created))
    return f"{whole}.{int(created % 1 * 1000):03d}Z"
