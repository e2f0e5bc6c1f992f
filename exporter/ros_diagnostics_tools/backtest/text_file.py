"""Recordings as text: messages as ROS prints them, rosbridge's, driving_log_replayer's, and ours.

One message that cannot be decoded is counted with its line and the reason; the others are read.
"""

from __future__ import annotations

from base64 import b64decode
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Annotated, Any

from pydantic import (
    AliasChoices,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    TypeAdapter,
    ValidationError,
)

from ros_diagnostics_exporter.files import read_regular
from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_tools import limits
from ros_diagnostics_tools.backtest.documents import Document, documents
from ros_diagnostics_tools.backtest.formats import TYPE, RecordingError, Row, Undecodable, shortened

RAW, AGGREGATED = "/diagnostics", "/diagnostics_agg"
LEVELS = {"OK": 0, "WARN": 1, "ERROR": 2, "STALE": 3}
HEAD = 64 * 1024  # bytes in which a file of another ending shows that it has messages
LATEST = 2.0**33  # Unix seconds, in the year 2242
CUT = "..."  # what `ros2 topic echo` prints for the rest of a long list
_Unplaced = tuple[float | None, str | None, Array | Undecodable]


def is_text(path: Path) -> bool:
    """Whether a file with any ending has printed messages."""
    try:
        head = read_regular(path, HEAD)
    except OSError:  # who reads it names what is wrong
        return False
    return b"\0" not in head and (b"status:" in head or b'"status"' in head)


class TextFile:
    """A file of JSON or YAML; docs/time-machine.md says how each form is understood."""

    def __init__(self, path: Path) -> None:
        self.warnings: list[str] = []
        self.others: dict[str, str] = {}
        try:
            text = limits.read(path, limits.TEXT).decode("utf-8-sig", "replace")
        except (OSError, limits.LimitError) as error:
            raise RecordingError(f"{path}: cannot be read: {shortened(error)}") from error
        found = list(documents(text))
        cut = found.pop() if len(found) > 1 and found[-1].damage else None
        self._rows = _placed([row for each in found for row in self._rows_of(each)])
        if cut is not None:  # the recorder was stopped while it wrote
            where = f"after {len(self._rows)} messages: line {cut.line} {cut.damage}"
            self.warnings.append(f"{path}: is damaged {where}")
        damaged = [str(row[2]) for row in self._rows if isinstance(row[2], Undecodable)]
        if len(damaged) == len(self._rows):
            what = damaged[0] if damaged else f"holds no {TYPE} in JSON or YAML"
            raise RecordingError(f"{path}: is no recording of diagnostics: {what}")
        if "- '...'\n" in text:
            self.warnings.append(f"{path}: long lists are cut off: record with --full-length")
        self.topics = {topic for _at, topic, _content in self._rows}
        self.count = len(self._rows)
        self.begin, self.end = self._rows[0][0], self._rows[-1][0]

    def _rows_of(self, document: Document) -> Iterator[_Unplaced]:
        if document.damage:
            yield None, None, Undecodable(f"line {document.line} {document.damage}")
        for number, item in enumerate(_items(document.value), 1):
            try:
                yield from map(_timed, self._understood(item))
            except (ValueError, TypeError, AttributeError, RecursionError) as error:  # noqa: PERF203
                more = f", number {number}" if isinstance(document.value, list) else ""
                topic = item.get("topic") if isinstance(item.get("topic"), str) else None
                what = Undecodable(f"line {document.line}{more}: {_reason(error)}")
                yield None, topic, what

    def _understood(self, item: dict[str, Any]) -> Iterator[_Unplaced]:
        if "t0_unix" in item:
            yield from _own(item)
        elif "Frame" in item:
            yield from _replayed(item)
        elif isinstance(item.get("msg"), dict) and isinstance(item.get("topic"), str):
            if _is_array(item["msg"]):
                array = _array(item["msg"])
                yield array.stamp, item["topic"], array
            else:
                self.others[item["topic"]] = "not printed"
        elif _is_array(item):
            array = _array(item)
            aggregated = all(each.name.startswith("/") for each in array.statuses)
            yield array.stamp, AGGREGATED if aggregated and array.statuses else RAW, array

    def messages(self) -> Iterator[Row]:
        """All of it in order of time."""
        return iter(self._rows)

    def close(self) -> None:
        """Let go of the messages."""
        self._rows.clear()


def _timed(row: _Unplaced) -> _Unplaced:
    at = row[0]
    if at is not None and not 0 <= at < LATEST:
        raise ValueError(f"{at:g} is no time in Unix seconds")
    return row


