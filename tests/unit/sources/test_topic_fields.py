"""Fields of messages become the statuses of components."""

import math

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState, JointState
from std_msgs.msg import Bool, Float64, String

from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.config.topics import TopicEntry
from ros_diagnostics_exporter.decode.messages import (
    MessageTypes,
    UndecodableError,
    UnknownTypeError,
)
from ros_diagnostics_exporter.model import Level, Status
from ros_diagnostics_exporter.sources.topic_entries import Reading, by_robot
from ros_diagnostics_exporter.sources.topic_fields import NoFieldError, status_of

TYPES = MessageTypes()


def status(message, **entry) -> Status:
    kind = type(message)
    name = f"{kind.__module__.split('.')[0]}/msg/{kind.__name__}"
    found = TYPES.find(name)
    made = validated(TopicEntry, {"topic": "t", "component": "C", **entry})
    return status_of(made, found.decode(serialize_message(message)), found.constants)


def test_fields_are_values_with_the_keys_that_fleet_yml_gives_them():
    battery = BatteryState(percentage=0.1, voltage=11.5, present=True)

    found = status(battery, fields={"percentage": "Charge", "voltage": "Voltage (V)"})

    assert found == Status(0, "C", "OK", "", (("Charge", "0.1"), ("Voltage (V)", "11.5")))


def test_a_number_that_the_robot_does_not_know_has_no_value_and_the_component_says_so():
    battery = BatteryState(percentage=0.5, temperature=math.nan, current=math.inf)
    fields = {"percentage": "Charge", "temperature": "Temperature", "current": "Current"}

    found = status(battery, fields=fields)

    assert found.values == (("Charge", "0.5"),)
    assert (found.level, found.message) == (Level.OK, "no value: Temperature, Current")


def test_what_was_made_of_messages_is_given_by_robot_without_what_has_no_status():
    arm, base = Status(0, "Arm"), Status(2, "Base")
    made = [Reading("r", "Arm", arm), Reading("r", "Odd", None, "why"), Reading("s", "Base", base)]
    assert by_robot([*made, Reading("r", "Base", base)]) == {"r": [arm, base], "s": [base]}


@pytest.mark.parametrize("word", ["1", "CHARGING", "power_supply_status_charging"])
def test_a_constant_is_known_by_number_and_by_both_its_names(word):
    battery = BatteryState(power_supply_status=1)

    found = status(battery, field="power_supply_status", levels={word: "WARN", "other": "OK"})

    assert (found.level, found.message) == (Level.WARN, "power_supply_status is CHARGING")
    assert found.values == (("power_supply_status", "CHARGING"),)


def test_a_value_without_a_level_is_an_error_unless_others_have_one():
    health = BatteryState(power_supply_health=3)
    levels = {"GOOD": "OK", "UNKNOWN": "OK"}

    assert status(health, field="power_supply_health", levels=levels).level == Level.ERROR
    levels["other"] = "WARN"
    assert status(health, field="power_supply_health", levels=levels).level == Level.WARN


@pytest.mark.parametrize(
    ("message", "error_when", "level"),
    [
        (Bool(data=True), True, Level.ERROR),
        (Bool(data=False), True, Level.OK),
        (String(data="Protective_Stop"), ["estop", "protective*"], Level.ERROR),
        (String(data="running"), ["estop", "protective*"], Level.OK),
        (Float64(data=3.0), 3, Level.ERROR),
        (Float64(data=math.nan), 3, Level.OK),
    ],
)
def test_error_when_names_the_values_that_are_errors(message, error_when, level):
    assert status(message, field="data", error_when=error_when).level == level


def test_elements_of_arrays_by_number_all_of_them_or_by_the_names_beside_them():
    joints = JointState(name=["shoulder", "elbow"], effort=[1.5, 2.5])

    assert status(joints, fields={"effort[1]": "Effort"}).values == (("Effort", "2.5"),)
    assert status(joints, fields={"effort[*]": "Effort"}).values == (
        ("Effort 0", "1.5"),
        ("Effort 1", "2.5"),
    )
    found = status(joints, fields={"effort[name]": "Effort (Nm)"})
    assert found.values == (("Effort shoulder (Nm)", "1.5"), ("Effort elbow (Nm)", "2.5"))
    assert status(joints, fields={"effort[7]": "Effort"}).message == "no value: Effort"


@pytest.mark.parametrize(
    ("path", "why"),
    [
        ("power", "sensor_msgs/BatteryState has no field power: it has header, voltage"),
        ("header", "header is a message: name a field of it, such as header.stamp"),
        ("cell_voltage", r"is an array: write cell_voltage\[0\], or cell_voltage\[\*\] for all"),
        ("voltage[0]", r"voltage is no array: remove \[0\]"),
        ("voltage.x", "float has no field x: it is no message"),
    ],
)
def test_a_field_that_is_not_there_is_named_with_the_way_out(path, why):
    with pytest.raises(NoFieldError, match=why):
        status(BatteryState(), field=path)


