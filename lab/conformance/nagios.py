"""Plays histories on the distribution's Nagios 4: passive results in, its notifications out."""

from __future__ import annotations

import math
import os
import re
import time
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from datetime import datetime, timezone
from pathlib import Path

from conformance.history import (
    HOST_CODES,
    HOURS_CHANGE,
    NONE,
    SERVICE_CODES,
    Acknowledgement,
    Escalation,
    History,
    Notification,
    marked,
)
from support import nagios_program
from testbed.polling import until

SECONDS = 2.0  # of a tick, in histories in which its length matters
PAST_THE_SECOND = 0.2  # a tick begins early in a second: Nagios' times are whole ones
CLOCK = "clock"  # the host and service whose results mark the ticks
READY = 60.0
START = 40.0  # seconds to start in, and to play the ticks before the hours change
PERIODS = ("begins", "ends")  # hours that begin at a tick, and that end at it
CONTACTS = ("ops", "second", "manager")

SETTINGS = """\
retain_state_information=1
use_retained_program_state=1
check_external_commands=1
enable_notifications=1
log_notifications=1
execute_host_checks=0
passive_host_checks_are_soft=1
translate_passive_host_checks=1
enable_flap_detection=1
check_service_freshness=1
service_freshness_check_interval=1
additional_freshness_latency=0
log_passive_checks=1
"""
DAYS = ("monday", "tuesday", "wednesday", "thursday", "friday", "saturday", "sunday")
COMMON = """\
define command {
  command_name nothing
  command_line /bin/true
}
define command {
  command_name stale
  command_line /bin/sh -c 'echo not fresh; exit 2'
}
"""
PERIOD = """\
define timeperiod {{
  timeperiod_name {name}
  alias {name}
{times}
}}
"""
CONTACT = """\
define contact {{
  contact_name {name}
  host_notification_period {period}
  service_notification_period {period}
  host_notification_options d,u,r,f,s
  service_notification_options w,u,c,r,f,s
  host_notification_commands nothing
  service_notification_commands nothing
}}
"""
HOST = """\
define host {{
  host_name {host}
  address 127.0.0.1
  parents {parent}
  max_check_attempts {attempts}
  active_checks_enabled 0
  flap_detection_enabled {flapping}
  low_flap_threshold 20
  high_flap_threshold 40
  notification_interval {interval}
  notification_options d,{unreachable}r,f,s
  notification_period {period}
  contacts {contact}
}}
"""
SERVICE = """\
define service {{
  host_name {host}
  service_description {service}
  check_command stale
  max_check_attempts {attempts}
  check_interval 1
  retry_interval 1
  active_checks_enabled 0
  check_freshness {fresh}
  freshness_threshold {threshold}
  flap_detection_enabled {flapping}
  low_flap_threshold 20
  high_flap_threshold 40
  notification_interval {interval}
  notification_period {period}
  contacts {contact}
}}
"""
ESCALATION = """\
define {kind}escalation {{
  host_name {host}
{service}  contacts {who}
  first_notification {first}
  last_notification {last}
  notification_interval {interval}
}}
"""
_NOTIFIED = re.compile(r"\[\d+\] (HOST|SERVICE) NOTIFICATION: ([^;]+);([^;]+);(.*)")
_TICK = re.compile(rf"\[\d+\] EXTERNAL COMMAND: .*;{CLOCK};{CLOCK};0;(\d+)")


