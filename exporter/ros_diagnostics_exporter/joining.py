"""Joins the domains again that could not be joined, and anew those that have become deaf."""

from __future__ import annotations

import logging
from collections.abc import Mapping, Sequence
from functools import cached_property

from ros_diagnostics_exporter.comparing import Comparing
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.loops import Loop, read_clocks
from ros_diagnostics_exporter.model import Domain, Instant, place
from ros_diagnostics_exporter.sources.listener import Listener

log = logging.getLogger(__name__)

INTERVAL = 1.0  # seconds between two looks at what has to be joined
AGAIN = 30.0  # ... until a domain that could not be joined is tried again
LEAST = 20.0  # ... that a domain is joined until it is joined anew because of silence
SILENT = "none of its robots is received"
MOVED = "this machine has other addresses"


def is_deaf(are_up: Sequence[bool]) -> bool:
    """Whether several robots were received, and all are silent now."""
    return len(are_up) > 1 and not any(are_up)


class Joining:
    """The domains of an exporter, as they follow the network."""

    def __init__(self, state: FleetState, listener: Listener) -> None:
        self._state, self._listener = state, listener
        self._join_at = 0.0  # what could not be joined, monotonic
        self.loop = Loop("domains", INTERVAL, self.turn, end=self._end)

    @cached_property
    def _comparing(self) -> Comparing:
        return Comparing(self._state, self._listener)

    def _end(self) -> None:
        self._comparing.stop()

    def configure(self, _fleet: Fleet, now: Instant) -> None:
        """Give the domains of another config, which the listener joins now, their time."""
        self._join_at = now.mono + AGAIN

    def turn(self) -> None:
        """Join what could not be joined, and anew what has become deaf."""
        now = read_clocks()
        anew = self._find_deaf(now)
        if anew:
            self._leave(anew, now)
        elif now.mono < self._join_at or self._listener.domain_ids == self._state.fleet.domain_ids:
            return
        else:
            self._note_late(now)
        self._join_at = now.mono + AGAIN
        self._listener.join()

    def _note_late(self, now: Instant) -> None:
        for domain_id in self._listener.joining:
            log.warning("%s is still being joined", place(domain_id))
            self._state.domain_failed(domain_id, "it is still being joined", now)

    def _find_deaf(self, now: Instant) -> Mapping[Domain, str]:
        """The domains to be joined anew, and why.

        Of one in which all robots have fallen silent nobody knows whether it is the robots; but a
        participant that has lost the network is healed by nothing else, and another one receives
        nothing either while the network is away. Of fewer robots it is known by comparing.
        """
        joined, received = self._listener.joined_at, self._state.received_since
        silent = {
            domain: SILENT
            for domain, at in joined.items()
            if now.mono >= at + LEAST and is_deaf(received(domain, at))
        }
        outdated = dict.fromkeys(self._listener.find_outdated(), MOVED)
        return {**self._comparing.find_deaf(now), **silent, **outdated}

    def _leave(self, domains: Mapping[Domain, str], now: Instant) -> None:
        for domain_id, why in domains.items():
            log.warning("%s is joined anew: %s", place(domain_id), why)
            if why != SILENT:  # so that the silence of its robots is none of theirs
                self._state.domain_failed(domain_id, f"it is joined anew: {why}", now)
        self._listener.leave(domains)
