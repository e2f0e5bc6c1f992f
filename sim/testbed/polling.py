"""Wait for a condition with a deadline: the only place in testbed and tests that sleeps."""

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
    """Call ``condition`` until its result is true, and return the result.

    Args:
        condition: Called at least once, and once more at the deadline.
        what: What is waited for, for the error; a function is called at the deadline.
        seconds: The deadline.
        every: Seconds between two calls.

    Raises:
        TimeoutError: The result was still false after ``seconds``.
    """
    deadline = time.monotonic() + seconds
    while True:
        late = time.monotonic() >= deadline
        if result := condition():
            return result
        if late:
            text = what() if callable(what) else what
            raise TimeoutError(f"after {seconds:g} s still waiting for {text}")
        time.sleep(every)
