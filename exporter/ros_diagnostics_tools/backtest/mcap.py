"""An MCAP file (https://mcap.dev/spec), read by its index, or without one as far as it is whole."""

from __future__ import annotations

import struct
from binascii import crc32
from collections.abc import Iterator
from heapq import heappop, heappush
from pathlib import Path
from typing import NamedTuple

from ros_diagnostics_exporter import zstd
from ros_diagnostics_exporter.extras import install_command
from ros_diagnostics_tools.backtest.formats import (
    ROS1_TYPE,
    TYPE,
    RecordingError,
    Ros1,
    Row,
    shortened,
)
from ros_diagnostics_tools.backtest.sqlite_bag import plain

MAGIC = b"\x89MCAP0\r\n"
ATTACHMENT = 0x09
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK = 0x02, 0x03, 0x04, 0x05, 0x06
CHUNK_INDEX, STATISTICS, SUMMARY_OFFSET = 0x08, 0x0B, 0x0E
FOOTER_SIZE = 9 + 20 + len(MAGIC)
_ENCODINGS = {"cdr": bytes, "ros1": Ros1}
_record = struct.Struct("<BQ")
_chunk = struct.Struct("<QQQI")
_message = struct.Struct("<HIQQ")


class DamageError(Exception):
    """The file is not whole from here on."""


class Block(NamedTuple):
    """A chunk, or a message outside of one: its time (ns), and where the record's content is."""

    begin: int
    end: int
    at: int
    size: int
    op: int


class _Fields:
    """Reads the fields of a record one after the other."""

    def __init__(self, content: bytes) -> None:
        self._content, self._at = content, 0

    def number(self, form: str) -> int:
        (value,) = struct.unpack_from(f"<{form}", self._content, self._at)
        self._at += struct.calcsize(f"<{form}")
        return int(value)

    def text(self) -> str:
        return self.bytes(self.number("I")).decode(errors="replace")

    def bytes(self, size: int) -> bytes:
        self._at += size
        return self._content[self._at - size : self._at]

    def counts(self) -> dict[int, int]:
        """A map of channel ids to numbers."""
        return dict(struct.iter_unpack("<HQ", self.bytes(self.number("I"))))


