"""The one way in which durations and times are written on the command line."""

from __future__ import annotations

import contextlib
import re
from collections.abc import Callable
from datetime import datetime, timedelta

from ros_diagnostics_exporter import durations
from ros_diagnostics_tools.flag_types import Written

LONGEST = 3650 * 86_400.0  # seconds
_TIME_OF_DAY = re.compile(r"\d\d:\d\d(:\d\d)?")


class Duration(Written[float]):
    """A duration as Prometheus writes it; its value in seconds."""

    name = "duration"

    def read(self, text: str) -> float:
        """The seconds."""
        with contextlib.suppress(ValueError):
            if 0 < (seconds := durations.parse(text)) <= LONGEST:
                return seconds
        raise ValueError(f"{text!r} is not a duration such as 90s, 10m or 1h30m")


class Moment(Written[datetime]):
    """A time; without a zone it is this machine's.

    Args:
        ahead: Whether it lies ahead: then 10m and 14:30 are the next such time, else the last.
    """

    name = "time"

    def __init__(self, *, ahead: bool = False) -> None:
        self._ahead = ahead

    def read(self, text: str) -> datetime:
        """The time, with its zone."""
        now = datetime.now().astimezone()
        found = moment(text, now, ahead=self._ahead)
        if self._ahead and found < now:
            raise ValueError(f"{text!r} has passed")
        return found


def moment(
    text: str,
    now: datetime,
    *,
    ahead: bool,
    localize: Callable[[datetime], datetime] = datetime.astimezone,
) -> datetime:
    """The time that a text names: 10m (ago, or from now), 14:30, 2027-01-31, 2027-01-31T14:30.

    ``localize`` gives a time without a zone the one that it is meant in.

    Raises:
        ValueError: It is none of these.
    """
    try:
        return now + timedelta(seconds=durations.parse(text)) * (1 if ahead else -1)
    except (ValueError, OverflowError):
        pass
    try:
        if _TIME_OF_DAY.fullmatch(text):
            naive = datetime.fromisoformat(f"{now.date()} {text}")
            then = localize(naive)
            days = int(then < now) if ahead else -int(then > now)
            return localize(naive + timedelta(days=days))
        then = datetime.fromisoformat(text.replace("Z", "+00:00"))  # Python 3.10 reads no Z
        return then if then.tzinfo else localize(then)
    except (ValueError, OverflowError, OSError) as error:
        raise ValueError(
            f"{text!r} is no time; write it as 10m, 14:30, 2027-01-31 or 2027-01-31T14:30"
        ) from error
