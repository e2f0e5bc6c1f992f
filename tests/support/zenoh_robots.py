"""A zenoh router, and robots behind bridges, from the test process itself.

A bridge declares the tokens that zenoh-bridge-ros2dds 1.10.2 does (its liveliness_mgt.rs).
"""

import json
from collections.abc import Sequence

import zenoh
from rclpy.serialization import serialize_message

from ros_diagnostics_exporter.model import Status
from support.ros_publisher import message
from testbed.polling import until

TYPE = "diagnostic_msgs/msg/DiagnosticArray"


def session(
    mode: str, *, base=None, connect: Sequence[str] = (), listen: Sequence[str] = (), **more
):
    values = {
        "mode": mode,
        "connect/endpoints": list(connect),
        "listen/endpoints": list(listen),
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        **more,
    }
    config = base or zenoh.Config()
    for key, value in values.items():
        config.insert_json5(key, json.dumps(value))
    return zenoh.open(config)


class Router:
    """A router that can be away for a time; ``more`` is of its config."""

    def __init__(self, locator: str, **more) -> None:
        self.locator = locator
        self._more = more
        self._session = None
        self.start()

    def start(self) -> None:
        self._session = session("router", listen=[self.locator], **self._more)

    def stop(self) -> None:
        if self._session is not None:
            self._session.close()
        self._session = None


class Bridge:
    """A session with the topics of a robot; without a locator to connect to it listens itself."""

    def __init__(self, locator: str = "", *, listen: str = "", **more) -> None:
        endpoints = {"connect": [locator] if locator else [], "listen": [listen] if listen else []}
        self._session = session("peer" if listen else "client", **endpoints, **more)
        self._id = self._session.zid()
        self._publishers = {}
        self._tokens = {}
        self._own = self._declare(f"@/{self._id}/@ros2_lv")

    def _declare(self, key: str):
        return self._session.liveliness().declare_token(key)

    def offer(
        self,
        topic: str,
        kind: str = TYPE,
        *,
        depth: int = 0,  # noqa: ARG002 - of DDS
        type_hash: str = "RIHS01_0",
    ) -> None:
        """A publisher, and its token."""
        key = topic.removeprefix("/")
        self._publishers[topic] = self._session.declare_publisher(
            key, congestion_control=zenoh.CongestionControl.BLOCK
        )
        names = [key.replace("/", "§"), kind.replace("/", "§"), f":1:::typehash={type_hash};"]
        self._tokens[topic] = self._declare(f"@/{self._id}/@ros2_lv/MP/{'/'.join(names)}")

    def listeners(self, topic: str) -> bool:
        return self._publishers[topic].matching_status.matching

    def wait_for_listeners(self) -> None:
        for topic in self._publishers:
            until(lambda each=topic: self.listeners(each), f"{topic} is subscribed")

    def wait_for_acknowledgements(self) -> None:
        """Nothing to wait for: what is sent waits for the router."""

    def send(self, topic: str, *statuses: Status) -> None:
        self.send_bytes(topic, serialize_message(message(statuses)))

    def send_bytes(self, topic: str, data: bytes) -> None:
        self._publishers[topic].put(data)

    def receive(self, key: str) -> list[str]:
        """The keys of what others put, as it comes."""
        received: list[str] = []
        self._receiving = self._session.declare_subscriber(
            key,
            lambda sample: received.append(str(sample.key_expr)),
        )
        return received

    def withdraw(self, topic: str) -> None:
        self._tokens.pop(topic).undeclare()
        self._publishers.pop(topic).undeclare()

    def close(self) -> None:
        self._session.close()
