"""Fields of small topics over real DDS: what robots without diagnostics publish is judged."""

from pathlib import Path

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState, Image
from std_msgs.msg import Bool

from ros_diagnostics_exporter.decode.messages import MessageTypes
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.sources.dds_types import borrowed_type
from support.configs import load_text
from support.ros_publisher import repeating
from testbed.polling import until

MODE = "ur_dashboard_msgs/msg/SafetyMode"
FLEET = """\
fleet: f
ROBOTS
profiles:
  default:
    confirm_after: 3s
    topics:
      - {topic: battery_state, component: Battery, fields: {percentage: Charge}}
      - {topic: safety/mode, component: Safety, field: mode, levels: {NORMAL: OK}}
      - {topic: e_stop, component: E-stop, field: data, error_when: true}
      - {topic: camera, component: Camera, fields: {height: Height}}
    components: [{match: Safety, reports: on_change}]
    values: [{component: Battery, scale: 100, unit: "%", thresholds: {low: {critical: 15}}}]
"""


class Robot:
    """A robot without diagnostics in the test process; all of it is published twice a second."""

    def __init__(self, robots, namespace: str) -> None:
        self.battery = robots.offer(f"{namespace}/battery_state", reliable=False, kind=BatteryState)
        self.e_stop = robots.offer(f"{namespace}/e_stop", kind=Bool)
        self.camera = robots.offer(f"{namespace}/camera", reliable=False, kind=Image)
        kind = borrowed_type(MODE)
        self.mode = robots.offer(f"{namespace}/safety/mode", latched=True, kind=kind, depth=1)
        self.charge, self.is_stopped = 0.8, False
        self.set_mode(1)

    def set_mode(self, mode: int) -> None:
        self.mode.publish(bytes((0, 1, 0, 0, mode)))

    def publish(self, _turn: int) -> None:
        self.battery.publish(BatteryState(percentage=self.charge))
        self.e_stop.publish(Bool(data=self.is_stopped))


def started(tmp_path: Path, run_exporter, robots: str):
    folder = tmp_path / "msg/ur_dashboard_msgs"
    folder.mkdir(parents=True)
    (folder / "SafetyMode.msg").write_text("uint8 NORMAL=1\nuint8 STOP=3\nuint8 mode\n")
    return run_exporter(load_text(tmp_path, FLEET.replace("ROBOTS", robots)))


def faults(running) -> dict[str, str]:
    found = running.service.state.faults()
    return {each.identity.component or each.identity.state.value: each.evidence for each in found}


@pytest.mark.parametrize(
    "entry",
    [
        "robots: [{name: r, namespace: /r, source: none, domain_id: DOMAIN}]",
        "robots: [{name: r, namespace: /r, domain_id: DOMAIN}]",
        'discovery: [{topic: "/{robot}/e_stop", source: none, domain_ids: [DOMAIN]}]',
    ],
)
def test_a_robot_without_diagnostics_has_its_faults_and_their_ends(
    tmp_path, robots, run_exporter, ros_domain, entry
):
    robot = Robot(robots, "/r/io" if "/r/io" in entry else "/r")
    running = started(tmp_path, run_exporter, entry.replace("DOMAIN", str(ros_domain)))
    with repeating(robot.publish, 0.5):
        running.wait_for("robot_up", 1, robot="r")
        running.wait_for("component_level", 0, component="Safety")
        until(lambda: "watch" in faults(running), lambda: f"{faults(running)}", 60)
        assert "Camera: /r/camera: sensor_msgs/msg/Image is too large" in faults(running)["watch"]
        robot.charge, robot.is_stopped = 0.1, True
        robot.set_mode(3)
        expected = {"Battery", "E-stop", "Safety", "watch"}
        until(lambda: faults(running).keys() == expected, lambda: f"{faults(running)}", 60)
        assert faults(running)["Battery"].startswith("10 %, below the threshold of 15 %")
        assert faults(running)["Safety"].startswith("mode is STOP")
        robot.charge, robot.is_stopped = 0.8, False
        robot.set_mode(1)
        until(lambda: faults(running).keys() == {"watch"}, lambda: f"{faults(running)}", 60)
    assert running.sample("robot_silent_reason", robot="r") in (None, 0)


def test_a_reload_judges_what_a_driver_published_once_by_the_new_levels(
    tmp_path, robots, run_exporter, ros_domain
):
    entry = f"robots: [{{name: r, namespace: /r, source: none, domain_id: {ros_domain}}}]"
    robot = Robot(robots, "/r")
    running = started(tmp_path, run_exporter, entry)
    robot.set_mode(3)
    with repeating(robot.publish, 0.5):
        running.wait_for("component_level", 2, component="Safety")
        text = FLEET.replace("ROBOTS", entry).replace("{NORMAL: OK}", "{NORMAL: OK, STOP: WARN}")
        running.service.reloader.configure(load_text(tmp_path, text))
        running.wait_for("component_level", 1, component="Safety")


