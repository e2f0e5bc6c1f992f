"""A robot of a second vendor: Eclipse Cyclone DDS, as ROS' rmw_cyclonedds_cpp uses it.

ROS is not among it. What makes a participant a ROS node is what its rmw sends, too: the enclave in
the participant's user data, and on the topic ros_discovery_info which endpoints are of which node.
"""

# No future annotations: Cyclone reads the types of fields.

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, bounded_str, int32, sequence, uint8, uint32
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from ros_diagnostics_exporter.model import Status

CONFIG_VARIABLE = "CYCLONEDDS_URI"  # read when a domain is joined
# By unicast on the loopback interface alone, as `testbed.domains` has it for Fast DDS.
CONFIG = """
<CycloneDDS><Domain Id="any">
  <General>
    <Interfaces><NetworkInterface name="lo"/></Interfaces><AllowMulticast>false</AllowMulticast>
  </General>
  <Discovery>
    <ParticipantIndex>auto</ParticipantIndex><MaxAutoParticipantIndex>32</MaxAutoParticipantIndex>
    <Peers><Peer address="localhost"/></Peers>
  </Discovery>
</Domain></CycloneDDS>
"""


# -- the messages, as ROS names their types in DDS ---------------------------------------------


@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: int32 = 0
    nanosec: uint32 = 0


@dataclass
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    stamp: Time
    frame_id: str = ""


@dataclass
class KeyValue(IdlStruct, typename="diagnostic_msgs::msg::dds_::KeyValue_"):
    key: str
    value: str


@dataclass
class DiagnosticStatus(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticStatus_"):
    level: uint8
    name: str
    message: str
    hardware_id: str
    values: sequence[KeyValue]


@dataclass
class DiagnosticArray(IdlStruct, typename="diagnostic_msgs::msg::dds_::DiagnosticArray_"):
    header: Header
    status: sequence[DiagnosticStatus]


@dataclass
class Text(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    data: str


@dataclass
class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
    data: array[uint8, 16]


@dataclass
class NodeEntities(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
    node_namespace: bounded_str[256]
    node_name: bounded_str[256]
    reader_gid_seq: sequence[Gid]
    writer_gid_seq: sequence[Gid]


@dataclass
class ParticipantEntities(
    IdlStruct, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"
):
    gid: Gid
    node_entities_info_seq: sequence[NodeEntities]


RELIABLE = Policy.Reliability.Reliable(duration(milliseconds=100))


class CycloneRobot:
    """One participant, whose endpoints are all of one node; `CONFIG_VARIABLE` has to be set."""

    def __init__(self, domain_id: int, namespace: str, node: str) -> None:
        self._namespace, self._node = namespace, node
        qos = Qos(Policy.Userdata(data=b"enclave=/;"))
        self._participant = DomainParticipant(domain_id, qos)
        self._writers: dict[str, DataWriter] = {}
        self._readers: dict[str, DataReader] = {}
        qos = Qos(RELIABLE, Policy.Durability.TransientLocal, Policy.History.KeepLast(1))
        self._entities = self._writer("ros_discovery_info", ParticipantEntities, qos)
        self._announce()

    def _writer(self, name: str, kind: type[IdlStruct], qos: Qos) -> DataWriter:
        return DataWriter(self._participant, Topic(self._participant, name, kind), qos)

    def publish(self, topic: str, kind: type[IdlStruct], *more: Policy, reliable=True) -> None:
        """Offer a topic by its ROS name."""
        reliability = RELIABLE if reliable else Policy.Reliability.BestEffort
        qos = Qos(reliability, Policy.History.KeepLast(10), *more)
        self._writers[topic] = self._writer(f"rt{topic}", kind, qos)
        self._announce()

    def subscribe(self, topic: str, kind: type[IdlStruct]) -> None:
        """Ask for a topic reliably."""
        named = Topic(self._participant, f"rt{topic}", kind)
        self._readers[topic] = DataReader(self._participant, named, Qos(RELIABLE))
        self._announce()

    def withdraw(self, topic: str) -> None:
        """Offer it no more."""
        del self._writers[topic]
        self._announce()

    def matched(self, topic: str) -> int:
        """How many subscriptions match its publisher."""
        return len(self._writers[topic].get_matched_subscriptions())

    def send(self, topic: str, *statuses: Status) -> None:
        found = [
            DiagnosticStatus(
                each.level,
                each.name,
                each.message,
                each.hardware_id,
                [KeyValue(*pair) for pair in each.values],
            )
            for each in statuses
        ]
        self._writers[topic].write(DiagnosticArray(Header(Time()), found))

    def close(self) -> None:
        """Leave the domain: Cyclone's entities end with their last reference."""
        self._writers.clear()
        self._readers.clear()
        del self._entities, self._participant
        gc.collect()

    def _announce(self) -> None:
        """Say which endpoints the node has, as the rmw does after each change."""
        node = NodeEntities(self._namespace, self._node, _gids(self._readers), _gids(self._writers))
        self._entities.write(ParticipantEntities(_gid(self._participant), [node]))


@contextmanager
def cyclone_robot(domain_id: int, namespace: str, node: str) -> Iterator[CycloneRobot]:
    """A robot that is gone at the end."""
    made = CycloneRobot(domain_id, namespace, node)
    try:
        yield made
    finally:
        made.close()


def _gid(entity) -> Gid:
    return Gid(list(entity.guid.bytes))


def _gids(entities: dict[str, DataWriter | DataReader]) -> Sequence[Gid]:
    return [_gid(each) for each in entities.values()]
