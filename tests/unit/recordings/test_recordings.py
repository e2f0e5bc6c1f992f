"""A recording has what was received around the begin of its fault, byte for byte, within limits."""

import io
import json
import os
import random
import resource
import sys
from contextlib import closing, contextmanager
from dataclasses import replace

import pytest
import yaml
from mcap.reader import make_reader
from rosbags.highlevel import AnyReader

from ros_diagnostics_exporter.config.fleet import Fleet, RecordingSettings
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import Instant, Stream, Topic
from ros_diagnostics_exporter.recordings import rings as rings_module
from ros_diagnostics_exporter.recordings.recordings import FaultRecordings, Kept, config_lines
from ros_diagnostics_exporter.recordings.rings import PER, RING, Rings
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from ros_diagnostics_tools.main import main
from support.called import called
from virtual_robots.model import Status
from virtual_robots.recording.cdr import encode_array

WALL = 1_790_000_000.0
FAULT = "0123456789ab"
TOPICS = Topic(0, "/r/diagnostics_agg"), Topic(0, "/r/diagnostics")
BEGAN = Event(
    WALL + 100, "fault_began", "r", "/Arm", "motor", scope="component", state="critical",
    severity="critical", message="motor: hot\nTemperature: 91", since=WALL + 90,
    details={"level": "ERROR", "message": "hot"},
)  # fmt: skip


def at(second):
    return Instant(float(second), WALL + second)


