"""Doing something at a steady rate for a bounded time."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator

_never = threading.Event()


def ticks(rate: float, seconds: float) -> Iterator[tuple[int, float]]:
    """Yield ``rate`` times a second for ``seconds``: the tick's number, and seconds it is late.

    A tick that is late is not left out; those after it follow at once until the rate is met.
    """
    begin = time.monotonic()
    for number in range(int(rate * seconds)):
        due = begin + number / rate
        _never.wait(max(0.0, due - time.monotonic()))
        yield number, time.monotonic() - due
