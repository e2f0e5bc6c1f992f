"""A recording has what is received of its robot beside diagnostics: as it came, with its type."""

import io
from itertools import starmap

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot
from ros_diagnostics_exporter.config.graph import Graph, Watched
from ros_diagnostics_exporter.config.topics import TopicEntry
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Instant, Stream, Topic
from ros_diagnostics_exporter.recordings.recordings import FaultRecordings
from ros_diagnostics_exporter.recordings.schemas import SCHEMAS
from ros_diagnostics_exporter.sources.graph_messages import (
    LOG_TYPE,
    PARAMETERS_TYPE,
    TRANSITION_TYPE,
    node_in,
)
from ros_diagnostics_tools.main import main
from virtual_robots.model import Status
from virtual_robots.recording.cdr import encode_array

JAZZY = get_typestore(Stores.ROS2_JAZZY)
KINDS = {each: JAZZY.types[each] for each in SCHEMAS}
WALL = 1_790_000_000.0
FAULT = "0123456789ab"
LOGS, LIFE = "/rosout", "/r/amcl/transition_event"
PARAMETERS = "/parameter_events"


def at(second):
    return Instant(float(second), WALL + second)


def made(kind, *, little=True, **fields):
    """A message of a type in CDR, with what ROS fills in where nothing is given."""
    return bytes(JAZZY.serialize_cdr(KINDS[kind](**fields), kind, little_endian=little))


def stamp():
    return JAZZY.types["builtin_interfaces/msg/Time"](sec=1, nanosec=2)


def log(logger, text, level=20, *, little=True):
    fields = {"name": logger, "msg": text, "level": level, "file": "f", "function": "g", "line": 7}
    return made(LOG_TYPE, little=little, stamp=stamp(), **fields)


def parameters(node, *, little=True):
    fields = {f"{each}_parameters": [] for each in ("new", "changed", "deleted")}
    return made(PARAMETERS_TYPE, little=little, stamp=stamp(), node=node, **fields)


def transition():
    state = JAZZY.types["lifecycle_msgs/msg/State"]
    step = JAZZY.types["lifecycle_msgs/msg/Transition"](id=3, label="activate")
    states = {"start_state": state(id=2, label="inactive"), "goal_state": state(id=3, label="a")}
    return made(TRANSITION_TYPE, timestamp=5, transition=step, **states)


class Site:
    """Two robots of one domain, of which the first is watched; a message of each every second."""

    def __init__(self, folder, watch, *topics):
        profile = Profile(graph=Graph(mode="on", watch=watch), topics=topics)
        robots = [
            Robot("r", topic_raw="/r/diagnostics", namespace="/r", profile=profile),
            Robot("s", topic_raw="/s/diagnostics", namespace="/s"),
        ]
        config = folder / "fleet.yml"
        config.write_text("fleet: f\nrobots: [{name: r, topic: /r/diagnostics, source: raw}]\n")
        self.state = FleetState(Fleet("f", tuple(robots)), at(0))
        self.recordings = FaultRecordings(
            folder / "kept", config, self.state.topics_of, definition=self.state.definition
        )
        self.state.recorder = self.recordings.rings.receive
        self.state.update_nodes(0, [("amcl", "/r"), ("amcl", "/s")], at(0))

    def diagnose(self, seconds):
        for second in seconds:
            data = encode_array([Status(0, "motor", "m", "m", ())], WALL + second)
            array = Array(WALL + second, (), len(data), data)
            self.state.receive(Topic(0, "/r/diagnostics"), array, at(second))
            self.recordings.rings.compress()

    def send(self, second, topic, kind, data):
        self.state.record_watched(0, topic, kind, data, at(second))
        self.recordings.rings.compress()

    def recording(self, second=100):
        wall = WALL + second
        began = Event(wall, "fault_began", "r", severity="critical", since=wall - 30)
        self.recordings.note(FAULT, began, at(second))
        self.recordings.turn(at(second + 10))
        return self.recordings.read(FAULT, at(second + 10))


