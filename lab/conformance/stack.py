"""Plays histories on a real Prometheus and Alertmanager, in real time; what Alertmanager sends.

The state is the exporter's own; its exposition is scraped, the shipped rules are evaluated, and the
shipped routes lead to a webhook in place of mail.
"""

from __future__ import annotations

import io
import json
import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stderr, redirect_stdout
from dataclasses import dataclass, field, replace
from datetime import datetime, timedelta, timezone
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from typing import Any

from conformance.history import (
    HOURS_CHANGE,
    NONE,
    SERVICE_CODES,
    History,
    Notification,
    marked,
)
from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    ComponentRule,
    FaultSettings,
    Flapping,
    Fleet,
    Profile,
    Robot,
    Source,
)
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_tools.main import main
from support.loopback import answering
from support.served_fleet import ServedFleet, serving
from testbed import short_clocks
from testbed.polling import until
from testbed.site import Site

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
UNACKNOWLEDGED = "RosDiagnosticsUnacknowledged"
OF_STATE = {"silent": "DOWN", "critical": "CRITICAL", "stale": "UNKNOWN", "warning": "WARNING"}
# Who reads the mails of a receiver; what else there is goes to OPS.
OPS = "ops"
PEOPLE = {"team": "team", "escalation-1": "second", "escalation-2": "manager"}
START = 60.0  # seconds to start in, before the first tick
REPEAT = 2  # ticks: notification_interval of all histories that have one
WORST = tuple(STATES.values())


@dataclass
class Sent:
    """One alert in one message of Alertmanager."""

    name: str
    firing: bool
    labels: Mapping[str, str]
    at: float  # Unix time of its begin or end
    receiver: str
    received: float  # monotonic time


@dataclass
class Inbox:
    """What Alertmanager has sent."""

    sent: list[Sent] = field(default_factory=list)

    def take(self, body: bytes) -> None:
        """Keep what a webhook was sent."""
        message = json.loads(body)
        for alert in message["alerts"]:
            firing = alert["status"] == "firing"
            at = datetime.fromisoformat(alert["startsAt" if firing else "endsAt"]).timestamp()
            self.sent.append(
                Sent(
                    *(alert["labels"]["alertname"], firing, alert["labels"], at),
                    *(message["receiver"], time.monotonic()),
                )
            )


def notifications(folder: Path, histories: Sequence[History]) -> list[list[Notification]]:
    """The notifications of each history; those of one tick in the order of their names."""
    minute = math.ceil((time.time() + START + HOURS_CHANGE * TICK) / 60) * 60.0
    hours = datetime.fromtimestamp(minute, timezone.utc)
    fleet = ServedFleet(_fleet(histories), lambda *_: None)
    inbox = Inbox()

    def prepare(prometheus: Path) -> None:
        rules = prometheus / "rules"
        after = f"{REPEAT * TICK:g}s"
        short_clocks.set_escalation(rules, {"0": after, "1": after, "2": f"{2 * REPEAT * TICK:g}s"})

    with (
        serving(fleet.scrape) as exporter,
        _webhook(inbox) as webhook,
        Site(folder) as site,
    ):
        site.start_alertmanager(
            edit=lambda config: _change_routes(config, webhook, histories, hours)
        )
        site.start_prometheus(exporters=[exporter], interval=1, edit=prepare)
        site.wait_until_ready()
        _ready(fleet.state, histories, site)
        now = time.monotonic()
        begin = minute - time.time() + now - (HOURS_CHANGE - 0.5) * TICK
        if not any(each.hours for each in histories):
            begin = now + WELL * TICK
        assert begin >= now, "the servers took too long to start"
        _Clock(fleet.state, histories, begin, site.addresses.alertmanager).run()
        _drained(site, inbox)
    return [_notifications(number, each, inbox, begin) for number, each in enumerate(histories)]


