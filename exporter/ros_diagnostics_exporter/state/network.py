"""What the ROS graph says about one robot's topics, and why the robot may be silent."""

from __future__ import annotations

from typing import NamedTuple

from ros_diagnostics_exporter.state.reasons import Silence


class Topic(NamedTuple):
    """A topic of one DDS domain."""

    domain_id: int
    name: str


class Endpoint(NamedTuple):
    """What the graph shows of one topic.

    ``wrong_type`` is the type found where it is not diagnostic_msgs/msg/DiagnosticArray, else "".
    """

    publishers: int
    wrong_type: str = ""


_NOTHING = Endpoint(0)


class Network:
    """The endpoints of one robot's topics as last seen."""

    __slots__ = ("_endpoints", "domain_up")

    def __init__(self) -> None:
        self.domain_up = True
        self._endpoints: dict[str, Endpoint] = {}

    def see(self, topic: str, endpoint: Endpoint | None) -> bool:
        """Take what the graph shows of a topic now; True if that is something else."""
        endpoint = endpoint or _NOTHING
        if self._endpoints.get(topic, _NOTHING) == endpoint:
            return False
        self._endpoints[topic] = endpoint
        return True

    @property
    def publishers(self) -> int:
        """Matched publishers on all of the robot's topics."""
        return sum(endpoint.publishers for endpoint in self._endpoints.values())

    @property
    def obstacle(self) -> Silence | None:
        """The reason, if the graph shows why nothing can arrive."""
        if not self.domain_up:
            return "domain_unreachable"
        if any(endpoint.wrong_type for endpoint in self._endpoints.values()):
            return "wrong_type"
        return None