@pytest.fixture
def site(tmp_path):
    return Site(tmp_path, Watched(logs=True, transitions=True, parameters=True))


def beside(content):
    """(topic, type, second, bytes) of all messages that are none of diagnostics."""
    found = make_reader(io.BytesIO(content), validate_crcs=True).iter_messages()
    return [
        (channel.topic, schema and schema.name, message.log_time / 1e9 - WALL, message.data)
        for schema, channel, message in found
        if not channel.topic.endswith("diagnostics")
    ]


def test_a_type_of_which_no_definition_is_known_is_none(tmp_path):
    topic, kind, data = "/r/odd", "no_such_msgs/msg/Odd", b"\0\1\0\0\7\0\0\0"
    site = Site(tmp_path, Watched(), TopicEntry(topic="odd", component="Odd", fields={"x": "X"}))
    site.diagnose(range(80))
    site.state.receive_fields(0, topic, kind, data, at(80))
    site.diagnose(range(81, 111))
    assert beside(site.recording()) == [(topic, None, 80, data)]


def test_a_topic_of_which_fields_are_read_is_in_it_with_its_type(tmp_path):
    topic, kind = "/r/joint_states", "sensor_msgs/msg/JointState"
    entry = TopicEntry(topic="joint_states", component="Arm", fields={"effort[name]": "Effort"})
    site = Site(tmp_path, Watched(), entry)
    header = JAZZY.types["std_msgs/msg/Header"](stamp=stamp(), frame_id="")
    fields = {"position": np.zeros(0), "velocity": np.zeros(0), "effort": np.array([1.5])}
    message = JAZZY.types[kind](header=header, name=["elbow"], **fields)
    data = bytes(JAZZY.serialize_cdr(message, kind))
    site.diagnose(range(80))
    site.state.receive_fields(0, topic, kind, data, at(80))
    site.diagnose(range(81, 111))
    content = site.recording()

    assert beside(content) == [(topic, kind, 80, data)]
    reader = make_reader(io.BytesIO(content), decoder_factories=[DecoderFactory()])
    (found,) = reader.iter_decoded_messages(topics=[topic])
    assert found.decoded_message.effort == [1.5]


def test_what_the_nodes_of_its_robot_say_is_in_it_byte_for_byte_with_its_type(site):
    sent = [
        (LOGS, LOG_TYPE, 80, log("r.amcl", "No map", 20)),
        (LOGS, LOG_TYPE, 90, log("r.amcl.tf", "Overrun", 40)),
        (PARAMETERS, PARAMETERS_TYPE, 91, parameters("/r/amcl")),
        (LIFE, TRANSITION_TYPE, 92, transition()),
    ]
    site.diagnose(range(111))
    for topic, kind, second, data in sent:
        site.send(second, topic, kind, data)
    site.send(93, LOGS, LOG_TYPE, log("s.amcl", "Of another robot"))
    site.send(93, LOGS, LOG_TYPE, log("nobody", "Of no robot"))
    content = site.recording()

    assert beside(content) == sent
    reader = make_reader(io.BytesIO(content), decoder_factories=[DecoderFactory()])
    read = {
        schema.name: message
        for schema, _channel, _message, message in reader.iter_decoded_messages()
    }
    assert (read[LOG_TYPE].name, read[LOG_TYPE].msg) == ("r.amcl.tf", "Overrun")
    assert (read[LOG_TYPE].level, read[LOG_TYPE].line) == (40, 7)
    assert read[PARAMETERS_TYPE].node == "/r/amcl"
    assert read[TRANSITION_TYPE].start_state.label == "inactive"
    assert read["diagnostic_msgs/msg/DiagnosticArray"].status[0].name == "motor"