def message(second, size=200):
    return encode_array([Status(0, "motor", f"{second}" * (size // 5), "m", ())], WALL + second)


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: f\nrobots: [{name: r, site: a}, {name: s, site: b}]\n")
    return path


@pytest.fixture
def recordings(tmp_path, config):
    return FaultRecordings(tmp_path / "kept", config, lambda _robot: TOPICS)


def receive(rings, topic, seconds, size=200):
    """Receive a message each second; returns them."""
    sent = []
    for second in seconds:
        data = message(second, size)
        sent.append((round((WALL + second) * 1e9), topic.name, data))
        rings.receive(Stream(topic), data, at(second))
        rings.compress()
    return sent


def recording(recordings, event=BEGAN, second=110):
    """The recording of a fault that began at 100, written when all of it was received."""
    recordings.note(FAULT, event, at(100))
    recordings.turn(at(second))
    return recordings.read(FAULT, at(second))


def whole(recordings, event=BEGAN):
    """As `recording`, of a topic that is received once a second."""
    receive(recordings.rings, TOPICS[0], range(111))
    return recording(recordings, event)


def opened(content):
    """By the reader of Foxglove, with all checksums."""
    return make_reader(io.BytesIO(content), validate_crcs=True)


@pytest.mark.parametrize("size", [200, 4_000])
def test_its_messages_are_those_received_byte_for_byte(tmp_path, recordings, size):
    sent = [
        *receive(recordings.rings, TOPICS[0], range(111), size),
        *receive(recordings.rings, TOPICS[1], range(111), size),
    ]
    path = tmp_path / "a.mcap"
    path.write_bytes(recording(recordings))

    with AnyReader([path]) as reader:
        found = [(time, each.topic, bytes(data)) for each, time, data in reader.messages()]
        decoded = reader.deserialize(found[0][2], "diagnostic_msgs/msg/DiagnosticArray")
    assert decoded.status[0].name == "motor"
    for topic in TOPICS:
        ours = [each for each in found if each[1] == topic.name]
        theirs = [each for each in sent if each[1] == topic.name]
        assert ours == theirs[-len(ours) :]
        assert ours[0][0] <= (WALL + 40) * 1e9
    with closing(Recordings([RecordingSource(path)])) as read:
        assert len(list(read.messages())) == read.count == len(found)
        assert read.warnings == []


def test_it_is_what_foxglove_asks_for_and_names_its_robot_the_fault_and_what_judged_it(recordings):
    reader = opened(whole(recordings))
    assert reader.get_header().profile == "ros2"
    summary = reader.get_summary()
    (schema,) = summary.schemas.values()
    assert (schema.name, schema.encoding) == ("diagnostic_msgs/msg/DiagnosticArray", "ros2msg")
    (channel,) = summary.channels.values()
    assert (channel.topic, channel.message_encoding) == (TOPICS[0].name, "cdr")
    assert channel.schema_id == schema.id != 0
    found = [(each.name, each.metadata) for each in reader.iter_metadata()]
    assert found == [("foxglove", {"deviceName": "r"})]
    fault, fleet = reader.iter_attachments()
    assert (fault.name, fault.media_type) == ("fault.json", "application/json")
    described = json.loads(fault.data)
    assert described["fault"] == FAULT
    assert described["evidence"] == ["motor: hot", "Temperature: 91"]
    assert described["details"] == {"level": "ERROR", "message": "hot"}
    assert (fleet.name, fleet.media_type) == ("fleet.yml", "application/yaml")
    assert b"site: a" in fleet.data
    assert b"site: b" not in fleet.data
    counts = summary.statistics
    assert counts.message_count == len(list(reader.iter_messages())) > 60
    assert (counts.schema_count, counts.channel_count) == (1, 1)
    assert (counts.attachment_count, counts.metadata_count) == (2, 1)
    assert counts.chunk_count == len(summary.chunk_indexes)


def test_a_silent_robots_has_its_last_messages(recordings):
    receive(recordings.rings, TOPICS[0], range(10))
    content = recording(recordings, second=5_000)

    assert opened(content).get_summary().statistics.message_count == 10


def test_a_robot_that_was_never_received_has_none(recordings):
    with pytest.raises(LookupError, match="no recording of fault"):
        recording(recordings)
    for name in ("../../etc", "*", FAULT.upper()):
        with pytest.raises(LookupError):
            recordings.read(name, at(0))


def test_one_that_is_not_complete_says_when_it_is(recordings):
    receive(recordings.rings, TOPICS[0], range(100))
    recordings.note(FAULT, BEGAN, at(100))
    recordings.turn(at(103))

    with pytest.raises(LookupError, match="is complete in 7 s"):
        recordings.read(FAULT, at(103))


def last(content):
    """The second at which the last message of a recording was received."""
    return opened(content).get_summary().statistics.message_end_time / 1e9 - WALL


def test_what_was_received_up_to_the_begin_is_there_at_once(recordings):
    receive(recordings.rings, TOPICS[0], range(100))
    with pytest.raises(LookupError, match="as it lasts now"):
        recordings.read_so_far(FAULT, BEGAN.since, at(100))
    recordings.note(FAULT, BEGAN, at(100))
    recordings.turn(at(101))
    so_far = recordings.read_so_far(FAULT, BEGAN.since, at(101))

    receive(recordings.rings, TOPICS[0], range(101, 111))
    recordings.turn(at(105))
    assert recordings.read_so_far(FAULT, BEGAN.since, at(105)) == so_far
    recordings.turn(at(110))
    complete = recordings.read_so_far(FAULT, BEGAN.since, at(110))
    assert complete == recordings.read(FAULT, at(110))
    assert [last(each) for each in (so_far, complete)] == [99, 110]


def test_the_recording_of_an_earlier_begin_is_not_that_of_the_fault_that_lasts(recordings):
    whole(recordings)
    for since in (BEGAN.since + 1_000, None):
        with pytest.raises(LookupError, match="as it lasts now"):
            recordings.read_so_far(FAULT, since, at(1_200))


def test_before_and_after_are_those_of_the_config(tmp_path, config):
    settings = RecordingSettings(before=200.0, after=30.0)
    recordings = FaultRecordings(
        tmp_path / "kept", config, lambda _robot: TOPICS, settings=settings
    )
    receive(recordings.rings, TOPICS[0], range(1, 401), 4_000)
    recordings.note(FAULT, replace(BEGAN, time=WALL + 370, since=WALL + 365), at(370))
    recordings.turn(at(399))
    with pytest.raises(LookupError, match="is complete in 1 s"):
        recordings.read(FAULT, at(399))
    recordings.configure(Fleet("f"), at(399))  # of those that begin from now on
    recordings.turn(at(400))

    content = recordings.read(FAULT, at(400))
    assert 160 < opened(content).get_summary().statistics.message_start_time / 1e9 - WALL <= 170
    assert last(content) == 400
    fault, _fleet = opened(content).iter_attachments()
    described = json.loads(fault.data)
    assert (described["before"], described["after"]) == (200.0, 30.0)


def test_a_fault_has_the_recording_of_its_own_begin_also_after_a_restart(
    recordings, tmp_path, config
):
    receive(recordings.rings, TOPICS[0], range(111))
    assert not recordings.has(FAULT, BEGAN.since)
    recording(recordings)

    restarted = FaultRecordings(tmp_path / "kept", config, lambda _robot: TOPICS)
    restarted.turn(at(120))
    for each in (recordings, restarted):
        assert each.has(FAULT, BEGAN.since)
        assert not each.has(FAULT, BEGAN.time + 5)  # it has begun again: that is not complete yet
        assert not each.has("ba9876543210", BEGAN.since)


def test_of_a_fault_that_began_again_the_recording_of_its_last_begin_is_served(recordings):
    whole(recordings)
    receive(recordings.rings, TOPICS[0], range(111, 311))
    recordings.note(FAULT, replace(BEGAN, time=WALL + 300, since=WALL + 290), at(300))
    recordings.turn(at(310))

    assert last(recordings.read(FAULT, at(310))) == 310
    assert recordings.has(FAULT, WALL + 290)


def test_one_that_cannot_be_written_is_not_tried_again(recordings, tmp_path):
    receive(recordings.rings, TOPICS[0], range(111))
    (tmp_path / "kept").write_text("is no folder")
    with pytest.raises(FileExistsError):
        recording(recordings)
    recordings.turn(at(111))


@contextmanager
def full_disk(room):
    """The real error of real writes: no file may be larger than ``room`` bytes."""
    limit = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (room, limit[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limit)


def test_one_that_cannot_be_written_whole_leaves_nothing_and_hinders_no_other(recordings, tmp_path):
    """The first is of a robot with much, the second of one with little."""
    large, small = TOPICS
    recordings._topics = lambda robot: (large,) if robot == "r" else (small,)
    noise = random.Random(1)
    for second in range(60, 110):
        recordings.rings.receive(Stream(large), b"\0\1\0\0" + noise.randbytes(600), at(second))
    receive(recordings.rings, small, range(100, 102))
    for fault, robot in ((FAULT, "r"), ("ba9876543210", "s")):
        recordings.note(fault, replace(BEGAN, robot=robot), at(100))
    with full_disk(7_000), pytest.raises(OSError, match="File too large"):
        recordings.turn(at(110))

    assert [each.name[:12] for each in (tmp_path / "kept").iterdir()] == ["ba9876543210"]
    recordings.turn(at(111))


def test_what_a_killed_exporter_left_unfinished_is_removed(recordings, tmp_path):
    (tmp_path / "kept").mkdir()
    (tmp_path / "kept" / f"{FAULT}-1.part").write_bytes(b"half")
    recordings.turn(at(1))
    assert list((tmp_path / "kept").iterdir()) == []


def test_only_the_exporters_user_may_read_them(recordings, tmp_path):
    whole(recordings)
    assert (tmp_path / "kept").stat().st_mode & 0o777 == 0o700


def test_the_robots_name_has_only_what_foxglove_takes(recordings):
    content = whole(recordings, replace(BEGAN, robot="hall/ärm 1"))
    (found,) = opened(content).iter_metadata()
    assert found.metadata == {"deviceName": "hall__rm_1"}


def test_a_text_that_is_no_unicode_does_not_lose_it(recordings):
    content = whole(recordings, replace(BEGAN, message="motor: \udcff"))
    fault, _fleet = opened(content).iter_attachments()
    assert json.loads(fault.data)["evidence"] == ["motor: ?"]


def test_a_storm_keeps_the_first_and_worst(recordings, tmp_path):
    receive(recordings.rings, TOPICS[0], range(100))
    for number in range(1_000):
        severity = "critical" if number >= 500 else "warning"
        event = Event(WALL + 100, "fault_began", "r", severity=severity)
        recordings.note(f"{number:012x}", event, at(100))
    recordings.turn(at(110))

    kept = sorted(int(path.name[:12], 16) for path in (tmp_path / "kept").iterdir())
    assert kept == [*range(50), *range(500, 550)]
    assert recordings.skipped == 900
    recordings.note(FAULT, BEGAN, at(100 + 599))
    assert recordings.skipped == 901
    recordings.note(FAULT, BEGAN, at(100 + 601))
    assert recordings.skipped == 901


@pytest.mark.parametrize(
    ("limits", "left"), [(Kept(number=3), 3), (Kept(size=20_000), None), (Kept(age=-1e10), 0)]
)
def test_files_are_kept_by_number_size_and_age(tmp_path, config, limits, left):
    recordings = FaultRecordings(tmp_path / "kept", config, lambda _robot: TOPICS, limits)
    receive(recordings.rings, TOPICS[0], range(100))
    for number in range(10):
        recordings.note(f"{number:012x}", BEGAN, at(100))
    recordings.turn(at(110))

    found = list((tmp_path / "kept").iterdir())
    if left is None:
        assert 0 < sum(path.stat().st_size for path in found) <= limits.size
    else:
        assert len(found) == left


def test_the_oldest_file_is_removed_first(tmp_path, config):
    kept = tmp_path / "kept"
    recordings = FaultRecordings(kept, config, lambda _robot: TOPICS, Kept(number=1))
    whole(recordings)
    (first,) = kept.iterdir()
    os.utime(first, (WALL, WALL))
    recordings.note("ba9876543210", BEGAN, at(110))
    recordings.turn(at(120))

    assert [path.name[:12] for path in kept.iterdir()] == ["ba9876543210"]


def test_a_topic_has_no_more_memory_than_its_ring(recordings):
    rings = Rings()
    for second in range(1_000):
        random = "".join(f"{(second * 7919 + n) ** 5 % 1_000_003:x}" for n in range(800))
        data = encode_array([Status(0, "motor", random, "m", ())], WALL + second)
        rings.receive(Stream(TOPICS[0]), data, at(second))
        rings.compress()
        assert rings.size <= RING + 2 * rings_module.CHUNK


def test_what_is_received_within_ten_seconds_is_compressed_together(recordings):
    receive(recordings.rings, TOPICS[0], range(20))
    assert len(recordings.rings.get(Stream(TOPICS[0])).chunks(0, 1 << 63)) == 2


def test_what_compresses_well_has_a_limit_as_it_is_decompressed(recordings):
    """A megabyte of zeros ten times a second would take a long time to be written."""
    for second in range(50):  # below the quota of a stream, else nothing of it is kept
        recordings.rings.receive(Stream(TOPICS[0]), b"\0\1\0\0" + bytes(1 << 19), at(second))
        recordings.rings.compress()
    chunks = recordings.rings.get(Stream(TOPICS[0])).chunks(0, 1 << 63)
    kept = sum(chunk.size for chunk in chunks)
    assert rings_module.PLAIN - (1 << 21) < kept <= rings_module.PLAIN + (1 << 21)


def test_a_topic_of_which_more_is_kept_has_more_memory():
    rings, generator = Rings(), random.Random(1)
    rings.keep = 10 * PER
    for second in range(80):
        text = generator.randbytes(2_000).hex()
        data = encode_array([Status(0, "motor", text, "m", ())], WALL + second)
        rings.receive(Stream(TOPICS[0]), data, at(second))
        rings.compress()
    assert 2 * RING < rings.size <= 10 * RING


def test_what_nobody_compresses_is_dropped_and_counted(monkeypatch):
    monkeypatch.setattr(rings_module, "QUOTA", 1_000)
    rings = Rings()
    for second in range(20):
        rings.receive(Stream(TOPICS[0]), message(second), at(second))
    kept = sum(bool(data) for _stream, _time, data in rings._waiting)
    assert 0 < kept < 20
    assert rings.dropped + kept == 20
    assert rings.size <= 1_000


def test_a_topic_of_large_messages_drops_none_of_others():
    """Five arrays of 4 MB a second dropped all that waited, of all robots."""
    rings, large = Rings(), Topic(0, "/x/diagnostics")
    others = [Topic(0, f"/r{number}/diagnostics") for number in range(20)]
    for second in range(60):
        for _ in range(5):
            rings.receive(Stream(large), b"\0\1\0\0" + bytes(4_000_000), at(second))
        for topic in others:
            rings.receive(Stream(topic), message(second), at(second))
        rings.compress()
    assert rings.dropped == 300 == len(rings.get(Stream(large)).lost)
    for topic in others:
        chunks = rings.get(Stream(topic)).chunks(0, 1 << 62)
        assert sum(len(list(each.messages())) for each in chunks) == 60


def test_many_topics_are_limited_together():
    rings = Rings()
    for number in range(1_000):
        for _ in range(20):
            rings.receive(Stream(Topic(0, f"/r{number}")), b"\0\1\0\0" + bytes(10_000), at(0))
    assert rings.size <= 3 * rings_module.WAITING


def test_a_recording_says_what_it_lacks(recordings, monkeypatch):
    monkeypatch.setattr(rings_module, "QUOTA", 60)
    receive(recordings.rings, TOPICS[0], range(40, 50))  # from its begin on
    monkeypatch.undo()
    receive(recordings.rings, TOPICS[0], range(100, 111))
    fault, _fleet = opened(recording(recordings)).iter_attachments()
    assert json.loads(fault.data)["missing_messages"] == {TOPICS[0].name: 10}


def test_a_message_larger_than_the_ring_leaves_no_memory_and_is_missing():
    rings, noise = Rings(), random.Random(1)
    rings.receive(Stream(TOPICS[0]), b"\0\1\0\0" + noise.randbytes(900_000), at(1))
    rings.compress()
    assert rings.size < RING
    assert len(rings.get(Stream(TOPICS[0])).lost) == 1


def test_a_planted_link_is_not_written_through(tmp_path, recordings):
    other = tmp_path / "others"
    other.write_text("precious")
    folder = tmp_path / "kept"
    folder.mkdir()
    (folder / f"{FAULT}-{BEGAN.time:.0f}.part").symlink_to(other)
    whole(recordings)

    assert other.read_text() == "precious"
    [written] = folder.glob("*.mcap")
    assert not written.is_symlink()
    assert written.stat().st_mode & 0o777 == 0o600


def test_nothing_is_written_or_removed_in_a_folder_that_is_a_link(tmp_path, recordings):
    (tmp_path / "others").mkdir()
    old = tmp_path / "others" / "old.mcap"
    old.write_bytes(b"")
    os.utime(old, (0, 0))
    (tmp_path / "kept").symlink_to(tmp_path / "others")
    receive(recordings.rings, TOPICS[0], range(111))
    recordings.note(FAULT, BEGAN, at(100))
    with pytest.raises(OSError, match="is a link"):
        recordings.turn(at(110))
    assert list((tmp_path / "others").iterdir()) == [old]


def test_a_config_that_cannot_be_read_is_said(tmp_path):
    assert "cannot be read" in config_lines(tmp_path / "none.yml", "r")
    (tmp_path / "bad.yml").write_text("a: [")
    assert "cannot be read" in config_lines(tmp_path / "bad.yml", "r")
    (tmp_path / "odd.yml").write_text("fleet: f\nrobots_folder: [a]\n")
    assert "cannot be read" in config_lines(tmp_path / "odd.yml", "r")


def test_what_folders_say_of_the_robot_is_in_it(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: f\nrobots_folder: robots\nrobots: [{name: s, topic: /s/d}]\n")
    for name, text in {
        "robots/r.yml": "{name: r, topic: /r/diagnostics, labels: {mode: on}}",
        "robots/more.yml": "[{name: t, topic: /t/diagnostics}]",
        "robots/.r.yml.swp": "{name: r, topic: /wrong}",
        "maintenance.d/night.yml": "{name: night, from: '2026-01-01 10:00', for: 1h}",
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text)
    lines = config_lines(path, "r")
    assert yaml.safe_load(lines) == {
        "fleet": "f",
        "robots": [{"name": "r", "topic": "/r/diagnostics", "labels": {"mode": "on"}}],
        "maintenance": [{"name": "night", "from": "2026-01-01 10:00", "for": "1h"}],
    }


FLEET = "fleet: f\nrobots: [{name: r, topic: /r/diagnostics, source: raw}]\n"


@pytest.fixture
def recorded(tmp_path, config, recordings, capsys):
    """A function (arguments): (exit code, result, standard error) of judging a recording."""
    config.write_text(FLEET)
    for second in range(111):
        level = 2 if second >= 90 else 0
        data = encode_array([Status(level, "motor", "m", "m", ())], WALL + second)
        recordings.rings.receive(Stream(TOPICS[1]), data, at(second))
    path = tmp_path / "recording.mcap"
    path.write_bytes(recording(recordings))

    def judge(*arguments):
        code = main(["backtest", "--output", "json", *arguments, str(path)])
        captured = capsys.readouterr()
        return code, json.loads(captured.out), captured.err

    return judge


def test_it_replays_by_what_is_attached(recorded):
    code, found, err = recorded()

    assert (code, err) == (0, "")
    (fault,) = found["notifications"]
    assert (fault["since"] - WALL, fault["notified"] - WALL) == (90, 100)
    assert fault["component"] == "motor"


def test_another_config_is_judged_and_says_when_it_is_too_short(recorded, tmp_path):
    other = tmp_path / "other.yml"
    other.write_text(FLEET + "profiles: {default: {confirm_after: 15s}}\n")
    code, found, err = recorded("--config", str(other))
    assert (code, err) == (0, "")
    assert [each["notified"] - WALL for each in found["notifications"]] == [105]

    other.write_text(FLEET + "profiles: {default: {confirm_after: 2m}}\n")
    code, found, err = recorded("--config", str(other))
    assert (code, found["notifications"]) == (0, [])
    assert "too short to know: the recording shows 20s of the trouble" in err
    assert "confirmed after 2m" in err
    assert found["warnings"] == [err.strip().removeprefix("ros-diagnostics: ")]


COMPRESSED = """
import os, resource
from ros_diagnostics_exporter.recordings.mcap import OpenChunk
from ros_diagnostics_exporter.recordings.rings import CHUNK
from ros_diagnostics_exporter.sources.ros_environment import free_large_blocks_at_once

free_large_blocks_at_once()
chunk = OpenChunk()
chunk.append(1, os.urandom(CHUNK))
chunk.compressed()
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(100):
    chunk.compressed()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def test_the_memory_of_the_compression_is_not_asked_for_again_at_each_chunk():
    argv = [sys.executable, "-c", COMPRESSED]
    assert int(called(argv).stdout) < 1_000  # pages
