"""Writes MCAP (https://mcap.dev/spec): chunks, metadata and attachments with their index.

With the types of what capsules have, as `ros2 bag record` writes them: a type, then what it uses.
"""

from __future__ import annotations

import struct
from binascii import crc32
from collections.abc import Iterable, Mapping, Sequence
from typing import NamedTuple

from ros_diagnostics_exporter import __version__, zstd
from ros_diagnostics_exporter.sources.graph_messages import (
    BATTERY_TYPE,
    LOG_TYPE,
    PARAMETERS_TYPE,
    TRANSITION_TYPE,
)

RULE = "=" * 80
_TIME = f"""{RULE}
MSG: builtin_interfaces/Time
int32 sec
uint32 nanosec
"""
_STAMPED = f"""{RULE}
MSG: std_msgs/Header
builtin_interfaces/Time stamp
string frame_id
{_TIME}"""
SCHEMAS = {
    "diagnostic_msgs/msg/DiagnosticArray": f"""std_msgs/Header header
DiagnosticStatus[] status
{_STAMPED}{RULE}
MSG: diagnostic_msgs/DiagnosticStatus
byte OK=0
byte WARN=1
byte ERROR=2
byte STALE=3
byte level
string name
string message
string hardware_id
KeyValue[] values
{RULE}
MSG: diagnostic_msgs/KeyValue
string key
string value
""",
    LOG_TYPE: f"""uint8 DEBUG=10
uint8 INFO=20
uint8 WARN=30
uint8 ERROR=40
uint8 FATAL=50
builtin_interfaces/Time stamp
uint8 level
string name
string msg
string file
string function
uint32 line
{_TIME}""",
    PARAMETERS_TYPE: f"""builtin_interfaces/Time stamp
string node
Parameter[] new_parameters
Parameter[] changed_parameters
Parameter[] deleted_parameters
{_TIME}{RULE}
MSG: rcl_interfaces/Parameter
string name
ParameterValue value
{RULE}
MSG: rcl_interfaces/ParameterValue
uint8 type
bool bool_value
int64 integer_value
float64 double_value
string string_value
byte[] byte_array_value
bool[] bool_array_value
int64[] integer_array_value
float64[] double_array_value
string[] string_array_value
""",
    TRANSITION_TYPE: f"""uint64 timestamp
Transition transition
State start_state
State goal_state
{RULE}
MSG: lifecycle_msgs/Transition
uint8 id
string label
{RULE}
MSG: lifecycle_msgs/State
uint8 id
string label
""",
    BATTERY_TYPE: f"""uint8 POWER_SUPPLY_STATUS_UNKNOWN=0
uint8 POWER_SUPPLY_STATUS_CHARGING=1
uint8 POWER_SUPPLY_STATUS_DISCHARGING=2
uint8 POWER_SUPPLY_STATUS_NOT_CHARGING=3
uint8 POWER_SUPPLY_STATUS_FULL=4
uint8 POWER_SUPPLY_HEALTH_UNKNOWN=0
uint8 POWER_SUPPLY_HEALTH_GOOD=1
uint8 POWER_SUPPLY_HEALTH_OVERHEAT=2
uint8 POWER_SUPPLY_HEALTH_DEAD=3
uint8 POWER_SUPPLY_HEALTH_OVERVOLTAGE=4
uint8 POWER_SUPPLY_HEALTH_UNSPEC_FAILURE=5
uint8 POWER_SUPPLY_HEALTH_COLD=6
uint8 POWER_SUPPLY_HEALTH_WATCHDOG_TIMER_EXPIRE=7
uint8 POWER_SUPPLY_HEALTH_SAFETY_TIMER_EXPIRE=8
uint8 POWER_SUPPLY_TECHNOLOGY_UNKNOWN=0
uint8 POWER_SUPPLY_TECHNOLOGY_NIMH=1
uint8 POWER_SUPPLY_TECHNOLOGY_LION=2
uint8 POWER_SUPPLY_TECHNOLOGY_LIPO=3
uint8 POWER_SUPPLY_TECHNOLOGY_LIFE=4
uint8 POWER_SUPPLY_TECHNOLOGY_NICD=5
uint8 POWER_SUPPLY_TECHNOLOGY_LIMN=6
uint8 POWER_SUPPLY_TECHNOLOGY_TERNARY=7
uint8 POWER_SUPPLY_TECHNOLOGY_VRLA=8
std_msgs/Header header
float32 voltage
float32 temperature
float32 current
float32 charge
float32 capacity
float32 design_capacity
float32 percentage
uint8 power_supply_status
uint8 power_supply_health
uint8 power_supply_technology
bool present
float32[] cell_voltage
float32[] cell_temperature
string location
string serial_number
{_STAMPED}""",
}


MAGIC = b"\x89MCAP0\r\n"
LEVEL = 3  # of the compression
_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK, _MESSAGE_INDEX, _CHUNK_INDEX = range(1, 9)
_ATTACHMENT, _ATTACHMENT_INDEX, _STATISTICS, _METADATA, _METADATA_INDEX = range(9, 14)
_DATA_END = 15
_message = struct.Struct("<BQHIQQ")
_pair = struct.Struct("<QQ")


class Channel(NamedTuple):
    """A topic of one type."""

    topic: str
    kind: str


class Chunk(NamedTuple):
    """Messages of one channel, compressed.

    ``begin`` and ``end`` are the times (ns) of the first and the last, ``entries`` the time and the
    offset of each.
    """

    channel: int
    begin: int
    end: int
    entries: bytes
    size: int
    checksum: int
    data: bytes