class _Clock:
    """Publishes each tick of all histories when its time has come."""

    def __init__(
        self, state: FleetState, histories: Sequence[History], begin: float, alertmanager: str
    ) -> None:
        self._state = state
        self._histories = histories
        self._alertmanager = alertmanager
        self._begin = begin
        self._tick = -math.floor((begin - time.monotonic()) / TICK)  # all is well until tick 0
        self._to_acknowledge: list[tuple[str, ...]] = []
        self._answer = ""

    def run(self) -> None:
        """Play all ticks, and let the last one pass."""
        last = max(each.ticks for each in self._histories)
        until(
            lambda: self._step() > last, "all ticks are played", 180 + last * 2 * TICK, every=STEP
        )
        assert not self._to_acknowledge, self._answer

    def _step(self) -> int:
        now = _now()
        self._state.tick(now)
        if now.mono >= self._begin + self._tick * TICK:
            for number, history in enumerate(self._histories):
                _publish(self._state, number, history, self._tick, now)
                self._to_acknowledge += [
                    _named(number, each.what)
                    for each in history.acknowledgements
                    if each.tick == self._tick
                ]
            self._state.tick(now)
            self._tick += 1
        self._to_acknowledge = [each for each in self._to_acknowledge if not self._ack(each)]
        return self._tick

    def _ack(self, part: tuple[str, ...]) -> bool:
        """Acknowledge as a person does; there may be no alert yet."""
        url = f"http://{self._alertmanager}"
        options = ("--author", "ann", "--comment", "on it", "--alertmanager", url)
        text = io.StringIO()
        with redirect_stdout(text), redirect_stderr(text):
            done = main(["ack", *options, "--", *part]) == 0
        self._answer = text.getvalue()
        return done


def _publish(state: FleetState, number: int, history: History, tick: int, now: Instant) -> None:
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


def _named(number: int, what: str) -> tuple[str, ...]:
    """Robot and component, as arguments of `ros-diagnostics ack`."""
    host, _, service = what.partition("/")
    return (f"h{number}-{host}", *([f"{service}-{number}"] if service else []))


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
        FaultSettings(), common=MANY, site=MANY, flapping=Flapping(start=2.0), restart_grace=0.0
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

    with answering(Handler) as address:
        yield f"http://{address}/"


def _change_routes(
    config: dict[str, Any], webhook: str, histories: Sequence[History], hours: datetime
) -> None:
    """The shipped routes below those that a site would write for the contacts of a history."""
    config["route"].update(group_wait="0s", group_interval="1s")
    for route in config["route"]["routes"]:
        if route["receiver"] == "reminder":
            route["repeat_interval"] = f"{REPEAT * TICK:g}s"
    own = [route for number, each in enumerate(histories) for route in _routes(number, each)]
    config["route"]["routes"][:0] = own
    config["time_intervals"] += _intervals(hours)
    for receiver in config["receivers"]:
        emails = receiver.pop("email_configs", [])
        receiver.pop("sns_configs", None)
        receiver["webhook_configs"] = [
            {"url": webhook, "send_resolved": each["send_resolved"]} for each in emails
        ]


def _routes(number: int, history: History) -> Iterator[dict[str, Any]]:
    robots = f'robot =~ "h{number}-.*"'
    steps = {0: bool(history.repeat), 1: len(history.escalations) > 0}
    steps[2] = len(history.escalations) > 1
    for step in (each for each, wanted in steps.items() if not wanted):
        matchers = [f"alertname = {UNACKNOWLEDGED}", f'step = "{step}"', robots]
        yield {"matchers": matchers, "receiver": "none"}
    if history.hours is not None:
        name = "begins" if history.hours.begin else "ends"
        yield {"matchers": [robots], "receiver": "team", "active_time_intervals": [name]}


