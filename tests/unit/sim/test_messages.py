"""The fields of a kind file as messages, which rclpy decodes; and what is no message."""

from pathlib import Path

import pytest
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import BatteryState, CameraInfo, JointState
from std_msgs.msg import Bool, Float64, String

from virtual_robots import commands
from virtual_robots.ros.contexts import RosError
from virtual_robots.ros.messages import MessageTypes
from virtual_robots.schema.documents import DocumentError
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.kinds import kind_path, known_kinds
from virtual_robots.simulation.robots import RobotSpec


@pytest.fixture
def types(tmp_path: Path) -> MessageTypes:
    folder = tmp_path / "msg" / "plant_msgs"
    folder.mkdir(parents=True)
    (folder / "Device.msg").write_text("uint8 OK=1\nstring name\nuint8[2] codes\nbool[] flags\n")
    (folder / "Status.msg").write_text("std_msgs/Header header\nDevice[] devices\nchar kind\n")
    return MessageTypes([tmp_path / "msg"])


@pytest.mark.parametrize(
    ("kind", "fields", "name", "value"),
    [
        (Bool, {"data": "1.0"}, "data", True),
        (Bool, {"data": False}, "data", False),
        (String, {"data": 7}, "data", "7"),
        (Float64, {"data": "{"}, "", "'{' is no number, as a float64 is"),
        (BatteryState, {"percentage": "0.5", "header": {"frame_id": "b"}}, "percentage", 0.5),
        (JointState, {"name": ("a", "b"), "effort": ("1", 2)}, "effort", [1, 2]),
        (JointState, {"name": "a"}, "", "'a' is no list, as an array needs"),
        (CameraInfo, {"k": (1,), "roi": {"height": "3"}}, "k", [1] + 8 * [0]),
        (Bool, {"value": 1}, "", "std_msgs/msg/Bool has the fields data, not value"),
        (BatteryState, {"header": 3}, "", "std_msgs/msg/Header has the fields stamp, frame_id"),
    ],
)
def test_what_is_encoded_is_what_rclpy_reads(types, kind, fields, name, value):
    full = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
    if not name:
        with pytest.raises(DocumentError, match=value):
            types.encode(full, fields)
        return
    message = deserialize_message(types.encode(full, fields), kind)
    found = getattr(message, name)
    assert (list(found) if isinstance(value, list) else found) == value
    assert types.publisher_type(full) is kind


def test_a_type_beside_the_kind_file_is_encoded_by_its_definition(types):
    devices = ({"name": "a", "codes": ("1", "2")}, {"flags": ("1", "0")})
    data = types.encode("plant_msgs/msg/Status", {"devices": devices, "kind": 5})
    header = bytes((0, 1, 0, 0, *8 * [0], 1, 0, 0, 0, 0, 0, 0, 0))
    first = bytes((2, 0, 0, 0, 2, 0, 0, 0, *b"a\0", 1, 2, 0, 0, 0, 0))
    second = bytes((1, 0, 0, 0, 0, 0, 0, 0, 2, 0, 0, 0, 1, 0))
    assert data == header + first + second + b"\5"
    assert types.publisher_type("plant_msgs/msg/Status").__class__.__name__ == "TypeStatus"


def test_what_cannot_be_read_says_where_and_what_to_do(types, tmp_path, monkeypatch):
    with pytest.raises(DocumentError, match=r"put its definition into msg/a/B.msg beside the kind"):
        types.encode("a/msg/B", {})
    (tmp_path / "msg/plant_msgs/Odd.msg").write_text("uint8 ?\n")
    with pytest.raises(DocumentError, match=r"plant_msgs/Odd.msg: cannot be read"):
        MessageTypes([tmp_path / "msg"]).encode("plant_msgs/msg/Odd", {})
    name = "virtual_robots.ros.borrowed.get_rmw_implementation_identifier"
    monkeypatch.setattr(name, lambda: "rmw_other")
    with pytest.raises(RosError, match="rmw_other needs it: install plant_msgs"):
        types.publisher_type("plant_msgs/msg/Device")


def types_of(path: Path) -> MessageTypes:
    return commands.types_of(Fleet([RobotSpec("r", path)]))


@pytest.mark.parametrize("kind", known_kinds())
def test_all_topics_of_the_kinds_that_come_along_can_be_encoded(kind, monkeypatch):
    monkeypatch.setattr(commands, "action_type", lambda _types: None)  # where none is installed
    types_of(kind_path(kind))


@pytest.mark.parametrize(
    ("kind", "fields", "what"),
    [
        (
            "std_msgs/msg/Bool",
            "{pressed: 1}",
            "C: std_msgs/msg/Bool has the fields data, not",
        ),
        ("std_msgs/msg/Boole", "{}", "C: nothing is known of the type"),
        ("std_msgs/msg/UInt8", "{data: '{v}'}", "C: 300 is beyond a uint8: 0 to 255"),
        ("std_msgs/msg/Int8", "{data: '{w}'}", "C: -500 is beyond a int8: -128 to 127"),
        ("std_msgs/msg/String", "{data: [1]}", "(1,) is no text, as a string is"),
        ("sensor_msgs/msg/JointState", "{name: [{if: w, below: 0, then: {}}]}", "{} is no text"),
    ],
)
def test_what_a_kind_cannot_publish_is_an_error_before_it_starts(tmp_path, kind, fields, what):
    path = tmp_path / "kind.yaml"
    path.write_text(
        f"""
components:
- name: C
  variables:
    v: {{walk: 0, start: 5, low: 0, high: 9}}
    w: {{walk: 0, start: 5, low: -500, high: 9}}
  publishes: {{topic: t, type: {kind}, fields: {fields}}}
  faults: {{leaves: {{drive: v, to: 300}}}}
"""
    )
    with pytest.raises(DocumentError) as caught:
        types_of(path)
    assert str(caught.value).startswith(f"{path}: C: ")
    assert what in str(caught.value)


def test_an_action_of_which_no_type_is_installed_is_an_error_before_it_starts(tmp_path):
    path = tmp_path / "kind.yaml"
    path.write_text("components: []\nactions: [{name: go, types: [gone_msgs/action/Go]}]\n")
    with pytest.raises(RosError, match="none of gone_msgs is installed"):
        types_of(path)
