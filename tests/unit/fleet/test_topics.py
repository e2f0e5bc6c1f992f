"""Fields of small topics through the state: components, faults, what cannot be read."""

from pathlib import Path

import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import BatteryState
from std_msgs.msg import Bool

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.model import Endpoint, Instant, Status
from ros_diagnostics_exporter.sources.graph_messages import Log
from support.configs import load_text
from support.state_driver import ERROR, OK, STALE, WALL, WARN, StateDriver, tree

BATTERY, BOOL = "sensor_msgs/msg/BatteryState", "std_msgs/msg/Bool"
TYPES = {"/r/battery_state": [BATTERY], "/r/e_stop": [BOOL]}
FLEET = """\
fleet: f
robots: [{name: r, namespace: /r, ROBOT}]
profiles:
  default:
    graph: {mode: "on"}
    topics:
      - {topic: battery_state, component: Battery, fields: {percentage: Charge, voltage: Voltage}}
      - {topic: e_stop, component: E-stop, field: data, error_when: true}
    values:
      - component: Battery
        key: Charge
        scale: 100
        unit: "%"
        thresholds: {low: {critical: 15}}
"""


def fleet_of(folder: Path, robot: str = "source: raw", text: str = FLEET):
    return load_text(folder, text.replace("ROBOT", robot))


class Driver(StateDriver):
    """One robot, whose graph is looked at once a second; ``sent`` are messages by topic."""

    types = TYPES
    nodes = ("driver",)

    def go_on(self, seconds: float, *raw, **sent):
        for _ in self.seconds(seconds):
            if raw:
                self.raw(*raw)
            self.state.update_nodes(0, [(each, "/r") for each in self.nodes], self.now)
            self.state.watched_topics(0, self.types, self.now)
            for name, message in sent.items():
                self.send(f"/r/{name}", message)
        return self

    def send(self, topic: str, message) -> None:
        data = message if isinstance(message, bytes) else serialize_message(message)
        self.state.receive_fields(0, topic, self.types[topic][0], data, self.now)


@pytest.fixture
def driver(tmp_path) -> Driver:
    return Driver(fleet=fleet_of(tmp_path))


def test_fields_are_components_that_are_judged_like_any_other(driver):
    low = BatteryState(percentage=0.1, voltage=11.0)
    driver.go_on(15, battery_state=low, e_stop=Bool(data=True))

    assert driver.faults() == [("Battery", "critical"), ("E-stop", "critical")]
    assert driver.sample("component_value", component="Battery", key="Charge") == 10
    assert driver.component("E-stop").group == "Topics"
    assert driver.component("E-stop").message == "data is true"
    driver.go_on(2, battery_state=BatteryState(percentage=0.8), e_stop=Bool(data=False))
    assert driver.faults() == []


def test_the_robot_is_up_while_any_of_its_topics_is_received(driver):
    assert driver.sample("robot_up") == 0
    assert driver.go_on(5, e_stop=Bool()).sample("robot_up") == 1
    assert driver.robot.silent_reason is None
    assert driver.wait(25).sample("robot_up") == 0
    assert driver.faults() == [("", "silent")]
    assert (driver.go_on(3, e_stop=Bool()).sample("robot_up"), driver.faults()) == (1, [])


def test_a_topic_that_stops_while_another_goes_on_is_stale(driver):
    driver.go_on(15, battery_state=BatteryState(percentage=0.5), e_stop=Bool())
    driver.go_on(20, e_stop=Bool())

    assert (driver.level("Battery"), driver.level("E-stop")) == (STALE, OK)
    assert driver.faults() == [("Battery", "stale")]


def test_a_message_that_cannot_be_read_is_named_with_its_entry_and_stops_nothing_else(driver):
    driver.go_on(15, battery_state=b"\0\1\0\0\0", e_stop=Bool())

    assert driver.level("watch") == WARN
    why = driver.component("watch").message
    assert why.startswith("Battery: /r/battery_state: is no sensor_msgs/msg/BatteryState")
    assert driver.level("E-stop") == OK
    driver.go_on(15, battery_state=BatteryState(percentage=0.5), e_stop=Bool())
    assert (driver.level("watch"), driver.level("Battery")) == (OK, OK)