class Nagios:
    """One process of Nagios with several histories, each with hosts of its own."""

    def __init__(self, folder: Path, histories: Sequence[History]) -> None:
        self._folder = folder
        self._histories = histories
        self._log = folder / "nagios.log"
        self._begin = next_minute() - (HOURS_CHANGE - 0.5) * SECONDS + PAST_THE_SECOND
        self._process = nagios_program.prepare(folder, self._objects(), SETTINGS)
        self._starts = 0

    def play(self) -> list[list[Notification]]:
        """The notifications of each history, in their order."""
        self._start()
        if any(each.hours for each in self._histories):
            self._wait_until(self._begin - SECONDS)
        else:
            self._begin = math.ceil(time.time()) + SECONDS + PAST_THE_SECOND
        try:
            for tick in range(-1, max(each.ticks for each in self._histories)):
                self._play_tick(tick)
        finally:
            self._process.stop()
        return self._notifications()

    # -- set-up ------------------------------------------------------------------------------

    def _objects(self) -> str:
        changes = datetime.fromtimestamp(self._begin + (HOURS_CHANGE - 0.5) * SECONDS, timezone.utc)
        parts = [COMMON, PERIOD.format(name="always", times=_times(DAYS))]
        parts += [PERIOD.format(name=name, times=_hours(changes, name)) for name in PERIODS]
        parts += [CONTACT.format(name=name, period="always") for name in CONTACTS]
        parts += [CONTACT.format(name=f"team-{name}", period=name) for name in PERIODS]
        parts += _history_objects("", History("", {f"{CLOCK}/{CLOCK}": ""}, attempts=1))
        for number, history in enumerate(self._histories):
            parts += _history_objects(f"h{number}-", history)
        return "".join(parts)

    def _start(self) -> None:
        self._process.start()
        self._starts += 1
        until(self._reads, self._process.describe, READY, every=0.2)

    def _reads(self) -> bool:
        """Whether this process reads commands; the pipe may still be that of the one before."""
        sign = f"{CLOCK};{CLOCK};0;start {self._starts}"
        with suppress(OSError):  # no pipe yet, or nobody reads it
            pipe = os.open(self._folder / "nagios.cmd", os.O_WRONLY | os.O_NONBLOCK)
            try:
                line = f"[{int(time.time())}] PROCESS_SERVICE_CHECK_RESULT;{sign}\n"
                os.write(pipe, line.encode())
            finally:
                os.close(pipe)
        return sign in self._log.read_text(errors="replace") if self._log.exists() else False

    # -- ticks -------------------------------------------------------------------------------

    def _play_tick(self, tick: int) -> None:
        """Send all results of a tick, and wait until Nagios has taken them."""
        if any(tick in each.restarts for each in self._histories):
            self._process.stop()
            self._start()
        if any(each.timed for each in self._histories):
            self._wait_until(self._begin + tick * SECONDS)
        lines = [
            line
            for number, history in enumerate(self._histories)
            for line in _results(number, history, tick)
        ]
        self._send([*lines, f"PROCESS_SERVICE_CHECK_RESULT;{CLOCK};{CLOCK};0;{tick + 1}"])
        until(
            lambda: f"{CLOCK};{CLOCK};0;{tick + 1}\n" in self._log.read_text(errors="replace"),
            lambda: f"tick {tick}: {self._log.read_text(errors='replace')[-2000:]}",
            READY,
        )

    def _wait_until(self, wall: float) -> None:
        until(lambda: time.time() >= wall, "the clock goes on", READY + 120)

    def _send(self, lines: Iterable[str]) -> None:
        now = int(time.time())
        with (self._folder / "nagios.cmd").open("w") as pipe:
            for line in lines:
                pipe.write(f"[{now}] {line}\n")
                pipe.flush()

    # -- notifications -----------------------------------------------------------------------

    def _notifications(self) -> list[list[Notification]]:
        """Those of each history; those of one tick in the order of their names."""
        found: list[list[tuple[int, Notification]]] = [[] for _ in self._histories]
        tick = 0
        for line in self._log.read_text(errors="replace").splitlines():
            if match := _TICK.match(line):
                tick = int(match[1])
            elif match := _NOTIFIED.match(line):
                number, notification = _notification(*match.groups())
                if tick > self._histories[number].ticks:
                    continue  # it is over; Nagios goes on, because others are not
                found[number].append((tick, notification))
        return [
            marked(kinds) if history.of_people else kinds
            for history, of_history in zip(self._histories, found, strict=True)
            for kinds in [[each for _, each in _sorted(of_history)]]
        ]


def _sorted(found: list[tuple[int, Notification]]) -> list[tuple[int, Notification]]:
    return sorted(found, key=lambda entry: (entry[0], entry[1].what, entry[1].who))  # stable


def next_minute() -> float:
    """The first full minute that leaves enough time to start, in Unix time."""
    return math.ceil((time.time() + START) / 60) * 60.0


def _times(days: Iterable[str], times: str = "00:00-24:00") -> str:
    return "\n".join(f"  {day} {times}" for day in days)


