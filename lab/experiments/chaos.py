"""Real servers that are killed, stopped and paused in a random order, while robots fail.

Exporter, Prometheus with the shipped rules, Alertmanager and a mail server run as in the demo; the
machine of the robots is paused, and the mail server is away. All from a seed. At the end the mails
are compared with what the robots know: see `chaos_truth`.
"""

from __future__ import annotations

import argparse
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

import yaml

from experiments import chaos_truth
from experiments.chaos_truth import KIND, Incident, Mail, Outage
from testbed import domains, http, short_clocks
from testbed.configuration import FLEET
from testbed.polling import until
from testbed.servers import Server
from testbed.site import Site
from testbed.stack import Plan, running

ROBOTS = 12
PAUSES = (10.0, 35.0)  # seconds between two outages
AWAY = (1.0, 5.0, 12.0, 30.0)  # seconds for which a server is away
READY = 90.0  # seconds in which it is ready again
END = 420.0  # seconds in which every fault ends, once all is repaired
Way = tuple[str, Callable[[], object], Callable[[], object]]
SITE = (f"{FLEET} site hall", "SILENT")
# Alerts that are no trouble: a heartbeat.
ALWAYS = ("RosDiagnosticsWatchdog", "RosDiagnosticsCanary")


class Chaos:
    """The running site, and what was done to it."""

    def __init__(self, site: Site, random: Random) -> None:
        self._site = site
        self._random = random
        self.outages: list[Outage] = []

    def go_on(self, end: float) -> None:
        """Let one server after the other be away, until then (Unix time)."""
        while True:
            at = time.time() + self._random.uniform(*PAUSES)
            if at > end:
                return
            _reach(at)
            self._next()

    def _next(self) -> None:
        what, ways = self._random.choice([*self._ways().items()])
        how, leave, come = self._random.choice(ways)
        begin, seconds = time.time(), self._random.choice(AWAY)
        print(f"{what}: {how}, {seconds:g} s", flush=True)
        leave()
        _reach(begin + seconds)
        come()
        self.outages.append(Outage(what, how, begin, time.time()))

    def _ways(self) -> dict[str, list[Way]]:
        """What can be away, how, and what is called when it goes and when it comes."""
        site = self._site
        ways: dict[str, list[Way]] = {}
        for server in (site.exporter, site.prometheus, site.alertmanager):
            start = partial(_start, server)
            kill, stop = ("kill", server.process.kill, start), ("stop", server.process.stop, start)
            ways[server.name] = [kill, stop, _pause(server)]
        mail = site.mail_server
        return {
            **ways,
            "robots": [_pause(site.robots)],
            "mail server": [("stop", mail.stop, mail.start)],
        }


def _start(server: Server) -> None:
    server.process.start()
    server.wait_until_ready(READY)


def _pause(server: Server) -> Way:
    process = server.process
    return "pause", partial(process.signal, signal.SIGSTOP), partial(process.signal, signal.SIGCONT)


def run(minutes: float, seed: int, out: Path) -> int:
    """Run for the time, and print what is wrong; 1 where anything is."""
    seconds, random = minutes * 60, Random(seed)
    content = chaos_truth.scenario(ROBOTS, seconds, seed)
    out.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix="chaos-") as name:
        folder = Path(name)
        path = folder / "scenario.yaml"
        path.write_text(yaml.safe_dump(content, sort_keys=False))
        plan = Plan(1, seed, path, environment=domains.BETWEEN_MACHINES)
        with running(folder, plan) as site:
            begin = _begin(site)
            short_clocks.edit(folder / "fleet.yml", _of_these_robots)  # it is reloaded by itself
            chaos = Chaos(site, random)
            chaos.go_on(begin + seconds - chaos_truth.LAST)
            _reach(begin + seconds)
            lasting = _lasting(site)
            mails, others = _mails(site)
    pauses = [each for each in chaos.outages if each.server == "robots"]
    known = chaos_truth.incidents(content, FLEET, begin, pauses)
    known += _while_paused(pauses, known)
    counts = chaos_truth.count(known, chaos.outages, mails, lasting)
    lines = [*chaos_truth.report(counts), *others]
    about = (
        f"seed {seed}, {minutes:g} minutes: {len(known)} incidents, {len(chaos.outages)} outages, "
    )
    lines.append(f"{about}{len(mails)} mails about faults")
    (out / "chaos.txt").write_text("\n".join(lines) + "\n")
    print("\n".join(lines), flush=True)
    return 1 if counts.wrong.total() else 0


def _of_these_robots(content: dict[str, Any]) -> None:
    """Leave out the entries for other kinds of robots: that they match nothing is a fault."""
    content["discovery"] = [each for each in content["discovery"] if each.get("profile") == KIND]


def _reach(at: float) -> None:
    """Wait until then, Unix time."""
    until(lambda: time.time() >= at, "the time", at - time.time() + 60, every=0.1)


def _begin(site: Site) -> float:
    """When the robots' time began: they write a line then, and the next at the first incident."""
    process = site.robots.process
    *_, last = process.output().splitlines()
    if not last.startswith("ready: "):
        raise RuntimeError(f"the servers were not ready before the first incident: {last}")
    return process.log_path.stat().st_mtime


def _while_paused(pauses: list[Outage], known: list[Incident]) -> Iterator[Incident]:
    """What may be mailed while no robot is received: the site's silence, and each robot's."""
    silent = {each.about for each in known if each.state == "SILENT"}
    robots = {f"{FLEET}/robot_{number}" for number in range(1, ROBOTS + 1)} | silent
    for each in pauses:
        for about, state in (SITE, *((robot, "SILENT") for robot in sorted(robots))):
            yield Incident(about, state, each.begin, each.end, must=False)


def _lasting(site: Site) -> list[str]:
    """The faults and alerts that last long after all was repaired."""
    found: list[str] = []

    def none() -> bool:
        found[:] = [*_faults(site), *_alerts(site)]
        return not found

    try:
        until(none, "nothing lasts", END, every=2.0)
    except TimeoutError:
        return found
    return []


def _faults(site: Site) -> Iterator[str]:
    faults: list[dict[str, Any]]
    faults = http.get_json(site.addresses.exporter, "/api/v1/faults")["faults"]
    for each in faults:
        parts = (each.get(key, "") for key in ("site", "robot", "component", "state"))
        yield f"fault of {' '.join(filter(None, parts))}"


def _alerts(site: Site) -> Iterator[str]:
    for each in http.get_json(site.addresses.alertmanager, "/api/v2/alerts"):
        if each["labels"]["alertname"] not in ALWAYS:
            yield f"alert {each['labels']}"


def _mails(site: Site) -> tuple[list[Mail], list[str]]:
    """The mails about robots, and the subjects of the others, each once."""
    mails: list[Mail] = []
    others: dict[str, int] = {}
    for each in site.inbox.mails():
        mail = chaos_truth.read(each.received, each.subject)
        if mail is not None and mail.about.startswith((f"{FLEET}/", f"{FLEET} site ")):
            mails.append(mail)
        else:
            others[each.subject] = others.get(each.subject, 0) + 1
    return mails, [f"about the monitoring: {number} x {what}" for what, number in others.items()]


def add_options(parser: argparse.ArgumentParser) -> None:
    """What the command line of `./run soak` has of it."""
    parser.add_argument(
        "--chaos", action="store_true", help="kill, stop and pause the servers instead"
    )
    parser.add_argument("--minutes", type=float, default=60.0, help="of --chaos")
