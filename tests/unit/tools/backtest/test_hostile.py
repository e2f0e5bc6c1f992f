"""Files that were made to take all memory, all disk or all day are read up to a limit."""

import sqlite3
import struct
import tracemalloc
import zipfile
from contextlib import closing
from types import SimpleNamespace

import pytest
from rosbags.rosbag1 import Writer

from ros_diagnostics_exporter import zstd
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_tools import limits
from ros_diagnostics_tools.backtest.formats import RecordingError
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from support.bags import every_second, write_bag, write_ros1

MEGABYTE = 2**20
LIMIT = 4 * MEGABYTE
ROWS = every_second(range(3), {"motor": []})


@pytest.fixture(autouse=True)
def lower_limits(monkeypatch):
    for name in ("TEXT", "MESSAGE", "CHUNK"):
        monkeypatch.setattr(limits, name, LIMIT)


def bomb(size):
    """Zeros, packed."""
    return zstd.compress(bytes(size))


def read(path):
    """Messages that can be decoded, reasons of the others, warnings; and the peak of memory."""
    tracemalloc.start()
    try:
        with closing(Recordings([RecordingSource(path)])) as recordings:
            good, bad = 0, []
            for each in recordings.messages():
                try:
                    each.decode()
                    good += 1
                except ValueError as error:  # noqa: PERF203
                    bad.append(str(error))
            return good, bad, recordings.warnings, tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()


def sqlite_bag(tmp_path, sql, *values):
    bag = write_bag(tmp_path / "bag", ROWS, "sqlite3")
    (file,) = bag.glob("*.db3")
    with closing(sqlite3.connect(file)) as connection:
        connection.executescript(sql) if not values else connection.execute(sql, values)
        connection.commit()
    return file


def test_a_message_in_a_bag_that_unpacks_to_gigabytes_is_undecodable(tmp_path):
    file = sqlite_bag(tmp_path, "UPDATE messages SET data = ? WHERE id = 2", bomb(64 * MEGABYTE))

    good, bad, _warnings, peak = read(file)

    assert (good, len(bad)) == (2, 1)
    assert peak < 4 * LIMIT


@pytest.mark.parametrize(
    "sql",
    [
        (
            "ALTER TABLE messages RENAME TO old; CREATE VIEW messages AS WITH RECURSIVE n(x) AS "
            "(VALUES (1) UNION ALL SELECT x + 1 FROM n) SELECT x AS id, 1 AS topic_id,"
            " x AS timestamp, x'00' AS data FROM n"
        ),
        (
            "ALTER TABLE messages DROP COLUMN data; "
            "ALTER TABLE messages ADD COLUMN data AS (zeroblob(1000000000))"
        ),
        "DROP TABLE topics",
    ],
    ids=["endless view", "computed column", "no topics"],
)
def test_a_bag_in_sqlite_that_computes_its_messages_is_none(tmp_path, sql):
    file = sqlite_bag(tmp_path, sql)

    with pytest.raises(RecordingError, match="it has no tables topics and messages"):
        read(file)


def chunk(content, size, compression=b"zstd"):
    begin = struct.pack("<QQQI", 1, 2, size, 0)
    body = begin + struct.pack("<I", len(compression)) + compression
    body += struct.pack("<Q", len(content)) + content
    return b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(body)) + body


@pytest.mark.parametrize(
    ("size", "why"),
    [
        (64 * MEGABYTE, "unpacks to more than 4 MB"),
        (MEGABYTE, "unpacks to more than 1 MB"),
        (2**64 - 1, "unpacks to more than 4 MB"),
    ],
)
def test_a_chunk_that_unpacks_to_more_than_it_says_is_damage(tmp_path, size, why):
    path = tmp_path / "bomb.mcap"
    path.write_bytes(chunk(bomb(64 * MEGABYTE), size))

    with pytest.raises(RecordingError, match=why):
        read(path)


def test_zeros_are_no_records(tmp_path):
    path = tmp_path / "zeros.mcap"
    path.write_bytes(chunk(bytes(LIMIT), LIMIT, b""))

    with pytest.raises(RecordingError, match="a record in it is damaged"):
        read(path)


def test_an_index_that_points_behind_the_end_is_damage(tmp_path):
    bag = write_bag(tmp_path / "bag", ROWS)
    (file,) = bag.glob("*.mcap")
    content = bytearray(file.read_bytes())
    (summary,) = struct.unpack_from("<Q", content, len(content) - 28)
    at = content.index(b"\x08", summary)  # the index of the chunk: begin, end, offset, length
    content[at + 9 + 16 : at + 9 + 32] = struct.pack("<QQ", 2**63, 2**63)
    file.write_bytes(content)

    good, _bad, (warning,), _peak = read(file)

    assert good == 0
    assert ": is damaged and read up to there: " in warning


@pytest.mark.parametrize("packing", [Writer.CompressionFormat.BZ2, Writer.CompressionFormat.LZ4])
def test_a_chunk_of_ros_1_that_unpacks_to_gigabytes_is_damage(tmp_path, packing):
    large = (Status(0, "motor", "x" * 64 * MEGABYTE),)
    file = write_ros1(tmp_path / "one.bag", [(0.0, "/diagnostics", large)], packing)

    good, _bad, (warning,), peak = read(file)

    assert good == 0
    assert "a chunk unpacks to more than 4 MB" in warning
    assert peak < 4 * LIMIT


@pytest.mark.parametrize("kind", ["zip", "zstd", "zip of two"])
def test_an_archive_that_unpacks_to_more_than_the_limit_is_an_error(tmp_path, monkeypatch, kind):
    monkeypatch.setattr(limits, "UNPACKED", LIMIT)
    if kind == "zstd":
        path = tmp_path / "bomb.mcap.zstd"
        path.write_bytes(bomb(64 * MEGABYTE))
    else:
        path = tmp_path / "bomb.zip"
        with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
            size = 64 * MEGABYTE if kind == "zip" else 3 * MEGABYTE
            for number in range(2):
                archive.writestr(f"{number}.mcap", bytes(size))

    with pytest.raises(RecordingError, match="unpacks to more than"):
        read(path)


def test_an_archive_never_fills_the_disk(tmp_path, monkeypatch):
    monkeypatch.setattr(limits.shutil, "disk_usage", lambda _path: SimpleNamespace(free=MEGABYTE))
    path = tmp_path / "large.mcap.zstd"
    path.write_bytes(zstd.compress(bytes(2 * MEGABYTE)))

    with pytest.raises(RecordingError, match="unpacks to more than 1 MB"):
        read(path)


@pytest.mark.parametrize("name", ["device.json", "large.json"])
def test_a_text_is_a_file_of_limited_size(tmp_path, name):
    path = tmp_path / name
    if name == "device.json":
        path.symlink_to("/dev/zero")
    else:
        path.write_bytes(b"[" + b" " * LIMIT)

    with pytest.raises(RecordingError, match=r"not a regular file|has more than 4 MB"):
        read(path)
