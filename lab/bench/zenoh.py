"""What receiving a whole fleet through a zenoh router costs, beside the same over DDS.

The exporter and the robots are those of `./run bench dds`, each robot a key of a few sessions at
one router. Each case runs over DDS and then through the router; the ratio is that of the CPU that
the exporter takes for a message, user and system time of all its threads.
"""

from __future__ import annotations

from bench.dds import CHANGING, Cost, exporting, parser_for

CASES = ("nothing changes", "every value changes")


def main() -> None:
    """Print two lines for each case."""
    parser = parser_for("zenoh", __doc__)
    parser.add_argument("--seconds", type=float, default=60.0, help="of each measurement")
    options = parser.parse_args()
    processes = f"in {options.processes} processes"
    print(f"{options.robots} robots at 1 Hz {processes}, {options.seconds:g} s a measurement")
    columns = f"{'us/msg':>8}{'of DDS':>8}{'threads':>9}{'msg/s':>8}{'MB':>6}{'peak':>6}{'lost':>6}"
    print(f"{'':<28}{columns}")
    for what in CASES:
        dds, fleet = exporting(options, CHANGING[what])
        print_row(f"{what}, DDS", dds, dds, fleet.sent)
        zenoh, fleet = exporting(options, CHANGING[what], zenoh=True)
        print_row(f"{what}, zenoh", zenoh, dds, fleet.sent)


def print_row(what: str, cost: Cost, dds: Cost, sent: int) -> None:
    """One measurement, beside that over DDS."""
    each = cost.cpu / cost.rate
    print(
        f"{what:<28}{each * 1e6:>8.0f}{each * dds.rate / dds.cpu:>8.2f}"
        f"{cost.middleware / cost.cpu:>9.0%}{cost.rate:>8.0f}"
        f"{cost.resident:>6.0f}{cost.peak:>6.0f}{sent - cost.received:>6}",
        flush=True,
    )


if __name__ == "__main__":
    main()
