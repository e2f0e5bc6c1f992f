"""How a hostile robot or client affects the other robots and the scrapes.

Each attack meets a fresh exporter with 20 robots at 1 Hz, of 16 components each, over real DDS on
this machine, or with --zenoh through a router, which the hostile robot is connected to as well.
The exporter is scraped each second. First comes a case without an attack: each column beside a
value is its ratio to that.

  1  a robot publishes arrays of 276 kB, 60 a second
  2  a robot publishes 500 components with 200 equal keys each, once a second
  3  a robot publishes arrays of 2.8 MB, 20 a second
  4  2,000 robots more are offered each second and publish nothing; only with --zenoh
  7  520 connections ask for /metrics and do not read the answer
  7b the same with /api/v1/fleet
  8  the event log is full of long texts; 8 connections ask for all of it and do not read the answer

A scrape that fails counts as one of 10 s, the time-out. The age of a robot's last message is that
at the end of a scrape. "stops in" is measured while the attack goes on, and at most 10 s, after
which the exporter is killed.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import resource
import threading
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from bench.scraper import TIMEOUT, Scrape, ScrapeError, Scraper
from bench.sim import cpu_seconds
from bench.site import BenchSite, running
from testbed.polling import until
from testbed.processes import Process

ROBOTS = 20
HOSTILE = "hostile"
EVENTS = 10_000  # that the event log keeps
SETTLE = 60.0  # seconds that anything may take to begin
MOST_MEMORY = 6000.0  # MB of the exporter at which a case ends early


@dataclass(frozen=True)
class Attack:
    """What the attacker is (the arguments of an actor), and what has to be so before it begins."""

    what: str
    actor: tuple[str, ...]
    prepare: Callable[[Attacked], None] | None = None
    reports: int = 1  # that the actor has written when the attack counts as begun


@dataclass(frozen=True)
class Result:
    """What one case showed; ages in s, scrapes in ms, memory in MB, CPU in s per s.

    What could not be seen, because no scrape succeeded, is NaN.
    """

    up: float
    age_median: float
    age_max: float
    scraped: float
    p50: float
    p99: float
    memory: float
    cpu: float
    stop: float
    scrapes: int
    rejected: dict[str, int]
    hostile_arrays: int  # that the exporter received
    attacker: str
    fleet: str


COLUMNS = (  # of the table: title, field of Result, format
    ("robots up", "up", "{:.0f}"),
    ("age p50 s", "age_median", "{:.2f}"),
    ("max s", "age_max", "{:.1f}"),
    ("scraped", "scraped", "{:.0%}"),
    ("p50 ms", "p50", "{:.0f}"),
    ("p99 ms", "p99", "{:.0f}"),
    ("RSS MB", "memory", "{:.0f}"),
    ("CPU s/s", "cpu", "{:.2f}"),
    ("stops in s", "stop", "{:.1f}"),
)


class Attacked:
    """A fresh exporter, its fleet, and what attacks it."""

    def __init__(self, site: BenchSite, seconds: float) -> None:
        self._site = site
        self._seconds = seconds
        self.exporter = site.start(site.exporter).process
        self.address = site.exporter.address
        self.scraper = site.use(closing(Scraper(self.address)))
        self.fleet = self.start_actor("fleet", "WHERE", str(ROBOTS))

    def start_actor(self, kind: str, *arguments: str) -> Process:
        """Start one of `bench.actors`; WHERE and PORT are replaced by this site's."""
        places = {"WHERE": self._site.where, "PORT": self.address.rpartition(":")[2]}
        named = [places.get(argument, argument) for argument in arguments]
        return self._site.start_actor(kind, *named, seconds=self._seconds)

    def wait_until_ready(self) -> None:
        """Wait until each robot of the fleet is up."""
        self._site.exporter.wait_until_ready(SETTLE)
        self.wait_for(lambda scrape: robots_up(scrape) == ROBOTS, "all robots are up")

    def wait_for(self, condition: Callable[[Scrape], bool], what: str) -> None:
        """Scrape until a scrape succeeds and shows the condition."""

        def shown() -> bool:
            with suppress(ScrapeError):
                return condition(self.scraper.scrape())
            return False

        until(shown, what, SETTLE, every=0.5)

    def stop_exporter(self) -> float:
        """Stop the exporter and return the seconds it took; it is killed after 10."""
        begin = time.monotonic()
        self.exporter.stop()
        return time.monotonic() - begin


