"""Recordings as text: rosbridge's envelopes, `ros2 topic echo`, and one message that is damaged."""

import base64
import json
import os
from contextlib import closing
from textwrap import indent

import pytest
import yaml

from ros_diagnostics_tools.backtest.formats import RecordingError
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from support import bags
from support.bags import BEGIN
from support.configs import load_text

FLEET = """
fleet: hall
profiles: {default: {stale_after: 10s, confirm_after: 8s}}
discovery: [{topic: "/{robot}/diagnostics", domain_ids: [0]}]
"""


def message(second, level, *, ros1=False, name="drive: Left"):
    at = int(BEGIN) + second
    stamp = {"secs": at, "nsecs": 0} if ros1 else {"sec": at, "nanosec": 0}
    status = {"level": level, "name": name, "message": "m", "hardware_id": "", "values": []}
    return {"header": {"stamp": stamp, "frame_id": ""}, "status": [status]}


def opened(path):
    return closing(Recordings([RecordingSource(path, namespace="/r1")]))


def levels(path, text):
    """Of such a recording the levels that can be decoded, why others cannot, and the warnings."""
    path.write_text(text)
    good, bad = [], []
    with opened(path) as recordings:
        for each in recordings.messages():
            try:
                good.append(each.decode().statuses[0].level)
            except ValueError as error:  # noqa: PERF203
                bad.append(str(error))
        return good, bad, recordings.warnings


def judged(path, text):
    """When faults were notified and ended, how many messages could not be decoded, and why."""
    path.write_text(text)
    result = bags.judged(load_text(path.parent, FLEET), path, namespace="/r1")
    faults = [(each.since - BEGIN, each.ended - BEGIN) for each in result.notifications]
    return faults, result.undecodable, result.reason


def test_what_a_rosbridge_client_stores_is_judged(tmp_path):
    lines = [
        {"op": "publish", "topic": "/diagnostics", "msg": message(at, level, ros1=True)}
        for at in range(120)
        for level in [2 if 30 <= at < 80 else 0]
    ]
    others = [
        {"op": "status", "level": "info", "msg": "connected"},
        {"op": "publish", "topic": "/fix", "msg": {"header": {}, "status": {"status": 0}, "x": 1}},
    ]
    text = "".join(f"{json.dumps(each)}\n" for each in (*others, *lines))

    assert judged(tmp_path / "diagnostics.jsonl", text) == ([(30, 80)], 0, "")


def test_a_level_that_ros_does_not_know_is_an_error_as_it_is_when_it_is_received(tmp_path):
    """An aggregator of a maker: what was not started yet has level 255."""
    levels_at = [255 if 30 <= at < 80 else 0 for at in range(120)]
    text = "\n".join(json.dumps(message(at, level)) for at, level in enumerate(levels_at))
    assert judged(tmp_path / "diagnostics.jsonl", text) == ([(30, 80)], 0, "")


@pytest.mark.timeout(60)
def test_a_clock_that_was_set_while_it_was_recorded_is_named_and_not_waited_for(tmp_path, run):
    path, config = tmp_path / "diagnostics.json", tmp_path / "fleet.yml"
    config.write_text(FLEET)
    of_1970 = [message(at - int(BEGIN), 0) for at in range(20)]
    path.write_text(json.dumps([*of_1970, *(message(at, 2) for at in range(20))]))

    command = ("backtest", "--config", str(config), "--namespace", "r1", "--output", "json")
    output = run(*command, str(path))

    assert "nothing was recorded for 2" in output.err
    found = json.loads(output.out)
    assert found["warnings"] == [output.err.strip().removeprefix("ros-diagnostics: ")]
    robot, drive = found["notifications"]
    assert (robot["scope"], robot["since"]) == ("robot", 19)  # the first day of that time counts
    assert (drive["component"], drive["since"]) == ("drive: Left", BEGIN)


@pytest.mark.parametrize(
    "written",
    [
        lambda level: level,
        str,
        lambda level: ("OK", "WARN", "ERROR", "STALE")[level],
        chr,
        lambda level: base64.b64encode(bytes([level])).decode(),
    ],
    ids=["number", "digit", "word", "character", "base64"],
)
def test_a_level_is_read_however_a_byte_is_written(tmp_path, written):
    text = json.dumps([message(each, written(each)) for each in range(4)])
    good, bad, _warnings = levels(tmp_path / "diagnostics.json", text)

    assert (good, bad) == ([0, 1, 2, 3], [])


def timed(text):
    """A message with this in place of its seconds."""
    return json.dumps(message(12, 0)).replace(str(int(BEGIN) + 12), text)


DAMAGED = {
    "no stamp": ({"header": {}, "status": []}, "header.stamp: Field required"),
    "half a stamp": (
        {"header": {"stamp": {"sec": 1}}, "status": []},
        "header.stamp.nanosec: Field required",
    ),
    "no time": (timed("1e400"), "inf is no time in Unix seconds"),
    "not a number": (timed("NaN"), "nan is no time in Unix seconds"),
    "long ago": (timed("-5"), "-5 is no time in Unix seconds"),
    "no level": (message(12, "broken"), "status.0.level: "),
    "no status": ({**message(12, 0), "status": [7]}, "status.0: Input should be"),
    "a number": ({**message(12, 0), "status": 7}, "status: Input should be a valid list"),
    "no header": ({"status": []}, "header: Field required"),
    "no JSON": ('{"header": {"stamp": ', "is not JSON: "),
}


