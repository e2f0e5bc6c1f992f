"""How fast a recording is judged: one robot, 16 components of 4 values each, every value changing.

An array a second, as its aggregator publishes it; one component fails now and then.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from bench.robots import aggregated_array
from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from support.bags import judged, write_bag

TOPIC = "/robot_1/diagnostics_agg"
FLEET = Fleet("bench", (Robot("robot_1", topic_agg=TOPIC, source=Source.AGG),))


def main() -> None:
    """Print seconds and ratio for both storages."""
    parser = argparse.ArgumentParser(prog="./run bench backtest", description=__doc__)
    parser.add_argument("--hours", type=float, default=4.0, help="of recording (default: 4)")
    seconds = int(parser.parse_args().hours * 3600)
    rows = [
        (float(at), TOPIC, aggregated_array(at, level=2 * (at % 600 < 60), of={3}).statuses)
        for at in range(seconds)
    ]
    print(f"{seconds / 3600:g} h of one robot, {seconds:,} messages")
    for storage in ("sqlite3", "mcap"):
        with tempfile.TemporaryDirectory() as folder:
            bag = write_bag(Path(folder) / "bag", rows, storage)
            begin, cpu = time.perf_counter(), time.process_time()
            result = judged(FLEET, bag)
            wall, used = time.perf_counter() - begin, time.process_time() - cpu
        faults = len(result.notifications)
        print(
            f"{storage:8} {faults} faults, {wall:.1f} s ({used:.1f} s of CPU): "
            f"{seconds / wall:,.0f} times real time ({seconds / used:,.0f} by CPU)"
        )


if __name__ == "__main__":
    main()