def _items(value: Any) -> Iterator[dict[str, Any]]:
    """The mappings of a document: itself, or those in its lists."""
    waiting = [value]
    while waiting:
        found = waiting.pop()
        if isinstance(found, list):
            waiting.extend(reversed(found))
        elif isinstance(found, dict):
            yield found


def _placed(rows: list[_Unplaced]) -> list[Row]:
    """All in order of time; what has none comes with the message before it, or the first."""
    at, topic = next(((at, topic) for at, topic, _ in rows if at is not None), (0.0, RAW))
    placed: list[Row] = []
    for its_time, its_topic, content in rows:
        at, topic = at if its_time is None else its_time, its_topic or topic
        placed.append((at or 0.0, topic or RAW, content))
    return sorted(placed, key=lambda row: row[0])


def _reason(error: Exception) -> str:
    """What is wrong with a message, and where in it."""
    if not isinstance(error, ValidationError):
        return shortened(error)
    first = error.errors(include_url=False)[0]
    place = ".".join(str(part) for part in first["loc"])
    return f"{place}: {first['msg'].removeprefix('Value error, ')}"


# -- messages as ROS prints them ---------------------------------------------------------------


def _level(value: Any) -> Any:
    """A byte: a number, a character, a word, or base64 as rosbridge writes it."""
    if not isinstance(value, str):
        return value
    if value in LEVELS:
        return LEVELS[value]
    if value.isdecimal():
        return int(value)
    if len(value) != 1:
        value = b64decode(value.strip(), validate=True).decode("latin-1")
    return ord(value)


def _whole(value: Any) -> Any:
    """A list without the mark of what was cut off."""
    return [each for each in value if each != CUT] if isinstance(value, list) else value


class _Printed(BaseModel):
    model_config = ConfigDict(coerce_numbers_to_str=True, frozen=True)


class _Stamp(_Printed):
    """Of ROS 2 or of ROS 1."""

    seconds: float = Field(validation_alias=AliasChoices("sec", "secs"))
    nanoseconds: float = Field(validation_alias=AliasChoices("nanosec", "nsecs"))


class _Header(_Printed):
    stamp: _Stamp


class _Value(_Printed):
    key: str
    value: str


class _Status(_Printed):
    level: Annotated[int, Field(ge=0, le=255), BeforeValidator(_level)]
    name: str
    message: str = ""
    hardware_id: str = ""
    values: Annotated[list[_Value], BeforeValidator(_whole)] = []


class _Message(_Printed):
    header: _Header
    status: Annotated[list[_Status], BeforeValidator(_whole)]


def _is_array(item: dict[str, Any]) -> bool:
    """Whether it is meant as one: other messages have a header, and a status that is no list."""
    return isinstance(item.get("status"), list) or item.keys() <= {"header", "status"}


def _array(item: dict[str, Any]) -> Array:
    """One array; its stamp is the only time that is known of it."""
    found = _Message.model_validate(item)
    stamp = found.header.stamp
    statuses = (
        Status(
            each.level,
            each.name,
            each.message,
            each.hardware_id,
            tuple((pair.key, pair.value) for pair in each.values),
        )
        for each in found.status
    )
    return Array(stamp.seconds + stamp.nanoseconds * 1e-9, tuple(statuses))


# -- other forms -------------------------------------------------------------------------------


class _Own(_Printed):
    t0_unix: float
    topic: str
    messages: list[dict[str, Any]]


def _own(item: dict[str, Any]) -> Iterator[_Unplaced]:
    """This project's form: many messages with the time of each receipt."""
    found = _Own.model_validate(item)
    for number, message in enumerate(found.messages, 1):
        if not isinstance(message.get("status"), list):
            continue  # an event, or a status alone
        try:
            at = _SECONDS.validate_python(message.get("t"))
            yield found.t0_unix + at, found.topic, _array(message)
        except ValidationError as error:
            yield None, found.topic, Undecodable(f"message {number}: {_reason(error)}")


_SECONDS = TypeAdapter(float)


def _replayed(result: dict[str, Any]) -> Iterator[_Unplaced]:
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
        level = LEVELS.get(level) if isinstance(level, str) else level
        if isinstance(level, int):
            yield _one_level(content, level, path)
            return
        for key, each in content.items():
            yield from _levels(each, path if key == "Info" else (*path, str(key)))


def _one_level(content: dict[str, Any], level: int, path: Iterable[str]) -> Status:
    name = ": ".join(filter(None, (*path, str(content.get("Name", "")))))
    values = (
        (key, str(value))
        for key, value in content.items()
        if key not in {"Name", "Level"} and isinstance(value, (str, int, float))
    )
    return Status(level, name, "", "", tuple(values))
