"""Which node an endpoint is of, also once the middleware does not know it any more. Pure: no ROS.

Of a process that was not received for its lease, 20 seconds, rmw forgets which nodes it has, and
Fast DDS takes no message twice. So once it is received again, all of its endpoints are found, but
not of which nodes they are, until it makes another endpoint. No two processes have the same id.

Of a process that ends, endpoints may be found for its lease, too, if its goodbye was lost. So they
show that a node is there only once it has been listed no more for longer than that.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Iterable
from sys import intern

from ros_diagnostics_exporter.sources.graph_topics import PARTICIPANT, Peer

NO_NODE = "_NODE_NAME_UNKNOWN_"  # of rmw: of an endpoint whose participant has named no node of it
LEASE = 25.0  # seconds, with what the middleware takes to notice
MOST = 20_000  # processes of one domain
MOST_ENDPOINTS = 1_000  # of one of them: one that makes new ones again and again takes no more


class EndpointNames:
    """The full names of nodes by their processes' endpoints."""

    def __init__(self) -> None:
        # process -> the rest of the endpoint's id -> node; that of which one was read last is last
        self._nodes: OrderedDict[str, dict[str, str]] = OrderedDict()
        self._forgotten: dict[str, frozenset[str]] = {}  # by the middleware: topic -> nodes
        self._listed: frozenset[str] = frozenset()  # not forgotten: what is nameless is not theirs
        self._left: dict[str, float] = {}  # within LEASE: node -> when (monotonic)

    def named(self, topic: str, endpoints: Iterable[Peer]) -> list[Peer]:
        """All endpoints of a topic, with the names that the middleware has forgotten."""
        named, forgotten = [], set()
        for each in endpoints:
            known = self._nodes.setdefault(each.process, {})
            self._nodes.move_to_end(each.process)
            own, node = intern(each.gid[PARTICIPANT:]), each.node
            if not node.endswith(NO_NODE):
                known[own] = intern(node)
                if len(known) > MOST_ENDPOINTS:
                    del known[next(iter(known))]
            elif own in known and self._is_forgotten(known[own]):
                node = known[own]
                forgotten.add(node)
            named.append(Peer(node, each.gid))
        while len(self._nodes) > MOST:
            self._nodes.popitem(last=False)
        self._forgotten.pop(topic, None)
        if forgotten:
            self._forgotten[topic] = frozenset(forgotten)
        return named

    def _is_forgotten(self, node: str) -> bool:
        return node not in self._listed and node not in self._left

    def complete(self, nodes: list[tuple[str, str]], mono: float) -> list[tuple[str, str]]:
        """These (name, namespace) of nodes, and those that the middleware has forgotten."""
        listed = frozenset(f"{namespace.rstrip('/')}/{name}" for name, namespace in nodes)
        self._left.update(dict.fromkeys(self._listed - listed, mono))
        self._left = {name: at for name, at in self._left.items() if mono < at + LEASE}
        self._listed = listed
        if not self._forgotten:
            return nodes
        split = (each.rpartition("/") for each in frozenset[str]().union(*self._forgotten.values()))
        found = {(name, namespace or "/") for namespace, _slash, name in split}
        return nodes + sorted(found.difference(nodes))