def test_a_topic_of_a_refused_type_is_not_wanted_and_named(driver):
    driver.types = {"/r/battery_state": ["sensor_msgs/msg/Image"], "/r/e_stop": [BOOL]}
    driver.go_on(3, e_stop=Bool())

    wanted = driver.state.watched_topics(0, driver.types, driver.now)
    assert wanted == {"/r/e_stop": BOOL}
    assert (
        "sensor_msgs/msg/Image is too large or too fast a type" in driver.component("watch").message
    )


def test_a_large_message_gives_its_topic_up_for_an_hour(driver):
    driver.go_on(3, battery_state=BatteryState(location="x" * 17_000), e_stop=Bool())

    wanted = driver.state.watched_topics(0, TYPES, driver.now)
    assert wanted == {"/r/e_stop": BOOL}
    assert "/r/battery_state is given up: 17" in driver.component("watch").message
    driver.now = Instant(driver.now.mono + 3700, WALL)
    assert driver.state.watched_topics(0, TYPES, driver.now).keys() == TYPES.keys()


def test_a_topic_that_is_given_up_does_not_count_towards_the_end_of_its_component(tmp_path):
    """Nobody could have received it again; once it is read, its time begins anew."""
    rule = "    components: [{match: E-stop, reports: on_change, ends_after: 5m}]\n"
    driver = Driver(fleet=fleet_of(tmp_path, text=FLEET + rule))
    driver.go_on(15, e_stop=Bool(data=True), battery_state=BatteryState(percentage=0.5))
    driver.send("/r/e_stop", bytes(100_000))
    driver.go_on(3600, battery_state=BatteryState(percentage=0.5))
    assert driver.faults() == [("E-stop", "critical"), ("watch", "warning")]
    driver.go_on(200, battery_state=BatteryState(percentage=0.5))
    assert driver.faults() == [("E-stop", "critical")]
    driver.go_on(200, battery_state=BatteryState(percentage=0.5))
    assert driver.faults() == []


def test_topics_of_fields_have_the_budget_of_all_that_is_watched(driver):
    driver.go_on(3, battery_state=BatteryState(), e_stop=Bool())
    driver.state.note_watched(0, {"/r/battery_state": 30_000.0, "/r/e_stop": 10.0}, driver.now)

    assert driver.state.watched_topics(0, TYPES, driver.now) == {"/r/e_stop": BOOL}
    assert driver.robot.network.watched is None
    assert driver.go_on(1, e_stop=Bool()).sample("robot_watch_bytes_per_second") == 30_010


def test_a_topic_that_nobody_publishes_is_named_once_its_robot_is_there_for_a_minute(driver):
    driver.types = {"/r/e_stop": [BOOL]}
    assert "watch" not in {each.name for each in driver.go_on(50, e_stop=Bool()).robot.components}
    driver.go_on(15, e_stop=Bool())
    assert "Battery: /r/battery_state: nobody publishes it" in driver.component("watch").message
    driver.types = TYPES
    assert driver.go_on(3, battery_state=BatteryState(), e_stop=Bool()).level("watch") == OK


def test_publishers_with_another_definition_are_not_read(driver):
    driver.go_on(1)
    accept = lambda type_hash: driver.state.offered(  # noqa: E731
        0, "/r/battery_state", BATTERY, type_hash, driver.now
    )

    assert accept("RIHS01_4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741")
    assert accept("")
    assert not accept("RIHS01_0000")
    driver.go_on(1, e_stop=Bool())
    why = "another definition of sensor_msgs/msg/BatteryState than the one that is installed here"
    assert why in driver.component("watch").message


def test_a_topic_that_two_robots_ask_for_is_read_of_none(tmp_path):
    text = FLEET.replace("topic: e_stop", "topic: /e_stop").replace(
        "robots: [", "robots: [{name: other, namespace: /other}, "
    )
    driver = Driver(fleet=fleet_of(tmp_path, text=text))
    driver.types = {"/e_stop": [BOOL], "/r/battery_state": [BATTERY]}
    driver.go_on(3, battery_state=BatteryState())

    assert "/e_stop" not in driver.state.watched_topics(0, driver.types, driver.now)
    assert "E-stop: /e_stop: other and r ask for it" in driver.component("watch").message


def test_an_entry_that_the_config_no_longer_has_takes_its_component_along(driver, tmp_path):
    driver.go_on(3, battery_state=BatteryState(), e_stop=Bool(data=True))
    text = "".join(line for line in FLEET.splitlines(keepends=True) if "E-stop" not in line)
    driver.configure(fleet_of(tmp_path, text=text))

    assert [each.name for each in driver.robot.components] == ["Battery"]