def fill_event_log(site: Attacked) -> None:
    """Let a robot flap until the event log is full, as far as the exporter lets it."""
    flapping = site.start_actor("arrays", "WHERE", "flapping")
    try:
        site.wait_for(lambda scrape: scrape.changes.get(HOSTILE, 0) >= EVENTS, "a full event log")
    except TimeoutError:
        print("attack 8: the robot could not fill the event log")
    flapping.stop()
    site.wait_for(lambda scrape: robots_up(scrape) == ROBOTS, "all robots are up again")


ATTACKS = {
    "1": Attack("276 kB at 60/s", ("arrays", "WHERE", "fast")),
    "2": Attack("equal keys", ("arrays", "WHERE", "equal-keys")),
    "3": Attack("2.8 MB at 20/s", ("arrays", "WHERE", "huge")),
    "4": Attack("ever more robots", ("keys", "WHERE")),
    "7": Attack("unread /metrics", ("readers", "PORT", "/metrics", "520"), reports=4),
    "7b": Attack("unread fleet", ("readers", "PORT", "/api/v1/fleet", "520"), reports=4),
    "8": Attack(
        "unread events", ("readers", "PORT", f"/api/v1/events?limit={EVENTS}", "8"), fill_event_log
    ),
}


OF_ZENOH = "4"


def is_hostile(robot: str) -> bool:
    """Whether it is of an attack: the hostile robot, or one that is only offered."""
    return robot.startswith(HOSTILE)


def robots_up(scrape: Scrape) -> int:
    """How many of the fleet's own robots are up."""
    return sum(up for robot, up in scrape.up.items() if not is_hostile(robot))


def run_case(attack: Attack | None, options: argparse.Namespace) -> Result:
    """Measure a fresh exporter under the attack, or without one."""
    lasting = options.seconds + 5 * SETTLE  # after which actors end by themselves
    with running(zenoh=options.zenoh, seconds=lasting) as bench:
        site = Attacked(bench, lasting)
        site.wait_until_ready()
        attacker = None
        if attack is not None:
            if attack.prepare is not None:
                attack.prepare(site)
            attacker = site.start_actor(*attack.actor)
            attacker.wait_for_output(rf"(.*\n){{{attack.reports}}}", SETTLE)
        return measure(site, attacker, options.seconds)


def measure(site: Attacked, attacker: Process | None, seconds: float) -> Result:
    """Scrape each second for so long, then stop the exporter."""
    pid = site.exporter.pid
    forget_peak_memory(pid)
    cpu, begin = cpu_seconds(pid), time.monotonic()
    scrapes = scrape_each_second(site, begin + seconds)
    cpu = (cpu_seconds(pid) - cpu) / (time.monotonic() - begin)
    memory = peak_megabytes(pid)
    done = "none" if attacker is None else last_line(attacker)  # before the exporter stops
    good = [scrape for scrape in scrapes if scrape is not None]
    times = [TIMEOUT if scrape is None else scrape.seconds for scrape in scrapes]
    ages = [age for each in good for robot, age in each.ages.items() if not is_hostile(robot)]
    return Result(
        up=min(map(robots_up, good), default=math.nan),
        age_median=median(ages) if ages else math.nan,
        age_max=max(ages, default=math.nan),
        scraped=len(good) / len(scrapes),
        p50=percentile(times, 0.5) * 1e3,
        p99=percentile(times, 0.99) * 1e3,
        memory=memory,
        cpu=cpu,
        stop=site.stop_exporter(),
        scrapes=len(scrapes),
        rejected=good[-1].rejected if good else {},
        hostile_arrays=good[-1].messages.get(HOSTILE, 0) if good else 0,
        attacker=done,
        fleet=last_line(site.fleet),
    )


