"""Runs a fleet and all servers for hours: does anything grow, is anything lost?

Virtual robots break, flap, fall silent, crash and come back, their values and components change;
the exporter, Prometheus with the shipped rules, Alertmanager and a mail server run as in the demo;
a client scrapes every 5 s and reads the API; the configuration is reloaded every 10 minutes.

Sampled into soak.csv: memory, open files, threads and CPU time of each program, the exporter's
database, messages and scrapes. soak.md and soak.png come from it: the slope of each, with its 95 %
interval (least squares, after the warm-up). Messages lost are counted by their numbers, of the half
of the robots that never stops publishing. Ctrl-C ends it early and keeps what was measured;
--report makes soak.md and soak.png of a folder anew. --chaos is another test, see `chaos`.
"""

from __future__ import annotations

import argparse
import csv
import json
import os
import re
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any, TextIO

from bench.scraper import MESSAGES, REJECTED, SEQUENCE, ScrapeError, Scraper, total
from experiments import chaos, machine, soak_plot, soak_report, soak_scenario
from experiments.usage import megabytes, usage
from testbed import domains, http
from testbed.site import Site
from testbed.stack import Plan, running

SCRAPE_INTERVAL = 5.0
SAMPLE_INTERVAL = 30.0
RELOAD_INTERVAL = 600.0
PROGRAMS = {  # names in the result
    "ros-diagnostics-exporter": "exporter",
    "Prometheus": "prometheus",
    "Alertmanager": "alertmanager",
    "virtual-robots": "robots",
}


@dataclass
class Client:
    """Scrapes the exporter every 5 s in a thread, and counts."""

    address: str
    robots: frozenset[str]  # that never stop publishing
    scrapes: int = 0
    failed: int = 0
    longest: float = 0.0  # seconds
    messages: int = 0
    rejected: int = 0
    lost: dict[str, int] = field(default_factory=dict)
    _first: dict[str, int] = field(default_factory=dict)
    _stop: threading.Event = field(default_factory=threading.Event)

    @contextmanager
    def scraping(self) -> Iterator[None]:
        """Scrape until the block ends."""
        thread = threading.Thread(target=self._run)
        thread.start()
        try:
            yield
        finally:
            self._stop.set()
            thread.join()

    def _run(self) -> None:
        scraper, due = Scraper(self.address), time.monotonic()
        while not self._stop.wait(max(0.0, due - time.monotonic())):
            due += SCRAPE_INTERVAL
            begin = time.monotonic()
            try:
                text = scraper.text()
                http.get(self.address, "/api/v1/fleet", seconds=10.0)
            except (ScrapeError, http.Unanswered) as error:
                print(f"scrape failed: {error}", flush=True)
                self.failed += 1
            else:
                self._count(text)
            self.scrapes += 1
            self.longest = max(self.longest, time.monotonic() - begin)
        scraper.close()

    def _count(self, text: bytes) -> None:
        """Lost: how much more the messages' numbers grew than the number of messages received."""
        received = {robot.decode(): int(float(value)) for robot, value in MESSAGES.findall(text)}
        self.messages = sum(received.values())
        self.rejected = total(REJECTED, text)
        numbers: dict[str, int] = {}
        for name, value in SEQUENCE.findall(text):
            robot = name.decode()
            numbers[robot] = max(numbers.get(robot, 0), int(float(value)))
        for robot in self.robots & numbers.keys() & received.keys():
            ahead = numbers[robot] - received[robot]
            first = self._first.setdefault(robot, ahead)
            self.lost[robot] = ahead - first


class Sampler:
    """One row of soak.csv at a time."""

    def __init__(self, stack: Site, client: Client, folder: Path) -> None:
        self._stack = stack
        self._client = client
        self._folder = folder
        self._began = time.monotonic()

    @property
    def elapsed(self) -> float:
        """Seconds since the begin."""
        return time.monotonic() - self._began

    def row(self) -> dict[str, float]:
        """Read everything once.

        Raises:
            RuntimeError: A program has ended; the text has its last output.
        """
        row: dict[str, float] = {"seconds": round(self.elapsed, 1)}
        for server in self._stack.started:
            if server.name not in PROGRAMS:  # Grafana, where it is installed
                continue
            if not server.process.alive:
                raise RuntimeError(server.process.describe())
            row |= {
                f"{PROGRAMS[server.name]}_{name}": round(value, 3)
                for name, value in usage(server.process.pid)._asdict().items()
            }
        database = self._stack.exporter.database
        row["exporter_database"] = megabytes([database])
        row["exporter_wal"] = megabytes([Path(f"{database}-wal")])
        row["prometheus_scrapes"], row["prometheus_failed"] = self._scrapes_of_prometheus()
        client = self._client
        row |= {
            "scrapes": client.scrapes,
            "scrapes_failed": client.failed,
            "scrape_longest": round(client.longest, 3),
            "messages": client.messages,
            "rejected": client.rejected,
            "lost": sum(client.lost.values()),
            "lost_robots": sum(each != 0 for each in client.lost.values()),
        }
        return row | self._notified()

    def _notified(self) -> dict[str, float]:
        subjects = [mail.subject for mail in self._stack.inbox.mails()]
        faults = http.get_json(self._stack.addresses.exporter, "/api/v1/faults")["faults"]
        return {
            "mails_problem": sum("PROBLEM" in each for each in subjects),
            "mails_recovery": sum("RECOVERY" in each for each in subjects),
            "faults": len(faults),
        }

    def _scrapes_of_prometheus(self) -> tuple[float, float]:
        since = f"[{max(30, int(self.elapsed))}s]"
        up = f'up{{instance="{self._stack.addresses.exporter}"}}'
        samples = self._stack.query(f"sum(count_over_time({up}{since}))")
        succeeded = self._stack.query(f"sum(sum_over_time({up}{since}))")
        if not samples or not succeeded:
            return 0.0, 0.0
        return samples[0].value, samples[0].value - succeeded[0].value