def test_a_message_is_read_at_most_once_in_every(tmp_path):
    text = FLEET.replace("error_when: true", "error_when: true, every: 5s")
    driver = Driver(fleet=fleet_of(tmp_path, text=text)).go_on(1, e_stop=Bool(data=True))
    assert driver.go_on(3, e_stop=Bool(data=False)).level("E-stop") == ERROR
    assert driver.go_on(2, e_stop=Bool(data=False)).level("E-stop") == OK


def test_what_was_known_of_fields_outlives_a_restart(driver, tmp_path):
    driver.go_on(15, battery_state=BatteryState(percentage=0.1), e_stop=Bool(data=True))
    later = driver.again(tmp_path / "db")
    later.__class__ = Driver
    assert {each.name: each.level for each in later.robot.components} == {
        "Battery": STALE,
        "E-stop": STALE,
    }
    later.go_on(5, battery_state=BatteryState(percentage=0.1), e_stop=Bool(data=False))
    assert later.faults() == [("Battery", "critical")]


# -- robots without diagnostics ------------------------------------------------------------------


@pytest.mark.parametrize("source", ["none", "auto"])
def test_a_robot_without_diagnostics_is_up_while_a_node_of_it_is_there(tmp_path, source):
    driver = Driver(fleet=fleet_of(tmp_path, f"source: {source}"))
    driver.nodes = ()
    assert (driver.go_on(5).sample("robot_up"), driver.robot.silent_reason) == (0, "never_seen")
    driver.nodes = ("driver",)
    assert driver.go_on(5).sample("robot_up") == 1
    driver.nodes = ()
    assert driver.go_on(25).sample("robot_up") == 0
    assert driver.faults() == [("", "silent")]


def test_the_nodes_of_a_robot_with_diagnostics_say_nothing_of_them(driver):
    motor = Status(OK, "Motor", "OK")
    driver.go_on(5, motor)
    driver.go_on(30)

    assert driver.sample("robot_up") == 0
    assert driver.faults() == [("", "silent")]


def test_diagnostics_that_stop_while_fields_go_on_are_stale_and_the_robot_is_up(driver):
    motor, e_stop = Status(OK, "Motor", "OK"), Bool()
    driver.go_on(15, motor, battery_state=BatteryState(percentage=0.5), e_stop=e_stop)
    driver.go_on(30, battery_state=BatteryState(percentage=0.5), e_stop=e_stop)

    assert (driver.sample("robot_up"), driver.level("Motor")) == (1, STALE)
    assert driver.faults() == [("Motor", "stale")]


def test_the_battery_and_the_log_of_a_robot_without_diagnostics_are_faults(tmp_path):
    """At 10 % of which 15 are critical; before, only its silence was one, with the log as why."""
    watch = 'graph: {mode: "on", watch: {logs: true, log_faults: "*avoided*"}}'
    text = FLEET.replace('graph: {mode: "on"}', watch)
    driver = Driver(fleet=fleet_of(tmp_path, "source: auto", text))
    driver.types = {**TYPES, "/rosout": ["rcl_interfaces/msg/Log"]}
    for _ in range(50):
        driver.state.receive_watched(0, "/rosout", Log("r.driver", "collision avoided"), driver.now)
        driver.go_on(1, battery_state=BatteryState(percentage=0.1))

    assert driver.faults() == [("Battery", "critical"), ("log driver", "critical")]
    assert "nothing was ever received" not in f"{[each.evidence for each in driver.state.faults()]}"


def test_what_is_logged_never_stands_beside_that_nothing_was_ever_received(tmp_path):
    watch = 'graph: {mode: "on", watch: {logs: true}}'
    text = FLEET.replace('graph: {mode: "on"}', watch) + "faults: {pending_after: 10s}\n"
    driver = Driver(fleet=fleet_of(tmp_path, "source: raw", text))
    driver.nodes = ()
    for _ in range(100):
        driver.state.receive_watched(0, "/rosout", Log("r.driver", "collision avoided"), driver.now)
        driver.go_on(1)

    (pending,) = driver.state.faults()
    assert pending.evidence == "nothing was ever received"


def test_a_robot_of_queries_may_have_topics_and_is_never_silent(tmp_path):
    driver = Driver(fleet=fleet_of(tmp_path, "source: queries, domain_id: 0"))
    assert driver.state.fleet.domain_ids == (0,)
    assert driver.go_on(15, e_stop=Bool(data=True)).faults() == [("E-stop", "critical")]
    assert driver.wait(60).sample("robot_up") == 1
    assert driver.sample("robot_info", domain_id="0") == 1


