"""What a source is: where statuses of robots come from.

A source brings arrays of statuses to the state, in threads of its own, and each of its feeds is one
of two kinds. A feed of the robot itself, as a topic is, shows whether the robot is alive: its
arrays make the robot up, and where none comes the robot is silent. A `model.Feed` is about the
robot and shows nothing of that: neither its arrays nor their absence. Of a complete feed (an
aggregator's topic) a component that an array lacks is STALE; of a partial one (drivers' topics,
every Feed) one that has not been in an array for its ``stale_after``. Of several arrays of a feed
the one received last counts.

A source rejects what it cannot read and counts or names it; it passes on texts that are valid
Unicode and of any length. It calls a `Receiver` of its kind, from any of its threads, and never
after `stop` has returned, nor for what `configure` has removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ros_diagnostics_exporter.config.reloader import ConfigReader
from ros_diagnostics_exporter.loops import Loop


class ArraySource(ConfigReader, Protocol):
    """One kind of feeds, begun by the first call of `configure`.

    None of its methods waits for another program for longer than seconds.
    """

    @property
    def name(self) -> str:
        """As logs call it."""

    def stop(self) -> None:
        """End; nothing is received after that."""

    @property
    def loops(self) -> Sequence[Loop]:
        """Its threads, for those who watch them."""
