"""ROS 1: its bags, read by the library `rosbags`, and a serialized DiagnosticArray -> Array."""

from __future__ import annotations

import struct
from bz2 import BZ2Decompressor
from bz2 import decompress as bz2_decompress
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_tools import limits
from ros_diagnostics_tools.backtest.formats import TYPE, RecordingError, Ros1, Row, shortened

_number = struct.Struct("<I").unpack_from
_header = struct.Struct("<III")  # sequence number, stamp


def decode(data: bytes) -> Array:
    """One diagnostic_msgs/DiagnosticArray of ROS 1: no alignment, strings without a closing zero.

    Raises:
        ValueError: the bytes are no such message.
    """
    try:
        _sequence, seconds, nanoseconds = _header.unpack_from(data)
        _frame_id, at = _text(data, _header.size)
        count, at = _number(data, at)[0], at + 4
        statuses = []
        for _ in range(count):
            status, at = _status(data, at)
            statuses.append(status)
    except (struct.error, IndexError):
        at = -1
    if at != len(data):
        raise ValueError("is no DiagnosticArray of ROS 1")
    return Array(seconds + nanoseconds * 1e-9, tuple(statuses), len(data))


def _status(data: bytes, at: int) -> tuple[Status, int]:
    level = data[at]
    name, at = _text(data, at + 1)
    message, at = _text(data, at)
    hardware_id, at = _text(data, at)
    count, at = _number(data, at)[0], at + 4
    values = []
    for _ in range(count):
        key, at = _text(data, at)
        value, at = _text(data, at)
        values.append((key, value))
    return Status(level, name, message, hardware_id, tuple(values)), at


def _text(data: bytes, at: int) -> tuple[str, int]:
    """(the text at an offset, the offset behind it)."""
    end = at + 4 + _number(data, at)[0]
    if end > len(data):
        raise IndexError
    return data[at + 4 : end].decode(errors="replace"), end


class Ros1Bag:
    """A .bag file."""

    def __init__(self, path: Path) -> None:
        try:
            from rosbags.rosbag1 import Reader  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise RecordingError(
                f"{path}: reading bags of ROS 1 needs the library rosbags ({error}): "
                f"{install_command('backtest')}"
            ) from error
        self._path = path
        try:
            self._reader = Reader(path)
            self._reader.open()
            _limit(self._reader.chunks)
        except Exception as error:  # a damaged file makes the library raise anything
            raise RecordingError(
                f"{path}: cannot be read as a bag: {shortened(error)}; one that was not closed is "
                f"mended by `rosbag reindex {path.name}`"
            ) from error
        found = self._reader.connections
        self._wanted = [each for each in found if each.msgtype == TYPE]
        self.topics = {each.topic for each in self._wanted}
        self.others = {each.topic: each.msgtype for each in found if each.msgtype != TYPE}
        self.count = sum(each.msgcount for each in self._wanted)
        self.begin, self.end = self._reader.start_time / 1e9, self._reader.end_time / 1e9
        self.warnings: list[str] = []

    def messages(self) -> Iterator[Row]:
        """All of it in order of time, up to where it is damaged."""
        count = 0
        try:
            for connection, at, data in self._reader.messages(self._wanted):
                yield at / 1e9, connection.topic, Ros1(data)
                count += 1
        except Exception as error:  # noqa: BLE001 - as above
            self.warnings.append(
                f"{self._path}: is damaged after {count} messages and read up to there "
                f"({shortened(error)}); `rosbag reindex {self._path.name}` may find more"
            )

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def _limit(chunks: dict[int, Any]) -> None:
    """Let the library unpack no more of a chunk than is read of any."""
    from lz4.frame import LZ4FrameDecompressor  # noqa: PLC0415 - comes with the extra
    from lz4.frame import decompress as lz4_decompress  # noqa: PLC0415

    limited = {bz2_decompress: BZ2Decompressor, lz4_decompress: LZ4FrameDecompressor}
    for at, chunk in chunks.items():
        if maker := limited.get(chunk.decompressor):
            chunks[at] = chunk._replace(decompressor=_limited(maker))


def _limited(maker: Callable[[], Any]) -> Callable[[bytes], bytes]:
    def decompress(data: bytes) -> bytes:
        content: bytes = maker().decompress(data, max_length=limits.CHUNK + 1)
        if len(content) > limits.CHUNK:
            raise limits.LimitError(f"a chunk unpacks to more than {limits.size(limits.CHUNK)}")
        return content

    return decompress
