"""Plays histories on the distribution's Nagios 4: passive results in, its notifications out."""

from __future__ import annotations

import getpass
import grp
import os
import re
import shutil
import time
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path

from conformance.history import HOST_CODES, NONE, SERVICE_CODES, History, Notification
from testbed.polling import until
from testbed.processes import Process

# Debian installs it to /usr/sbin, which is not in every PATH.
PROGRAM = shutil.which("nagios4", path=f"{os.environ['PATH']}:/usr/sbin")
SECONDS = 2.0  # of a tick, in histories in which its length matters
CLOCK = "clock"  # the host and service whose results mark the ticks
READY = 60.0

SETTINGS = """\
cfg_file={folder}/objects.cfg
object_cache_file={folder}/objects.cache
precached_object_file={folder}/objects.precache
status_file={folder}/status.dat
log_file={folder}/nagios.log
lock_file={folder}/nagios.lock
temp_file={folder}/nagios.tmp
temp_path={folder}
check_result_path={folder}/results
query_socket={folder}/nagios.qh
command_file={folder}/nagios.cmd
state_retention_file={folder}/retention.dat
retain_state_information=1
use_retained_program_state=1
nagios_user={user}
nagios_group={group}
interval_length=1
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
log_rotation_method=n
check_for_updates=0
use_syslog=0
"""
COMMON = """\
define timeperiod {
  timeperiod_name always
  alias always
  monday 00:00-24:00
  tuesday 00:00-24:00
  wednesday 00:00-24:00
  thursday 00:00-24:00
  friday 00:00-24:00
  saturday 00:00-24:00
  sunday 00:00-24:00
}
define command {
  command_name nothing
  command_line /bin/true
}
define command {
  command_name stale
  command_line /bin/sh -c 'echo not fresh; exit 2'
}
define contact {
  contact_name ops
  host_notification_period always
  service_notification_period always
  host_notification_options d,u,r,f,s
  service_notification_options w,u,c,r,f,s
  host_notification_commands nothing
  service_notification_commands nothing
}
"""
HOST = """\
define host {{
  host_name {host}
  address 127.0.0.1
  max_check_attempts {attempts}
  active_checks_enabled 0
  flap_detection_enabled {flapping}
  low_flap_threshold 20
  high_flap_threshold 40
  notification_interval 0
  notification_period always
  contacts ops
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
  notification_interval 0
  notification_period always
  contacts ops
}}
"""
_NOTIFIED = re.compile(r"\[\d+\] (HOST|SERVICE) NOTIFICATION: ([^;]+);([^;]+);(.*)")
_TICK = re.compile(rf"\[\d+\] EXTERNAL COMMAND: .*;{CLOCK};{CLOCK};0;(\d+)")


class Nagios:
    """One process of Nagios with several histories, each with hosts of its own."""

    def __init__(self, folder: Path, histories: Sequence[History]) -> None:
        assert PROGRAM, "nagios4 is not installed; ./run test --all installs it (nagios4-core)"
        self._folder = folder
        self._histories = histories
        self._log = folder / "nagios.log"
        self._process = Process("nagios", [PROGRAM, folder / "nagios.cfg"], {}, folder / "out.log")
        self._starts = 0
        self._write_settings()

    def play(self) -> list[list[Notification]]:
        """The notifications of each history, in their order."""
        self._start()
        try:
            for tick in range(-1, max(each.ticks for each in self._histories)):
                self._play_tick(tick)
        finally:
            self._process.stop()
        return self._notifications()

    # -- set-up ------------------------------------------------------------------------------

    def _write_settings(self) -> None:
        (self._folder / "results").mkdir(parents=True)
        group = grp.getgrgid(os.getgid()).gr_name
        user = getpass.getuser()
        settings = SETTINGS.format(folder=self._folder, user=user, group=group)
        (self._folder / "nagios.cfg").write_text(settings)
        clock = {"attempts": 1, "flapping": 0, "fresh": 0, "threshold": 0}
        parts = [COMMON, HOST.format(host=CLOCK, **clock)]
        parts.append(SERVICE.format(host=CLOCK, service=CLOCK, **clock))
        for number, history in enumerate(self._histories):
            parts += _objects(number, history)
        (self._folder / "objects.cfg").write_text("".join(parts))

    def _start(self) -> None:
        self._process.start()
        self._starts += 1
        until(self._reads, lambda: f"Nagios: {self._process.log.read_text()}", READY, every=0.2)

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
        begun = time.time()
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
        if any(each.timed for each in self._histories):
            until(lambda: time.time() >= begun + SECONDS, lambda: "the clock stands still", READY)

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
        return [[each for _, each in _sorted(of_history)] for of_history in found]


def _sorted(found: list[tuple[int, Notification]]) -> list[tuple[int, Notification]]:
    return sorted(found, key=lambda entry: (entry[0], entry[1].what))  # stable


def _objects(number: int, history: History) -> Iterable[str]:
    common = {"attempts": history.attempts, "flapping": int(history.flapping)}
    for host in history.all_hosts:
        yield HOST.format(host=f"h{number}-{host}", **common)
    fresh = {
        "fresh": int(history.freshness is not None),
        "threshold": int((history.freshness or 0) * SECONDS),
    }
    for each in history.services:
        host, _, service = each.partition("/")
        yield SERVICE.format(host=f"h{number}-{host}", service=service, **common, **fresh)


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
    for downtime in history.downtimes:
        if tick == -1:
            now = time.time()
            start, end = (now + (at + 0.5) * SECONDS for at in (downtime.start, downtime.end))
            times = f"{int(start)};{int(end)};1;0;0"
            yield f"SCHEDULE_HOST_DOWNTIME;h{number}-{downtime.host};{times};ops;planned"


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
    return int(number), Notification(who, f"{name}/{service}" if service else name, word)
