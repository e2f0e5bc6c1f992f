"""Durations as Prometheus and Go write them: `1m30s`, `1.5s`, `24h`."""

from __future__ import annotations

import re

_UNITS = {"w": 604_800_000, "d": 86_400_000, "h": 3_600_000, "m": 60_000, "s": 1000, "ms": 1}
PATTERN = "".join(rf"(?:(\d+(?:\.\d+)?){unit})?" for unit in _UNITS)


def parse(text: str) -> float:
    """The seconds of a duration.

    Raises:
        ValueError: The text is not a duration.
    """
    match = re.fullmatch(PATTERN, text, re.ASCII)
    if not text or match is None:
        raise ValueError(f"{text!r} is not a duration")
    parts = zip(match.groups(), _UNITS.values(), strict=True)
    return sum(float(count) * size for count, size in parts if count) / 1000


def written(seconds: float) -> str:
    """Seconds as a duration, to the millisecond."""
    left = round(seconds * 1000)
    text = ""
    for unit, size in _UNITS.items():
        count, left = divmod(left, size)
        text += f"{count}{unit}" if count else ""
    return text or "0s"
