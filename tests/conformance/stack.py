"""Plays histories on a real Prometheus and Alertmanager, in real time; what Alertmanager sends.

The state is the exporter's own; its exposition is scraped, the shipped rules are evaluated, and the
shipped routes lead to a webhook in place of mail.
"""

from __future__ import annotations

import json
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from datetime import datetime
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

from conformance.history import NONE, SERVICE_CODES, History, Notification
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    ComponentRule,
    FaultSettings,
    Fleet,
    Profile,
    Robot,
    Source,
)
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.state.state import State
from support import short_clocks
from support.prometheus_site import Site, running
from support.served_fleet import ServedFleet, serving
from testbed.polling import until
from testbed.ports import free_port

TICK = 8.0  # seconds: longer than a fault takes to its notification
WELL = 3  # ticks of which all is well, before the first
STEP = 0.2  # seconds between two looks at the clock
LATE = 4.0  # seconds within which a lower fault that lasts follows a higher one that ends
NEVER = 1e9
MANY = CauseSettings(1_000_000, 1.0)
STATES = {
    "RosDiagnosticsRobotSilent": "DOWN",
    "RosDiagnosticsComponentCritical": "CRITICAL",
    "RosDiagnosticsComponentStale": "UNKNOWN",
    "RosDiagnosticsComponentWarning": "WARNING",
}
ChangeRules = Callable[[Path], None]
WORST = tuple(STATES.values())


@dataclass
class Sent:
    """One alert in one message of Alertmanager."""

    name: str
    firing: bool
    labels: Mapping[str, str]
    at: float  # Unix time of its begin or end


@dataclass
class Inbox:
    """What Alertmanager has sent."""

    sent: list[Sent] = field(default_factory=list)

    def take(self, body: bytes) -> None:
        for alert in json.loads(body)["alerts"]:
            firing = alert["status"] == "firing"
            at = datetime.fromisoformat(alert["startsAt" if firing else "endsAt"]).timestamp()
            labels = alert["labels"]
            self.sent.append(Sent(labels["alertname"], firing, labels, at))


def play(
    folder: Path, histories: Sequence[History], change_rules: ChangeRules = lambda _: None
) -> list[dict[str, list[str]]]:
    """Of each history, by what it is about, the kinds of its notifications in their order.

    ``change_rules`` is called with the folder of the rules, before Prometheus reads it.
    """
    fleet = ServedFleet(_fleet(histories), lambda *_: None)
    inbox = Inbox()
    with (
        serving(fleet.scrape) as exporter,
        _webhook(inbox) as webhook,
        running(folder, {"f": exporter}, prepare=_prepare(folder, webhook, change_rules)) as site,
    ):
        _ready(fleet.state, histories, site)
        _Clock(fleet.state, histories).run()
        _drained(site, inbox)
    return [_kinds(number, inbox.sent) for number in range(len(histories))]


class _Clock:
    """Publishes each tick of all histories when its time has come."""

    def __init__(self, state: State, histories: Sequence[History]) -> None:
        self._state = state
        self._histories = histories
        self._begin = time.monotonic()
        self._tick = -WELL

    def run(self) -> None:
        """Play all ticks, and let the last one pass."""
        last = max(each.ticks for each in self._histories)
        until(lambda: self._step() > last, "all ticks are played", 60 + last * 2 * TICK, every=STEP)

    def _step(self) -> int:
        now = _now()
        self._state.tick(now)
        if now.mono >= self._begin + (self._tick + WELL) * TICK:
            for number, history in enumerate(self._histories):
                _publish(self._state, number, history, self._tick, now)
            self._state.tick(now)
            self._tick += 1
        return self._tick


def _publish(state: State, number: int, history: History, tick: int, now: Instant) -> None:
    for host in history.all_hosts:
        track = history.hosts.get(host, "")
        if tick >= 0 and tick < len(track) and track[tick] == "d":
            continue
        statuses = []
        for each, results in history.services.items():
            robot, _, component = each.partition("/")
            letter = "o" if tick < 0 else results[tick] if tick < len(results) else NONE
            if robot == host and letter != NONE:
                statuses.append(Status(SERVICE_CODES[letter], f"{component}-{number}"))
        array = Array(now.wall, tuple(statuses), 100)
        state.receive(Topic(0, f"/h{number}_{host}/diagnostics"), array, now)


