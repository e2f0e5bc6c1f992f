"""The actors' command line; `bench.hostile` starts them."""

from __future__ import annotations

import argparse

from bench.actors.publishing import FLOODS, publish_fleet, publish_flood
from bench.actors.reading import hold_unread


def main() -> None:
    """Run one of them."""
    parser = argparse.ArgumentParser("python -m bench.actors", description=__doc__)
    kinds = parser.add_subparsers(dest="kind", required=True)
    fleet = kinds.add_parser("fleet", help="normal robots")
    fleet.add_argument("domain_id", type=int)
    fleet.add_argument("robots", type=int)
    fleet.add_argument("--first", type=int, default=0, help="number of the first robot")
    arrays = kinds.add_parser("arrays", help="a hostile robot")
    arrays.add_argument("domain_id", type=int)
    arrays.add_argument("flood", choices=FLOODS)
    readers = kinds.add_parser("readers", help="clients that do not read their answers")
    readers.add_argument("port", type=int)
    readers.add_argument("path")
    readers.add_argument("count", type=int)
    for each in (fleet, arrays, readers):
        each.add_argument("seconds", type=float, help="after which it ends")
    options = parser.parse_args()
    if options.kind == "fleet":
        publish_fleet(options.domain_id, options.robots, options.seconds, options.first)
    elif options.kind == "arrays":
        publish_flood(options.domain_id, options.flood, options.seconds)
    else:
        hold_unread(options.port, options.path, options.count, options.seconds)


if __name__ == "__main__":
    main()