def test_robots_of_queries_without_a_domain_leave_the_root_namespace_to_others(tmp_path):
    text = FLEET.replace("namespace: /r, ROBOT", "source: none").replace(
        "robots: [", "robots: [{name: ap, source: queries}, "
    )
    driver = Driver(fleet=fleet_of(tmp_path, text=text))
    driver.types = {"/e_stop": [BOOL]}
    driver.state.update_nodes(0, [("driver", "/")], driver.now)
    assert driver.state.watched_topics(0, driver.types, driver.now) == {"/e_stop": BOOL}
    assert driver.sample("robot_info", robot="ap", domain_id="none") == 1
    robots = fleet_snapshot(driver.state, driver.now)["robots"]
    assert {each["robot"]: each["domain_id"] for each in robots} == {"ap": None, "r": 0}


def test_a_robot_that_two_components_are_made_for_of_fields_and_of_diagnostics_is_one(driver):
    driver.go_on(15, Status(OK, "Battery", "OK"), battery_state=BatteryState(percentage=0.5))

    assert {(each.group, each.name) for each in driver.robot.components} == {
        ("", "Battery"),
        ("Topics", "Battery"),
    }
    assert driver.robot.messages == 15


# -- discovery -----------------------------------------------------------------------------------

FOUND = """\
fleet: f
discovery: [{topic: "/hall/{robot}/io/e_stop", source: none, include: "r*"}]
profiles: {default: {topics: [{topic: io/e_stop, component: E-stop, field: data, error_when: 1}]}}
"""


def offered(*topics: str) -> dict[str, Endpoint]:
    return dict.fromkeys(topics, Endpoint(0, wrong_type=BOOL))


def test_a_robot_is_found_by_any_topic_and_has_the_namespace_up_to_its_name(tmp_path):
    driver = Driver(fleet=fleet_of(tmp_path, text=FOUND))
    topic = "/hall/r/io/e_stop"
    (pattern,) = driver.state.finders(0)
    assert pattern.fullmatch(topic)
    driver.state.update_graph(0, {topic: Endpoint(0)}, driver.now)
    assert not driver.state.robots
    for _ in range(2):
        driver.state.update_graph(0, offered(topic, "/hall/other/io/e_stop"), driver.now)
    assert list(driver.state.robots) == ["r"]
    assert driver.robot.settings.namespace == "/hall/r"
    assert dict(driver.state.rejected)["duplicate_robot"] == 0

    driver.types = {topic: [BOOL]}
    for _ in driver.seconds(15):
        driver.state.update_nodes(0, [("plc", "/hall/r")], driver.now)
        driver.state.watched_topics(0, driver.types, driver.now)
        driver.send(topic, Bool(data=True))
    assert driver.faults() == [("E-stop", "critical")]
    later = driver.again(tmp_path / "db")
    assert list(later.state.robots) == ["r"]
    later.configure(later.state.fleet)
    assert later.robot.settings.namespace == "/hall/r"


def test_two_robots_of_one_name_are_not_mixed_up_by_any_topic(tmp_path):
    text = FOUND.replace("/hall/{robot}", "/*/{robot}")
    driver = Driver(fleet=fleet_of(tmp_path, text=text))
    driver.state.update_graph(0, offered("/hall/r/io/e_stop", "/yard/r/io/e_stop"), driver.now)

    assert driver.robot.settings.namespace == "/hall/r"
    assert dict(driver.state.rejected)["duplicate_robot"] == 1


def test_an_array_of_an_aggregator_says_nothing_of_what_was_known_of_fields(tmp_path):
    driver = Driver(fleet=fleet_of(tmp_path, "source: agg"))
    rows = tree(All=[Status(OK, "Motor", "OK")])
    for _ in range(15):
        driver.agg(*rows)
        driver.go_on(1, battery_state=BatteryState(percentage=0.5), e_stop=Bool())
    later = driver.again(tmp_path / "db")
    later.agg_every(1, 20, *rows)

    assert later.level("Battery") == STALE
    assert later.state.faults() == []