def _reload(stack: Site, folder: Path, number: int) -> None:
    """Change fleet.yml, reload the other programs, change how many motors some robots have."""
    fleet = folder / "fleet.yml"
    text = re.sub(r"\n# reload \d+\n\Z", "\n", fleet.read_text())
    fleet.write_text(f"{text}# reload {number}\n")
    for server in (stack.prometheus, stack.alertmanager):
        server.process.signal(signal.SIGHUP)
    soak_scenario.write_settings(folder, motors=3 - number % 2)


def _progress(row: dict[str, float], seconds: float) -> str:
    return (
        f"{_clock(row['seconds'])} of {_clock(seconds)}: exporter {row['exporter_memory']:.1f} MB,"
        f" {row['exporter_files']} files, {row['exporter_threads']} threads;"
        f" {row['messages']:,} messages, {row['lost']} lost; {row['scrapes']} scrapes,"
        f" {row['scrapes_failed']} failed; {row['faults']} faults,"
        f" {row['mails_problem']}+{row['mails_recovery']} mails"
    )


def _clock(seconds: float) -> str:
    return f"{int(seconds) // 3600}:{int(seconds) // 60 % 60:02}:{int(seconds) % 60:02}"


def soak(options: argparse.Namespace, out: Path) -> None:
    """Run for the time, writing soak.csv; interrupted: as long as it lasted."""
    seconds = options.hours * 3600
    about: dict[str, Any] = machine.describe() | {
        "robots": options.robots,
        "hours": options.hours,
        "seed": options.seed,
        "sampled every": f"{options.interval:g} s",
    }
    with tempfile.TemporaryDirectory(prefix="soak-") as name:
        folder = Path(name)
        scenario = soak_scenario.write(folder, options.robots, seconds, options.seed)
        plan = Plan(1, options.seed, scenario, environment=domains.BETWEEN_MACHINES)
        with running(folder, plan) as stack:
            (out / "soak.json").write_text(json.dumps(about, indent=2) + "\n")
            steady = soak_scenario.fleet_of(options.robots).steady_robots()
            client = Client(stack.addresses.exporter, frozenset(steady))
            with client.scraping(), (out / "soak.csv").open("w", newline="") as file:
                sampler = Sampler(stack, client, folder)
                reload = partial(_reload, stack, folder)
                _sample(sampler, file, seconds, options.interval, reload)


def _sample(
    sampler: Sampler, file: TextIO, seconds: float, interval: float, reload: Callable[[int], None]
) -> None:
    """Write a row every ``interval`` seconds; call ``reload`` with its number when it is due."""
    writer: csv.DictWriter[str] | None = None
    reloads, due = 0, 0.0
    end = "\r" if sys.stdout.isatty() else "\n"
    pause = threading.Event()
    while sampler.elapsed < seconds:
        pause.wait(max(0.0, due - sampler.elapsed))
        due += interval
        row = sampler.row() | {"reloads": reloads}
        if writer is None:
            writer = csv.DictWriter(file, list(row))
            writer.writeheader()
        writer.writerow(row)
        file.flush()
        print(_progress(row, seconds), end=end, flush=True)
        if sampler.elapsed >= (reloads + 1) * RELOAD_INTERVAL:
            reloads += 1
            reload(reloads)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        "./run soak", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--hours", type=float, default=2.0)
    parser.add_argument("--robots", type=int, default=60, help="at least 10")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument(
        "--interval", type=float, default=SAMPLE_INTERVAL, help="seconds between two samples"
    )
    parser.add_argument("--out", type=Path, default=Path("build/soak"), help="folder of the result")
    parser.add_argument("--report", type=Path, metavar="FOLDER", help="only soak.md and soak.png")
    chaos.add_options(parser)
    return parser.parse_args()


def main() -> None:
    """Run, then report."""
    options = _options()
    if options.chaos:
        sys.exit(chaos.run(options.minutes, options.seed, options.out))
    out: Path = options.report or options.out
    if options.report is None:
        out.mkdir(parents=True, exist_ok=True)
        for number in (signal.SIGINT, signal.SIGTERM):  # SIGINT is ignored in a background job
            signal.signal(number, signal.default_int_handler)
        print(f"soak test in {out}, process {os.getpid()}", flush=True)
        with suppress(KeyboardInterrupt):
            soak(options, out)
    print(soak_report.write(out))
    soak_plot.draw(out)


if __name__ == "__main__":
    main()
