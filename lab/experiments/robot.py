"""What monitoring costs a robot: CPU, memory and network of the robot itself.

A virtual robot (ten components, driver and aggregator, 1 Hz) in a network of its own, joined to the
monitoring by a virtual cable whose bytes the kernel counts; needs root and `ip`. In turn, in random
order, again and again: nobody listens; the exporter is attached; a fresh subscriber process takes
one message every 10 s, as the 2014 thesis did every 1 and 5 minutes. Each is compared with nobody
listening in the same block. What a poll costs does not depend on how often it comes, so the cost at
1 and 5 minutes is computed from that of one poll.
"""

from __future__ import annotations

import itertools
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from math import sqrt
from pathlib import Path
from random import Random
from statistics import mean, stdev

from experiments import plots, results
from experiments.results import Results, table
from experiments.site import started
from experiments.usage import usage
from testbed import programs
from testbed.polling import until
from testbed.site import Site

NAME = "robot"
ARMS = ("none", "exporter", "polled")
PERIOD = 20.0  # seconds of an arm
POLL_INTERVAL = 10.0
INTERVALS = (("10 s", 10.0), ("minute", 60.0), ("5 minutes", 300.0))
SETTLE = 8.0  # seconds after an arm has begun: discovery is over
QUANTITIES = (  # column, title, unit, digits
    ("cpu", "CPU", "ms/s", 2),
    ("sent", "sent", "B/s", 0),
    ("received", "received", "B/s", 0),
)


@dataclass(frozen=True)
class Cable:
    """A network namespace of the robot, and the host's end of the link to it."""

    namespace: str
    interface: str

    def counters(self) -> tuple[int, int]:
        """Return the bytes that the robot has sent and received."""
        folder = Path("/sys/class/net", self.interface, "statistics")
        names = ("rx_bytes", "tx_bytes")  # of the host's end
        sent, received = (int((folder / name).read_text()) for name in names)
        return sent, received


@contextmanager
def cable() -> Iterator[Cable]:
    """Make the namespace and the link; removed at the end.

    Raises:
        SystemExit: No right to, or no `ip`.
    """
    if os.geteuid() != 0 or shutil.which("ip") is None:
        sys.exit("this experiment gives the robot a network of its own: it needs root and `ip`")
    made = Cable(f"robot-{os.getpid()}", f"rbt{os.getpid()}")
    network = f"10.{os.getpid() % 200 + 20}.77"
    peer = f"{made.interface}p"
    inside = ("netns", "exec", made.namespace, "ip")
    _ip("netns", "add", made.namespace)
    try:
        _ip("link", "add", made.interface, "type", "veth", "peer", "name", peer)
        _ip("link", "set", peer, "netns", made.namespace)
        _ip("addr", "add", f"{network}.1/24", "dev", made.interface)
        _ip("link", "set", made.interface, "up")
        _ip(*inside, "addr", "add", f"{network}.2/24", "dev", peer)
        _ip(*inside, "link", "set", peer, "up")
        _ip(*inside, "link", "set", "lo", "up")
        yield made
    finally:
        _ip("netns", "delete", made.namespace)  # and with it the link


def _ip(*arguments: str) -> None:
    subprocess.run(["ip", *arguments], check=True)


class Place:
    """The robot, and what is done to it."""

    def __init__(self, site: Site, link: Cable) -> None:
        self.link = link
        self._site = site
        fleet = site.write(
            "fleet.yml",
            "fleet: bench\ndiscovery:\n"
            f'  - {{topic: "/{{robot}}/diagnostics_agg", domain_ids: [{site.domain_id}]}}\n',
        )
        self._exporter = site.make_exporter(fleet)
        inside = ["ip", "netns", "exec", link.namespace]
        argv = inside + programs.virtual_robots(1, 1, site.domain_id)
        self.robot = site.start_program("robot", argv, domain_id=site.domain_id).process
        self.robot.wait_for_output("ready: .*\n", 60)

    @contextmanager
    def attached(self) -> Iterator[None]:
        """Have the exporter subscribed."""
        process = self._site.start(self._exporter).process
        try:
            until(self._exporter.receives, process.describe, 60)
            yield
        finally:
            process.stop()

    def poll(self) -> float:
        """Take one message with a fresh process; return the CPU seconds that it used.

        Raises:
            RuntimeError: It got none.
        """
        plugin = Path(__file__).with_name("check_by_subscription.py")
        before = os.times()
        argv = [sys.executable, str(plugin), "-H", "robot_1"]
        done = subprocess.run(
            argv, env=self._site.environment(), check=False, capture_output=True, text=True
        )
        if "sensors" not in done.stdout:
            raise RuntimeError(f"the poll failed: {done.stdout}{done.stderr}")
        after = os.times()
        user = after.children_user - before.children_user
        return user + after.children_system - before.children_system