@pytest.mark.parametrize("watch", [Watched(), Watched(parameters=True, transitions=True)])
def test_logs_that_the_robots_config_does_not_name_are_not_in_it(tmp_path, watch):
    site = Site(tmp_path, watch)
    site.diagnose(range(111))
    site.send(95, LOGS, LOG_TYPE, log("r.amcl", "For another robot's sake"))
    assert beside(site.recording()) == []


def test_what_another_robot_says_is_not_in_it(site):
    site.diagnose(range(111))
    for robot in ("r", "s"):
        stream = Stream(Topic(0, LOGS), LOG_TYPE, robot)
        site.recordings.rings.receive(stream, log(f"{robot}.amcl", "Overrun"), at(93))
    site.recordings.rings.compress()
    assert [data for *_, data in beside(site.recording())] == [log("r.amcl", "Overrun")]


def test_what_was_said_long_before_is_not_in_it_however_little_is_said(site):
    for second in (0, 20, 25, 45, 60, 95):
        site.send(second, LOGS, LOG_TYPE, log("r.amcl", f"At {second}"))
    site.diagnose(range(111))
    assert [second for *_, second, _data in beside(site.recording())] == [45, 60, 95]


def test_a_silent_robots_has_what_it_said_last(site):
    site.diagnose(range(50))
    site.send(40, LOGS, LOG_TYPE, log("r.amcl", "Battery is empty"))
    assert len(beside(site.recording(3_000))) == 1


def test_it_is_judged_as_without_that(site, tmp_path, capsys):
    site.diagnose(range(111))
    site.send(95, LOGS, LOG_TYPE, log("r.amcl", "Overrun", 40))
    path = tmp_path / "c.mcap"
    path.write_bytes(site.recording())
    assert main(["backtest", str(path)]) == 0
    assert capsys.readouterr().err == ""


def test_what_is_not_received_any_more_is_forgotten_but_for_a_recording_under_way(site):
    site.diagnose(range(101))
    site.send(95, LOGS, LOG_TYPE, log("r.amcl", "Overrun"))
    rings = site.recordings.rings
    began = Event(WALL + 100, "fault_began", "r", severity="critical", since=WALL + 100)
    site.recordings.keep_only(*site.state.received())
    size = rings.size
    assert size
    site.recordings.note(FAULT, began, at(100))
    site.state.configure(Fleet("f", ()), at(101))
    site.recordings.keep_only(*site.state.received())
    assert rings.size == size
    site.recordings.turn(at(110))
    assert len(beside(site.recordings.read(FAULT, at(110)))) == 1
    site.recordings.keep_only(*site.state.received())
    assert rings.size == 0


@pytest.mark.parametrize("kind", SCHEMAS)
def test_its_types_are_those_of_ros(kind):
    """By the hash that ROS 2 itself compares types by (REP 2011)."""
    found = get_typestore(Stores.EMPTY)
    found.register(get_types_from_msg(SCHEMAS[kind], kind))
    assert found.hash_rihs01(kind) == JAZZY.hash_rihs01(kind)


@pytest.mark.parametrize("little", [True, False])
def test_the_node_of_a_message_is_read_from_its_bytes(little):
    life = "/r/amcl/transition_event"
    cases = [
        (LOGS, LOG_TYPE, log("r.amcl.tf", "m", little=little), "/r/amcl/tf"),
        (PARAMETERS, PARAMETERS_TYPE, parameters("/r/amcl", little=little), "/r/amcl"),
        (life, TRANSITION_TYPE, b"", "/r/amcl"),
    ]
    assert list(starmap(node_in, (each[:3] for each in cases))) == [each[3] for each in cases]


@pytest.mark.parametrize("kind", [LOG_TYPE, PARAMETERS_TYPE])
@pytest.mark.parametrize("data", [b"", b"\0", b"\0\1\0\0", b"\0\1\0\0" + b"\xff" * 20])
def test_bytes_that_are_no_message_are_of_no_robot(site, kind, data):
    site.send(1, "/rosout", kind, data)
    assert site.recordings.rings.size == 0
