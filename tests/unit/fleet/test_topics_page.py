"""The examples of docs/robots-without-diagnostics.md, played with messages of those types."""

import re
from pathlib import Path

import numpy as np
import pytest
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from support.configs import load_text
from support.shipped_rules import ROOT
from support.state_driver import ERROR, OK, WARN, StateDriver

PAGE = (ROOT / "docs/robots-without-diagnostics.md").read_text("utf-8")
FIRST, ARM, CREATE = re.findall("^```yaml\n(fleet:.*?)^```", PAGE, re.DOTALL | re.MULTILINE)
UR = "ur_dashboard_msgs/msg/SafetyMode"
BATTERY, JOINTS = "sensor_msgs/msg/BatteryState", "sensor_msgs/msg/JointState"
DEFINITIONS = {
    UR: "uint8 NORMAL=1\nuint8 PROTECTIVE_STOP=3\nuint8 mode\n",
    "irobot_create_msgs/msg/DockStatus": (
        "std_msgs/Header header\nbool dock_visible\nbool is_docked\n"
    ),
    "irobot_create_msgs/msg/HazardDetection": (
        "uint8 BUMP=1\nuint8 WHEEL_DROP=4\nstd_msgs/Header header\nuint8 type\n"
    ),
    "irobot_create_msgs/msg/HazardDetectionVector": (
        "std_msgs/Header header\nHazardDetection[] detections\n"
    ),
}
STORE = get_typestore(Stores.ROS2_JAZZY)
for _name, _text in DEFINITIONS.items():
    STORE.register(get_types_from_msg(_text, _name))
TYPES = STORE.types
HEADER = TYPES["std_msgs/msg/Header"](TYPES["builtin_interfaces/msg/Time"](1, 2), "")


class Robot(StateDriver):
    """The only robot of an example; definitions that are not installed are beside fleet.yml."""

    def __init__(self, folder: Path, text: str) -> None:
        for name, definition in DEFINITIONS.items():
            file = folder / name.replace("/msg/", "/")
            file = (folder / "msg").joinpath(*file.relative_to(folder).parts).with_suffix(".msg")
            file.parent.mkdir(parents=True, exist_ok=True)
            file.write_text(definition)
        super().__init__(fleet=load_text(folder, text))
        (self.settings,) = self.state.fleet.robots
        self.types: dict[str, list[str]] = {}  # of what is published, now or seldom

    def go_on(self, seconds: int, **sent: tuple[str, object]):
        """Look at the graph, and send these messages by the names of topics, once a second."""
        namespace = self.settings.namespace
        messages = {f"{namespace}/{name.replace('__', '/')}": each for name, each in sent.items()}
        for _ in self.seconds(seconds):
            self.state.update_nodes(0, [("driver", namespace)], self.now)
            self.types |= {name: [kind] for name, (kind, _message) in messages.items()}
            wanted = self.state.watched_topics(0, self.types, self.now)
            for name in wanted.keys() & messages.keys():
                data = bytes(STORE.serialize_cdr(messages[name][1], wanted[name]))
                self.state.receive_fields(0, name, wanted[name], data, self.now)
        return self

    def found(self) -> dict[str, tuple[int, str]]:
        """Level and message of each component."""
        robot = self.state.robots[self.settings.name]
        return {each.name: (each.level, each.message) for each in robot.components}

    def faults(self) -> dict[str, str]:
        return {each.identity.component: each.evidence for each in self.state.faults()}


def battery(percentage: float, health: int = 1) -> tuple[str, object]:
    none = np.zeros(0, np.float32)
    numbers = (24.5, 20.0, 1.0, 1.0, 1.0, 1.0, percentage)
    return BATTERY, TYPES[BATTERY](HEADER, *numbers, 2, health, 0, True, none, none, "", "")


def std(kind: str, value: object) -> tuple[str, object]:
    name = f"std_msgs/msg/{kind}"
    return name, TYPES[name](value)


@pytest.mark.parametrize("mode", ["auto", "manual"])
def test_the_battery_of_the_mobile_robot(tmp_path, mode):
    robot = Robot(tmp_path, FIRST).go_on(15, battery_state=battery(0.1), mode=std("String", mode))

    assert robot.found() == {
        "Battery": (OK, "Health is GOOD"),
        "Mode": (OK if mode == "auto" else WARN, f"data is {mode}"),
    }
    assert robot.faults()["Battery"].startswith("10 %, below the threshold of 15 %")
    robot.go_on(15, battery_state=battery(0.8, 2), mode=std("String", mode))
    assert robot.found()["Battery"] == (ERROR, "Health is OVERHEAT")


def test_the_arm_in_a_protective_stop(tmp_path):
    robot = Robot(tmp_path, ARM)
    safety = "io_and_status_controller__safety_mode"
    efforts = np.array([150.0, 2.0])
    joints = JOINTS, TYPES[JOINTS](HEADER, ["pan", "lift"], np.zeros(0), np.zeros(0), efforts)
    robot.go_on(1, **{safety: (UR, TYPES[UR](1))}, e_stop=std("Bool", False))
    robot.go_on(120, e_stop=std("Bool", False), joint_states=joints)
    assert robot.found()["Safety"] == (OK, "mode is NORMAL")
    assert robot.faults() == {"Joints": "150 Nm, above the threshold of 120 Nm;\nOK"}
    robot.go_on(1, **{safety: (UR, TYPES[UR](3))}, e_stop=std("Bool", True))
    robot.go_on(15, e_stop=std("Bool", True))
    assert robot.found()["Safety"] == (ERROR, "mode is PROTECTIVE_STOP")
    assert {"Safety", "E-stop"} <= robot.faults().keys()


def test_the_create_3_on_and_off_its_dock(tmp_path):
    robot = Robot(tmp_path, CREATE)
    vector, hazard, dock = (
        f"irobot_create_msgs/msg/{each}"
        for each in ("HazardDetectionVector", "HazardDetection", "DockStatus")
    )

    def go_on(*types: int, docked: bool) -> None:
        detections = [TYPES[hazard](HEADER, each) for each in types]
        robot.go_on(
            15,
            dock_status=(dock, TYPES[dock](HEADER, True, docked)),
            hazard_detection=(vector, TYPES[vector](HEADER, detections)),
            battery_state=battery(0.1),
        )

    go_on(docked=True)
    assert robot.found()["Hazards"] == (OK, "no Hazard")
    assert robot.faults() == {}
    go_on(1, 4, docked=False)
    assert robot.found()["Hazards"] == (ERROR, "Hazard 1 is WHEEL_DROP")
    assert robot.faults().keys() == {"Hazards", "Battery"}
    go_on(1, docked=True)
    assert robot.faults() == {}
