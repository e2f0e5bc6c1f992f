"""What Prometheus would have scraped, with the times of the recording, for its history.

`promtool tsdb create-blocks-from openmetrics` makes blocks of it. Each scrape is written as a whole
after the one before, as promtool takes it; a strict OpenMetrics parser wants families in one piece.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TextIO

from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.texts import escape

END = "# EOF\n"


class Samples:
    """Writes the families of a replayed state every ``interval`` seconds.

    ``labels`` are added to every sample, as a scrape adds job and instance.
    """

    def __init__(self, out: TextIO, interval: float, labels: Mapping[str, str]) -> None:
        self._out = out
        self._interval = interval
        self._labels = ",".join(f'{name}="{escape(text)}"' for name, text in labels.items())
        self._due = 0.0
        self._state: FleetState | None = None
        self._exposition: Exposition | None = None
        self.count = 0

    def scrape(self, state: FleetState, now: Instant) -> None:
        """Write the samples of this moment, if it is time to."""
        if now.wall < self._due:
            return
        self._due = now.wall + self._interval
        if self._state is not state or self._exposition is None:
            self._state, self._exposition = state, Exposition(state)
        lines = [f"up{{{self._labels}}} 1", *self._exposition.render().decode().splitlines()]
        for line in lines:
            if not line.startswith("#"):
                self._out.write(f"{self._labelled(line)} {now.wall:.3f}\n")
                self.count += 1

    def _labelled(self, line: str) -> str:
        if line.startswith("up{"):
            return line
        name, _, rest = line.partition("{")
        return f"{name}{{{self._labels},{rest}"

    def close(self) -> None:
        """Write the end, without which promtool takes nothing."""
        self._out.write(END)
