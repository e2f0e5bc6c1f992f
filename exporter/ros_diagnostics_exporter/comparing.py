"""Finds domains that have become deaf to a robot: a second participant finds it, this one not.

A robot that is silent may be off, or this process may be deaf to it; so may a node that is gone. So
while there is one, a second process listens to the robot's topics, or looks for the node, for some
seconds: soon after it went, and then ever less often. This process is deaf to a topic that the
second one received twice, or a node that it found twice, and itself not once meanwhile.
"""

from __future__ import annotations

import logging
import os
import random
import subprocess
import sys
import time
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from math import inf

from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Domain, Instant, place
from ros_diagnostics_exporter.sources.graph_nodes import NODE
from ros_diagnostics_exporter.sources.listener import Listener
from ros_diagnostics_exporter.texts import first_few

log = logging.getLogger(__name__)

PROGRAM = "ros_diagnostics_exporter.sources.dds_second"
LISTEN = 10.0  # seconds that the second participant listens
ENDED = 60.0  # ... after which it is ended, where joining takes as long
REST = 60.0  # ... between two comparisons, and from joining to the first
LONGEST = 3600.0  # ... between two of the same topics, which are ever further apart
CONFIRM = 10.0  # ... from the one that first missed topics to the next of these
MOST = 100  # topics and nodes of one comparison: of more, some are chosen by chance


class Second:
    """A second participant of a domain: a process that looks for these topics and nodes."""

    def __init__(
        self, domain: Domain, wanted: Collection[str], ros_arguments: Sequence[str]
    ) -> None:
        self.began = time.monotonic()
        self._process = subprocess.Popen(  # noqa: S603
            [sys.executable, "-m", PROGRAM, str(domain), str(LISTEN), *wanted, *ros_arguments],
            env=os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,  # which holds all that it says
            text=True,
        )

    @property
    def listens(self) -> bool:
        """Whether it goes on."""
        return self._process.poll() is None and time.monotonic() < self.began + ENDED

    def stop(self) -> set[str]:
        """End it; the topics of which it received a message, and the nodes that it found."""
        if self._process.poll():
            log.warning(
                "the process that listens to silent robots failed (exit code %d)",
                self._process.returncode,
            )
        self._process.kill()
        return set(self._process.communicate()[0].splitlines())


@dataclass(slots=True)
class _Compared:
    """What is known of one domain; times are monotonic."""

    last: float = -inf  # when the last comparison began
    rest: float = REST
    lost: set[str] = field(default_factory=set)  # since before the last one
    missed: set[str] = field(default_factory=set)  # at the last one, by this process alone
    since: float = 0.0  # when the one began that first missed them


class Comparing:
    """Compares domains with what a second participant finds there, one after the other."""

    def __init__(self, state: FleetState, listener: Listener) -> None:
        self._state, self._listener = state, listener
        self._domains: dict[Domain, _Compared] = {}
        self._second: Second | None = None
        self._domain: Domain = 0  # that it listens to

    def stop(self) -> None:
        """End the second participant, if there is one."""
        if self._second is not None:
            self._second.stop()
            self._second = None

    def find_deaf(self, now: Instant) -> Mapping[Domain, str]:
        """Go on with comparing; the domains that turned out to be deaf, and to what."""
        if self._second is None:
            self._begin(now)
        elif not self._second.listens:
            second, self._second = self._second, None
            return self._judge(self._domains[self._domain], second, now)
        return {}

    def _begin(self, now: Instant) -> None:
        joined = self._listener.joined_at
        self._domains = {each: self._domains.get(each) or _Compared() for each in joined}
        for domain, known in self._domains.items():
            if now.mono < joined[domain] + REST:
                continue
            if wanted := _choose(known, self._lost(domain), now):
                known.last, self._domain = now.mono, domain
                self._start(wanted)
                return

    def _lost(self, domain: Domain) -> set[str]:
        """The topics of silent robots, and the nodes that are gone."""
        return {*self._state.silent_topics(domain), *self._gone(domain)}

    def _gone(self, domain: Domain) -> set[str]:
        return {NODE + each for each in self._state.gone_nodes(domain)}

    def _start(self, wanted: Collection[str]) -> None:
        try:
            self._second = Second(self._domain, wanted, self._listener.ros_arguments)
        except OSError as error:  # domains are joined all the same
            log.warning(
                "%s: the process that listens to silent robots was not started: %s",
                place(self._domain),
                error,
            )

    def _judge(self, known: _Compared, second: Second, now: Instant) -> Mapping[Domain, str]:
        domain, before = self._domain, known.missed
        known.since = known.since if before else second.began
        found, known.missed = second.stop(), set()
        if self._listener.joined_at.get(domain, inf) > known.since:
            return {}  # it was joined anew meanwhile, or left
        nodes = {each for each in found if each.startswith(NODE)}
        topics = found - nodes
        missed = topics - self._listener.received_since(domain, topics, known.since)
        missed |= nodes & self._gone(domain)
        missing = first_few(sorted(missed), 1)
        why = f"a second process on this machine finds {missing}, and the exporter does not"
        if missed and before:
            return {domain: why}
        known.missed = missed
        if missed:  # so that their silence becomes no fault of a robot meanwhile
            log.warning("%s: %s", place(domain), why)
            self._state.domain_deaf(domain, missed, why, now)
        elif before:
            self._state.domain_joined(domain)
        return {}


def _choose(known: _Compared, lost: set[str], now: Instant) -> set[str]:
    """The topics and nodes that are due; notes that they are compared now."""
    if known.missed:
        return known.missed if now.mono >= known.last + CONFIRM else set()
    known.lost &= lost
    rest = REST if lost - known.lost else known.rest
    if not lost or now.mono < known.last + rest:
        return set()
    known.lost, known.rest = lost, min(2 * rest, LONGEST)
    return set(random.sample(sorted(lost), min(MOST, len(lost))))
