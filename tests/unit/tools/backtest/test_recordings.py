"""A recording that cannot be read is an error that names the file and the way out."""

import json
import random
import shutil
import sqlite3
import struct
import zipfile
from contextlib import closing

import pytest
from mcap.writer import CompressionType, Writer

from ros_diagnostics_exporter import zstd
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_tools.backtest import fault_recording, ros1
from ros_diagnostics_tools.backtest.formats import TYPE, RecordingError
from ros_diagnostics_tools.backtest.mcap import McapFile
from ros_diagnostics_tools.backtest.recordings import Period, Recordings, RecordingSource
from support.bags import BEGIN, TOPIC, every_second, ros1_array, write_bag, write_ros1
from testbed.configuration import CHECKOUT
from virtual_robots.model import Status as EncodedStatus
from virtual_robots.recording.bags import STATUS
from virtual_robots.recording.cdr import encode_array


def opened(*paths):
    return Recordings(RecordingSource(path) for path in paths)


def error(*paths):
    with pytest.raises(RecordingError) as raised, closing(opened(*paths)) as recordings:
        list(recordings.messages())
    return str(raised.value)


def test_a_missing_file_is_named(tmp_path):
    assert error(tmp_path / "no") == f"{tmp_path / 'no'}: there is no such file or folder"
    other = tmp_path / "notes.txt"
    other.write_text("-")
    assert error(other).startswith(f"{other}: is no recording, and has none: .mcap, .db3, .bag")


@pytest.mark.parametrize(
    ("content", "what"),
    [
        ("{", "is not JSON"),
        ("[]", "is no recording of diagnostics"),
        ('{"t0_unix": 1, "topic": "/d"}', "line 1: messages: Field required"),
        (
            '{"t0_unix": 1, "topic": "/d", "messages": [{"t": 1, "status": [{}]}]}',
            "header: Field required",
        ),
        ('{"t0_unix": 1, "topic": "/d", "messages": []}', "holds no diagnostic_msgs"),
    ],
)
def test_a_wrong_json_file_is_named_with_what_is_wrong(tmp_path, content, what):
    path = tmp_path / "recording.json"
    path.write_text(content)

    assert error(path).startswith(f"{path}: ")
    assert what in error(path)


def test_a_bag_without_diagnostics_says_what_to_record(tmp_path):
    bag = write_bag(tmp_path / "bag", every_second(range(3), {"motor": []}), topic_type=STATUS)

    assert error(bag) == (
        f"{bag}: holds no diagnostic_msgs/msg/DiagnosticArray; record /diagnostics_agg; "
        f"it has 1 topics: {TOPIC} ({STATUS})"
    )


ROWS = every_second(range(2000), {"motor": [*range(40, 90), 1999]})


def read(path):
    """(seconds of the messages, statuses of the first, warnings) of a recording."""
    with closing(opened(path)) as recordings:
        messages = list(recordings.messages())
        decoded = messages[0].decode().statuses if messages else ()
        return [round(each.at - BEGIN) for each in messages], decoded, recordings.warnings


def damaged(file, place, content):
    """Overwrite a part of a file, or with None cut it off there."""
    data = bytearray(file.read_bytes())
    at = round(len(data) * place)
    data[at:] = b"" if content is None else content + data[at + len(content) :]
    file.write_bytes(data)
    return file


@pytest.mark.parametrize("content", [None, b"\xff" * 4096])
def test_a_damaged_mcap_is_read_up_to_the_damage(tmp_path, content):
    long = (Status(0, "motor", "x" * 1000),)  # so that it has several chunks
    bag = write_bag(tmp_path / "bag", ((float(each), TOPIC, long) for each in range(3000)))
    (file,) = bag.glob("*.mcap")
    seconds, _statuses, (warning,) = read(damaged(file, 0.7, content))

    assert seconds == list(range(len(seconds)))
    assert (2090 if content is None else 900) < len(seconds) < 2110
    assert warning.startswith(f"{file}: is damaged and read up to there: ")
    assert warning.endswith("; `mcap recover bag.mcap` writes what is whole of it")