def _cpu(pid: int) -> float:
    """Return the CPU seconds of a process' threads, to a microsecond."""
    tasks = Path(f"/proc/{pid}/task").iterdir()
    return sum(int((task / "schedstat").read_text().split()[0]) for task in tasks) / 1e9


def measure_arm(place: Place, arm: str) -> dict[str, float | str]:
    """Measure one arm for its period: a second's CPU in ms, bytes a second, MB."""
    pause = threading.Event()
    with place.attached() if arm == "exporter" else ExitStack():
        pause.wait(SETTLE)
        began = time.monotonic()
        cpu, (sent, received) = _cpu(place.robot.pid), place.link.counters()
        polls, used = 0, 0.0
        while arm == "polled" and polls < PERIOD / POLL_INTERVAL:
            pause.wait(max(0.0, began + polls * POLL_INTERVAL + 1.0 - time.monotonic()))
            used += place.poll()
            polls += 1
        pause.wait(max(0.0, began + PERIOD - time.monotonic()))
        seconds = time.monotonic() - began
        now_sent, now_received = place.link.counters()
        return {
            "arm": arm,
            "seconds": round(seconds, 2),
            "cpu": round((_cpu(place.robot.pid) - cpu) / seconds * 1e3, 3),
            "sent": round((now_sent - sent) / seconds, 1),
            "received": round((now_received - received) / seconds, 1),
            "memory": round(usage(place.robot.pid).memory, 2),
            "polls": polls,
            "poll_cpu": round(used / polls, 3) if polls else "",
        }


def measure(block: int, seed: int) -> Iterator[dict[str, float | str]]:
    """Yield the three arms of a block, in random order, of a fresh robot."""
    order = Random(f"{seed} {block}").sample(ARMS, len(ARMS))
    with started() as site:
        place = Place(site, site.use(cable()))
        threading.Event().wait(SETTLE)
        rows = [measure_arm(place, arm) for arm in order]
    for row in rows:
        yield {"block": block, **row}


def _blocks(result: Results) -> list[dict[str, dict[str, str]]]:
    """Return the complete blocks: arm -> row."""
    rows = sorted(result.rows(), key=lambda row: int(row["block"]))
    groups = itertools.groupby(rows, key=lambda row: row["block"])
    blocks = [{row["arm"]: row for row in group} for _, group in groups]
    return [block for block in blocks if len(block) == len(ARMS)]


def _margin(found: list[float]) -> float:
    """Return half the width of the mean's 95 % interval; NaN of one value."""
    return 1.96 * stdev(found) / sqrt(len(found)) if len(found) > 1 else float("nan")


def _spread(found: list[float], digits: int, *, sign: bool = False) -> str:
    return f"{mean(found):{'+' if sign else ''}.{digits}f} ± {_margin(found):.{digits}f}"


def extra(
    blocks: list[dict[str, dict[str, str]]], column: str, interval: float = 0.0
) -> list[float]:
    """Return by how much a column is above nobody listening, block by block.

    Of the exporter attached, or with ``interval`` of a poll every so many seconds.
    """
    if not interval:
        return [_above(block, "exporter", column) for block in blocks]
    return [each / interval for each in per_poll(blocks, column)]


def per_poll(blocks: list[dict[str, dict[str, str]]], column: str) -> list[float]:
    """Return what one poll costs the robot, block by block: ms of CPU, or bytes."""
    return [
        _above(block, "polled", column)
        * float(block["polled"]["seconds"])
        / float(block["polled"]["polls"])
        for block in blocks
    ]