def test_what_is_no_message_of_the_type_is_undecodable():
    data = serialize_message(BatteryState(voltage=1.0))

    for cut in range(len(data) - 1):
        with pytest.raises(UndecodableError, match="is no sensor_msgs/msg/BatteryState"):
            TYPES.find("sensor_msgs/msg/BatteryState").decode(data[:cut])


def test_a_definition_beside_fleet_yml_precedes_an_installed_one(tmp_path):
    folder = tmp_path / "ur_msgs"
    folder.mkdir()
    (folder / "Mode.msg").write_text("uint8 RUNNING=7\nuint8 mode # the mode\nPart[] parts\n")

    with pytest.raises(UnknownTypeError, match=r"ur_msgs/msg/Part, which ur_msgs/msg/Mode uses"):
        MessageTypes(tmp_path).find("ur_msgs/msg/Mode")
    (folder / "Part.msg").write_text("string name\nfloat64 load\n")
    found = MessageTypes(tmp_path).find("ur_msgs/msg/Mode")

    assert found.constants["ur_msgs/Mode"] == {"RUNNING": "7"}
    message = found.decode(b"\0\1\0\0\7\0\0\0\0\0\0\0")
    entry = validated(TopicEntry, {"topic": "t", "component": "C", "field": "mode"})
    assert status_of(entry, message, found.constants).values == (("mode", "RUNNING"),)


def test_a_type_of_which_nothing_is_known_says_what_to_do():
    with pytest.raises(UnknownTypeError, match="mir_msgs/msg/State: install its package, or put"):
        TYPES.find("mir_msgs/msg/State")
    with pytest.raises(UnknownTypeError, match="is not the name of a type"):
        TYPES.find("../../etc/passwd")


def test_devices_in_arrays_of_arrays_are_told_apart_by_their_own_names(tmp_path):
    """As control_msgs/HardwareStatus has them: without a state a device has no value."""
    folder = tmp_path / "plant_msgs"
    folder.mkdir()
    (folder / "Status.msg").write_text("Device[] devices\n")
    (folder / "Device.msg").write_text("string device_id\nState[] states\n")
    constants = "uint8 HEALTH_OK=1\nuint8 HEALTH_ERROR=4\nuint8 MODE_AUTO=1\nuint8 MODE_JOG=4\n"
    fields = "uint8 health_status\nuint8 operational_mode\n"
    (folder / "State.msg").write_text(constants + fields)
    found = MessageTypes(tmp_path).find("plant_msgs/msg/Status")
    names = [b"left\0\0\0\0", b"lift\0\0\0\0", b"arm\0"]
    sizes, states = [5, 5, 4], [b"\1\0\0\0\1\4\0\0", b"\1\0\0\0\4\1\0\0", b"\0\0\0\0"]
    parts = zip(sizes, names, states, strict=True)
    data = b"".join(bytes((size, 0, 0, 0)) + name + state for size, name, state in parts)
    message = found.decode(b"\0\1\0\0\3\0\0\0" + data)
    health = "devices[device_id].states[0].health_status"
    mode = "devices[device_id].states[0].operational_mode"
    given = {"field": health, "levels": {"OK": "OK", "nan": "OK"}}
    fields = {"fields": {health: "Health", mode: "Mode"}}
    entry = validated(TopicEntry, {"topic": "t", "component": "C", **given, **fields})

    status = status_of(entry, message, found.constants)

    assert (status.level, status.message) == (
        Level.ERROR,
        "Health lift is ERROR; no value: Health arm, Mode arm",
    )
    assert dict(status.values) == {
        "Health left": "OK",
        "Mode left": "JOG",
        "Health lift": "ERROR",
        "Mode lift": "AUTO",
    }


@pytest.mark.parametrize(
    ("kind", "field", "value", "word"),
    [
        # As mir_msgs/RobotMode has them, and ur_dashboard_msgs/RobotMode.
        ("uint8 ROBOT_MODE_MISSION = 7", "uint8 robot_mode", 7, "MISSION"),
        ("int8 NO_CONTROLLER=-1\nint8 RUNNING=7", "int8 mode", 255, "NO_CONTROLLER"),
        ("uint8 A=1\nuint8 B=1", "uint8 mode", 1, "1"),  # which of both is not known
    ],
)
def test_a_mode_has_the_name_of_its_constant(tmp_path, kind, field, value, word):
    folder = tmp_path / "mode_msgs"
    folder.mkdir()
    (folder / "Mode.msg").write_text(f"{kind}\n{field}  # one of these\n")
    found = MessageTypes(tmp_path).find("mode_msgs/msg/Mode")
    name = field.split()[1]
    entry = validated(TopicEntry, {"topic": "t", "component": "C", "field": name})

    message = found.decode(bytes((0, 1, 0, 0, value)))
    assert status_of(entry, message, found.constants).values == ((name, word),)
