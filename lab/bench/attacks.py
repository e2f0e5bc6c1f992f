"""The attacks of `bench.hostile`: who attacks, what is asked meanwhile, and which bounds hold."""

from __future__ import annotations

import math
import subprocess
import sys
import time
from collections.abc import Callable
from contextlib import closing, suppress
from dataclasses import dataclass
from io import BytesIO
from typing import Any

from mcap.reader import make_reader

from bench import scraper
from bench.scraper import TIMEOUT, Scrape, ScrapeError, Scraper
from bench.site import BenchSite
from testbed import http
from testbed.polling import until
from testbed.processes import Process

ROBOTS = 20
HOSTILE = "hostile"
FAULTY = "hostile_faulty"  # robots of attacks begin so; this one is attacked by another
EVENTS = 10_000  # that the event log keeps
SETTLE = 60.0  # seconds that anything may take to begin
LOGIN = "bench:right"
GUESSED = 10  # wrong passwords until an address has a pause
PATIENCE, START = 5.0, 3.0  # seconds that `status` is given, and that its process takes beside
RECORDED = 30.0  # ... from the confirmation of a fault to its recording


@dataclass(frozen=True)
class Bound:
    """What a field of a result has to be; ``calm``: in multiples of that without an attack."""

    field: str
    at_most: float = math.inf
    at_least: float = -math.inf
    calm: bool = False

    def __str__(self) -> str:
        """As it is printed."""
        times = " times that without an attack" if self.calm else ""
        most, least = math.isfinite(self.at_most), math.isfinite(self.at_least)
        texts = [f"at most {self.at_most:g}"] * most + [f"at least {self.at_least:g}"] * least
        return f"{self.field} {' and '.join(texts)}{times}"

    def holds(self, value: float) -> bool:
        """Whether it is within; what could not be seen is not."""
        return self.at_least <= value <= self.at_most


ALL_UP = Bound("up", at_least=ROBOTS)
ALL_SCRAPED = Bound("scraped", at_least=1.0)
FAULTS_SCRAPED = Bound("faults_p99", at_most=500.0)
HARMLESS = (ALL_UP, ALL_SCRAPED)


@dataclass(frozen=True)
class Attack:
    """What the attacker is (the arguments of an actor), and what has to be so before it begins.

    It lasts ``seconds`` at least. ``kept`` is asked at the end for the share of what belongs to
    others that is still there. ``rest`` is for how many seconds after the attack memory is watched.
    In ``options`` of the exporter SLOW is the address of the actor `slow`, LOGIN its web config, by
    which `LOGIN` may log in.
    """

    what: str
    actor: tuple[str, ...]
    prepare: Callable[[Attacked], None] | None = None
    reports: int = 1  # that the actor has written when the attack counts as begun
    bounds: tuple[Bound, ...] = HARMLESS
    seconds: float = 0.0
    kept: Callable[[Attacked], float] | None = None
    rest: float = 0.0
    options: tuple[str, ...] = ()  # of the exporter
    login: str = ""  # NAME:PASSWORD of who scrapes


class Attacked:
    """A fresh exporter, its fleet, and what attacks it."""

    def __init__(self, site: BenchSite, seconds: float, login: str) -> None:
        self._site = site
        self._seconds = seconds
        self.begin = time.monotonic()
        self.exporter = site.start(site.exporter).process
        self.address = f"{login}{login and '@'}{site.exporter.address}"
        self.slow = site.slow
        self.scraper = site.use(closing(Scraper(self.address)))
        self.fleet = self.start_actor("fleet", "WHERE", str(ROBOTS))

    def start_actor(self, kind: str, *arguments: str) -> Process:
        """Start one of `bench.actors`; WHERE, PORT and SLOW are replaced by this site's."""
        port = self.address.rpartition(":")[2]
        places = {"WHERE": self._site.where, "PORT": port, "SLOW": self._site.slow}
        named = [places.get(argument, argument) for argument in arguments]
        return self._site.start_actor(kind, *named, seconds=self._seconds)

    def wait_until_ready(self) -> None:
        """Wait until each robot of the fleet is up."""
        self.wait_for(lambda scrape: robots_up(scrape) == ROBOTS, "all robots are up")

    def wait_for(self, condition: Callable[[Scrape], bool], what: str) -> None:
        """Scrape until a scrape succeeds and shows the condition."""

        def shown() -> bool:
            with suppress(ScrapeError):
                return condition(self.scraper.scrape())
            return False

        until(shown, what, SETTLE, every=0.5)

    def ask(self, path: str) -> Any:
        """What the API answers."""
        return http.get_json(self.address, path, TIMEOUT)

    def fetch(self, path: str) -> bytes:
        """The bytes that are served there; none where there are none yet."""
        try:
            return http.get(self.address, path, TIMEOUT)
        except http.Unanswered:
            return b""

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


def start_faulty(site: Attacked) -> None:
    """Let another robot have a fault, which its exporter confirms."""
    site.start_actor("arrays", "WHERE", "faulty").wait_for_output("sent", SETTLE)
    until(lambda: fault_of(site), "the other robot has a fault", SETTLE, every=0.5)


