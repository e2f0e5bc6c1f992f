"""Output lines and signals of every command."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType


def print_line(text: str) -> None:
    """Print a line on stdout and flush: scripts wait for it."""
    print(text, flush=True)  # noqa: T201 - a command's answer


def print_error(text: str) -> None:
    """Print a line on stderr and flush."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - a command's answer


def stop_on_signals() -> threading.Event:
    """Return an event that SIGINT and SIGTERM set."""
    stop = threading.Event()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    return stop
