"""What outlives the process, as plain nouns; times are Unix time, levels numbers."""

from __future__ import annotations

from typing import Any, NamedTuple


class RememberedComponent(NamedTuple):
    """One component; ``identity`` is (name, its group where that belongs to it, parting id)."""

    identity: tuple[str, str, str]
    group: str
    hardware_id: str
    level: int
    before_stale: int | None
    since: float
    problem_since: float | None
    message: str
    slots: tuple[int, ...]
    listed: float
    was_ok: bool | None = None  # when last received; None: a version before did not note it


class RememberedRobot(NamedTuple):
    """One robot; ``source`` as decided, ``topic`` where it was found or declared.

    ``components`` are RememberedComponent, or their fields on the way to the file.
    """

    domain_id: int
    topic: str
    source: str
    last_seen: float
    components: list[Any]
