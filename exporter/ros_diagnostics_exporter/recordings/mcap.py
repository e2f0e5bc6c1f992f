"""Writes MCAP (https://mcap.dev/spec) by Foxglove's library, of messages that wait compressed."""

from __future__ import annotations

import io
import struct
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

from ros_diagnostics_exporter import __version__, zstd
from ros_diagnostics_exporter.texts import encodable

# Kept: its memory is a large block, which is returned to the system once it is freed. To ask for
# one at each chunk takes ten times as long as to compress it.
_compressor = zstd.ZstdCompressor(level=3)
_message = struct.Struct("<QI")  # its time, and the length of what follows


class Channel(NamedTuple):
    """A topic of one type, whose ``definition`` is "" where it is not known any more."""

    topic: str
    kind: str
    definition: str


class Chunk(NamedTuple):
    """Messages in CDR, compressed; the times (ns) of the first and of the last.

    ``size`` is what they need decompressed.
    """

    begin: int
    end: int
    size: int
    data: bytes

    def messages(self) -> Iterator[tuple[int, bytes]]:
        """Time and content of each."""
        content, at = zstd.decompress(self.data), 0
        while at < len(content):
            time, size = _message.unpack_from(content, at)
            at += _message.size + size
            yield time, content[at - size : at]


class OpenChunk:
    """A chunk that is filled: as bytes, which take less memory than messages do."""

    __slots__ = ("begin", "content", "end")

    def __init__(self) -> None:
        self.begin = self.end = 0
        self.content = bytearray()

    def append(self, time: int, data: bytes) -> None:
        """Append a message in CDR; ``time`` is in ns."""
        self.begin = min(self.begin or time, time)
        self.end = max(self.end, time)
        self.content += _message.pack(time, len(data)) + data

    def compressed(self) -> Chunk:
        """What is in it."""
        data = _compressor.compress(self.content, zstd.ZstdCompressor.FLUSH_FRAME)
        return Chunk(self.begin, self.end, len(self.content), data)


class Attachment(NamedTuple):
    """A file within the file."""

    name: str
    media_type: str
    content: bytes


def write(
    recorded: Iterable[tuple[Channel, Iterable[Chunk]]],
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Iterable[Attachment],
    time: int,
) -> bytes:
    """One file, of what each topic has; ``time`` (ns) is when it is written."""
    from mcap.writer import Writer  # noqa: PLC0415 - with its compressors it takes 1 MB

    out = io.BytesIO()
    writer = Writer(out)
    writer.start("ros2", f"ros-diagnostics-exporter {__version__}")
    for channel, chunk in _in_order(writer, recorded):
        for at, data in chunk.messages():  # of a chunk at a time: decompressed they may be large
            writer.add_message(channel, at, data, at)
    for file in attachments:
        writer.add_attachment(time, time, file.name, file.media_type, file.content)
    for name, fields in metadata.items():
        writer.add_metadata(name, {key: encodable(text) for key, text in fields.items()})
    writer.finish()
    return out.getvalue()


def _in_order(
    writer: Any, recorded: Iterable[tuple[Channel, Iterable[Chunk]]]
) -> list[tuple[int, Chunk]]:
    """The chunks of all topics by their begin, with their channels, which are written."""
    schemas = {"": 0}  # by definition; 0 is MCAP's number of none
    listed: list[tuple[int, Chunk]] = []
    for (topic, kind, text), chunks in recorded:
        if text not in schemas:
            schemas[text] = writer.register_schema(kind, "ros2msg", text.encode())
        channel = writer.register_channel(encodable(topic), "cdr", schemas[text])
        listed += [(channel, chunk) for chunk in chunks]
    return sorted(listed, key=lambda each: each[1].begin)