def _intervals(change: datetime) -> Iterator[dict[str, Any]]:
    """Hours that begin, and hours that end, at a minute; it may be near midnight."""
    yesterday, today, tomorrow = (
        f"{change + timedelta(days=days):%A}".lower() for days in (-1, 0, 1)
    )
    minute = f"{change:%H:%M}"
    until_then = {"weekdays": [today], "times": [{"start_time": "00:00", "end_time": minute}]}
    ends: list[dict[str, Any]] = [{"weekdays": [yesterday]}]
    ends += [until_then] if minute != "00:00" else []
    from_then = {"weekdays": [today], "times": [{"start_time": minute, "end_time": "24:00"}]}
    yield {"name": "begins", "time_intervals": [from_then, {"weekdays": [tomorrow]}]}
    yield {"name": "ends", "time_intervals": ends}


def _ready(state: FleetState, histories: Sequence[History], site: Site) -> None:
    """Let the robots be received, until Prometheus has seen all of them up and settled."""
    robots = sum(len(each.all_hosts) for each in histories)

    def seen() -> bool:
        now = _now()
        for number, history in enumerate(histories):
            _publish(state, number, history, -1, now)
        state.tick(now)
        settled = site.query("ros_diagnostics_exporter_settled == 1")
        return bool(settled) and site.engine.value("count(ros_diagnostics_robot_up == 1)") == robots

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

    until(
        over,
        lambda: f"messages keep coming: {inbox.sent[-3:]} of {site.addresses.alertmanager}",
        120,
    )


# -- messages to notifications ---------------------------------------------------------------


def _notifications(number: int, history: History, inbox: Inbox, begin: float) -> list[Notification]:
    """What the messages about one history say, as Nagios would call it."""
    objects: dict[tuple[str, str], _Object] = {}
    for each in inbox.sent:
        robot = each.labels.get("robot", "")
        if robot.startswith(f"h{number}-") and each.name in (*STATES, UNACKNOWLEDGED):
            host = robot.partition("-")[2]
            component = each.labels.get("component", "").rpartition("-")[0]
            what = f"{host}/{component}" if component else host
            who = PEOPLE.get(each.receiver, OPS)
            objects.setdefault((what, who), _Object()).take(each)
    found = sorted(
        (math.floor((received - begin) / TICK), what, who, number, kind)
        for (what, who), each in objects.items()
        for number, (received, kind) in enumerate(each.kinds)
        if received < begin + (history.ticks + 1) * TICK  # then it is over, and nothing is sent
    )
    made = [Notification(who, what, kind) for _, what, who, _, kind in found]
    return marked(made) if history.of_people else made


@dataclass
class _Object:
    """A host or service, and who is notified: the faults that were sent and last."""

    kinds: list[tuple[float, str]] = field(default_factory=list)  # when received, and the kind
    _lasting: set[str] = field(default_factory=set)
    _ended: float = 0.0  # when the fault ended that the last kind is about; 0 where one began

    def take(self, sent: Sent) -> None:
        """Follow one message; several about one change are one notification of Nagios.

        Where CRITICAL ends, the WARNING below it ends or begins at the same time.
        """
        if sent.name == UNACKNOWLEDGED:
            kind = OF_STATE[sent.labels["state"]] if sent.firing else "RECOVERY"
            self.kinds.append((sent.received, kind))
            return
        (self._lasting.add if sent.firing else self._lasting.discard)(STATES[sent.name])
        kind = next((state for state in WORST if state in self._lasting), "RECOVERY")
        if abs(sent.at - self._ended) < LATE:
            self.kinds[-1] = (self.kinds[-1][0], kind)
        elif not self.kinds or self.kinds[-1][1] != kind:
            self.kinds.append((sent.received, kind))
            self._ended = 0.0 if sent.firing else sent.at


def by_object(notifications: Sequence[Notification]) -> dict[str, list[str]]:
    """What was notified of, and the kinds of its notifications in their order."""
    found: dict[str, list[str]] = {}
    for each in notifications:
        found.setdefault(each.what, []).append(each.kind)
    return found
