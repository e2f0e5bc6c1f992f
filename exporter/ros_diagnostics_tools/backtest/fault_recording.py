"""A recording that the exporter made of a fault: it says which fault, and what judged it."""

from __future__ import annotations

import json
from contextlib import closing
from pathlib import Path
from typing import Any, NamedTuple

from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_tools.backtest import words
from ros_diagnostics_tools.backtest.formats import RecordingError
from ros_diagnostics_tools.backtest.history import confirm_after
from ros_diagnostics_tools.backtest.mcap import DamageError, McapFile
from ros_diagnostics_tools.backtest.replay import Result


class FaultRecording(NamedTuple):
    """``fault`` is as in /api/v1/events, ``config`` the lines of fleet.yml for its robot."""

    fault: dict[str, Any]
    config: bytes


def read(path: Path) -> FaultRecording | None:
    """The recording of a fault at a path; None where it is of something else, or unreadable."""
    if path.suffix != ".mcap" or not path.is_file():
        return None
    try:
        with closing(McapFile(path)) as file:
            attached = file.attachments()
        return FaultRecording(json.loads(attached["fault.json"]), attached["fleet.yml"])
    except (KeyError, ValueError, DamageError, RecordingError):
        return None  # whoever reads its messages names what is wrong


def too_short(recording: FaultRecording, result: Result, state: FleetState) -> list[str]:
    """Why a recording does not show whether its fault would have begun; nothing if it does."""
    fault = recording.fault
    needed = confirm_after(state, fault["robot"], fault.get("component", ""))
    seen = max(0.0, result.end - max(result.begin, fault["since"]))
    if seen >= needed:
        return []
    return [
        (
            f"too short to know: the recording shows {words.duration(seen)} of the trouble, and "
            f"it would be confirmed after {words.duration(needed)}"
        )
    ]
