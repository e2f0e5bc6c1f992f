"""A rosbag2 file in SQLite (.db3)."""

from __future__ import annotations

import sqlite3
from collections.abc import Iterable, Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from urllib.parse import quote

from ros_diagnostics_exporter import zstd
from ros_diagnostics_tools import limits
from ros_diagnostics_tools.backtest.formats import (
    TYPE,
    Content,
    Fields,
    RecordingError,
    Row,
    Wanted,
    nothing,
    shortened,
)

_NEEDED = {
    *(("topics", name) for name in ("id", "name", "type", "serialization_format")),
    *(("messages", name) for name in ("id", "topic_id", "timestamp", "data")),
}
_OF_DEFINITIONS = {
    ("message_definitions", name)
    for name in ("topic_type", "encoding", "encoded_message_definition")
}
_ROWS = "SELECT topic_id, timestamp, data FROM messages WHERE topic_id IN (%s)"


class SqliteBag:
    """One .db3 file; those of a folder do not need its metadata.yaml."""

    def __init__(self, path: Path, wanted: Wanted = nothing) -> None:
        self._path, self._wanted = path, wanted
        self.warnings: list[str] = []
        # A log beside it has the last messages; without one, the folder may be read-only.
        how = "mode=ro" if path.with_name(f"{path.name}-wal").exists() else "immutable=1"
        with ExitStack() as stack:
            try:
                connection = sqlite3.connect(f"file:{quote(str(path))}?{how}", uri=True)
                self._file = stack.enter_context(closing(connection))
                self._read_topics()
            except sqlite3.Error as error:
                raise RecordingError(
                    f"{path}: cannot be read as a bag: {shortened(error)}; {self._way_out}"
                ) from error
            self._salvaged: list[tuple[int, int, bytes]] | None = None
            try:
                self._read_size()
            except sqlite3.Error as error:
                self._salvage(error)
            stack.pop_all()  # it can be read, and stays open

    def _read_topics(self) -> None:
        if not limits.held_columns(self._file) >= _NEEDED:
            raise sqlite3.DatabaseError("it has no tables topics and messages")
        self._names: dict[int, str] = {}
        self._kinds: dict[int, str] = {}  # of those that are no diagnostics
        self.others: dict[str, str] = {}
        found = self._file.execute("SELECT id, name, type, serialization_format FROM topics")
        for number, name, kind, encoding in found:
            if kind != TYPE and encoding == "cdr" and self._wanted(name):
                self._names[number] = name
                self._kinds[number] = kind
            elif kind != TYPE:
                self.others[name] = kind
            elif encoding == "cdr":
                self._names[number] = name
            else:
                self.warnings.append(f"{self._path}: {name} is encoded as {encoding}, not read")
        self._definitions = self._read_definitions() if self._kinds else {}
        self.topics = set(self._names.values())
        self._query = _ROWS % ",".join(map(str, self._names))

    def _read_definitions(self) -> dict[str, str]:
        """By type; none of bags of before ROS 2 Iron."""
        if not limits.held_columns(self._file) >= _OF_DEFINITIONS:
            return {}
        found = self._file.execute(
            "SELECT topic_type, encoded_message_definition FROM message_definitions "
            "WHERE encoding = 'ros2msg'"
        )
        return {str(kind): str(text) for kind, text in found}

    def _content(self, number: int, data: bytes) -> Content:
        kind = self._kinds.get(number)
        return data if kind is None else Fields(kind, self._definitions.get(kind, ""), data)

    def _read_size(self) -> None:
        [(begin, end)] = self._file.execute("SELECT min(timestamp), max(timestamp) FROM messages")
        [(self.count,)] = self._file.execute(f"SELECT count(*) FROM ({self._query})")  # noqa: S608 - numbers
        self.begin, self.end = (begin or 0) / 1e9, (end or 0) / 1e9

    def _salvage(self, error: sqlite3.Error) -> None:
        """Take what can be read of a damaged file in the order in which it was written."""
        found: list[tuple[int, int, bytes]] = []
        try:
            found.extend(self._file.execute(f"{self._query} ORDER BY id"))
        except sqlite3.Error as later:
            error = later
        found.sort(key=lambda row: row[1])
        if not found:
            raise RecordingError(f"{self._path}: is damaged: {shortened(error)}; {self._way_out}")
        self._salvaged, self.count = found, len(found)
        self.begin, self.end = found[0][1] / 1e9, found[-1][1] / 1e9
        self._warn(len(found), error)

    @property
    def _way_out(self) -> str:
        return f"`sqlite3 {self._path.name} .recover` may find more"

    def _warn(self, count: int, error: sqlite3.Error) -> None:
        self.warnings.append(
            f"{self._path}: is damaged after {count} messages and read up to there "
            f"({shortened(error)}); {self._way_out}"
        )

    def messages(self) -> Iterator[Row]:
        """All of it in order of time, up to where it is damaged."""
        found: Iterable[tuple[int, int, bytes]] | None = self._salvaged
        count = 0
        try:
            if found is None:
                found = self._file.execute(f"{self._query} ORDER BY timestamp")
            for number, at, data in found:
                yield at / 1e9, self._names[number], self._content(number, plain(data))
                count += 1
        except sqlite3.Error as error:
            self._warn(count, error)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def plain(data: bytes) -> bytes:
    """A message, decompressed where the recorder compressed each; one that is damaged as it is."""
    if not data.startswith(zstd.MAGIC):
        return data
    try:
        return limits.unzstd(data, limits.MESSAGE)
    except (zstd.ZstdError, limits.LimitError):
        return data  # counted as undecodable
