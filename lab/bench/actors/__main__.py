"""The actors' command line; `bench.hostile` starts them."""

from __future__ import annotations

import argparse

from bench.actors.graph import publish_graph
from bench.actors.publishing import ALL, FLOODS, publish_fleet, publish_flood
from bench.actors.reading import hold_unread
from bench.actors.taking import take_fleet
from bench.actors.zenoh import offer_keys, route

WHERE = "ROS domain, or endpoint of a zenoh router"


def main() -> None:
    """Run one of them."""
    parser = argparse.ArgumentParser("python -m bench.actors", description=__doc__)
    kinds = parser.add_subparsers(dest="kind", required=True)
    fleet = kinds.add_parser("fleet", help="normal robots")
    fleet.add_argument("where", help=WHERE)
    fleet.add_argument("robots", type=int)
    fleet.add_argument("--first", type=int, default=0, help="number of the first robot")
    fleet.add_argument(
        "--changing", type=int, default=len(ALL), help="components whose values change each second"
    )
    graph = kinds.add_parser("graph", help="robots with many nodes and topics")
    graph.add_argument("domain_id", type=int)
    graph.add_argument("robots", type=int)
    graph.add_argument("topics", type=int, help="of each robot")
    graph.add_argument("nodes", type=int, help="of each robot")
    graph.add_argument("--first", type=int, default=0, help="number of the first robot")
    taker = kinds.add_parser("taker", help="a subscriber of a fleet that decodes nothing")
    taker.add_argument("domain_id", type=int)
    taker.add_argument("robots", type=int)
    arrays = kinds.add_parser("arrays", help="a hostile robot")
    arrays.add_argument("where", help=WHERE)
    arrays.add_argument("flood", choices=FLOODS)
    router = kinds.add_parser("router", help="a zenoh router")
    router.add_argument("endpoint")
    keys = kinds.add_parser("keys", help="a zenoh session that offers ever more robots")
    keys.add_argument("endpoint")
    readers = kinds.add_parser("readers", help="clients that do not read their answers")
    readers.add_argument("port", type=int)
    readers.add_argument("path")
    readers.add_argument("count", type=int)
    for each in (fleet, graph, taker, arrays, router, keys, readers):
        each.add_argument("seconds", type=float, help="after which it ends")
    options = parser.parse_args()
    if options.kind == "fleet":
        robots = range(options.first, options.first + options.robots)
        publish_fleet(options.where, robots, options.seconds, range(options.changing))
    elif options.kind == "graph":
        robots = range(options.first, options.first + options.robots)
        publish_graph(options.domain_id, robots, options.topics, options.nodes, options.seconds)
    elif options.kind == "taker":
        take_fleet(options.domain_id, options.robots, options.seconds)
    elif options.kind == "arrays":
        publish_flood(options.where, options.flood, options.seconds)
    elif options.kind == "router":
        route(options.endpoint, options.seconds)
    elif options.kind == "keys":
        offer_keys(options.endpoint, options.seconds)
    else:
        hold_unread(options.port, options.path, options.count, options.seconds)


if __name__ == "__main__":
    main()
