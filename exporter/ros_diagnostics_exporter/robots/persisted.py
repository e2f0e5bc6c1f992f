"""What a later process should know of the robots, as it is stored."""

from __future__ import annotations

import json
from typing import Annotated, Literal, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter.robots.limits import MAX_TEXT

# Limits for what is read from the file: whatever passes them can be restored and shown.
Level = Annotated[int, Field(ge=0, le=3)]
Moment = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
Text = Annotated[str, Field(max_length=MAX_TEXT)]


class PersistedComponent(NamedTuple):
    """One component; ``identity`` as in ``component``, times are Unix time."""

    identity: tuple[Text, Text, Text]
    group: Text
    hardware_id: Text
    level: Level
    before_stale: Level | None
    since: Moment
    message: Text
    listed: Moment

    def not_after(self, wall: float) -> PersistedComponent:
        """It, with nothing in the future."""
        return self._replace(since=min(self.since, wall), listed=min(self.listed, wall))


Origin = Literal["declared", "discovered", "shared"]  # shared: by a status on a shared topic


class PersistedRobot(NamedTuple):
    """One robot; ``source`` as decided, ``topic`` where it was discovered or declared."""

    domain_id: Annotated[int, Field(ge=0, le=232)] | Literal["zenoh"]
    topic: Text
    source: Literal["agg", "raw", "both", "auto", "queries"]
    last_seen: Moment
    components: list[PersistedComponent]
    origin: Origin

    def as_json(self) -> str:
        """The fields by name, those of the components, too."""
        components = [component._asdict() for component in self.components]
        return json.dumps({**self._asdict(), "components": components}, ensure_ascii=False)

    def seen_at(self, last_seen: float) -> PersistedRobot:
        """It, received later than when it was written: its components as long before that."""
        later = last_seen - self.last_seen
        if not (self.last_seen and later > 0):
            return self
        components = [each._replace(listed=each.listed + later) for each in self.components]
        return self._replace(last_seen=last_seen, components=components)

    def not_after(self, wall: float) -> PersistedRobot:
        """It, with nothing in the future: the wall clock was set back since it was written."""
        components = [each.not_after(wall) for each in self.components]
        return self._replace(last_seen=min(self.last_seen, wall), components=components)
