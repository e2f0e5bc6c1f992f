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

  history     100 components with long texts change their levels ten times a second, for a minute at
              least; what is kept is the begin of another robot's fault
  memory      200 topics with two arrays of 4 MB each; and a minute later
  recordings  a robot publishes arrays of 0.9 MB, 20 a second; what is kept are the messages in the
              recording of another robot's fault
  newcomers   seven robots with new names a second, each for some seconds, for five minutes at least
  passwords   a client guesses ten passwords a second, for half a minute at least; what is kept is
              the count, and a line of the log a minute
  slow        the Alertmanager sends a header one byte at a time; what is kept is the time limit of
              `status --timeout 5s`, which asks it, too

Each case has bounds. They are printed with what was measured; one that does not hold makes the exit
code 1.

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
import sys
import threading
import time
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median

from bench.attacks import (
    ATTACKS,
    HOSTILE,
    OF_ZENOH,
    ROBOTS,
    SETTLE,
    Attack,
    Attacked,
    is_hostile,
    robots_up,
)
from bench.beside import Beside, private_megabytes
from bench.scraper import TIMEOUT, Scrape, ScrapeError
from bench.sim import cpu_seconds
from bench.site import running
from testbed.processes import Process

CONFIG = "profiles: {default: {confirm_after: 2s}}\n"  # of the robot that has a fault
CALM = Attack("no attack", ())
MOST_MEMORY = 6000.0  # MB of the exporter at which a case ends early


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
    faults_p99: float
    memory: float  # that is the exporter's alone, at most
    memory_after: float
    kept: float
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
    ("faults p99", "faults_p99", "{:.0f}"),
    ("memory MB", "memory", "{:.0f}"),
    ("and after", "memory_after", "{:.0f}"),
    ("kept", "kept", "{:.0%}"),
    ("CPU s/s", "cpu", "{:.2f}"),
    ("stops in s", "stop", "{:.1f}"),
)


def run_case(attack: Attack, options: argparse.Namespace) -> Result:
    """Measure a fresh exporter under the attack."""
    seconds = max(options.seconds, attack.seconds)
    lasting = seconds + attack.rest + 5 * SETTLE  # after which actors end by themselves
    with running(
        zenoh=options.zenoh, seconds=lasting, more=CONFIG, options=attack.options
    ) as bench:
        site = Attacked(bench, lasting, attack.login)
        site.wait_until_ready()
        if attack.prepare is not None:
            attack.prepare(site)
        return measure(site, attack, seconds)


def measure(site: Attacked, attack: Attack, seconds: float) -> Result:
    """Scrape each second for so long, then stop the exporter."""
    attacker = site.start_actor(*attack.actor) if attack.actor else None
    if attacker is not None:
        attacker.wait_for_output(rf"(.*\n){{{attack.reports}}}", SETTLE)
    pid = site.exporter.pid
    cpu, begin = cpu_seconds(pid), time.monotonic()
    with Beside(pid, site.address) as beside:
        scrapes = scrape_each_second(site, begin + seconds)
    cpu = (cpu_seconds(pid) - cpu) / (time.monotonic() - begin)
    kept = math.nan if attack.kept is None else attack.kept(site)
    done = "none" if attacker is None else last_line(attacker)  # before the exporter stops
    if attack.rest:
        scrape_each_second(site, time.monotonic() + attack.rest)
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
        faults_p99=percentile(beside.faults, 0.99) * 1e3,
        memory=beside.memory,
        memory_after=private_megabytes(pid) if attack.rest else math.nan,
        kept=kept,
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


def print_bounds(results: dict[str, Result], attacks: dict[str, Attack]) -> bool:
    """Print a line for each bound, and whether it holds; whether all do."""
    calm = next(iter(results.values()))
    print("\nbounds")
    held = []
    for name, attack in attacks.items():
        for bound in attack.bounds:
            value = getattr(results[name], bound.field)
            value = value / getattr(calm, bound.field) if bound.calm else value
            held.append(bound.holds(value))
            print(f"  {name:<28}{bound}: {value:,.4g}{'' if held[-1] else '   FAILED'}")
    return all(held)


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
        help="which, for example 1,memory (default: all)",
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
    attacks = {CALM.what: CALM}
    attacks |= {f"{each} {ATTACKS[each].what}": ATTACKS[each] for each in options.attacks}
    results = {name: run_case(attack, options) for name, attack in attacks.items()}
    print_table(results)
    held = print_bounds(results, attacks)
    if options.json is not None:
        cases = {name: asdict(result) for name, result in results.items()}
        options.json.write_text(json.dumps(cases, indent=2) + "\n")
    sys.exit(not held)


if __name__ == "__main__":
    main()