def _above(block: dict[str, dict[str, str]], arm: str, column: str) -> float:
    return float(block[arm][column]) - float(block["none"][column])


def render(result: Results) -> str:
    """Write the tables and the plot."""
    blocks = _blocks(result)
    _plot(result, blocks)
    return result.write_markdown(_table(blocks), _polls(blocks))


def _table(blocks: list[dict[str, dict[str, str]]]) -> list[str]:
    rows = [{"what": "nobody listens"}, {"what": "more with the exporter attached"}]
    rows += [{"what": f"more with a poll every {title}"} for title, _ in INTERVALS]
    for column, _, unit, digits in QUANTITIES:
        alone = [float(block["none"][column]) for block in blocks]
        rows[0][column] = f"{_spread(alone, digits)} {unit}"
        for row, interval in zip(rows[1:], (0.0, *(each for _, each in INTERVALS)), strict=True):
            found = extra(blocks, column, interval)
            row[column] = f"{_spread(found, max(digits, 1), sign=True)} {unit}"
    for row, arm in zip(rows, ARMS, strict=False):
        row["memory"] = f"{mean(float(block[arm]['memory']) for block in blocks):.1f} MB"
    titles = [("", "what"), *((title, column) for column, title, *_ in QUANTITIES)]
    titles.append(("memory", "memory"))
    return table(rows, [(name, partial(_cell, key)) for name, key in titles])


def _cell(key: str, row: Mapping[str, str]) -> str:
    return row.get(key, "")


def _polls(blocks: list[dict[str, dict[str, str]]]) -> list[str]:
    used = [float(block["polled"]["poll_cpu"]) for block in blocks]
    cpu, sent, received = (per_poll(blocks, column) for column, *_ in QUANTITIES)
    text = (
        f"{len(blocks)} blocks; ± is the 95 % interval of the mean. A poll costs the robot"
        f" {_spread(cpu, 1)} ms of CPU, {_spread([each / 1e3 for each in sent], 1)} kB sent and"
        f" {_spread([each / 1e3 for each in received], 1)} kB received, and the server"
        f" {_spread(used, 2)} s of CPU."
    )
    return [text]


def _plot(result: Results, blocks: list[dict[str, dict[str, str]]]) -> None:
    bars = (("exporter\nattached", 0.0), *((f"poll every\n{name}", at) for name, at in INTERVALS))
    with plots.figure(result.path(".png"), 1, 2) as (cpu, network):
        for axes, columns, unit in (
            (cpu, (("cpu", "CPU"),), "more CPU of the robot, ms/s"),
            (network, (("sent", "sent"), ("received", "received")), "more network, B/s"),
        ):
            width = 0.8 / len(columns)
            for number, (column, title) in enumerate(columns):
                found = [extra(blocks, column, interval) for _, interval in bars]
                margins = [_margin(each) for each in found]
                places = [n + number * width for n in range(len(bars))]
                axes.bar(
                    places,
                    [mean(each) for each in found],
                    width * 0.9,
                    yerr=margins,
                    color=plots.COLORS[number],
                    ecolor=plots.TEXT,
                    label=title,
                    capsize=3,
                )
            axes.set_xticks([n + width * (len(columns) - 1) / 2 for n in range(len(bars))])
            axes.set_xticklabels([title for title, _ in bars])
            axes.set_ylabel(unit)
            axes.axhline(0, color=plots.TEXT, linewidth=0.8)
        network.legend()


def main() -> None:
    """Measure the blocks; write the result."""
    parser = results.parser(NAME, __doc__ or "")
    parser.add_argument("--blocks", type=int, default=12, help="of all three, about 100 s each")
    parser.add_argument("--first", type=int, default=1, help="number of the first block")
    options = parser.parse_args()
    cases = range(options.first, options.first + options.blocks)
    results.run(
        Results(options.out, NAME),
        options,
        cases,
        lambda block: measure(block, options.seed),
        render,
    )


if __name__ == "__main__":
    main()