class McapFile:
    """One .mcap file."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self.warnings: list[str] = []
        self.others: dict[str, str] = {}
        self._types: dict[int, str] = {}  # by schema
        self._channels: dict[int, tuple[str, type[bytes]]] = {}  # that hold diagnostics
        self._blocks: list[Block] = []
        self.count, self._times = 0, (0, 0)
        self._file = path.open("rb")
        self._size = path.stat().st_size
        if self._file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(f"{path}: cannot be read as a bag: does not begin as MCAP does")
        try:
            self._read()
        except (DamageError, struct.error) as damage:
            self._warn(str(damage))
        self._blocks.sort()
        self.topics = {topic for topic, _encoding in self._channels.values()}
        self.begin, self.end = (at / 1e9 for at in self._times)

    def _warn(self, damage: str) -> None:
        self.warnings.append(
            f"{self._path}: is damaged and read up to there: {damage}; "
            f"`mcap recover {self._path.name}` writes what is whole of it"
        )

    # -- what is in it -------------------------------------------------------------------------

    def _read(self) -> None:
        try:
            is_indexed = self._read_index()
        except (DamageError, struct.error):
            is_indexed = False
        if not is_indexed:
            self._scan()

    def _read_index(self) -> bool:
        """Read the summary; False where the file ends without one, or it does not index chunks."""
        self._file.seek(max(0, self._size - FOOTER_SIZE))
        footer = self._file.read()
        if len(footer) < FOOTER_SIZE or not footer.endswith(MAGIC) or footer[0] != FOOTER:
            return False
        (start,) = struct.unpack_from("<Q", footer, 9)
        if not 0 < start < self._size:
            return False
        indexes, statistics = [], None
        for op, at, size in self._records(start, self._size - FOOTER_SIZE):
            fields = _Fields(self._bytes(at, size))
            if op == CHUNK_INDEX:
                indexes.append(fields)
            elif op == STATISTICS:
                statistics = fields
            else:
                self._note(op, fields)
        if statistics is None or not indexes:
            return False
        statistics.bytes(26)
        self._times = statistics.number("Q"), statistics.number("Q")
        counts = statistics.counts()
        self.count = sum(counts.get(each, 0) for each in self._channels)
        self._blocks = [block for each in indexes if (block := self._block(each)) is not None]
        return True

    def _block(self, fields: _Fields) -> Block | None:
        """A chunk by its index; None where it holds no diagnostics."""
        begin, end, at, size = (fields.number("Q") for _ in range(4))
        channels = fields.counts()  # none where the recorder writes no indexes of messages
        if channels and not channels.keys() & self._channels.keys():
            return None
        return Block(begin, end, at + _record.size, size - _record.size, CHUNK)

    def _scan(self) -> None:
        """Read the file from the begin: what the index would say, up to where it is damaged."""
        self._times = 0, 0
        for op, at, size in self._records(len(MAGIC), self._size):
            if op == FOOTER:
                return
            if op == CHUNK:
                begin, end, *_rest = _chunk.unpack_from(self._bytes(at, _chunk.size))
                before = self.count
                for inner, fields, content in self._inside(at, size):
                    self._count(inner, fields, content)
                if self.count > before:
                    self._blocks.append(Block(begin, end, at, size, CHUNK))
            elif op in (SCHEMA, CHANNEL, MESSAGE):
                content = self._bytes(at, size)
                if self._count(op, _Fields(content), content):
                    (_channel, _number, time, _published) = _message.unpack_from(content)
                    self._blocks.append(Block(time, time, at, size, MESSAGE))
        raise DamageError(f"ends without a footer after {self._size} bytes")

    def _count(self, op: int, fields: _Fields, content: bytes) -> bool:
        """Note one record of the data; whether it is a message of diagnostics."""
        if op != MESSAGE:
            self._note(op, fields)
            return False
        channel, _number, at, _published = _message.unpack_from(content)
        self._times = min(self._times[0] or at, at), max(self._times[1], at)
        self.count += channel in self._channels
        return channel in self._channels

    def _note(self, op: int, fields: _Fields) -> None:
        if op == SCHEMA:
            schema = fields.number("H")
            self._types[schema] = fields.text()
        elif op == CHANNEL:
            number, kind = fields.number("H"), self._types.get(fields.number("H"), "")
            topic, encoding = fields.text(), fields.text()
            if kind not in (TYPE, ROS1_TYPE):
                self.others[topic] = kind or encoding
            elif encoding in _ENCODINGS:
                self._channels[number] = topic, _ENCODINGS[encoding]
            else:
                warning = f"{self._path}: {topic} is encoded as {encoding}, not read"
                if warning not in self.warnings:
                    self.warnings.append(warning)

    # -- records -------------------------------------------------------------------------------

    def _records(self, begin: int, end: int) -> Iterator[tuple[int, int, int]]:
        """(kind, offset and size of the content) of each record."""
        at = begin
        while at < end:
            op, size = _record.unpack(self._bytes(at, _record.size))
            at += _record.size
            left = self._size - at
            if op == CHUNK or size <= left:
                yield op, at, min(size, left)
            if size > left:
                raise DamageError(f"the record at byte {at - _record.size} is cut off")
            at += size

    def _bytes(self, at: int, size: int) -> bytes:
        self._file.seek(at)
        content = self._file.read(size)
        if len(content) < size:
            raise DamageError(f"ends at byte {at + len(content)}, within a record")
        return content

    def _inside(self, at: int, size: int) -> Iterator[tuple[int, _Fields, bytes]]:
        """The records of a chunk, which is checked before; of one that is cut off the first."""
        content = self._bytes(at, size)
        try:
            yield from _unpacked(content)
        except (struct.error, ValueError, zstd.ZstdError) as error:
            raise DamageError(f"the chunk at byte {at}: {shortened(error)}") from error

    def attachments(self) -> dict[str, bytes]:
        """The files in it by name. Raises DamageError or struct.error where it is damaged."""
        found = {}
        for op, at, size in self._records(len(MAGIC), self._size - len(MAGIC)):
            if op == ATTACHMENT:
                fields = _Fields(self._bytes(at, size))
                fields.bytes(16)  # times
                name, _media_type = fields.text(), fields.text()
                found[name] = fields.bytes(fields.number("Q"))
        return found

    # -- messages ------------------------------------------------------------------------------

    def messages(self) -> Iterator[Row]:
        """All of it in order of time, up to where it is damaged."""
        waiting: list[tuple[int, int, int, bytes]] = []  # time, number, channel, data
        number = 0
        try:
            for block in self._blocks:
                while waiting and waiting[0][0] < block.begin:
                    yield self._row(heappop(waiting))
                for channel, at, data in self._messages_of(block):
                    heappush(waiting, (at, number, channel, data))
                    number += 1
        except DamageError as damage:
            self._warn(f"{damage}, after {number} messages")
        while waiting:
            yield self._row(heappop(waiting))

    def _row(self, message: tuple[int, int, int, bytes]) -> Row:
        at, _number, channel, data = message
        topic, encoding = self._channels[channel]
        return at / 1e9, topic, encoding(plain(data))

    def _messages_of(self, block: Block) -> Iterator[tuple[int, int, bytes]]:
        """(channel, time, bytes) of the diagnostics in it."""
        if block.op == MESSAGE:
            contents = [self._bytes(block.at, block.size)]
        else:
            found = self._inside(block.at, block.size)
            contents = [content for op, _fields, content in found if op == MESSAGE]
        for content in contents:
            channel, _number, at, _published = _message.unpack_from(content)
            if channel in self._channels:
                yield channel, at, content[_message.size :]

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _unpacked(chunk: bytes) -> Iterator[tuple[int, _Fields, bytes]]:
    """The records in the content of a chunk.

    Raises:
        ValueError, struct.error, ZstdError: it is damaged.
    """
    _begin, _end, size, checksum = _chunk.unpack_from(chunk)
    fields = _Fields(chunk[_chunk.size :])
    compression, whole = fields.text(), fields.number("Q")
    data = fields.bytes(whole)
    content = _decompressed(compression, data, is_cut=len(data) < whole)
    if len(data) == whole and (len(content) != size or checksum not in (0, crc32(content))):
        raise ValueError("its content is not what was written")
    at = _record.size
    while at <= len(content):
        op, length = _record.unpack_from(content, at - _record.size)
        inner = content[at : at + length]
        if len(inner) == length:
            yield op, _Fields(inner), inner
        elif len(data) == whole:
            raise ValueError("a record in it is damaged")
        at += length + _record.size


def _decompressed(compression: str, data: bytes, *, is_cut: bool) -> bytes:
    if compression == "zstd":
        return zstd.ZstdDecompressor().decompress(data) if is_cut else zstd.decompress(data)
    if compression == "lz4":
        try:
            from lz4.frame import decompress  # noqa: PLC0415 - an extra
        except ImportError as error:
            raise RecordingError(
                f"a chunk compressed with lz4 needs the library lz4 ({error}): "
                f"{install_command('backtest')}"
            ) from error
        try:
            return b"" if is_cut else bytes(decompress(data))
        except RuntimeError as error:  # what the library raises
            raise ValueError(str(error)) from error
    if compression:
        raise ValueError(f"is compressed with {compression!r}, which is not known")
    return data
