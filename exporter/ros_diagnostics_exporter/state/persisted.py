"""What outlives the process, as plain nouns; times are Unix time, levels numbers.

The bounds hold for what comes back from a file: whatever passes them can be restored and shown.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal, NamedTuple

from pydantic import Field

from ros_diagnostics_exporter.state.flapping import SLOTS
from ros_diagnostics_exporter.state.trimming import MOST_TEXT

_Level = Annotated[int, Field(ge=0, le=3)]
_Moment = Annotated[float, Field(ge=-1e11, le=1e11, allow_inf_nan=False)]
_Text = Annotated[str, Field(max_length=MOST_TEXT)]


class RememberedComponent(NamedTuple):
    """One component; ``identity`` is (name, its group where that belongs to it, parting id)."""

    identity: tuple[_Text, _Text, _Text]
    group: _Text
    hardware_id: _Text
    level: _Level
    before_stale: _Level | None
    since: _Moment
    problem_since: _Moment | None
    message: _Text
    slots: Annotated[tuple[_Level, ...], Field(min_length=SLOTS, max_length=SLOTS)]
    listed: _Moment
    was_ok: bool | None = None  # when last received; None: a version before did not note it


class RememberedRobot(NamedTuple):
    """One robot; ``source`` as decided, ``topic`` where it was found or declared."""

    domain_id: Annotated[int, Field(ge=0, le=232)]
    topic: _Text
    source: Literal["agg", "raw", "both", "auto"]
    last_seen: _Moment
    components: list[RememberedComponent]

    def as_json(self) -> dict[str, Any]:
        """The fields by their names, those of the components as well."""
        return {
            **self._asdict(),
            "components": [component._asdict() for component in self.components],
        }
