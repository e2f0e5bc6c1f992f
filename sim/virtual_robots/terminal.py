"""What every command does with a terminal: lines out, signals in."""

from __future__ import annotations

import signal
import sys
import threading
from types import FrameType


def say(text: str) -> None:
    """A line on stdout, at once: others wait for it."""
    print(text, flush=True)  # noqa: T201 - a command's answer


def complain(text: str) -> None:
    """A line on stderr, at once."""
    print(text, file=sys.stderr, flush=True)  # noqa: T201 - a command's answer


def stop_on_signals() -> threading.Event:
    """An event that SIGINT and SIGTERM set."""
    stop = threading.Event()

    def on_signal(_number: int, _frame: FrameType | None) -> None:
        stop.set()

    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, on_signal)
    return stop
