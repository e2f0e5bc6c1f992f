"""What nodes log, and say of their life cycle, parameters and a battery, over real DDS."""

import re
import sys
from collections import Counter
from dataclasses import replace
from pathlib import Path

from rosbags.highlevel import AnyReader

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.graph import Graph, Watched
from ros_diagnostics_exporter.config.topics import TopicEntry
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.recordings.recordings import FaultRecordings
from support.ros_publisher import repeating
from testbed.polling import until

ALL = Watched(
    logs=True,
    log_faults=(re.compile(".*overrun.*"),),
    transitions=True,
    parameters=True,
)
BATTERY = TopicEntry(
    topic="battery_state",
    component="Battery",
    field="power_supply_health",
    fields={"percentage": "percentage", "voltage": "voltage (V)", "current": "current"},
    levels={"good": 0},
)
OK, HOT = Status(0, "Motor", "OK"), Status(2, "Motor", "Hot")
NODE = """
import rclpy
from lifecycle_msgs.msg import State, TransitionEvent
from rclpy.parameter import Parameter
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import BatteryState

rclpy.init()
node = rclpy.create_node("amcl", namespace="/r")
node.declare_parameter("max_range", 5.0)
life = node.create_publisher(TransitionEvent, "~/transition_event", 10)
battery = node.create_publisher(BatteryState, "battery_state", qos_profile_sensor_data)
charge = BatteryState(percentage=0.625, voltage=24.5, current=float("nan"), present=True)
charge.power_supply_status = BatteryState.POWER_SUPPLY_STATUS_DISCHARGING
charge.power_supply_health = BatteryState.POWER_SUPPLY_HEALTH_OVERHEAT
states = State(label="errorprocessing"), State(label="unconfigured")

def work():
    node.get_logger().info("Nothing of interest")
    node.get_logger().error("Sensor overrun")
    node.set_parameters([Parameter("max_range", value=10.0)])
    life.publish(TransitionEvent(start_state=states[0], goal_state=states[1]))
    battery.publish(charge)

node.create_timer(1.0, work)
rclpy.spin(node)
"""


def noted(events: list[Event], texts: Counter[str]) -> list[Event]:
    """The events, whose messages are counted."""
    texts.update(each.message for each in events if each.kind == "graph")
    return events


TEXTS = {
    "/r/diagnostics": lambda message: message.status[0].message,
    "/rosout": lambda message: message.msg,
    "/parameter_events": lambda message: "".join(each.name for each in message.changed_parameters),
    "/r/amcl/transition_event": lambda message: message.goal_state.label,
    "/r/battery_state": lambda message: f"{message.percentage}",
}


def recorded(recordings: FaultRecordings, folder: Path) -> set[tuple[str, str, str]]:
    """(topic, type, text) of what is in a recording of a fault that began now."""
    now = read_clocks()
    began = Event(now.wall, "fault_began", "r", severity="critical", since=now.wall)
    recordings.note("0123456789ab", began, now)
    recordings.turn(now)
    path = folder / "r.mcap"
    path.write_bytes(recordings.read_so_far("0123456789ab", now.wall, now))
    with AnyReader([path]) as reader:
        found = [
            (each.topic, each.msgtype, reader.deserialize(data, each.msgtype))
            for each, _time, data in reader.messages()
        ]
    assert {topic for topic, _kind, _message in found} == TEXTS.keys()
    return {(topic, kind, TEXTS[topic](message)) for topic, kind, message in found}


def test_what_the_config_names_is_received_and_nothing_else(
    robots, run_exporter, start_process, dds_environment, monkeypatch
):
    domain_id = int(dds_environment["ROS_DOMAIN_ID"])
    profile = Profile(confirm_after=5.0, graph=Graph(mode="on", watch=ALL), topics=(BATTERY,))
    robot = Robot("r", domain_id, profile=profile, namespace="/r", source=Source.RAW)
    running = run_exporter(Fleet("f", (replace(robot, topic_raw="/r/diagnostics"),)))
    state = running.service.state
    recordings = FaultRecordings(
        running.folder, running.folder / "fleet.yml", state.topics_of, definition=state.definition
    )
    state.recorder = recordings.rings.receive
    robots.offer("/r/diagnostics")
    start_process("amcl", [sys.executable, "-c", NODE], dds_environment)
    events = Counter[str]()
    take = running.service.state.take_events
    monkeypatch.setattr(running.service.state, "take_events", lambda: noted(take(), events))
    motor = [OK]

    def faults() -> dict[str, str]:
        found = running.service.state.faults()
        return {each.identity.component: each.evidence for each in found}

    with repeating(lambda _turn: robots.send("/r/diagnostics", *motor), 0.2):
        of_graph = {"log amcl", "lifecycle amcl", "Battery"}
        until(lambda: faults().keys() == of_graph, lambda: f"{faults()}", 60)
        motor[:] = [HOT]
        until(lambda: "Motor" in faults(), lambda: f"{faults()}", 60)
    found = faults()
    assert "logged: amcl: Sensor overrun" in found["Motor"]
    assert "Nothing of interest" not in f"{found}"
    assert "fell to unconfigured after an error" in found["lifecycle amcl"]
    assert "power_supply_health is OVERHEAT; no value: current" in found["Battery"]
    values = running.samples("component_value")
    assert {(dict(each)["key"], dict(each)["unit"]): value for each, value in values.items()} == {
        ("percentage", ""): 0.625,
        ("voltage (V)", "V"): 24.5,
    }
    assert events["parameter max_range of amcl is now 10.0"]
    assert recorded(recordings, running.folder) >= {
        ("/r/diagnostics", "diagnostic_msgs/msg/DiagnosticArray", "Hot"),
        ("/rosout", "rcl_interfaces/msg/Log", "Sensor overrun"),
        ("/rosout", "rcl_interfaces/msg/Log", "Nothing of interest"),
        ("/parameter_events", "rcl_interfaces/msg/ParameterEvent", "max_range"),
        ("/r/battery_state", "sensor_msgs/msg/BatteryState", "0.625"),
        ("/r/amcl/transition_event", "lifecycle_msgs/msg/TransitionEvent", "unconfigured"),
    }
