"""Fields of thirty types are decoded as rclpy decodes them, whatever is in the messages."""

from __future__ import annotations

import importlib
import math
import string
from contextlib import suppress
from typing import Any

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rclpy.serialization import deserialize_message, serialize_message
from rosidl_parser import definition as idl

from ros_diagnostics_exporter.decode.messages import (
    MessageTypes,
    UndecodableError,
    UnknownTypeError,
)

NAMES = [
    "actionlib_msgs/GoalStatusArray",
    "action_msgs/GoalStatusArray",
    "builtin_interfaces/Duration",
    "diagnostic_msgs/DiagnosticArray",
    "diagnostic_msgs/KeyValue",
    "geometry_msgs/AccelWithCovarianceStamped",
    "geometry_msgs/PolygonStamped",
    "geometry_msgs/PoseWithCovarianceStamped",
    "geometry_msgs/TwistStamped",
    "geometry_msgs/WrenchStamped",
    "lifecycle_msgs/TransitionEvent",
    "nav_msgs/MapMetaData",
    "nav_msgs/Odometry",
    "nav_msgs/Path",
    "rcl_interfaces/Log",
    "rcl_interfaces/ParameterEvent",
    "sensor_msgs/BatteryState",
    "sensor_msgs/CameraInfo",
    "sensor_msgs/FluidPressure",
    "sensor_msgs/Imu",
    "sensor_msgs/JointState",
    "sensor_msgs/Joy",
    "sensor_msgs/MultiDOFJointState",
    "sensor_msgs/NavSatFix",
    "sensor_msgs/Range",
    "sensor_msgs/Temperature",
    "std_msgs/Bool",
    "std_msgs/ByteMultiArray",
    "std_msgs/ColorRGBA",
    "std_msgs/Empty",
    "std_msgs/Float32",
    "std_msgs/Int64MultiArray",
    "std_msgs/String",
    "std_msgs/UInt8",
    "stereo_msgs/DisparityImage",
    "trajectory_msgs/JointTrajectory",
    "visualization_msgs/Marker",
]
TYPES = MessageTypes()
NUMBERS = {
    "float": st.floats(width=32, allow_nan=True),
    "double": st.floats(allow_nan=True),
    "boolean": st.booleans(),
    "octet": st.binary(min_size=1, max_size=1),
    **{
        f"int{bits}": st.integers(-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        for bits in (8, 16, 32, 64)
    },
    **{f"uint{bits}": st.integers(0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
TEXTS = st.text(string.printable.replace("\0", "") + "äß漢", max_size=20)


def python_type(name: str) -> Any:
    package, _, kind = name.partition("/")
    return getattr(importlib.import_module(f"{package}.msg"), kind)


def values(kind: Any) -> st.SearchStrategy[Any]:
    """What a field of this type of IDL may have."""
    if isinstance(kind, idl.Array):
        return st.lists(values(kind.value_type), min_size=kind.size, max_size=kind.size)
    if isinstance(kind, idl.AbstractSequence):
        return st.lists(values(kind.value_type), max_size=3)
    if isinstance(kind, idl.NamespacedType):
        return messages(python_type("/".join((kind.namespaces[0], kind.name))))
    return NUMBERS[kind.typename] if isinstance(kind, idl.BasicType) else TEXTS


def messages(kind: Any) -> st.SearchStrategy[Any]:
    names = kind.get_fields_and_field_types()
    fields = dict(zip(names, map(values, kind.SLOT_TYPES), strict=True))
    return st.fixed_dictionaries(fields).map(lambda given: kind(**given))


def is_same(mine: Any, theirs: Any) -> bool:
    """Whether a decoded value is rclpy's."""
    if hasattr(theirs, "get_fields_and_field_types"):
        names = theirs.get_fields_and_field_types()
        return all(is_same(getattr(mine, name), getattr(theirs, name)) for name in names)
    theirs = theirs.item() if getattr(theirs, "ndim", None) == 0 else theirs  # of numpy
    if isinstance(theirs, bytes) and not isinstance(mine, bytes):
        theirs = theirs[0]  # rclpy has an octet as bytes
    if isinstance(theirs, float):
        return mine == theirs or (math.isnan(mine) and math.isnan(theirs))
    if isinstance(theirs, str | bool | int | bytes):
        return bool(mine == theirs)
    return len(mine) == len(theirs) and all(map(is_same, mine, theirs))


@pytest.mark.parametrize("name", NAMES)
def test_a_message_is_decoded_as_rclpy_does(name):
    kind = python_type(name)
    found = TYPES.find(name.replace("/", "/msg/"))

    @settings(max_examples=30, deadline=None, suppress_health_check=list(HealthCheck))
    @given(messages(kind))
    def check(message: Any) -> None:
        data = serialize_message(message)
        assert is_same(found.decode(data), deserialize_message(data, kind))

    check()


@settings(max_examples=500, deadline=1000)
@given(st.sampled_from(NAMES), st.binary(max_size=300), st.sampled_from((b"\0\0", b"\0\1")))
def test_whatever_bytes_come_they_are_a_message_or_undecodable(name, data, order):
    with suppress(UndecodableError):
        TYPES.find(name.replace("/", "/msg/")).decode(order + data)


def test_a_type_has_its_constants_and_the_hash_that_its_publishers_have():
    found = TYPES.find("sensor_msgs/msg/BatteryState")
    assert found.constants["sensor_msgs/BatteryState"]["POWER_SUPPLY_STATUS_FULL"] == "4"
    using = TYPES.find("actionlib_msgs/msg/GoalStatusArray")
    assert using.constants["actionlib_msgs/GoalStatus"]["ACTIVE"] == "1"
    string = "RIHS01_df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18"
    assert TYPES.find("std_msgs/msg/String").hash == string


@pytest.mark.parametrize(
    ("text", "missing"),
    [(None, "Own: install"), ("odd_msgs/Odd odd", "Odd, which odd_msgs/msg/Own uses: install")],
)
def test_of_a_type_that_is_not_known_it_is_said_which_definition_is_missing(
    tmp_path, text, missing
):
    (tmp_path / "odd_msgs").mkdir()
    if text is not None:
        (tmp_path / "odd_msgs/Own.msg").write_text(text)
    with pytest.raises(UnknownTypeError, match=f"of the type odd_msgs/msg/{missing}"):
        MessageTypes(tmp_path).find("odd_msgs/msg/Own")