def scrape_each_second(site: Attacked, deadline: float) -> list[Scrape | None]:
    """Scrape until the deadline, None where it failed; one that takes long delays the next."""
    scrapes: list[Scrape | None] = []
    due = time.monotonic()
    pause = threading.Event()
    while due < deadline:
        pause.wait(max(0.0, due - time.monotonic()))
        try:
            scrapes.append(site.scraper.scrape())
        except ScrapeError:
            scrapes.append(None)
        due = max(due + 1.0, time.monotonic())
        if not site.exporter.alive:
            raise RuntimeError(site.exporter.describe())
        if peak_megabytes(site.exporter.pid) > MOST_MEMORY:
            print(f"ended early: the exporter has taken more than {MOST_MEMORY:.0f} MB")
            break
    return scrapes


def percentile(values: list[float], part: float) -> float:
    """The nearest rank: of few values the 99th percentile is the largest."""
    return sorted(values)[math.ceil(part * len(values)) - 1]


def forget_peak_memory(pid: int) -> None:
    """Let the peak count from now on (proc(5), clear_refs)."""
    Path(f"/proc/{pid}/clear_refs").write_text("5")


def peak_megabytes(pid: int) -> float:
    """The most resident memory that the process has had."""
    status = Path(f"/proc/{pid}/status").read_text()
    return int(status.split("VmHWM:")[1].split()[0]) / 1024


def last_line(process: Process) -> str:
    """What an actor wrote last."""
    return process.output().splitlines()[-1]


def print_table(results: dict[str, Result]) -> None:
    """Print a line for each case, and below it what was rejected and what the attacker did."""
    baseline = next(iter(results.values()))
    lines = [f"{'':<20}" + "".join(f"{title:>10}{'':7}" for title, _, _ in COLUMNS)]
    for name, result in results.items():
        lines.append(
            f"{name:<20}" + "".join(_cell(result, baseline, *rest) for _, *rest in COLUMNS)
        )
    print("\n".join(line.rstrip() for line in lines))
    print()
    for name, result in results.items():
        counts = result.rejected.items()
        rejected = ", ".join(f"{reason} {count}" for reason, count in counts if count)
        print(f"{name}: {result.scrapes} scrapes; rejected: {rejected or 'nothing'}")
        print(f"    fleet: {result.fleet}; attacker: {result.attacker}")
        print(f"    arrays of the hostile robot that were received: {result.hostile_arrays}")


def _cell(result: Result, baseline: Result, field: str, form: str) -> str:
    value, reference = getattr(result, field), getattr(baseline, field)
    if math.isnan(value):
        return f"{'-':>10}{'':7}"
    ratio = value / reference if reference else math.nan
    times = f"x{ratio:.0f}" if ratio >= 10 else f"x{ratio:.2f}"
    return f"{form.format(value):>10}{times:>7}"


def print_header(seconds: float) -> None:
    """Print what the numbers depend on."""
    load = " ".join(f"{each:.2f}" for each in os.getloadavg())
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    print(f"{ROBOTS} robots, {seconds:g} s a case, scraped each second, {os.cpu_count()} cores")
    print(f"load average before: {load}; open files: {soft}, at most {hard}\n", flush=True)


def main() -> None:
    """Measure without an attack and under the chosen ones, and print the table."""
    parser = argparse.ArgumentParser(
        "./run bench hostile",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--seconds", type=float, default=20.0, help="of each case")
    parser.add_argument(
        "--attacks",
        type=lambda text: text.split(","),
        help="which, for example 1,2 (default: all)",
    )
    parser.add_argument("--zenoh", action="store_true", help="through a zenoh router")
    parser.add_argument("--json", type=Path, metavar="FILE", help="write the numbers there, too")
    options = parser.parse_args()
    if options.attacks is None:
        options.attacks = [each for each in ATTACKS if options.zenoh or each != OF_ZENOH]
    if OF_ZENOH in options.attacks and not options.zenoh:
        parser.error(f"attack {OF_ZENOH} needs --zenoh")
    if unknown := set(options.attacks) - set(ATTACKS):
        parser.error(f"no attack {min(unknown)}; there are {', '.join(ATTACKS)}")
    print_header(options.seconds)
    results = {"no attack": run_case(None, options)}
    for number in options.attacks:
        attack = ATTACKS[number]
        results[f"{number} {attack.what}"] = run_case(attack, options)
    print_table(results)
    if options.json is not None:
        cases = {name: asdict(result) for name, result in results.items()}
        options.json.write_text(json.dumps(cases, indent=2) + "\n")


if __name__ == "__main__":
    main()
