"""An MCAP file (https://mcap.dev/spec), read by its index, or without one as far as it is whole.

Foxglove's library reads the records. It stops at the first damage: what it read before counts.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from heapq import heappop, heappush
from io import BytesIO
from itertools import chain
from pathlib import Path
from typing import NamedTuple

from lz4.frame import LZ4FrameDecompressor
from mcap.data_stream import ReadDataStream
from mcap.exceptions import EndOfFile, InvalidMagic, McapError
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, McapRecord, Message, Schema
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from zstandard import ZstdError

from ros_diagnostics_exporter import zstd
from ros_diagnostics_tools import limits
from ros_diagnostics_tools.backtest.formats import (
    ROS1_TYPE,
    TYPE,
    Content,
    Fields,
    RecordingError,
    Ros1,
    Row,
    Wanted,
    nothing,
    shortened,
)
from ros_diagnostics_tools.backtest.sqlite_bag import plain

HEADER = 9  # bytes of a record before its content: its kind and its length
_ENCODINGS = {"cdr": bytes, "ros1": Ros1}
# What the library raises where a file is damaged: its own errors, and those of a length or a place
# that is none. lz4 raises RuntimeError.
_DAMAGE = (
    *(McapError, ZstdError, zstd.ZstdError, struct.error, RuntimeError),
    *(KeyError, ValueError, OverflowError, OSError, MemoryError),
)


class DamageError(Exception):
    """The file is not whole from here on."""


class Block(NamedTuple):
    """A chunk, or a message outside of one: its time (ns), and where its content begins."""

    begin: int
    end: int
    at: int
    size: int  # of a message; 0: a chunk


class McapFile:
    """One .mcap file."""

    def __init__(self, path: Path, wanted: Wanted = nothing) -> None:
        self._path, self._wanted = path, wanted
        self.warnings: list[str] = []
        self.others: dict[str, str] = {}
        self._types: dict[int, Schema] = {}
        self._channels: dict[int, tuple[str, Callable[[bytes], Content]]] = {}  # that are read
        self._blocks: list[Block] = []
        self.count, self._times = 0, (0, 0)
        self._cut: int | None = None  # where the content of the chunk begins that is cut off
        self._file = path.open("rb")
        self._size = path.stat().st_size
        try:
            self._reader = SeekingReader(self._file)
        except (InvalidMagic, EndOfFile, struct.error) as error:
            self._file.close()
            raise RecordingError(
                f"{path}: cannot be read as a bag: does not begin as MCAP does"
            ) from error
        try:
            self._read()
        except DamageError as damage:
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
            summary = self._reader.get_summary()
        except _DAMAGE:  # it was not closed, or is damaged at its end
            summary = None
        if summary is None or summary.statistics is None or not summary.chunk_indexes:
            self._scan()
        else:
            self._take(summary)

    def _take(self, summary: Summary) -> None:
        for record in chain(summary.schemas.values(), summary.channels.values()):
            self._note(record)
        if (counts := summary.statistics) is not None:
            self._times = counts.message_start_time, counts.message_end_time
            of_each = counts.channel_message_counts
            self.count = sum(of_each.get(channel, 0) for channel in self._channels)
        self._blocks = [_block(index) for index in summary.chunk_indexes if self._holds(index)]

    def _holds(self, index: ChunkIndex) -> bool:
        """Whether a chunk holds diagnostics; not known where messages have no indexes."""
        channels = index.message_index_offsets
        return not channels or not channels.keys().isdisjoint(self._channels)

    def _scan(self) -> None:
        """Read the file from the begin: what the index would say, up to where it is damaged."""
        self._file.seek(0)
        at = self._file.tell()
        try:
            for record in StreamReader(self._file, emit_chunks=True).records:
                at = self._file.tell()
                self._add(record, at)
        except _DAMAGE as error:
            self._add_cut(at)
            if isinstance(error, EndOfFile):
                raise DamageError(f"ends without a footer after {self._size} bytes") from error
            raise DamageError(f"the record at byte {at}: {shortened(error)}") from error

    def _add(self, record: McapRecord, end: int) -> None:
        """Note one record of the file, which ends there."""
        if isinstance(record, Chunk):
            before = self.count
            size = struct.calcsize("<QQQIIQ") + len(record.compression) + len(record.data)
            for inner in self._inside(record, end - size):
                self._count(inner)
            if self.count > before:
                times = record.message_start_time, record.message_end_time
                self._blocks.append(Block(*times, end - size, 0))
        elif self._count(record) and isinstance(record, Message):
            size = struct.calcsize("<HIQQ") + len(record.data)
            self._blocks.append(Block(record.log_time, record.log_time, end - size, size))

    def _add_cut(self, at: int) -> None:
        """Note the chunk that is cut off at the end of the file: its first part is there."""
        self._file.seek(at)
        header = self._file.read(HEADER)
        is_chunk = len(header) == HEADER and header[0] == Opcode.CHUNK
        if is_chunk and at + HEADER + int.from_bytes(header[1:], "little") > self._size:
            self._cut = at + HEADER
            self._add(self._chunk(at + HEADER), self._size)

    def _count(self, record: McapRecord) -> bool:
        """Note one record of the data; whether it is a message of diagnostics."""
        if not isinstance(record, Message):
            self._note(record)
            return False
        self._times = (
            min(self._times[0] or record.log_time, record.log_time),
            max(self._times[1], record.log_time),
        )
        self.count += record.channel_id in self._channels
        return record.channel_id in self._channels

    def _note(self, record: McapRecord) -> None:
        if isinstance(record, Schema):
            self._types[record.id] = record
        elif isinstance(record, Channel):
            schema = self._types.get(record.schema_id)
            kind = "" if schema is None else schema.name
            topic, encoding = record.topic, record.message_encoding
            if kind not in (TYPE, ROS1_TYPE) and encoding == "cdr" and self._wanted(topic):
                self._channels[record.id] = topic, partial(Fields, kind, _definition(schema))
            elif kind not in (TYPE, ROS1_TYPE):
                self.others[topic] = kind or encoding
            elif encoding in _ENCODINGS:
                self._channels[record.id] = topic, _ENCODINGS[encoding]
            else:
                warning = f"{self._path}: {topic} is encoded as {encoding}, not read"
                if warning not in self.warnings:
                    self.warnings.append(warning)

    # -- records -------------------------------------------------------------------------------

    def _chunk(self, at: int) -> Chunk:
        """The chunk whose content begins there; of one that is cut off what there is."""
        try:
            self._file.seek(at)
            return Chunk.read(ReadDataStream(self._file))
        except _DAMAGE as error:
            raise DamageError(f"the chunk at byte {at}: {shortened(error)}") from error

    def _inside(self, chunk: Chunk, at: int) -> list[McapRecord]:
        """The records of a chunk whose content begins there; of the one that is cut off the first.

        Raises:
            DamageError: its content is not what was written.
        """
        if at == self._cut:
            return _first_records(chunk)
        try:
            plain_chunk = replace(chunk, compression="", data=_content(chunk))
            return list(breakup_chunk(plain_chunk, validate_crc=True))
        except _DAMAGE as error:
            raise DamageError(f"the chunk at byte {at}: {shortened(error)}") from error

    def attachments(self) -> dict[str, bytes]:
        """The files in it by name. Raises DamageError where it is damaged."""
        try:
            return {each.name: each.data for each in self._reader.iter_attachments()}
        except _DAMAGE as error:
            raise DamageError(shortened(error)) from error

    # -- messages ------------------------------------------------------------------------------

    def messages(self) -> Iterator[Row]:
        """All of it in order of time, up to where it is damaged."""
        waiting: list[tuple[int, int, int, bytes]] = []  # time, number, channel, data
        number = 0
        try:
            for block in self._blocks:
                while waiting and waiting[0][0] < block.begin:
                    yield self._row(heappop(waiting))
                for message in self._messages_of(block):
                    heappush(waiting, (message.log_time, number, message.channel_id, message.data))
                    number += 1
        except DamageError as damage:
            self._warn(f"{damage}, after {number} messages")
        while waiting:
            yield self._row(heappop(waiting))

    def _row(self, message: tuple[int, int, int, bytes]) -> Row:
        at, _number, channel, data = message
        topic, encoding = self._channels[channel]
        return at / 1e9, topic, encoding(plain(data))

    def _messages_of(self, block: Block) -> Iterator[Message]:
        """The diagnostics in it."""
        records: Iterable[McapRecord]
        if block.size:
            self._file.seek(block.at)
            records = [Message.read(ReadDataStream(self._file), block.size)]
        else:
            records = self._inside(self._chunk(block.at), block.at)
        for record in records:
            if isinstance(record, Message) and record.channel_id in self._channels:
                yield record

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def _definition(schema: Schema | None) -> str:
    """The definition of a type as `ros2 bag record` writes it; "" where there is none such."""
    if schema is None or schema.encoding != "ros2msg":
        return ""
    return bytes(schema.data).decode(errors="replace")


def _content(chunk: Chunk) -> bytes:
    """What is in a whole chunk. The library would unpack any size, and read zeros as records.

    Raises:
        One of _DAMAGE: it is not what was written, or more than is read.
    """
    size = chunk.uncompressed_size
    limits.check(size, limits.CHUNK)
    content: bytes = chunk.data
    if chunk.compression == "zstd":
        content = limits.unzstd(chunk.data, size)
    elif chunk.compression == "lz4":
        content = bytes(LZ4FrameDecompressor().decompress(chunk.data, size + 1))
    elif chunk.compression:
        raise ValueError(f"is compressed with {chunk.compression!r}, which is not known")
    if len(content) != size:
        raise ValueError("its content is not what was written")
    at = 0
    while at < size:
        kind, length = struct.unpack_from("<BQ", content, at)
        if kind not in (Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE):
            raise ValueError("a record in it is damaged")
        at += HEADER + length
    return bytes(content)


def _first_records(chunk: Chunk) -> list[McapRecord]:
    """The records of a chunk that is cut off, as far as they are there."""
    content = chunk.data if not chunk.compression else b""
    records: list[McapRecord] = []
    with suppress(*_DAMAGE):  # where it is cut off
        if chunk.compression == "zstd":
            content = limits.unzstd(chunk.data, limits.CHUNK, is_cut=True)
        records.extend(StreamReader(BytesIO(content), skip_magic=True).records)
    return records


def _block(index: ChunkIndex) -> Block:
    return Block(
        index.message_start_time, index.message_end_time, index.chunk_start_offset + HEADER, 0
    )
