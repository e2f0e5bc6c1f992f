"""Recordings in JSON: this project's form, messages as ROS prints them, driving_log_replayer's."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_tools.backtest.formats import RecordingError, Row, shortened

RAW, AGGREGATED = "/diagnostics", "/diagnostics_agg"
_LEVELS = {"OK": 0, "WARN": 1, "ERROR": 2, "STALE": 3}  # as the second version writes them


class JsonFile:
    """A .json or .jsonl file; docs/time-machine.md says how each form is understood."""

    def __init__(self, path: Path) -> None:
        self.warnings: list[str] = []
        self.others: dict[str, str] = {}
        try:
            documents, damage = _documents(path.read_text(encoding="utf-8"))
            self._rows = list(_rows(documents))
        except OSError as error:
            raise RecordingError(f"{path}: cannot be read: {error.strerror}") from error
        except (KeyError, TypeError, AttributeError) as error:
            raise RecordingError(f"{path}: is no recording of diagnostics: {error!r}") from error
        except (ValueError, RecursionError) as error:
            raise RecordingError(f"{path}: is not JSON: {shortened(error)}") from error
        if damage:
            count = len(self._rows)
            self.warnings.append(f"{path}: is damaged after {count} messages: {damage}")
        self._rows.sort(key=lambda row: row[0])
        self.topics = {topic for _at, topic, _array in self._rows}
        self.count = len(self._rows)
        times = [at for at, _topic, _array in self._rows] or [0.0]
        self.begin, self.end = times[0], times[-1]

    def messages(self) -> Iterator[Row]:
        """All of it in order of time."""
        return iter(self._rows)

    def close(self) -> None:
        """Let go of the messages."""
        self._rows.clear()


def _documents(text: str) -> tuple[list[Any], str]:
    """(the values in a text, one or many, "---" between them or not; what is wrong behind them)."""
    decoder, at = json.JSONDecoder(), 0
    found: list[Any] = []
    while rest := text[at : at + 80].lstrip():
        at = text.index(rest[0], at)
        if rest.startswith("---"):
            at += 3
            continue
        try:
            value, at = decoder.raw_decode(text, at)
        except ValueError as error:
            if not found:
                raise
            return found, shortened(error)
        found.append(value)
    return found, ""


def _rows(documents: list[Any]) -> Iterator[Row]:
    if len(documents) == 1 and isinstance(documents[0], dict) and "t0_unix" in documents[0]:
        yield from _own(documents[0])
        return
    count = 0
    for document in _flat(documents):
        if "status" in document:
            yield _printed(document)
            count += 1
        elif "Frame" in document:
            yield from _replayed(document)
            count += 1
    if not count:
        raise TypeError("neither t0_unix, nor status, nor Frame is in it")


def _flat(documents: Iterable[Any]) -> Iterator[dict[str, Any]]:
    for each in documents:
        if isinstance(each, list):
            yield from _flat(each)
        elif isinstance(each, dict):
            yield each


def _own(document: dict[str, Any]) -> Iterator[Row]:
    begin, topic = float(document["t0_unix"]), str(document["topic"])
    for raw in document["messages"]:
        if isinstance(raw.get("status"), list):  # others are events, or a status alone
            array = Array(_stamp(raw["header"]["stamp"]), tuple(map(_status, raw["status"])))
            yield begin + float(raw["t"]), topic, array


def _stamp(stamp: dict[str, Any]) -> float:
    """Of ROS 2 or of ROS 1."""
    if "secs" in stamp:
        return float(stamp["secs"] + stamp["nsecs"] * 1e-9)
    return float(stamp["sec"] + stamp["nanosec"] * 1e-9)


def _status(raw: dict[str, Any]) -> Status:
    values = tuple((str(pair["key"]), str(pair["value"])) for pair in raw["values"])
    texts = str(raw["name"]), str(raw["message"]), str(raw["hardware_id"])
    level = raw["level"]  # a byte, which some print as a character
    return Status(ord(level) if isinstance(level, str) else int(level), *texts, values)


def _printed(message: dict[str, Any]) -> Row:
    """A message as ROS prints it; its stamp is the only time that is known."""
    at, statuses = _stamp(message["header"]["stamp"]), tuple(map(_status, message["status"]))
    aggregated = bool(statuses) and all(each.name.startswith("/") for each in statuses)
    return at, AGGREGATED if aggregated else RAW, Array(at, statuses)


def _replayed(result: dict[str, Any]) -> Iterator[Row]:
    """A frame of driving_log_replayer: every object with a Level is a status."""
    at = result.get("Stamp", {}).get("ROS")
    statuses = tuple(_levels(result["Frame"], ()))
    if at is not None and statuses:  # what was evaluated before the drive began has no ROS time
        yield float(at), RAW, Array(float(at), statuses)


def _levels(content: Any, path: tuple[str, ...]) -> Iterator[Status]:
    if isinstance(content, list):
        for each in content:
            yield from _levels(each, path)
    elif isinstance(content, dict):
        level = content.get("Level")
        level = _LEVELS.get(level) if isinstance(level, str) else level
        if isinstance(level, int):
            yield _level(content, level, path)
            return
        for key, each in content.items():
            yield from _levels(each, path if key == "Info" else (*path, str(key)))


def _level(content: dict[str, Any], level: int, path: tuple[str, ...]) -> Status:
    name = ": ".join(filter(None, (*path, str(content.get("Name", "")))))
    values = (
        (key, str(value))
        for key, value in content.items()
        if key not in {"Name", "Level"} and isinstance(value, (str, int, float))
    )
    return Status(level, name, "", "", tuple(values))