class OpenChunk:
    """A chunk that is filled: as bytes, which take less memory than messages do."""

    __slots__ = ("begin", "channel", "content", "end", "index")

    def __init__(self, channel: int) -> None:
        self.channel = channel
        self.begin = self.end = 0
        self.content = bytearray()
        self.index = bytearray()

    def append(self, time: int, data: bytes) -> None:
        """Append a message in CDR; ``time`` is in ns."""
        self.begin = min(self.begin or time, time)
        self.end = max(self.end, time)
        self.index += _pair.pack(time, len(self.content))
        self.content += _message.pack(_MESSAGE, 22 + len(data), self.channel, 0, time, time)
        self.content += data

    def compressed(self) -> Chunk:
        """What is in it."""
        checksum, data = crc32(self.content), zstd.compress(self.content, LEVEL)
        times, size = (self.begin, self.end), len(self.content)
        return Chunk(self.channel, *times, bytes(self.index), size, checksum, data)


class Attachment(NamedTuple):
    """A file within the file."""

    name: str
    media_type: str
    content: bytes


class _Writer:
    """A file in memory, and what its index says."""

    def __init__(self) -> None:
        self.parts: list[bytes] = [MAGIC]
        self.size = len(MAGIC)
        self.summary: list[bytes] = []

    def add(self, record: bytes) -> tuple[int, int]:
        """Append a record; returns where it begins, and its length."""
        self.parts.append(record)
        self.size += len(record)
        return self.size - len(record), len(record)


def write(
    channels: Mapping[int, Channel],
    chunks: Iterable[Chunk],
    metadata: Mapping[str, Mapping[str, str]],
    attachments: Iterable[Attachment],
    time: int,
) -> bytes:
    """One file; ``channels`` are by number, ``time`` (ns) is when it is written."""
    out = _Writer()
    out.add(_record(_HEADER, _text("ros2"), _text(f"ros-diagnostics-exporter {__version__}")))
    kinds = list(dict.fromkeys(each.kind for each in channels.values()))
    described = [_schema(number, kind) for number, kind in enumerate(kinds, 1)]
    for number, (topic, kind) in channels.items():
        described.append(_channel(number, topic, 1 + kinds.index(kind)))
    for record in described:
        out.add(record)
    listed = sorted(chunks, key=lambda each: each.begin)
    for each in listed:
        _add_chunk(out, each)
    files = list(attachments)
    for file in files:
        _add_attachment(out, file, time)
    for name, fields in metadata.items():
        place = out.add(_record(_METADATA, _text(name), _map(fields)))
        out.summary.append(_record(_METADATA_INDEX, _pair.pack(*place), _text(name)))
    out.add(_record(_DATA_END, struct.pack("<I", 0)))
    start = out.size
    statistics = _statistics(channels, listed, len(kinds), len(files), len(metadata))
    for record in (*described, statistics, *out.summary):
        out.add(record)
    out.add(_record(_FOOTER, struct.pack("<QQI", start, 0, 0)))
    return b"".join((*out.parts, MAGIC))


def _schema(number: int, kind: str) -> bytes:
    fields = _text(kind), _text("ros2msg"), _text(SCHEMAS[kind])
    return _record(_SCHEMA, struct.pack("<H", number), *fields)


def _channel(number: int, topic: str, schema: int) -> bytes:
    ids = struct.pack("<HH", number, schema)
    return _record(_CHANNEL, ids, _text(topic), _text("cdr"), _map({}))


def _add_chunk(out: _Writer, chunk: Chunk) -> None:
    times = _pair.pack(chunk.begin, chunk.end)
    body = (struct.pack("<QI", chunk.size, chunk.checksum), _text("zstd"))
    place = out.add(_record(_CHUNK, times, *body, struct.pack("<Q", len(chunk.data)), chunk.data))
    fields = struct.pack("<HI", chunk.channel, len(chunk.entries)), chunk.entries
    at, length = out.add(_record(_MESSAGE_INDEX, *fields))
    offsets = struct.pack("<IHQ", 10, chunk.channel, at)
    sizes = _pair.pack(len(chunk.data), chunk.size)
    rest = offsets, struct.pack("<Q", length), _text("zstd"), sizes
    out.summary.append(_record(_CHUNK_INDEX, times, _pair.pack(*place), *rest))


def _add_attachment(out: _Writer, file: Attachment, time: int) -> None:
    names = _text(file.name), _text(file.media_type)
    times, size = _pair.pack(time, time), struct.pack("<Q", len(file.content))
    body = b"".join((times, *names, size, file.content))
    place = out.add(_record(_ATTACHMENT, body, struct.pack("<I", crc32(body))))
    index = _pair.pack(*place), times, size, *names
    out.summary.append(_record(_ATTACHMENT_INDEX, *index))


def _statistics(
    channels: Iterable[int], chunks: Sequence[Chunk], schemas: int, attachments: int, metadata: int
) -> bytes:
    counts = dict.fromkeys(channels, 0)
    for each in chunks:
        counts[each.channel] += len(each.entries) // _pair.size
    begin, end = min(each.begin for each in chunks), max(each.end for each in chunks)
    numbers = sum(counts.values()), schemas, len(counts), attachments, metadata, len(chunks)
    fields = struct.pack("<QHIIII", *numbers), _pair.pack(begin, end)
    pairs = b"".join(struct.pack("<HQ", *each) for each in counts.items())
    return _record(_STATISTICS, *fields, struct.pack("<I", len(pairs)), pairs)


def _record(kind: int, *fields: bytes) -> bytes:
    content = b"".join(fields)
    return struct.pack("<BQ", kind, len(content)) + content


def _text(text: str) -> bytes:
    raw = text.encode(errors="replace")
    return struct.pack("<I", len(raw)) + raw


def _map(fields: Mapping[str, str]) -> bytes:
    content = b"".join(_text(key) + _text(value) for key, value in fields.items())
    return struct.pack("<I", len(content)) + content