def begin_faulty(site: Attacked) -> None:
    """Let another robot be received, which has a fault a quarter of a minute later."""
    site.start_actor("arrays", "WHERE", "faulty").wait_for_output("sent", SETTLE)
    site.wait_for(lambda scrape: scrape.up.get(FAULTY, False), "the other robot is received")


def fault_of(site: Attacked) -> str:
    """The id of the other robot's fault, by the event of its begin; "" where there is none."""
    events = site.ask(f"/api/v1/events?kind=fault_began&robot={FAULTY}")["events"]
    return str(events[0]["fault"]) if events else ""


def kept_history(site: Attacked) -> float:
    """1 where the begin of the other robot's fault is in the history."""
    return float(bool(fault_of(site)))


def kept_recording(site: Attacked) -> float:
    """The share of the other robot's messages, one a second, that its recording has."""
    until(lambda: fault_of(site), "the other robot has a fault", SETTLE, every=0.5)
    path = f"/api/v1/faults/{fault_of(site)}/recording.mcap"
    data = until(lambda: site.fetch(path), "its recording", RECORDED, every=1.0)
    messages = make_reader(BytesIO(data)).iter_messages()
    times = [message.log_time / 1e9 for _schema, _channel, message in messages]
    return len(times) / float(round(times[-1] - times[0]) + 1)


def kept_logged(site: Attacked) -> float:
    """1 where each rejected login is counted, and a minute has no more than one line of the log."""
    counted = scraper.total(scraper.REJECTED_LOGINS, site.scraper.text())
    lines = site.exporter.output().count("logins were rejected")
    minutes = (time.monotonic() - site.begin) / 60
    return float(counted > GUESSED and 1 <= lines <= minutes + 1)


def kept_patience(site: Attacked) -> float:
    """1 where `status` gives up a server that answers slowly in the time that it is given."""
    argv = ["status", "--url", f"http://{site.slow}", "--timeout", f"{PATIENCE:g}s"]
    begin = time.monotonic()
    subprocess.run(
        [sys.executable, "-m", "ros_diagnostics_tools.main", *argv],
        check=False,
        capture_output=True,
        timeout=SETTLE,
    )
    return float(time.monotonic() - begin < PATIENCE + START)


ATTACKS = {
    "1": Attack("276 kB at 60/s", ("arrays", "WHERE", "fast")),
    "2": Attack("equal keys", ("arrays", "WHERE", "equal-keys")),
    "3": Attack("2.8 MB at 20/s", ("arrays", "WHERE", "huge")),
    "4": Attack(
        "ever more robots",
        ("keys", "WHERE"),
        bounds=(*HARMLESS, FAULTS_SCRAPED, Bound("memory", at_most=2.0, calm=True)),
    ),
    "7": Attack("unread /metrics", ("readers", "PORT", "/metrics", "520"), reports=4),
    "7b": Attack("unread fleet", ("readers", "PORT", "/api/v1/fleet", "520"), reports=4),
    "8": Attack(
        "unread events", ("readers", "PORT", f"/api/v1/events?limit={EVENTS}", "8"), fill_event_log
    ),
    "history": Attack(
        "levels at 10 Hz",
        ("arrays", "WHERE", "levels"),
        start_faulty,
        bounds=(*HARMLESS, Bound("kept", at_least=1.0)),
        seconds=60.0,
        kept=kept_history,
        options=("--storage.retention.size=20MB",),
    ),
    "memory": Attack(
        "4 MB on 200 topics",
        ("large", "WHERE", "200", "2"),
        bounds=(*HARMLESS, Bound("memory", at_most=400.0), Bound("memory_after", at_most=200.0)),
        rest=60.0,
    ),
    "recordings": Attack(
        "0.9 MB at 20/s",
        ("arrays", "WHERE", "heavy"),
        begin_faulty,
        bounds=(*HARMLESS, Bound("kept", at_least=0.95)),
        seconds=30.0,
        kept=kept_recording,
    ),
    "newcomers": Attack(
        "7 new robots a s",
        ("newcomers", "WHERE"),
        bounds=(*HARMLESS, FAULTS_SCRAPED, Bound("memory", at_most=2.0, calm=True)),
        seconds=300.0,
    ),
    "passwords": Attack(
        "wrong passwords",
        ("passwords", "PORT"),
        bounds=(*HARMLESS, Bound("kept", at_least=1.0)),
        seconds=30.0,
        kept=kept_logged,
        options=("--web.config.file=LOGIN",),
        login=LOGIN,
    ),
    "slow": Attack(
        "slow headers",
        ("slow", "SLOW"),
        bounds=(*HARMLESS, Bound("kept", at_least=1.0), Bound("stop", at_most=9.0)),
        kept=kept_patience,
        options=("--alertmanager.url=http://SLOW",),
    ),
}


OF_ZENOH = "4"


def is_hostile(robot: str) -> bool:
    """Whether it is of an attack: the hostile robot, or one that is only offered."""
    return robot.startswith(HOSTILE)


def robots_up(scrape: Scrape) -> int:
    """How many of the fleet's own robots are up."""
    return sum(up for robot, up in scrape.up.items() if not is_hostile(robot))
