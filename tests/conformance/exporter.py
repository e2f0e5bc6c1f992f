"""Plays histories on the exporter's state and engine, in virtual time."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace

from conformance.history import NONE, SERVICE_CODES, History, Notification
from ros_diagnostics_exporter.config.fleet import (
    ComponentRule,
    FaultSettings,
    Fleet,
    Maintenance,
    Profile,
    Robot,
    Source,
)
from ros_diagnostics_exporter.faults.model import Fault, Row
from ros_diagnostics_exporter.faults.model import State as FaultState
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_exporter.state.state import State

# Seconds; slightly below the minute that is one state of a robot that comes and goes: a change is
# then one state, as it is one result for Nagios.
TICK = 59.0
STEP = 0.25  # between two looks at the clock, as the exporter's; longer where nothing is due
IDLE = 2.0
WALL = 1_700_000_000.0
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


@dataclass(frozen=True)
class Variant:
    """How the exporter is set up: as it should be, or wrong on purpose.

    ``early`` ticks are taken off confirm_after. ``soft_recovery`` notifies that a problem is over
    that never was a fault.
    """

    early: float = 0.0
    soft_recovery: bool = False


def play(history: History, variant: Variant = Variant()) -> list[Notification]:
    """The notifications of one history, in their order."""
    player = _Player(history, variant)
    for tick in range(READY, history.ticks):
        player.tick(tick)
    return [
        Notification("ops", what, kind)
        for _, what, kind in sorted(player.found, key=lambda each: each[:2])
    ]


class _Player:
    def __init__(self, history: History, variant: Variant) -> None:
        self._history = history
        self._fleet = _fleet(history, variant)
        self._now = _at(READY - 10)
        self._state = State(self._fleet, self._now)
        self._lasting: dict[str, set[FaultState]] = {}
        self._planned: dict[str, bool] = {}
        self._rows: dict[tuple[str, tuple[str, ...]], Row] = {}
        self._variant = variant
        self._soft: set[str] = set()
        self.found: list[tuple[int, str, str]] = []

    def tick(self, tick: int) -> None:
        """Let time pass up to the tick, and receive what is received then."""
        if tick in self._history.restarts:
            self._restart()
        self._pass(tick - 1e-3)
        self._now = _at(tick)
        for host in self._history.all_hosts:
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
        self._state = State(self._fleet, self._now)
        self._state.restore(robots, self._now)
        kept = [row for row in self._rows.values() if row.fields is not None]
        self._state.restore_faults(kept, self._now)

    # -- faults to notifications -------------------------------------------------------------

    def _collect(self) -> None:
        for host in self._history.all_hosts:
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
        if self._variant.soft_recovery:
            self._soft_recoveries()

    def _soft_recoveries(self) -> None:
        soft = {
            "/".join(filter(None, (each.identity.robot, each.identity.component)))
            for each in self._state.problems(self._now)
            if each.fault is None
        }
        for what in self._soft - soft - self._lasting.keys():
            self._say(what, "RECOVERY")
        self._soft = soft

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
    return "/".join(filter(None, (identity.robot, identity.component)))


def _at(tick: float) -> Instant:
    return Instant(tick * TICK, WALL + tick * TICK)


def _letter(track: str, tick: int, before: str) -> str:
    if tick < 0:
        return before
    return track[tick] if tick < len(track) else NONE


def _fleet(history: History, variant: Variant) -> Fleet:
    # A fault is confirmed with its last result, not in the moment before the next one.
    confirm_after = (history.attempts - 1 - variant.early) * TICK + TICK / 10
    fresh = history.freshness
    profile = Profile(
        stale_after=TICK + STEP / 2 if history.hosts else NEVER,
        confirm_after=max(0.0, confirm_after),
        flap_interval=1.02 * TICK,  # as a robot's
        stale_is_critical=fresh is not None,
    )
    rule = ComponentRule(Pattern(".*"), stale_after=NEVER if fresh is None else fresh * TICK)
    profile = replace(profile, components=(rule,))
    robots = tuple(
        Robot(host, topic_raw=f"/{host}/diagnostics", source=Source.RAW, profile=profile)
        for host in history.all_hosts
    )
    on = FaultSettings() if history.flapping else FaultSettings(flapping_start=FLAPPING_OFF)
    return Fleet("f", robots, maintenance=tuple(_downtimes(history)), faults=on)


def _downtimes(history: History) -> Iterator[Maintenance]:
    for each in history.downtimes:
        selector: Mapping[str, tuple[Pattern, ...]] = {"robot": (Pattern(each.host),)}
        start, end = (_at(at - 0.5).wall for at in (each.start, each.end))
        yield Maintenance("planned", selector, "planned", start, end)