def _hours(changes: datetime, name: str) -> str:
    """The times of a period that begins or ends at a minute; it may be near midnight."""
    yesterday, today, tomorrow = (DAYS[(changes.weekday() + days) % 7] for days in (-1, 0, 1))
    if name == "begins":
        return f"{_times([today], f'{changes:%H:%M}-24:00')}\n{_times([tomorrow])}"
    until_then = _times([today], f"00:00-{changes:%H:%M}") if changes.hour + changes.minute else ""
    return f"{_times([yesterday])}\n{until_then}"


def _history_objects(prefix: str, history: History) -> Iterable[str]:
    hours = history.hours and ("begins" if history.hours.begin else "ends")
    of = history.hours and history.hours.of
    common = {
        "attempts": history.attempts,
        "flapping": int(history.flapping),
        # A second less: times are whole seconds, and a result may be late by one.
        "interval": int(history.repeat * SECONDS) - 1 if history.repeat else 0,
        "period": hours if of == "service" else "always",
        "contact": f"team-{hours}" if of == "contact" else "ops",
    }
    unreachable = "u," if history.unreachable else ""
    for host in history.all_hosts:
        parent = f"{prefix}{history.parents[host]}" if host in history.parents else "null"
        more = {"parent": parent, "unreachable": unreachable}
        yield HOST.format(host=f"{prefix}{host}", **common, **more)
        for each in history.escalations if host in history.hosts else ():
            yield _escalation(each, "host", f"{prefix}{host}", "", common)
    fresh = {
        "fresh": int(history.freshness is not None),
        "threshold": int((history.freshness or 0) * SECONDS),
    }
    for what in history.services:
        host, _, service = what.partition("/")
        yield SERVICE.format(host=f"{prefix}{host}", service=service, **common, **fresh)
        for each in history.escalations:
            line = f"  service_description {service}\n"
            yield _escalation(each, "service", f"{prefix}{host}", line, common)


def _escalation(
    escalation: Escalation, kind: str, host: str, service: str, common: Mapping[str, object]
) -> str:
    fields = {**escalation._asdict(), "interval": common["interval"]}
    return ESCALATION.format(kind=kind, host=host, service=service, **fields)


def _results(number: int, history: History, tick: int) -> Iterable[str]:
    """The commands of one history at a tick; before the first one everything is well."""
    for host, track in history.hosts.items():
        if (letter := _at(track, tick, "u")) != NONE:
            yield f"PROCESS_HOST_CHECK_RESULT;h{number}-{host};{HOST_CODES[letter]};{letter}"
    for each, track in history.services.items():
        if (letter := _at(track, tick, "o")) != NONE:
            host, _, service = each.partition("/")
            result = f"{SERVICE_CODES[letter]};{letter}"
            yield f"PROCESS_SERVICE_CHECK_RESULT;h{number}-{host};{service};{result}"
    for made in history.acknowledgements:
        if tick == made.tick:
            yield _acknowledge(number, made)
    for downtime in history.downtimes:
        if tick == -1:
            now = time.time()
            start, end = (now + (at + 0.5) * SECONDS for at in (downtime.start, downtime.end))
            times = f"{int(start)};{int(end)};1;0;0"
            yield f"SCHEDULE_HOST_DOWNTIME;h{number}-{downtime.host};{times};ops;planned"


def _acknowledge(number: int, made: Acknowledgement) -> str:
    host, _, service = made.what.partition("/")
    command, name = ("SVC", f"{host};{service}") if service else ("HOST", host)
    options = f"{2 if made.sticky else 0};{int(made.notify)};0"
    return f"ACKNOWLEDGE_{command}_PROBLEM;h{number}-{name};{options};ann;on it"


def _at(track: str, tick: int, before: str) -> str:
    if tick < 0:
        return before
    return track[tick] if tick < len(track) else NONE


def _notification(scope: str, who: str, host: str, rest: str) -> tuple[int, Notification]:
    number, _, name = host.removeprefix("h").partition("-")
    service, state, *_ = [*([""] if scope == "HOST" else []), *rest.split(";")]
    kind = re.match(r"[A-Z]+", state)
    assert kind, state
    word = {"OK": "RECOVERY", "UP": "RECOVERY"}.get(kind[0], kind[0])
    who = who.partition("-")[0]  # a contact of a period is the team
    return int(number), Notification(who, f"{name}/{service}" if service else name, word)