def test_a_flood_of_large_messages_is_given_up_and_slows_nothing_else(
    tmp_path, robots, run_exporter, ros_domain
):
    entry = f"robots: [{{name: r, namespace: /r, source: none, domain_id: {ros_domain}}}]"
    battery = robots.offer("/r/battery_state", kind=BatteryState)
    e_stop = robots.offer("/r/e_stop", reliable=False, kind=Bool)
    running = started(tmp_path, run_exporter, entry)
    flood = BatteryState(location="x" * 20_000)
    with repeating(lambda _turn: battery.publish(flood), 0.01):
        until(battery.get_subscription_count, "the flood is subscribed")
        until(lambda: not battery.get_subscription_count(), "the flood is given up", 30)
        with repeating(lambda _turn: e_stop.publish(Bool(data=True)), 0.5):
            expected = {"E-stop", "watch"}
            until(lambda: faults(running).keys() == expected, lambda: f"{faults(running)}", 60)
    assert "/r/battery_state is given up: 20" in faults(running)["watch"]


def test_a_flood_of_small_messages_is_given_up_by_the_budget_and_the_robot_is_one(
    tmp_path, robots, run_exporter, ros_domain, monkeypatch
):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.watched_bytes.COUNTED", 5.0)
    entry = f"robots: [{{name: r, namespace: /r, source: raw, domain_id: {ros_domain}}}]"
    battery = robots.offer("/r/battery_state", reliable=False, kind=BatteryState)
    e_stop = robots.offer("/r/e_stop", kind=Bool)
    robots.offer("/r/diagnostics")
    running = started(tmp_path, run_exporter, entry)
    flood = BatteryState(percentage=0.8, location="x" * 1000)

    def publish(_turn: int) -> None:
        e_stop.publish(Bool(data=True))
        robots.send("/r/diagnostics", Status(0, "Motor", "OK"))

    with repeating(publish, 0.5), repeating(lambda _turn: battery.publish(flood), 0.005):
        until(battery.get_subscription_count, "the flood is subscribed")
        until(lambda: not battery.get_subscription_count(), "the flood is given up", 60)
        expected = {"E-stop", "watch"}
        until(lambda: faults(running).keys() == expected, lambda: f"{faults(running)}", 60)
        assert running.sample("robot_watch_bytes_per_second", robot="r") > 20_000
        running.wait_for("component_level", 0, component="Motor")  # of its diagnostics
        assert running.sample("robot_up", robot="r") == 1
    assert "/r/battery_state is given up: " in faults(running)["watch"]
    assert list(running.service.state.robots) == ["r"]


ZENOH = """\
fleet: f
zenoh: {routers: [ROUTER]}
robots: [{name: r, zenoh: cell/r, source: none}]
discovery: [{topic: "/{robot}/e_stop", zenoh: yard, source: none, include: "s*"}]
profiles:
  default:
    confirm_after: 3s
    topics:
      - {topic: e_stop, component: E-stop, field: data, error_when: true}
      - {topic: mode, component: Mode, field: data, levels: {auto: OK}}
"""


def test_robots_beyond_the_lan_are_judged_by_their_topics_too(
    tmp_path, router, bridge, run_exporter
):
    running = run_exporter(load_text(tmp_path, ZENOH.replace("ROUTER", router.locator)))
    known = MessageTypes()
    for robot in ("cell/r", "yard/s"):
        kind = "std_msgs/msg/Bool"
        bridge.offer(f"/{robot}/e_stop", kind, type_hash=known.find(kind).hash)
    bridge.offer("/cell/r/mode", "std_msgs/msg/String", type_hash="RIHS01_5")
    stopped = Bool(data=True)

    def publish(_turn: int) -> None:
        for robot in ("cell/r", "yard/s"):
            bridge.send_bytes(f"/{robot}/e_stop", serialize_message(stopped))

    def found() -> set[tuple[str, str]]:
        faults = running.service.state.faults()
        return {(each.identity.robot, each.identity.component) for each in faults}

    with repeating(publish, 0.5):
        expected = {("r", "E-stop"), ("s", "E-stop"), ("r", "watch"), ("s", "watch")}
        until(lambda: found() >= expected - {("s", "watch")}, lambda: f"{found()}", 60)
        assert (
            "its publisher has another definition of std_msgs/msg/String"
            in faults(running)["watch"]
        )
        stopped.data = False
        until(lambda: not found() - {("r", "watch"), ("s", "watch")}, lambda: f"{found()}", 60)
    running.wait_for("robot_up", 1, robot="r")  # its publishers' tokens are there
    bridge.close()
    running.wait_for("robot_up", 0, robot="r")