@pytest.mark.parametrize("kind", DAMAGED)
@pytest.mark.parametrize("wrapped", [False, True], ids=["plain", "rosbridge"])
def test_one_damaged_message_is_counted_with_its_line_and_the_others_are_judged(
    tmp_path, kind, wrapped
):
    def line(content):
        if wrapped and not isinstance(content, str):
            content = {"op": "publish", "topic": "/diagnostics", "msg": content}
        return content if isinstance(content, str) else json.dumps(content)

    damaged, reason = DAMAGED[kind]
    lines = [line(message(each, 2 if 20 <= each < 50 else 0)) for each in range(60)]
    lines.insert(12, line(damaged))

    faults, undecodable, why = judged(tmp_path / "diagnostics.jsonl", "\n".join(lines))

    assert (faults, undecodable) == ([(20, 50)], 1)
    assert why.startswith("/r1/diagnostics: line 13")
    assert reason in why


def echo(levels_, cut_off=False):
    """As `ros2 topic echo` prints it: the level is a byte, and long lists end with a mark."""
    parts = [message(at, chr(level)) for at, level in enumerate(levels_)]
    if cut_off:
        parts[0]["status"].append("...")
    return "".join(
        f"{yaml.safe_dump(each, sort_keys=False, default_flow_style=False)}---\n" for each in parts
    )


@pytest.mark.parametrize("name", ["echo.yaml", "echo.yml", "report.txt", "echo"])
def test_the_output_of_ros2_topic_echo_is_judged(tmp_path, name):
    text = echo([2 if 20 <= at < 50 else 0 for at in range(60)])

    assert judged(tmp_path / name, text) == ([(20, 50)], 0, "")


def test_it_is_judged_as_a_block_of_code_too(tmp_path):
    text = indent(echo([2 if 20 <= at < 50 else 0 for at in range(60)]), "    ")

    assert judged(tmp_path / "issue.md", text) == ([(20, 50)], 0, "")


def test_what_rostopic_echo_of_ros_1_prints_is_read(tmp_path):
    path = tmp_path / "echo.yaml"
    path.write_text(
        "header: \n  seq: 1\n  stamp: \n    secs: 1790000000\n    nsecs:  500000000\n"
        "  frame_id: ''\nstatus: \n  - \n    level: 2\n    name: \"drive: Left\"\n"
        '    message: "m"\n    hardware_id: "1.50"\n    values: \n      - \n        key: "a"\n'
        '        value: "yes"\n---\n'
    )
    with opened(path) as recordings:
        (found,) = recordings.messages()

    (status,) = found.decode().statuses
    assert (found.at - BEGIN, status.level, status.hardware_id) == (0.5, 2, "1.50")
    assert status.values == (("a", "yes"),)


def test_a_damaged_document_of_yaml_is_counted_with_its_line(tmp_path):
    text = "$ ros2 topic echo /diagnostics\n" + echo([0, 2, 2])
    damaged = text.replace("name: 'drive: Left'", "name: drive: Left", 1)
    lost = "A message was lost!!!\n\ttotal count change:1\n\ttotal count: 1---\n"
    text = damaged + lost + echo([1]) + "header: [\n---\n" + echo([3])

    good, bad, _warnings = levels(tmp_path / "echo.yaml", text)
    first, second = sorted(bad)

    assert sorted(good) == [1, 2, 2, 3]
    assert first.startswith("line 2 is not YAML: ")
    assert second.startswith("line 54 is not YAML")


def test_lists_that_were_cut_off_are_a_warning(tmp_path):
    path = tmp_path / "echo.yaml"
    good, bad, (warning,) = levels(path, echo([1, 2], cut_off=True))

    assert (good, bad) == ([1, 2], [])
    assert warning == f"{path}: long lists are cut off: record with --full-length"


def test_an_alias_of_yaml_is_no_message(tmp_path):
    text = echo([1]) + "header: &a {b: c}\nstatus: [*a, *a]\n---\n" + echo([2])

    _good, bad, _warnings = levels(tmp_path / "echo.yaml", text)
    assert bad == ["line 13 has an alias of YAML, which no message has"]


def test_a_text_in_which_nothing_can_be_decoded_says_why(tmp_path):
    path = tmp_path / "diagnostics.jsonl"
    path.write_text('{"header": {}, "status": []}\n' * 3)

    with pytest.raises(RecordingError) as raised, opened(path):
        pass

    assert str(raised.value) == (
        f"{path}: is no recording of diagnostics: line 1: header.stamp: Field required"
    )


def test_a_pipe_is_no_recording(tmp_path):
    path = tmp_path / "pipe"
    os.mkfifo(path)

    with pytest.raises(RecordingError, match="is no recording"), opened(path):
        pass
