"""What the network shows of one robot: its topics' endpoints, and whether it can be reached."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from ros_diagnostics_exporter.model import Endpoint
from ros_diagnostics_exporter.robots.marks import Mark, Marks, marking
from ros_diagnostics_exporter.robots.rejections import SilentReason
from ros_diagnostics_exporter.sources.link import LinkReading

_NO_PUBLISHER = Endpoint(0)


@marking(
    domain_up=Mark.RECEIPT,
    uplink_up=Mark.RECEIPT,
    link=Mark.RECEIPT,
    expected_nodes=Mark.RECEIPT,
    watched=Mark.RECEIPT,
)
@dataclass(slots=True, eq=False, repr=False)
class Network:
    """The endpoints of one robot's topics as the ROS graph last showed them."""

    marks: Marks[Any]
    domain_up: bool = True
    uplink_up: bool = True
    link: LinkReading | None = None  # how messages arrive, where that is known
    expected_nodes: int | None = None  # None: nothing of the graph is known
    lossy: bool = False  # so many are lost that what is not received says nothing
    logs: tuple[str, ...] = ()  # of the last minute from ERROR on, the newest first
    watched: float | None = None  # bytes per second beside diagnostics; None: nothing is
    _endpoints: dict[str, Endpoint] = field(default_factory=dict, init=False)

    def update(self, topic: str, endpoint: Endpoint | None) -> bool:
        """Set a topic's endpoint; True if more than its reliability changed."""
        endpoint = (endpoint or _NO_PUBLISHER)._replace(reliable=True)
        if self._endpoints.get(topic, _NO_PUBLISHER) == endpoint:
            return False
        self._endpoints[topic] = endpoint
        self.marks.note(Mark.RECEIPT)
        return True

    @property
    def publishers(self) -> int:
        """Matched publishers on all of the robot's topics."""
        return sum(endpoint.publishers for endpoint in self._endpoints.values())

    @property
    def obstacle(self) -> SilentReason | None:
        """The reason, if the graph shows why nothing can be received."""
        if not self.domain_up:
            return "domain_unreachable"
        if not self.uplink_up:
            return "uplink_down"
        if any(endpoint.wrong_type for endpoint in self._endpoints.values()):
            return "wrong_type"
        if any(endpoint.refused for endpoint in self._endpoints.values()):
            return "incompatible_qos"
        if not self.publishers and any(each.is_cut_off for each in self._endpoints.values()):
            return "unreachable"
        return None
