"""What keeps the state finite: label lengths and the budget of all series."""

from __future__ import annotations

import hashlib
from collections.abc import Callable

from ros_diagnostics_exporter.state.reasons import Rejection

# Told the reason of what is not taken in, and its name.
Reject = Callable[[Rejection, str], None]


def bounded(text: str, length: int) -> str:
    """``text`` if it has at most ``length`` characters; else its begin and a hash of the whole.

    Two long names stay two names. What is no valid Unicode is replaced.
    """
    if not text.isascii():
        text = text.encode("utf-8", "replace").decode()
    if len(text) <= length:
        return text
    digest = hashlib.sha256(text.encode()).hexdigest()[:8]
    return f"{text[: max(0, length - 9)]}~{digest}"


class Budget:
    """How many series the whole exporter may serve; what is taken is given back when it goes."""

    __slots__ = ("limit", "used")

    def __init__(self, limit: int) -> None:
        self.limit = limit
        self.used = 0

    def take(self, series: int) -> bool:
        """Take ``series``, or nothing and return False."""
        if self.used + series > self.limit:
            return False
        self.used += series
        return True

    def give(self, series: int) -> None:
        """Give back what was taken."""
        self.used -= series
