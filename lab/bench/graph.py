"""What it costs to watch the ROS graph of a fleet: an exporter with `graph: {mode: on}` and `off`.

First a real graph: robots of some nodes and 50 topics in one domain, from several processes, each
with one exporter and then the other, in turns; CPU is that of the whole process. A real graph of
1,000 such robots is 100,000 endpoints, more than two cores have a middleware for: of these what
the exporter does with the graph is measured alone, with a graph in memory, and what the middleware
takes for it is that of the real graph, for each node and topic. Endpoints are read by turns, for at
most so many points of a core as `sources/dds.py` allows (ROUND_SHARE); more topics have a longer
round.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable
from itertools import count
from typing import NamedTuple

import rclpy
from rclpy.context import Context

from bench.dds import BEGIN, LIMITS, SETTLE, measure, parser_for
from bench.scraper import robots_up
from bench.sim import resident_megabytes
from bench.site import BenchSite, running
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources.dds_endpoints import ROUND, ROUND_SHARE
from ros_diagnostics_exporter.sources.graph_topics import Peer, TopicView
from testbed import domains, http
from testbed.polling import until

WALL = 1_700_000_000.0
PROFILE = 'profiles: {{default: {{graph: {{mode: "{}"}}}}}}\n'
JUDGED = 120  # seconds of virtual time in which the graph in memory is judged
READ = 100  # topics read in one of them


class Middleware(NamedTuple):
    """CPU seconds that rclpy takes to name one node, and for the endpoints of one topic."""

    node: float
    topic: float


def start_robots(site: BenchSite, options: argparse.Namespace) -> None:
    """The real graph."""
    share = -(-options.robots // options.processes)
    actors = [
        site.start_actor(
            "graph",
            site.where,
            *map(str, (min(share, options.robots - first), options.topics, options.nodes)),
            f"--first={first}",
            seconds=4 * (BEGIN + options.seconds),
        )
        for first in range(0, options.robots, share)
    ]
    for each in actors:
        each.wait_for_output("nodes and endpoints", BEGIN)


def exporting(site: BenchSite, options: argparse.Namespace, mode: str) -> tuple[float, float]:
    """(cores, MB) of an exporter that has received all robots."""
    server = site.exporter
    server.config.write_text(site.config + PROFILE.format(mode))
    exporter, address = site.start(server).process, server.address
    try:

        def received() -> bool:
            count: int = options.robots
            return robots_up(http.get(address, "/metrics", seconds=60)) >= count

        server.wait_until_ready(BEGIN)
        until(received, exporter.describe, BEGIN, 1.0)
        time.sleep(SETTLE + ROUND)
        cpu, _of_middleware = measure(exporter, options.seconds)
        return cpu, resident_megabytes(exporter.pid)
    finally:
        exporter.stop()


def asking(options: argparse.Namespace, domain_id: int) -> Middleware:
    """What rclpy takes to answer a participant of the real graph."""
    os.environ.update(domains.environment(domain_id))
    context = Context()
    rclpy.init(context=context, domain_id=domain_id)
    node = rclpy.create_node("bench", context=context, start_parameter_services=False)
    nodes = options.robots * options.nodes
    topics = options.robots * options.topics
    until(lambda: len(node.get_node_names_and_namespaces()) >= nodes, "all nodes", BEGIN, 1.0)
    until(lambda: len(node.get_topic_names_and_types()) >= topics, "all topics", BEGIN, 1.0)
    names = [name for name, _types in node.get_topic_names_and_types()][:READ]
    of_nodes = _cpu(node.get_node_names_and_namespaces)

    def endpoints() -> None:
        for name in names:
            node.count_publishers(name)
            node.count_subscribers(name)
            node.get_publishers_info_by_topic(name)
            node.get_subscriptions_info_by_topic(name)

    of_topics = _cpu(endpoints)
    node.destroy_node()
    context.try_shutdown()
    return Middleware(of_nodes / nodes, of_topics / len(names))


def _cpu(work: Callable[[], object]) -> float:
    """CPU seconds of this thread."""
    begin = time.thread_time()
    work()
    return time.thread_time() - begin


class InMemory:
    """The graph of a large fleet, and the state that judges it."""

    def __init__(self, robots: int, topics: int, nodes: int, mode: str) -> None:
        profile = Profile(graph=Graph(mode=mode))  # type: ignore[arg-type]
        names = [f"robot_{number}" for number in range(robots)]
        found = tuple(
            Robot(
                each,
                namespace=f"/{each}",
                topic_agg=f"/{each}/diagnostics_agg",
                source=Source.AGG,
                profile=profile,
            )
            for each in names
        )
        self._mono = 0.0
        self.state = FleetState(Fleet("bench", found), self._now())
        self.nodes = [(f"node_{n}", f"/{each}") for each in names for n in range(nodes)]
        self.topics = [
            (
                f"/{each}/topic_{number}",
                TopicView(
                    (Peer(f"/{each}/node_{number % nodes}", f"{robot:024x}{number:08x}"),),
                    (Peer(f"/{each}/node_{(number + 1) % nodes}", f"{robot:024x}{number:08x}"),),
                ),
            )
            for robot, each in enumerate(names)
            for number in range(topics)
        ]

    def _now(self) -> Instant:
        return Instant(self._mono, WALL + self._mono)

    def run(self) -> tuple[float, float]:
        """CPU seconds: of one look at the nodes with its reports, of taking one topic.

        The first looks and the first round are left out: they find everything.
        """
        self.state.update_nodes(0, self.nodes, self._now())
        self.state.update_endpoints(0, dict(self.topics), self._now())
        looks = read = 0.0
        first = count(0, READ)
        for _ in range(JUDGED):
            self._mono += 1.0
            nodes = [(name, namespace) for name, namespace in self.nodes]
            at = next(first) % len(self.topics)
            topics = dict(self.topics[at : at + READ])
            looks += _cpu(lambda nodes=nodes: self.state.update_nodes(0, nodes, self._now()))  # type: ignore[misc]
            read += _cpu(lambda topics=topics: self.state.update_endpoints(0, topics, self._now()))  # type: ignore[misc]
        return looks / JUDGED, read / JUDGED / READ


def print_large(options: argparse.Namespace, middleware: Middleware) -> None:
    """What the large fleet costs."""
    robots, topics, nodes = options.large, options.topics, options.nodes_of_large
    looks, each = InMemory(robots, topics, nodes, "on").run()
    without, _none = InMemory(robots, topics, nodes, "off").run()
    naming = middleware.node * robots * nodes
    a_round = robots * topics * (middleware.topic + each) / ROUND_SHARE
    print(f"\n{robots} robots of {nodes} nodes and {topics} topics, in one domain")
    print(f"{'asking for all nodes (rclpy)':<44}{naming:>7.1%}")
    print(f"{'judging them, reports':<44}{looks:>7.1%}   {without:.1%} with off")
    share = min(ROUND_SHARE, robots * topics * (middleware.topic + each) / ROUND)
    print(f"{'reading endpoints':<44}{share:>7.1%}   at most {ROUND_SHARE:.0%}")
    print(f"{'together, of a core':<44}{naming + looks - without + share:>7.1%}")
    print(f"a round through all topics takes {max(ROUND, a_round):.0f} s")


def main() -> None:
    """Print the real graph's cost, then the large one's."""
    parser = parser_for("graph", __doc__)
    parser.set_defaults(robots=100)
    parser.add_argument("--topics", type=int, default=50, help="of each robot")
    parser.add_argument("--nodes", type=int, default=4, help="of each robot of the real graph")
    parser.add_argument("--large", type=int, default=1000, help="robots of the graph in memory")
    parser.add_argument("--nodes-of-large", type=int, default=16)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each exporter")
    parser.add_argument("--turns", type=int, default=2)
    options = parser.parse_args()
    with running(seconds=0, more=LIMITS) as site:
        start_robots(site, options)
        print(f"{options.robots} robots of {options.nodes} nodes and {options.topics} topics")
        print(f"{'graph':<10}{'CPU':>7}{'MB':>6}")
        for mode in ("off", "on") * options.turns:
            cpu, resident = exporting(site, options, mode)
            print(f"{mode:<10}{cpu:>7.1%}{resident:>6.0f}", flush=True)
        middleware = asking(options, site.domain_id)
        print(
            f"rclpy takes {1e6 * middleware.node:.1f} us for a node,"
            f" {1e6 * middleware.topic:.0f} us for a topic's endpoints"
        )
    print_large(options, middleware)


if __name__ == "__main__":
    main()
