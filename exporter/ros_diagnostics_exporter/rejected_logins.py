"""Logins that were rejected: counted, logged, and too many of one address are a pause for it."""

from __future__ import annotations

import logging
from collections import Counter, OrderedDict

log = logging.getLogger(__name__)

MINUTE = 60.0
ALLOWED = 10  # rejected logins of an address in a minute; with more it has a pause of a minute
MANY = 30  # rejected logins in a minute that are a fault of the exporter, for `RECENT` seconds
RECENT = 600.0
ADDRESSES = 1_000  # that are known


class RejectedLogins:
    """Those of one exporter; times are monotonic. ``total`` is how many there were."""

    def __init__(self) -> None:
        self.total = 0
        self._minutes: OrderedDict[str, tuple[float, int]] = OrderedDict()  # begin, number
        self._begin = float("-inf")  # of the minute that is logged and counted
        self._of_minute = Counter[str]()
        self._many_at = float("-inf")
        self._many = ""

    def note(self, address: str, now: float) -> None:
        """Note that a login of an address was rejected."""
        self.total += 1
        begin, number = self._minutes.pop(address, (now, 0))
        self._minutes[address] = (begin, number + 1) if now - begin < MINUTE else (now, 1)
        if len(self._minutes) > ADDRESSES:
            self._minutes.popitem(last=False)
        if len(self._of_minute) < ADDRESSES or address in self._of_minute:
            self._of_minute[address] += 1
        text = self._described()
        if self._of_minute.total() > MANY:
            self._many_at, self._many = now, text
        if now - self._begin >= MINUTE:
            log.warning("%s", text)
            self._begin, self._of_minute = now, Counter()

    def has_pause(self, address: str, now: float) -> bool:
        """Whether no new login of an address is looked at for now."""
        begin, number = self._minutes.get(address, (now, 0))
        return number > ALLOWED and now - begin < 2 * MINUTE

    def reason(self, now: float) -> str:
        """What is wrong; "" where few were rejected of late."""
        return self._many if now - self._many_at < RECENT else ""

    def _described(self) -> str:
        [(address, most)] = self._of_minute.most_common(1)
        return f"{self._of_minute.total()} logins were rejected, {most} of them of {address}"
