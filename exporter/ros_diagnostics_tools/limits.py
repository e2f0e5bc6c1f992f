"""How much is read of a file that somebody else made: none takes all memory, all disk or all day.

A few kilobytes can be written so that they unpack to gigabytes.
"""

from __future__ import annotations

import shutil
import sqlite3
from pathlib import Path
from typing import Protocol

from ros_diagnostics_exporter import zstd
from ros_diagnostics_exporter.files import read_regular

TEXT = 256 * 2**20  # bytes of a file that is read whole
MESSAGE = 64 * 2**20  # bytes of a message that was compressed by itself
CHUNK = 256 * 2**20  # bytes of a part of a recording, unpacked
UNPACKED = 4 * 2**30  # bytes of an archive, unpacked
_PIECE = 2**20
_HELD = (
    "SELECT m.name, c.name FROM sqlite_master m, pragma_table_info(m.name) c"
    " WHERE m.type = 'table' AND m.rootpage > 0"
)


class Source(Protocol):
    """What bytes are read from."""

    def read(self, size: int, /) -> bytes:
        """The next bytes."""


class LimitError(ValueError):
    """There is more of it than is read."""


def size(count: int) -> str:
    """A limit for people."""
    return f"{count >> 30} GB" if count >> 30 else f"{count >> 20} MB"


def read(path: Path, most: int) -> bytes:
    """All of a regular file.

    Raises:
        OSError: it cannot be read, or is a device or a FIFO.
        LimitError: it is larger.
    """
    content = read_regular(path, most + 1)
    if len(content) > most:
        raise LimitError(f"has more than {size(most)}")
    return content


def check(count: int, most: int) -> None:
    """Raise LimitError where something unpacks to more bytes than are read."""
    if count > most:
        raise LimitError(f"unpacks to more than {size(most)}")


def unpack(source: Source, target: Path, most: int) -> None:
    """Write what ``source`` yields to a file.

    Raises:
        LimitError: it is more than ``most``, or than the disk has room for.
    """
    most = min(most, shutil.disk_usage(target.parent).free)
    count = 0
    with target.open("wb") as out:
        while piece := source.read(_PIECE):
            count += len(piece)
            check(count, most)
            out.write(piece)


def held_columns(connection: sqlite3.Connection) -> set[tuple[str, str]]:
    """Tables and columns whose rows are in the file: a view could have any number of them.

    Columns that are computed are not in `table_info`; views and virtual tables have no pages.
    """
    return set(connection.execute(_HELD))


def unzstd(data: bytes, most: int, *, is_cut: bool = False) -> bytes:
    """Zstandard's frames, unpacked; of data that ``is_cut`` off what is there.

    Raises:
        ZstdError: they are damaged.
        LimitError: they unpack to more than ``most`` bytes.
    """
    parts: list[bytes] = []
    count = 0
    while data:
        frame = zstd.ZstdDecompressor()
        parts.append(frame.decompress(data, max_length=most + 1 - count))
        count += len(parts[-1])
        check(count, most)
        if not frame.eof and not is_cut:
            raise zstd.ZstdError("is cut off")
        data = frame.unused_data if frame.eof else b""
    return b"".join(parts)