def write_mcap(path, compression, *, chunked):
    """Thirty messages in several chunks, or in none, and an attachment."""
    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1500, compression=compression, use_chunking=chunked)
        writer.start("ros2")
        schema = writer.register_schema(TYPE, "ros2msg", b"")
        channel = writer.register_channel(TOPIC, "cdr", schema)
        writer.add_attachment(1, 1, "fault.json", "application/json", b"{}")
        for second in range(30):
            at = round((BEGIN + second) * 1e9)
            writer.add_message(channel, at, encode_array([MOTOR], BEGIN + second), at)
        writer.finish()


MOTOR = EncodedStatus(0, "motor", "x" * 100, "", ())


@pytest.mark.parametrize("chunked", [True, False])
@pytest.mark.parametrize("compression", CompressionType)
def test_an_mcap_of_any_compression_is_read_and_bytes_that_are_changed_stop_nothing(
    tmp_path, compression, chunked
):
    path = tmp_path / "a.mcap"
    write_mcap(path, compression, chunked=chunked)
    assert read(path)[0] == list(range(30))
    whole, chance = path.read_bytes(), random.Random(1)
    for _ in range(100):
        content = bytearray(whole)
        for _ in range(chance.randint(1, 4)):
            place = chance.randrange(8, len(content))
            content[place] = chance.choice((0, 255, chance.randrange(256)))
        if chance.random() < 0.3:
            del content[chance.randrange(8, len(content)) :]
        path.write_bytes(content)
        with closing(McapFile(path)) as file:
            assert len(list(file.messages())) <= 31
        assert fault_recording.read(path) is None


