"""Recordings made for tests: a robot's arrays at given seconds, in a bag or as JSON."""

import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from rosbags import rosbag2
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_typestore

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from ros_diagnostics_tools.backtest.replay import Replay, Result, play
from virtual_robots.model import Status as SentStatus
from virtual_robots.recording.bags import ARRAY, BagWriter, Recorded
from virtual_robots.recording.cdr import encode_array

BEGIN = 1_790_000_000.0  # Unix time of second 0
TOPIC = "/r/diagnostics"
Row = tuple[float, str, tuple[Status, ...]]  # second, topic, statuses


def fleet(**profile: object) -> Fleet:
    """One robot "r" that publishes raw diagnostics."""
    robot = Robot("r", topic_raw=TOPIC, source=Source.RAW, profile=Profile(**profile))
    return Fleet("f", (robot,))


def every_second(
    seconds: Iterable[int], levels: dict[str, Iterable[int]], *, topic: str = TOPIC
) -> list[Row]:
    """An array each second, in which the components have ERROR in the seconds of ``levels``."""
    bad = {name: frozenset(where) for name, where in levels.items()}
    return [
        (
            float(second),
            topic,
            tuple(Status(2 if second in where else 0, name, "m") for name, where in bad.items()),
        )
        for second in seconds
    ]


def write_bag(path: Path, rows: Iterable[Row], storage: str = "mcap", topic_type: str = ARRAY):
    """A rosbag2 folder of these arrays."""
    writer = BagWriter(path, storage)
    for second, topic, statuses in rows:
        data = encode_array([SentStatus(*each) for each in statuses], BEGIN + second)
        writer.write(Recorded(round((BEGIN + second) * 1e9), topic, topic_type, data))
    writer.close()
    return path


def write_messages(
    folder: Path, rows: Iterable[tuple[float, str, str, Any]], storage: StoragePlugin, types: Any
) -> Path:
    """A bag of ROS 2 of (second, topic, type, message), the messages as rosbags has them."""
    with rosbag2.Writer(folder, version=9, storage_plugin=storage) as writer:
        connections: dict[str, Connection] = {}
        for second, topic, kind, message in rows:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            data = types.serialize_cdr(message, kind)
            writer.write(connections[topic], round((BEGIN + second) * 1e9), data)
    return folder


def write_json(path: Path, rows: Iterable[Row]) -> Path:
    """A recording of one topic in the JSON form."""
    listed = list(rows)
    messages = [
        {
            "t": second,
            "header": {"stamp": {"sec": int(BEGIN + second), "nanosec": 0}, "frame_id": ""},
            "status": [
                {
                    "level": each.level,
                    "name": each.name,
                    "message": each.message,
                    "hardware_id": each.hardware_id,
                    "values": [{"key": key, "value": value} for key, value in each.values],
                }
                for each in statuses
            ],
        }
        for second, _topic, statuses in listed
    ]
    path.write_text(json.dumps({"topic": listed[0][1], "t0_unix": BEGIN, "messages": messages}))
    return path


def judged(config: Fleet, *paths: Path, **source: object) -> Result:
    """What a configuration makes of recordings."""
    recordings = Recordings(RecordingSource(path, **source) for path in paths)
    replay = Replay(config, recordings)
    for _message in play(recordings, [replay]):
        pass
    recordings.close()
    return replay.result()


def texts(result: Result) -> list[str]:
    """Each notification in one line, its times in seconds of the recording."""
    return [
        f"{each.since - BEGIN:g} {each.began.time - BEGIN:g} "
        + ("lasts" if each.ended is None else f"{each.ended - BEGIN:g}")
        + f" {each.began.component or each.began.robot} {each.began.state}"
        for each in result.notifications
    ]


def write_ros1(
    path: Path, rows: Iterable[Row], packing: Writer.CompressionFormat | None = None
) -> Path:
    """A .bag of ROS 1 of these arrays."""
    types = get_typestore(Stores.ROS1_NOETIC)
    writer = Writer(path)
    if packing is not None:
        writer.set_compression(packing)
    with writer:
        connections: dict[str, Connection] = {}
        for second, topic, statuses in rows:
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, ARRAY, typestore=types)
            at = round((BEGIN + second) * 1e9)
            writer.write(connections[topic], at, ros1_array(statuses))
    return path


def ros1_array(statuses: Iterable[Status]) -> bytes:
    """A DiagnosticArray as ROS 1 serializes it, by the library's own serializer."""
    types = get_typestore(Stores.ROS1_NOETIC)
    kind = {name.rpartition("/")[2]: each for name, each in types.types.items()}
    time = types.types["builtin_interfaces/msg/Time"]
    header = kind["Header"](seq=7, stamp=time(sec=int(BEGIN), nanosec=5), frame_id="base")
    found = [
        kind["DiagnosticStatus"](
            level=each.level,
            name=each.name,
            message=each.message,
            hardware_id=each.hardware_id,
            values=[kind["KeyValue"](key=key, value=value) for key, value in each.values],
        )
        for each in statuses
    ]
    return bytes(types.serialize_ros1(kind["DiagnosticArray"](header=header, status=found), ARRAY))
