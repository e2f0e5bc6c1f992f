"""Plays histories on the exporter's state and engine, in virtual time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace

from conformance.history import HOURS_CHANGE, NONE, SERVICE_CODES, History, Notification
from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    FaultSettings,
    Flapping,
    Fleet,
    Maintenance,
    Profile,
    Robot,
    Source,
    WarningHours,
)
from ros_diagnostics_exporter.faults.model import Fault, Row
from ros_diagnostics_exporter.faults.model import State as FaultState
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.regex import Pattern

# Seconds; slightly below the minute that is one state of a robot that comes and goes: a change is
# then one state, as it is one result for Nagios.
TICK = 59.0
STEP = 0.25  # between two looks at the clock, as the exporter's; longer where nothing is due
IDLE = 2.0
# Of tick 0: the hours of a history change on a Tuesday at 8:00 UTC, half a tick before one.
WALL = 1_699_948_800.0 - (HOURS_CHANGE - 0.5) * TICK
TUESDAY, EIGHT, DAY = 1, 8 * 60, 24 * 60  # minutes of a `Weekly`
HOURS = {
    True: ((TUESDAY, EIGHT, DAY), (TUESDAY + 1, 0, DAY)),
    False: ((TUESDAY - 1, 0, DAY), (TUESDAY, 0, EIGHT)),
}
READY = -10  # the tick from which on the robots are received; all is settled by tick 0
NEVER = 1e9
FLAPPING_OFF = 2.0  # no ratio is as high
# The worst that lasts names what is wrong, as a state of Nagios; the worst first.
NAMES = {
    FaultState.SILENT: "DOWN",
    FaultState.CRITICAL: "CRITICAL",
    FaultState.STALE: "UNKNOWN",
    FaultState.WARNING: "WARNING",
}


def play(history: History) -> list[Notification]:
    """The notifications of one history, in their order."""
    player = _Player(history)
    for tick in range(READY, history.ticks):
        player.tick(tick)
    return [
        Notification("ops", what, kind)
        for _, what, kind in sorted(player.found, key=lambda each: each[:2])
    ]


class _Player:
    def __init__(self, history: History) -> None:
        self._history = history
        self._fleet = _fleet(history)
        self._now = _at(READY - 10)
        self._state = FleetState(self._fleet, self._now)
        self._lasting: dict[str, set[FaultState]] = {}
        self._planned: dict[str, bool] = {}
        self._rows: dict[tuple[str, tuple[str, ...]], Row] = {}
        self.found: list[tuple[int, str, str]] = []

    def tick(self, tick: int) -> None:
        """Let time pass up to the tick, and receive what is received then."""
        if tick in self._history.restarts:
            self._restart()
        self._pass(tick - 1e-3)
        self._now = _at(tick)
        for host in self._history.robots:
            if _letter(self._history.hosts.get(host, "u" * self._history.ticks), tick, "u") == "u":
                self._receive(host, tick)
        self._state.tick(self._now)
        self._collect()
        self._pass(tick + 0.9)

    def _pass(self, until: float) -> None:
        end = _at(until).mono
        while self._now.mono < end:
            after = self._now.mono % TICK
            mono = min(end, self._now.mono + (STEP if after < TICK / 8 else IDLE))
            self._now = Instant(mono, WALL + mono)
            self._state.tick(self._now)
            self._collect()

    def _receive(self, host: str, tick: int) -> None:
        statuses = []
        for each, track in self._history.services.items():
            robot, _, component = each.partition("/")
            letter = _letter(track, tick, "o")
            if robot == host and letter != NONE:
                statuses.append(Status(SERVICE_CODES[letter], component))
        array = Array(self._now.wall, tuple(statuses), 100)
        self._state.receive(Topic(0, f"/{host}/diagnostics"), array, self._now)
        self._collect()

    def _restart(self) -> None:
        """Go on as another process, from what this one would have written."""
        for row in self._state.take_fault_rows(self._now):
            self._rows[row.kind, row.key] = row
        robots = {name: robot.persist(self._now) for name, robot in self._state.robots.items()}
        self._state = FleetState(self._fleet, self._now)
        self._state.restore(robots, self._now)
        kept = [row for row in self._rows.values() if row.fields is not None]
        self._state.restore_faults(kept, self._now)

    # -- faults to notifications -------------------------------------------------------------

    def _collect(self) -> None:
        for host in self._history.robots:
            planned = self._state.robots[host].maintenance
            if planned != self._planned.get(host, False):
                self._planned[host] = planned
                self._say(host, "DOWNTIMESTART" if planned else "DOWNTIMEEND")
        lasting: dict[str, set[FaultState]] = {}
        for fault in self._state.faults():
            lasting.setdefault(_about(fault), set()).add(fault.identity.state)
        for what in lasting.keys() | self._lasting.keys():
            self._compare(what, self._lasting.get(what, set()), lasting.get(what, set()))
        self._lasting = lasting

    def _compare(self, what: str, before: set[FaultState], after: set[FaultState]) -> None:
        if (FaultState.FLAPPING in before) != (FaultState.FLAPPING in after):
            started = FaultState.FLAPPING in after
            self._say(what, "FLAPPINGSTART" if started else "FLAPPINGSTOP")
        if (name := _worst(after)) != _worst(before):
            self._say(what, name or "RECOVERY")

    def _say(self, what: str, kind: str) -> None:
        # What happens in the second half of a tick comes before the results of the next one.
        tick = math.floor(self._now.mono / TICK + 0.6)
        self.found.append((tick, what, kind))


def _worst(states: set[FaultState]) -> str:
    return next((name for state, name in NAMES.items() if state in states), "")


def _about(fault: Fault) -> str:
    identity = fault.identity
    return "/".join(filter(None, (identity.site or identity.robot, identity.component)))


def _at(tick: float) -> Instant:
    return Instant(tick * TICK, WALL + tick * TICK)


def _letter(track: str, tick: int, before: str) -> str:
    if tick < 0:
        return before
    return track[tick] if tick < len(track) else NONE


def _fleet(history: History) -> Fleet:
    # A fault is confirmed with its last result, not in the moment before the next one.
    confirm_after = (history.attempts - 1) * TICK + TICK / 10
    fresh = history.freshness
    profile = Profile(
        stale_after=TICK + STEP / 2 if history.hosts else NEVER,
        confirm_after=confirm_after,
        flap_interval=1.02 * TICK,  # as a robot's
        stale_is_critical=fresh is not None,
    )
    rule = ComponentRule(Pattern(".*"), stale_after=NEVER if fresh is None else fresh * TICK)
    profile = replace(profile, components=(rule,))
    robots = tuple(
        Robot(
            host,
            topic_raw=f"/{host}/diagnostics",
            source=Source.RAW,
            profile=profile,
            labels={"site": history.parents[host]} if host in history.parents else {},
        )
        for host in history.robots
    )
    faults = FaultSettings(confirm_after=profile.confirm_after)
    if not history.flapping:
        faults = replace(faults, flapping=Flapping(start=FLAPPING_OFF))
    if history.hours is not None:
        faults = replace(faults, warning_hours=WarningHours(HOURS[history.hours.begin]))
    return Fleet("f", robots, maintenance=tuple(_downtimes(history)), faults=faults)


def _downtimes(history: History) -> Iterator[Maintenance]:
    for each in history.downtimes:
        selector: Mapping[str, tuple[Pattern, ...]] = {"robot": (Pattern(each.host),)}
        start, end = (_at(at - 0.5).wall for at in (each.start, each.end))
        yield Maintenance("planned", selector, "planned", start, end)
