"""Wait for a condition with a deadline: the one place of demo and tests that sleeps."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TypeVar

Value = TypeVar("Value")


def until(
    condition: Callable[[], Value],
    what: str | Callable[[], str],
    seconds: float = 30.0,
    every: float = 0.05,
) -> Value:
    """Ask ``condition`` until its answer is true, and return that answer.

    Args:
        condition: Asked ``every`` so many seconds; at least once, and once more at the deadline.
        what: What is waited for, for the error; called late where it tells of the last state.
        seconds: The deadline.
        every: Seconds between two questions.

    Raises:
        TimeoutError: The answer was still false after ``seconds``.
    """
    deadline = time.monotonic() + seconds
    while True:
        late = time.monotonic() >= deadline
        if answer := condition():
            return answer
        if late:
            said = what() if callable(what) else what
            raise TimeoutError(f"after {seconds:g} s still waiting for {said}")
        time.sleep(every)