def test_a_topic_that_is_received_of_no_robot_is_named_after_five_minutes(driver):
    for _ in range(400):
        driver.go_on(1, e_stop=Bool())

    found = fleet_snapshot(driver.state, driver.now)["unmatched"]
    assert {"what": "topic", "entry": "battery_state: Battery", "nearest": ""}.items() <= next(
        each for each in found if each["what"] == "topic"
    ).items()
    assert [each["why"] for each in found if each["what"] == "topic"] == ["is received of no robot"]


def test_what_was_wrong_with_an_entry_that_is_corrected_is_no_problem_any_more(driver, tmp_path):
    driver.types = {"/r/battery_state": ["sensor_msgs/msg/Image"], "/r/e_stop": [BOOL]}
    assert driver.go_on(50, e_stop=Bool()).faults() == [("watch", "warning")]
    text = FLEET.replace("topic: battery_state, component: Battery", "topic: bat, component: Cell")
    driver.types["/r/bat"] = [BATTERY]
    driver.configure(fleet_of(tmp_path, text=text))
    driver.go_on(3, bat=BatteryState(), e_stop=Bool())

    assert driver.faults() == []


def test_any_topic_of_a_namespace_finds_its_robot_once(tmp_path):
    driver = Driver(fleet=fleet_of(tmp_path, text=FOUND.replace("{robot}/io/e_stop", "{robot}/*")))
    names = ("/hall/r/cmd", "/hall/r/mode", "/yard/r2/mode")
    (pattern,) = driver.state.finders(0)
    driver.state.update_graph(0, offered(*filter(pattern.fullmatch, names)), driver.now)

    assert list(driver.state.robots) == ["r"]
    assert driver.robot.settings.namespace == "/hall/r"
    assert dict(driver.state.rejected)["duplicate_robot"] == 0


def test_a_topic_that_is_read_seldom_leaves_its_robot_no_less_received(tmp_path):
    text = FLEET.replace("{percentage: Charge, voltage: Voltage}}", "{voltage: V}, every: 15s}")
    driver = Driver(fleet=fleet_of(tmp_path, "source: none", text))
    driver.nodes = ()
    assert driver.robot.settings.profile.stale_after == 10
    driver.go_on(120, battery_state=BatteryState(voltage=12.0))
    assert [each.after for each in driver.events if each.kind == "robot"] == ["known", "received"]


@pytest.mark.parametrize("source", ["none", "auto", "queries, domain_id: 0"])
def test_a_restart_waits_for_a_topic_that_is_published_seldom(tmp_path, source):
    driver = Driver(fleet=fleet_of(tmp_path, f"source: {source}"))
    battery = BatteryState(percentage=0.5)
    for _ in range(3):
        driver.go_on(1, battery_state=battery, e_stop=Bool()).go_on(59, e_stop=Bool())
    later = driver.again(tmp_path / "db")
    later.__class__ = Driver

    assert later.go_on(60, e_stop=Bool()).faults() == []
    assert later.go_on(60, e_stop=Bool()).faults() == [("Battery", "stale")]
    assert not [each for each in later.events if each.kind == "fault_ended"]


def test_a_topic_of_a_robot_of_queries_that_stops_is_stale_also_after_a_restart(tmp_path):
    driver = Driver(fleet=fleet_of(tmp_path, "source: queries, domain_id: 0"))
    driver.go_on(40, e_stop=Bool())
    assert driver.go_on(40).faults() == [("E-stop", "stale")]
    assert driver.go_on(3, e_stop=Bool()).faults() == []

    later = driver.again(tmp_path / "db")
    later.__class__ = Driver
    assert later.go_on(60).faults() == []
    assert later.go_on(60).faults() == [("E-stop", "stale")]


def test_a_topic_that_another_entry_reads_is_subscribed_anew(driver, tmp_path):
    driver.go_on(3, battery_state=BatteryState(), e_stop=Bool())
    look = lambda: set(driver.state.watched_topics(0, TYPES, driver.now))  # noqa: E731
    driver.state.configure(
        fleet_of(tmp_path, text=FLEET.replace("_when: true", "_when: 1")), driver.now
    )
    assert (look(), look()) == ({"/r/battery_state"}, TYPES.keys())
    driver.state.configure(fleet_of(tmp_path, text=FLEET + "limits: {values: 99}\n"), driver.now)
    assert (look(), look()) == ({"/r/battery_state"}, TYPES.keys())
    driver.state.configure(fleet_of(tmp_path, text=FLEET), driver.now)
    assert (look(), look()) == (TYPES.keys(), TYPES.keys())
