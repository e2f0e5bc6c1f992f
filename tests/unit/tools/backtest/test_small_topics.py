"""The fields of small topics in a recording are judged as the running exporter judges them."""

import sqlite3
from contextlib import closing
from pathlib import Path

import pytest
from rosbags.rosbag2 import StoragePlugin
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from ros_diagnostics_exporter.sources.topic_entries import asked_names
from support.bags import judged, texts, write_messages
from support.configs import load_text

SAFETY, BOOL = "ur_dashboard_msgs/msg/SafetyMode", "std_msgs/msg/Bool"
STORE = get_typestore(Stores.ROS2_JAZZY)
STORE.register(get_types_from_msg("uint8 NORMAL=1\nuint8 STOP=3\nuint8 mode\n", SAFETY))
FLEET = """\
fleet: cell
robots:
  - {name: arm, namespace: /arm, source: none}
  - {name: other, namespace: /other, source: none}
profiles:
  default:
    topics:
      - {topic: safety/mode, component: Safety, field: mode, levels: {NORMAL: OK}, every: 2s}
      - {topic: e_stop, component: E-stop, field: data, error_when: true}
    components: [{match: Safety, reports: on_change}]
"""


def write(folder: Path, rows, storage: StoragePlugin) -> Path:
    """A bag of (second, topic, type, value of the only field)."""
    typed = ((at, topic, kind, STORE.types[kind](value)) for at, topic, kind, value in rows)
    return write_messages(folder, typed, storage, STORE)


@pytest.mark.parametrize("storage", StoragePlugin)
def test_a_bag_without_diagnostics_gives_the_faults_of_its_topics(tmp_path, storage):
    changes = [(0, 1), (40, 3), (41.5, 1), (60, 1), (60.5, 3), (90, 1)]
    rows = [(at, "/arm/safety/mode", SAFETY, mode) for at, mode in changes]
    rows += [(at, "/arm/e_stop", BOOL, 100 <= at < 130) for at in range(200)]
    rows += [(at, "/arm/cmd", BOOL, True) for at in range(200)]
    bag = write(tmp_path / "bag", sorted(rows, key=lambda row: row[0]), storage)
    fleet = load_text(tmp_path, FLEET)

    result = judged(fleet, bag, asked=asked_names(fleet.profiles.values()))

    # What came 0.5 s after another message is read when that is due: 2 s after it.
    assert texts(result) == ["62 72 90 Safety critical", "100 110 130 E-stop critical"]
    assert (result.robots, result.messages) == (("arm",), 206)


def test_a_bag_of_an_earlier_ros_needs_the_definition_beside_fleet_yml(tmp_path):
    rows = [(at, "/arm/safety/mode", SAFETY, 3) for at in range(60)]
    rows += [(at, "/arm/e_stop", BOOL, False) for at in range(60)]
    rows.sort(key=lambda row: row[0])
    bag = write(tmp_path / "bag", rows, StoragePlugin.SQLITE3)
    with closing(sqlite3.connect(next(bag.glob("*.db3")), isolation_level=None)) as database:
        database.execute("DROP TABLE message_definitions")
    fleet = load_text(tmp_path, FLEET)
    asked = asked_names(fleet.profiles.values())
    result = judged(fleet, bag, asked=asked)
    assert {each.began.component for each in result.notifications} == {"watch"}

    file = tmp_path / "msg/ur_dashboard_msgs/SafetyMode.msg"
    file.parent.mkdir(parents=True)
    file.write_text("uint8 NORMAL=1\nuint8 mode\n")
    result = judged(fleet, bag, asked=asked)
    assert {each.began.component for each in result.notifications} == {"Safety"}