def _fleet(histories: Sequence[History]) -> Fleet:
    robots = []
    for number, history in enumerate(histories):
        profile = Profile(
            stale_after=TICK + TICK / 10 if history.hosts else NEVER,
            confirm_after=(history.attempts - 1) * TICK + TICK / 10,
            components=(ComponentRule(Pattern(".*"), stale_after=NEVER),),
        )
        robots += [
            Robot(
                f"h{number}-{host}",
                topic_raw=f"/h{number}_{host}/diagnostics",
                source=Source.RAW,
                profile=profile,
                labels={"site": f"s{number}-{host}"},
            )
            for host in history.all_hosts
        ]
    # Nothing that many robots have in common here is of one cause.
    settings = replace(
        FaultSettings(), common=MANY, site=MANY, flapping_start=2.0, restart_grace=0.0
    )
    return Fleet("f", tuple(robots), faults=settings)


def _now() -> Instant:
    return Instant(time.monotonic(), time.time())


# -- servers ---------------------------------------------------------------------------------


@contextmanager
def _webhook(inbox: Inbox) -> Iterator[str]:
    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            inbox.take(self.rfile.read(int(self.headers["Content-Length"])))
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None:
            """Say nothing of every message."""

    server = ThreadingHTTPServer(("127.0.0.1", free_port()), Handler)
    thread = threading.Thread(target=server.serve_forever, args=(0.05,))
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}/"
    finally:
        server.shutdown()
        thread.join()
        server.server_close()


def _prepare(folder: Path, webhook: str, change_rules: ChangeRules) -> Callable[[Path], None]:
    def prepare(prometheus: Path) -> None:
        change_rules(prometheus / "rules")
        path = folder / "alertmanager" / "alertmanager.yml"
        short_clocks.edit(path, lambda config: _to_webhook(config, webhook))

    return prepare


def _to_webhook(config: dict[str, Any], webhook: str) -> None:
    config["route"].update(group_wait="0s", group_interval="1s")
    for receiver in config["receivers"]:
        emails = receiver.pop("email_configs", [])
        receiver.pop("sns_configs", None)
        receiver["webhook_configs"] = [
            {"url": webhook, "send_resolved": each["send_resolved"]} for each in emails
        ]


def _ready(state: State, histories: Sequence[History], site: Site) -> None:
    """Let the robots be received, until Prometheus has seen all of them up and settled."""
    robots = sum(len(each.all_hosts) for each in histories)

    def seen() -> bool:
        now = _now()
        for number, history in enumerate(histories):
            _publish(state, number, history, -1, now)
        state.tick(now)
        found = site.query("count(ros_diagnostics_robot_up == 1)")
        settled = site.query("ros_diagnostics_exporter_settled == 1")
        return bool(found and settled) and int(float(found[0]["value"][1])) == robots

    until(seen, "Prometheus has seen all robots", 120, every=0.5)


def _drained(site: Site, inbox: Inbox) -> None:
    """Wait until nothing more comes: a few evaluations after the last message."""
    quiet = time.monotonic() + TICK
    count = len(inbox.sent)

    def over() -> bool:
        nonlocal quiet, count
        if len(inbox.sent) != count:
            quiet, count = time.monotonic() + TICK, len(inbox.sent)
        return time.monotonic() >= quiet

    until(over, lambda: f"messages keep coming: {inbox.sent[-3:]} of {site.alertmanager}", 120)


# -- messages to notifications ---------------------------------------------------------------


def _kinds(number: int, sent: Sequence[Sent]) -> dict[str, list[str]]:
    """What the messages about one history say, as Nagios would call it."""
    objects: dict[str, _Object] = {}
    for each in sent:
        robot = each.labels.get("robot", "")
        if robot.startswith(f"h{number}-") and each.name in STATES:
            host = robot.partition("-")[2]
            component = each.labels.get("component", "").rpartition("-")[0]
            what = f"{host}/{component}" if component else host
            objects.setdefault(what, _Object()).take(each)
    return {what: each.kinds for what, each in objects.items()}


@dataclass
class _Object:
    """A host or service: the faults that were sent and last, and what that was for Nagios."""

    kinds: list[str] = field(default_factory=list)
    _lasting: set[str] = field(default_factory=set)
    _ended: float = 0.0  # when the fault ended that the last kind is about; 0 where one began

    def take(self, sent: Sent) -> None:
        """Follow one message; several about one change are one notification of Nagios.

        Where CRITICAL ends, the WARNING below it ends or begins at the same time.
        """
        (self._lasting.add if sent.firing else self._lasting.discard)(STATES[sent.name])
        kind = next((state for state in WORST if state in self._lasting), "RECOVERY")
        if abs(sent.at - self._ended) < LATE:
            self.kinds[-1] = kind
        elif self.kinds[-1:] != [kind]:
            self.kinds.append(kind)
            self._ended = 0.0 if sent.firing else sent.at


def by_object(notifications: Sequence[Notification]) -> dict[str, list[str]]:
    """Notifications as `play` returns them."""
    found: dict[str, list[str]] = {}
    for each in notifications:
        found.setdefault(each.what, []).append(each.kind)
    return found
