"""What a later process should know of the robots, as it is stored."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from math import inf
from typing import Annotated, Literal, NamedTuple

from pydantic import Field, TypeAdapter

from ros_diagnostics_exporter.robots.limits import MAX_TEXT

# Limits for what is read from the file: whatever passes them can be restored and shown.
Level = Annotated[int, Field(ge=0, le=3)]
Published = Annotated[int, Field(ge=0, le=255)]  # by a robot, also what ROS does not know
Moment = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=MAX_TEXT)]


class PersistedSaid(NamedTuple):
    """What a publisher of a component said last; ``is_beyond`` as in `component.Said`.

    A database of an earlier version has no hardware_id.
    """

    level: Published
    is_beyond: bool
    hardware_id: Text = ""


@dataclass(frozen=True, slots=True)
class PersistedComponent:
    """One component; ``identity`` as in ``component``, times are Unix time.

    ``name`` is the one that it keeps until its fault is over, where its identity has another;
    ``reported`` the level that was published last, ``said`` what each publisher said.
    """

    identity: tuple[Text, Text, Text]
    group: Text
    hardware_id: Text
    level: Level
    before_stale: Level | None
    since: Moment
    message: Text
    listed: Moment
    name: Text | None = None
    reported: Published | None = None
    said: dict[Text, PersistedSaid] = field(default_factory=dict)

    def shifted(self, later: float, latest: float) -> PersistedComponent:
        """It, listed ``later`` by so many seconds, and nothing of it after ``latest``."""
        listed = min(self.listed + later, latest)
        return replace(self, since=min(self.since, latest), listed=listed)


Origin = Literal["declared", "discovered", "shared"]  # shared: by a status on a shared topic


@dataclass(frozen=True, slots=True)
class PersistedRobot:
    """One robot; ``source`` as decided, ``topic`` where it was discovered or declared."""

    domain_id: Annotated[int, Field(ge=0, le=232)] | Literal["zenoh"]
    topic: Text
    source: Literal["agg", "raw", "both", "auto", "none", "queries"]
    last_seen: Moment
    components: list[PersistedComponent]
    origin: Origin

    def as_json(self) -> str:
        """What `ROBOT` reads."""
        return json.dumps(ROBOT.dump_python(self), ensure_ascii=False)

    def seen_at(self, last_seen: float, latest: float = inf) -> PersistedRobot:
        """It, received later than when it was written: its components as long before that.

        Nothing of it is after ``latest``: the wall clock may have been set back meanwhile.
        """
        later = max(0.0, last_seen - self.last_seen) if self.last_seen else 0.0
        if not later and latest == inf:
            return self
        components = [each.shifted(later, latest) for each in self.components]
        return replace(self, last_seen=min(self.last_seen + later, latest), components=components)


ROBOT = TypeAdapter(PersistedRobot)  # both ways
