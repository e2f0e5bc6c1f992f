"""The actors' command line; `bench.hostile` starts them."""

from __future__ import annotations

import argparse
from typing import Any

from bench.actors.asking import answer_slowly, guess_passwords
from bench.actors.graph import publish_graph
from bench.actors.inventing import invent, publish_large
from bench.actors.publishing import ALL, FLOODS, publish_fleet, publish_flood, publish_joints
from bench.actors.reading import hold_unread
from bench.actors.taking import take_fleet
from bench.actors.zenoh import offer_keys, route

WHERE = "ROS domain, or endpoint of a zenoh router"


def main() -> None:
    """Run one of them."""
    parser = argparse.ArgumentParser("python -m bench.actors", description=__doc__)
    kinds = parser.add_subparsers(required=True)
    _add_fleets(kinds)
    _add_hostile(kinds)
    for each in kinds.choices.values():
        each.add_argument("seconds", type=float, help="after which it ends")
    options = parser.parse_args()
    options.run(options)


def _add_fleets(kinds: Any) -> None:
    """Normal robots, and what connects or takes them."""
    fleet = kinds.add_parser("fleet", help="normal robots")
    fleet.add_argument("where", help=WHERE)
    fleet.add_argument("robots", type=int)
    fleet.add_argument("--first", type=int, default=0, help="number of the first robot")
    fleet.add_argument(
        "--changing", type=int, default=len(ALL), help="components whose values change each second"
    )
    fleet.set_defaults(
        run=lambda o: publish_fleet(o.where, _robots(o), o.seconds, range(o.changing))
    )
    graph = kinds.add_parser("graph", help="robots with many nodes and topics")
    graph.add_argument("domain_id", type=int)
    graph.add_argument("robots", type=int)
    graph.add_argument("topics", type=int, help="of each robot")
    graph.add_argument("nodes", type=int, help="of each robot")
    graph.add_argument("--first", type=int, default=0, help="number of the first robot")
    graph.set_defaults(
        run=lambda o: publish_graph(o.domain_id, _robots(o), o.topics, o.nodes, o.seconds)
    )
    joints = kinds.add_parser("joints", help="robots without diagnostics")
    joints.add_argument("where", help="ROS domain")
    joints.add_argument("robots", type=int)
    joints.add_argument("rate", type=float, help="messages a second of each robot")
    joints.add_argument("--first", type=int, default=0, help="number of the first robot")
    joints.set_defaults(run=lambda o: publish_joints(o.where, _robots(o), o.rate, o.seconds))
    taker = kinds.add_parser("taker", help="a subscriber of a fleet that decodes nothing")
    taker.add_argument("domain_id", type=int)
    taker.add_argument("robots", type=int)
    taker.set_defaults(run=lambda o: take_fleet(o.domain_id, o.robots, o.seconds))
    router = kinds.add_parser("router", help="a zenoh router")
    router.add_argument("endpoint")
    router.set_defaults(run=lambda o: route(o.endpoint, o.seconds))


def _add_hostile(kinds: Any) -> None:
    """Those that attack."""
    arrays = kinds.add_parser("arrays", help="a hostile robot")
    arrays.add_argument("where", help=WHERE)
    arrays.add_argument("flood", choices=FLOODS)
    arrays.set_defaults(run=lambda o: publish_flood(o.where, o.flood, o.seconds))
    newcomers = kinds.add_parser("newcomers", help="robots that are invented")
    newcomers.add_argument("where", help=WHERE)
    newcomers.set_defaults(run=lambda o: invent(o.where, o.seconds))
    large = kinds.add_parser("large", help="robots with a few large arrays each")
    large.add_argument("where", help=WHERE)
    large.add_argument("topics", type=int)
    large.add_argument("arrays", type=int, help="of each topic")
    large.set_defaults(run=lambda o: publish_large(o.where, o.topics, o.arrays, o.seconds))
    keys = kinds.add_parser("keys", help="a zenoh session that offers ever more robots")
    keys.add_argument("endpoint")
    keys.set_defaults(run=lambda o: offer_keys(o.endpoint, o.seconds))
    readers = kinds.add_parser("readers", help="clients that do not read their answers")
    readers.add_argument("port", type=int)
    readers.add_argument("path")
    readers.add_argument("count", type=int)
    readers.set_defaults(run=lambda o: hold_unread(o.port, o.path, o.count, o.seconds))
    guessing = kinds.add_parser("passwords", help="a client that guesses passwords")
    guessing.add_argument("port", type=int)
    guessing.set_defaults(run=lambda o: guess_passwords(o.port, o.seconds))
    slow = kinds.add_parser("slow", help="a server that sends a header one byte at a time")
    slow.add_argument("address")
    slow.set_defaults(run=lambda o: answer_slowly(o.address, o.seconds))


def _robots(options: argparse.Namespace) -> range:
    return range(options.first, options.first + options.robots)


if __name__ == "__main__":
    main()
