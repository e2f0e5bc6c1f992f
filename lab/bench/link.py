"""What a robot's link carries with zenoh: one robot, its bridge, and a router in another network.

The robot publishes an array of 16 components with 64 values once a second over DDS; bridge and
router are the real ones (./run demo --zenoh builds them); a client subscribes as the exporter does.
Counted are the bytes on the link in both directions, with the headers of IP and TCP and without
those of Ethernet.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from support import subnets
from testbed import domains, zenoh
from testbed.configuration import CHECKOUT
from testbed.polling import until

HOSTS = ("robot", "office")
ENDPOINT = "tcp/10.77.{}.1:7447"
PYTHONPATH = ":".join(str(CHECKOUT / each) for each in ("lab", "tests"))  # as ./run sets it
ETHERNET = 14  # bytes of a frame's header
BEGIN = 180.0  # seconds until messages arrive
SUBSCRIBE = """
import sys
from bench.actors.pace import ticks
from support.zenoh_robots import session
session = session("client", connect=[sys.argv[1]])
count = 0
def note(_sample):
    global count
    count += 1
subscribed = session.declare_subscriber("robot/**", note)
for _ in ticks(1, float(sys.argv[2])):
    print(f"{count} received", flush=True)
"""
COMPRESSION = {"transport": {"unicast": {"compression": {"enabled": True}}}}
SELDOM = {"pub_max_frequencies": [".*/diagnostics_agg=0.5"]}
NOTHING = {"allow": {"publishers": ["/none"]}}
CASES: dict[str, tuple[dict[str, Any], dict[str, Any]]] = {  # of zenoh's config, of the plugin's
    "/diagnostics_agg": ({}, {}),
    "with compression": (COMPRESSION, {}),
    "pub_max_frequencies 0.5": ({}, SELDOM),
    "both": (COMPRESSION, SELDOM),
    "nothing published": ({}, NOTHING),
}


def measure(config: dict[str, Any], plugin: dict[str, Any], seconds: float) -> tuple[float, float]:
    """(bytes, messages) a second of one case."""
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        domain_id = stack.enter_context(domains.lease())
        network = subnets.Subnets(stack, folder, HOSTS, subnets.APART)
        local = domains.environment(domain_id) | {"PYTHONPATH": PYTHONPATH}
        argv = zenoh.router(folder / "zenohd.json5", "tcp/0.0.0.0:7447")
        _change(folder / "zenohd.json5", config, {})
        network.start("", argv, local)
        argv = zenoh.bridge(folder / "bridge.json5", ENDPOINT.format(1), domain_id, "/robot")
        _change(folder / "bridge.json5", config, plugin)
        network.start("robot", argv, zenoh.on_loopback(local))
        lasting = str(2 * BEGIN + seconds)
        actor = [sys.executable, "-m", "bench.actors", "fleet", str(domain_id), "1", lasting]
        robot = network.start("robot", actor, local)
        argv = [sys.executable, "-c", SUBSCRIBE, ENDPOINT.format(2), lasting]
        office = network.start("office", argv, local)
        if plugin is not NOTHING:
            robot.wait_for_output("turn 5", BEGIN)
        until(lambda: "received" in office.output(), office.describe, BEGIN)
        before, received = _carried(network), _received(office.output())
        begin = time.monotonic()
        time.sleep(seconds)
        took = time.monotonic() - begin
        messages = _received(office.output()) - received
        return (_carried(network) - before) / took, messages / took


def _change(path: Path, config: dict[str, Any], plugin: dict[str, Any]) -> None:
    """Add to the config in a file."""
    found = json.loads(path.read_text()) | config
    if plugin:
        found["plugins"]["ros2dds"] |= plugin
    path.write_text(json.dumps(found))


def _received(output: str) -> int:
    return int(output.splitlines()[-1].split()[0])


def _carried(network: subnets.Subnets) -> int:
    """The bytes that the robot's link has carried until now."""
    [link] = json.loads(network.output("", "ip", "-json", "-stats", "link", "show", "to1"))
    ways = link["stats64"]["rx"], link["stats64"]["tx"]
    return sum(each["bytes"] - ETHERNET * each["packets"] for each in ways)


def main() -> None:
    """Print a line for each case."""
    parser = argparse.ArgumentParser(
        "./run bench link",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seconds", type=float, default=60.0, help="of each case")
    options = parser.parse_args()
    print(f"{'':<26}{'msg/s':>7}{'bytes/s':>9}{'MB/h':>7}")
    for what, (config, plugin) in CASES.items():
        carried, messages = measure(config, plugin, options.seconds)
        line = f"{what:<26}{messages:>7.2f}{carried:>9.0f}{carried * 3600 / 1e6:>7.1f}"
        print(line, flush=True)


if __name__ == "__main__":
    main()
