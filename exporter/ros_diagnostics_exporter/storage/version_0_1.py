"""The files of version 0.1, read once: the state as one JSON file, events as lines of JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import fields
from pathlib import Path
from typing import Any

import pydantic_core

from ros_diagnostics_exporter.events import KINDS, MESSAGE, Event
from ros_diagnostics_exporter.files import read_regular

STATE_NAMES = ("state", "state.json")  # beside the database; of the shipped unit and of the README
EVENTS_NAME = "events.jsonl"
BACKUPS = 5  # of the events: .1 is the newest
VERSION = 1
MAX_BYTES = 128 * 1024 * 1024  # of the state
MAX_LINE = 64 * 1024
_FIELDS = {field.name for field in fields(Event)}


def is_state(header: bytes) -> bool:
    """Whether a file that begins so looks like a state of version 0.1."""
    return header[:1] in (b"{", b"[")


def state_beside(database: Path) -> Path | None:
    """The state of version 0.1 beside a database that is not there yet.

    Raises:
        OSError: there is one that cannot be read.
    """
    for name in STATE_NAMES:
        path = database.with_name(name)
        if path.is_file() and is_state(read_regular(path, 1, follow=False)):
            return path
    return None


def read_state(path: Path) -> tuple[dict[str, Any], list[Any], str]:
    """Robots by name, rows of faults, and what is wrong with the file, or "".

    Raises:
        OSError: it cannot be read.
    """
    raw = read_regular(path, MAX_BYTES + 1, follow=False)
    if len(raw) > MAX_BYTES:
        return {}, [], f"it is larger than {MAX_BYTES} bytes"
    try:
        content = pydantic_core.from_json(raw, allow_inf_nan=False)
    except ValueError as error:
        return {}, [], f"it is not JSON: {error}"
    version = content.get("version") if isinstance(content, dict) else None
    if version != VERSION:
        return {}, [], f"its version is {version!r:.40}, not {VERSION}"
    if not isinstance(content.get("robots"), dict):
        return {}, [], "it has no robots by name"
    rows = content.get("faults", [])
    if not isinstance(rows, list):
        return content["robots"], [], "its faults are no list"
    return content["robots"], rows, ""


def event_files(path: Path) -> list[Path]:
    """The rotated files of the event log ``path`` and itself, as far as they are there."""
    numbered = [path.with_name(f"{path.name}.{number}") for number in range(BACKUPS, 0, -1)]
    return [each for each in (*numbered, path) if each.is_file() and not each.is_symlink()]


def count_lines(paths: list[Path]) -> int:
    """How many lines these files have, of any kind.

    Raises:
        OSError: one cannot be read.
    """
    count = 0
    for path in paths:
        with path.open("rb") as file:
            while file.readline(MAX_LINE):
                count += 1
    return count


def read_events(paths: list[Path]) -> Iterator[Event]:
    """The events of these files in order; lines that are none are left out."""
    for path in paths:
        with path.open("rb") as file:
            while line := file.readline(MAX_LINE):
                event = _event(line)
                if event is not None:
                    yield event


def _event(line: bytes) -> Event | None:
    try:
        found = json.loads(line)
    except ValueError:
        return None
    if not isinstance(found, dict) or not found.keys() <= _FIELDS:
        return None
    time, kind = found.pop("time", None), found.pop("kind", None)
    texts = [value for value in found.values() if isinstance(value, str)]
    is_time = isinstance(time, float | int) and math.isfinite(time)
    if not is_time or kind not in KINDS or len(texts) != len(found):
        return None
    return Event(float(time), kind, **{key: text[:MESSAGE] for key, text in found.items()})