def test_of_the_chunk_that_is_cut_off_the_first_messages_are_read(tmp_path):
    path = tmp_path / "a.mcap"
    write_mcap(path, CompressionType.NONE, chunked=True)
    whole, numbers = path.read_bytes(), set()
    for length in range(len(whole) // 4, len(whole) // 2, 31):
        path.write_bytes(whole[:length])
        numbers.add(len(read(path)[0]))
    assert numbers == set(range(min(numbers), max(numbers) + 1))


def test_a_recording_that_an_earlier_exporter_wrote_is_read():
    path = CHECKOUT / "tests/data/recording-0.2.mcap"
    with closing(opened(path)) as recordings:
        assert [each.at - 1.79e9 for each in recordings.messages()] == list(range(95, 110))
        assert recordings.warnings == []
    found = fault_recording.read(path)
    assert (found.fault["fault"], b"name: r" in found.config) == ("0123456789ab", True)


def test_an_mcap_that_was_not_closed_is_read_whole(tmp_path):
    bag = write_bag(tmp_path / "bag", ROWS)
    (file,) = bag.glob("*.mcap")
    with file.open("rb") as content:
        content.seek(-37, 2)
        (summary,) = struct.unpack_from("<Q", content.read(), 9)
    file.write_bytes(file.read_bytes()[:summary])

    seconds, _statuses, (warning,) = read(file)

    assert seconds == list(range(2000))
    assert "ends without a footer" in warning


def test_a_damaged_db3_is_read_up_to_the_damage(tmp_path):
    bag = write_bag(tmp_path / "bag", ROWS, "sqlite3")
    (file,) = bag.glob("*.db3")
    assert "`sqlite3 cut.db3 .recover` may find more" in error(
        damaged(shutil.copy(file, tmp_path / "cut.db3"), 0.6, None)
    )
    seconds, _statuses, (warning,) = read(damaged(file, 0.6, b"\xff" * 9000))

    assert seconds == list(range(len(seconds)))
    assert 0 < len(seconds) < 2000
    assert "`sqlite3 bag.db3 .recover` may find more" in warning


def test_a_bag_of_ros_1_gives_what_one_of_ros_2_does(tmp_path):
    values = (("Temperature (C)", "41"), ("Ünit", ""))
    rows = [(0.0, "diagnostics", (Status(2, "motor", "hot", "m-1", values),))]

    _seconds, statuses, warnings = read(write_ros1(tmp_path / "one.bag", rows))

    assert statuses == rows[0][2]
    assert warnings == []
    with closing(opened(tmp_path / "one.bag")) as recordings:
        assert {each.name for each in recordings.topics} == {"/diagnostics"}


def test_a_damaged_bag_of_ros_1_names_the_way_out(tmp_path):
    file = write_ros1(tmp_path / "one.bag", ROWS[:20])

    assert "`rosbag reindex one.bag`" in error(damaged(file, 0.5, None))


@pytest.mark.parametrize("length", range(62))
def test_a_cut_message_of_ros_1_is_undecodable(length):
    whole = ros1_array((Status(2, "motor", "hot", "m-1", (("a", "b"),)),))

    assert len(whole) == 62
    with pytest.raises(ValueError, match="is no DiagnosticArray of ROS 1"):
        ros1.decode(whole[:length])


def test_split_bags_zips_and_compressed_files_are_read_without_metadata(tmp_path):
    split = tmp_path / "split"
    split.mkdir()
    for number, storage in enumerate(("sqlite3", "mcap")):
        rows = every_second(range(number * 30, number * 30 + 30), {"motor": []})
        (file,) = write_bag(tmp_path / f"part{number}", rows, storage).glob("part*")
        file.rename(split / file.name)
    with zipfile.ZipFile(tmp_path / "all.zip", "w") as archive:
        for file in split.iterdir():
            archive.write(file, f"bag/{file.name}")
    packed = tmp_path / "part0.db3.zstd"
    packed.write_bytes(zstd.compress((split / "part0.db3").read_bytes()))

    assert read(split)[0] == list(range(60))
    assert read(tmp_path / "all.zip")[0] == list(range(60))
    assert read(packed)[0] == list(range(30))
    with closing(opened(split)) as recordings:
        assert len(recordings.periods) == 1


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_topic_of_another_encoding_is_named_and_the_rest_is_read(tmp_path, storage):
    rows = [*every_second(range(9), {"a": []}), *every_second(range(9), {"b": []}, topic="/o")]
    (file,) = write_bag(tmp_path / "bag", sorted(rows), storage).glob("bag*")
    if storage == "sqlite3":
        with closing(sqlite3.connect(file)) as connection, connection:
            connection.execute("UPDATE topics SET serialization_format = 'xml' WHERE name = '/o'")
    else:
        channel = b"\x02\0\0\0/o\x03\0\0\0"
        file.write_bytes(file.read_bytes().replace(channel + b"cdr", channel + b"xml"))

    seconds, _statuses, warnings = read(file)

    assert (seconds, warnings) == (list(range(9)), [f"{file}: /o is encoded as xml, not read"])


STATUS_2 = {"name": "motor", "message": "hot", "hardware_id": "m", "values": []}


@pytest.mark.parametrize("level", [2, "\x02"])
@pytest.mark.parametrize("separator", ["\n", "\n---\n", ""])
def test_messages_as_ros_prints_them_are_read(tmp_path, level, separator):
    path = tmp_path / "echo.json"
    stamps = {"sec": int(BEGIN), "nanosec": 0}, {"secs": int(BEGIN) + 1, "nsecs": 0}
    messages = [
        {"header": {"stamp": stamp, "frame_id": ""}, "status": [{**STATUS_2, "level": level}]}
        for stamp in stamps
    ]
    path.write_text(separator.join(map(json.dumps, messages)))

    seconds, statuses, warnings = read(path)

    assert (seconds, warnings) == ([0, 1], [])
    assert statuses == (Status(2, "motor", "hot", "m", ()),)
    path.write_text(json.dumps(messages[0]) + json.dumps(messages[1])[:-3])
    seconds, _statuses, (warning,) = read(path)
    assert seconds == [0]
    assert warning.startswith(f"{path}: is damaged after 1 messages: ")


def test_results_of_its_second_version_have_levels_in_words(tmp_path):
    path = tmp_path / "result.json"
    info = {"TotalPassed": 3, "Level": "WARN"}
    frame = {"validator: collision": {"Result": {"Total": "Fail"}, "Info": info}}
    entry = {"Stamp": {"System": 1.0, "ROS": BEGIN + 3}, "Frame": frame}
    odd = {"Stamp": {"ROS": BEGIN + 4}, "Frame": {"x": {"Info": {"Level": "odd"}}}}
    path.write_text(json.dumps([entry, odd]))

    seconds, statuses, _warnings = read(path)

    assert seconds == [3]
    assert statuses == (Status(1, "validator: collision", "", "", (("TotalPassed", "3"),)),)


def test_results_of_driving_log_replayer_are_read(tmp_path):
    path = tmp_path / "result.json"
    info = {"Name": "front", "Level": 2, "GroundBlockageRatio": "0.4"}
    frame = {
        "Ego": {"x": 1.0},
        "Visibility": [{"Result": "Success", "Info": [{"Level": 0, "Visibility": "0.9"}]}],
        "Blockage": [{"Result": "Fail", "Info": [info]}],
    }
    entries = [
        {"Condition": {"Blockage": {}}},
        {"Result": {}, "Stamp": {"System": 1.0}, "Frame": {}},
        {"Result": {}, "Stamp": {"System": 1.0, "ROS": BEGIN + 3}, "Frame": frame},
    ]
    path.write_text(json.dumps(entries))

    seconds, statuses, _warnings = read(path)

    assert seconds == [3]
    assert statuses == (
        Status(0, "Visibility", "", "", (("Visibility", "0.9"),)),
        Status(2, "Blockage: front", "", "", (("GroundBlockageRatio", "0.4"),)),
    )


def test_several_are_merged_by_time_and_their_pauses_are_known(tmp_path):
    first = write_bag(tmp_path / "1", every_second([0, 2, 4], {"motor": []}))
    second = write_bag(tmp_path / "2", every_second([1, 3, 5], {"motor": []}))
    third = write_bag(tmp_path / "3", every_second([60, 61], {"motor": []}))
    with closing(opened(third, second, first)) as recordings:
        times = [round(message.at - BEGIN) for message in recordings.messages()]

        assert times == [0, 1, 2, 3, 4, 5, 60, 61]
        assert recordings.count == 8
        periods = [Period(round(b - BEGIN), round(e - BEGIN)) for b, e in recordings.periods]
        assert periods == [(0, 5), (60, 61)]


def test_a_recording_within_another_does_not_end_its_period(tmp_path):
    bags = [
        write_bag(tmp_path / f"bag_{begin}", every_second(range(begin, end), {"motor": []}))
        for begin, end in ((0, 100), (10, 20))
    ]
    with closing(opened(*bags)) as recordings:
        assert recordings.periods == [Period(BEGIN, BEGIN + 99)]


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_messages_that_were_written_late_are_read_in_order_of_time(tmp_path, storage):
    bag = write_bag(tmp_path / "bag", every_second([0, 2, 1, 4, 3], {"motor": []}), storage)
    seconds, _statuses, warnings = read(bag)
    assert (seconds, warnings) == ([0, 1, 2, 3, 4], [])


def test_files_of_one_name_in_an_archive_are_all_read(tmp_path):
    archive = tmp_path / "bags.zip"
    with zipfile.ZipFile(archive, "w") as out:
        for begin in (0, 10):
            bag = write_bag(tmp_path / str(begin), every_second([begin], {"motor": []}))
            (file,) = bag.glob("*.mcap")
            out.write(file, f"{begin}/bag.mcap")
    assert read(archive)[0] == [0, 10]


@pytest.mark.parametrize("names", [("sec", "nanosec"), ("secs", "nsecs")])
def test_the_stamp_of_a_printed_message_has_its_fraction(tmp_path, names):
    stamp = dict(zip(names, (int(BEGIN), 250_000_000), strict=True))
    path = tmp_path / "echo.json"
    path.write_text(json.dumps({"header": {"stamp": stamp, "frame_id": ""}, "status": []}))
    with closing(opened(path)) as recordings:
        assert [each.at - BEGIN for each in recordings.messages()] == [0.25]


def test_a_message_of_ros_1_with_more_behind_it_is_undecodable():
    whole = ros1_array([Status(2, "motor", "hot")])
    with pytest.raises(ValueError, match="is no DiagnosticArray of ROS 1"):
        ros1.decode(whole + b"\0")
