"""Which robots of a fleet.yml are an exporter's, if several exporters share them."""

from __future__ import annotations

import re
from collections.abc import Set as AbstractSet
from dataclasses import dataclass
from functools import lru_cache
from hashlib import blake2b

from ros_diagnostics_exporter.model import Topic

_WRITTEN = re.compile(r"([1-9][0-9]{0,2})/([1-9][0-9]{0,2})", re.ASCII)


@dataclass(frozen=True)
class Shard:
    """Exporter ``number`` of ``count`` that share the robots of one fleet.yml.

    A robot belongs to the shard that the hash of its name gives, on every machine the same. If the
    count grows by one, robots move to the new shard only. ``uplinks`` belong to each shard, because
    they explain the silence of robots of all. ``elsewhere`` are the topics of the robots that
    fleet.yml names and other shards have. ``together`` is the name of all the shards.
    """

    number: int
    count: int
    together: str = ""
    uplinks: AbstractSet[str] = frozenset()
    elsewhere: AbstractSet[Topic] = frozenset()

    def has(self, robot: str) -> bool:
        """Whether the robot of this name is one of this exporter's."""
        return robot in self.uplinks or _owner(robot, self.count) == self.number

    @property
    def name(self) -> str:
        """The exporter's own name: the same with whatever count."""
        return f"{self.together}-{self.number}"

    @property
    def twice(self) -> frozenset[str]:
        """The uplinks, of which another exporter is to count what they have in common."""
        others = (each for each in self.uplinks if _owner(each, self.count) != self.number)
        return frozenset(others)

    def __str__(self) -> str:
        """As it is written."""
        return f"{self.number}/{self.count}"


def parse(text: str) -> Shard:
    """The shard that is written as 2/4.

    Raises:
        ValueError: It is none.
    """
    match = _WRITTEN.fullmatch(text)
    if match is None or int(match[1]) > int(match[2]):
        raise ValueError(f"{text!r} is not a shard such as 2/4, the second of four exporters")
    return Shard(int(match[1]), int(match[2]))


@lru_cache(maxsize=1 << 15)  # asked for each topic at each look at the graph
def _owner(robot: str, count: int) -> int:
    """The shard whose number has the highest hash with the name: rendezvous hashing."""
    name = robot.encode(errors="surrogatepass")
    return max(
        range(1, count + 1),
        key=lambda number: blake2b(b"%d/%s" % (number, name), digest_size=8).digest(),
    )
