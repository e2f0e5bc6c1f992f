"""Counters of change: a reader compares them to find out what it has to make anew."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(slots=True)
class Versions:
    """One robot's counters, each raised when its part changed."""

    structure: int = 0  # which series there are
    names: int = 0  # a component was added, removed or has another label
    receipt: int = 0  # messages, bytes, last message, clock offset, the graph
    rejections: int = 0
    levels: int = 0
    values: int = 0
    groups: int = 0
    inventory: int = 0  # the config's part

    def copy(self) -> Versions:
        """The counters as they stand."""
        return replace(self)
