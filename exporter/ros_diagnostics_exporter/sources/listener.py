"""The source of what robots publish: a `Reception` for each DDS domain, and one for zenoh."""

from __future__ import annotations

import errno
import os
import threading
import time
from collections.abc import Iterable, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory

from ros_diagnostics_exporter.config.fleet import Fleet, Zenoh
from ros_diagnostics_exporter.loops import Loop
from ros_diagnostics_exporter.model import ZENOH, Domain, Instant, place
from ros_diagnostics_exporter.sources.addresses import local_addresses
from ros_diagnostics_exporter.sources.dds import DdsDomain
from ros_diagnostics_exporter.sources.receiver import Receiver
from ros_diagnostics_exporter.sources.reception import Reception
from ros_diagnostics_exporter.sources.ros_environment import (
    free_large_blocks_at_once,
    leave_out_generator,
    use_log_folder,
    use_profiles,
)

LEAVE_TIME = 4.0  # seconds that domains are waited for when they are left
STALLED = 10.0  # seconds without a turn of a domain's thread after which it is not ready


class Listener:
    """An `ArraySource` that joins the domains and subscribes to what is wanted there."""

    name = "topics"

    def __init__(
        self,
        receiver: Receiver,
        poll_interval: float = 1.0,
        ros_arguments: tuple[str, ...] = (),
    ) -> None:
        """``ros_arguments`` are those from ``--ros-args`` on, as ROS' own tools take them."""
        self.poll_interval = poll_interval  # seconds between two looks at a domain's graph
        self.ros_arguments = ros_arguments
        self._receiver = receiver
        self._log_folder: TemporaryDirectory[str] | None = None
        self._fleet: Fleet | None = None  # the config that it follows
        self._domains: dict[Domain, Reception] = {}  # in the order of the config
        self._addresses: frozenset[str] = frozenset()  # of this machine, when last asked
        self._joining = threading.Lock()
        self._counting = threading.Lock()
        self.decode_seconds = 0.0
        self.ingest_seconds = 0.0

    def configure(self, fleet: Fleet, _now: Instant) -> None:
        """Be in exactly the domains of this config."""
        with self._joining:
            self._fleet = fleet
            self._join(fleet)

    def join(self) -> None:
        """Join the domains of the config that could not be joined, or were left by `leave`.

        Each is joined by a thread of its own, which calls ``domain_joined`` or ``domain_failed`` of
        the receiver: this waits for none of them, and for those that are left at most
        ``LEAVE_TIME``. One that is still being joined, or left, stays as it is.
        """
        with self._joining:
            if self._fleet is not None:
                self._join(self._fleet)

    def stop(self) -> None:
        """Leave all domains."""
        with self._joining:
            self._fleet = None
            self._be_in({})

    def find_outdated(self) -> list[Domain]:
        """The DDS domains that were joined with other addresses than this machine has now.

        None until the addresses are the same at two calls: they may come one by one. None either
        while no file may be opened, as where somebody holds many connections: nobody knows them.
        """
        try:
            before, self._addresses = self._addresses, local_addresses()
        except OSError as error:
            if error.errno not in (errno.EMFILE, errno.ENFILE):
                raise
            return []
        return [
            each
            for each, domain in self._domains.items()
            if before == self._addresses != domain.addresses and domain.joined and each != ZENOH
        ]

    def leave(self, domains: Iterable[Domain]) -> None:
        """Leave these domains, which `join` joins anew."""
        with self._joining:
            self._leave([self._domains[each] for each in domains])

    def _leave(self, leaving: list[Reception]) -> None:
        for domain in leaving:
            domain.loop.ask_to_stop()
        deadline = time.monotonic() + LEAVE_TIME
        for domain in leaving:
            domain.wait(max(0.0, deadline - time.monotonic()))

    def _join(self, fleet: Fleet) -> None:
        new = self._be_in(
            {each: fleet.zenoh if each == ZENOH else None for each in fleet.domain_ids}
        )
        for domain in self._domains.values():
            domain.max_message = fleet.limits.message_bytes
        for domain in new:
            domain.loop.start()
        for domain_id in self.domain_ids:  # so that robots that are new in it know
            self._receiver.domain_joined(domain_id)

    def _be_in(self, wanted: Mapping[Domain, Zenoh | None]) -> list[Reception]:
        """Leave all other domains; returns those that are to be joined by their threads."""
        leaving = [
            domain
            for each, domain in self._domains.items()
            if each not in wanted or domain.settings != wanted[each]
        ]
        self._leave(leaving)
        alive = {each: domain for each, domain in self._domains.items() if domain.alive}
        new = {
            each: self._new(each, settings)
            for each, settings in wanted.items()
            if each not in alive
        }
        self._domains = {each: alive.get(each) or new[each] for each in wanted} | alive
        return list(new.values())

    def _new(self, domain: Domain, zenoh: Zenoh | None) -> Reception:
        free_large_blocks_at_once()
        if zenoh is not None:
            from ros_diagnostics_exporter.sources.zenoh import (  # noqa: PLC0415 - see there
                ZenohNetwork,
            )

            return ZenohNetwork(zenoh, self._receiver, self.count, self.poll_interval)
        if not isinstance(domain, int):
            raise TypeError("zenoh has no settings")
        leave_out_generator()
        use_profiles(os.environ, Path())
        self._log_folder = self._log_folder or use_log_folder(os.environ)
        return DdsDomain(domain, self.ros_arguments, self._receiver, self.count, self.poll_interval)

    def count(self, decode_seconds: float, ingest_seconds: float) -> None:
        """Add to the CPU time spent; called by the domains' threads."""
        with self._counting:
            self.decode_seconds += decode_seconds
            self.ingest_seconds += ingest_seconds

    @property
    def domain_ids(self) -> tuple[Domain, ...]:
        """The domains that are joined."""
        return tuple(each for each, domain in self._domains.items() if domain.joined)

    @property
    def joined_at(self) -> Mapping[Domain, float]:
        """When the DDS domains were joined, monotonic; infinity: not yet."""
        return {each: of.joined_at for each, of in self._domains.items() if each != ZENOH}

    def received_since(self, domain: Domain, topics: Iterable[str], mono: float) -> set[str]:
        """Those of these topics of which any bytes were taken since then."""
        known = self._domains[domain].topics.get  # which its thread changes meanwhile
        return {each for each in topics if (of := known(each)) and of.content.received_at > mono}

    @property
    def joining(self) -> tuple[Domain, ...]:
        """The domains that are being joined, which may take long."""
        return tuple(each for each, domain in self._domains.items() if domain.joining)

    @property
    def last_looks(self) -> Mapping[Domain, float]:
        """Joined domain -> Unix time when its graph was last looked at; 0 before that."""
        return {each: of.last_look for each, of in self._domains.items() if of.joined}

    @property
    def loops(self) -> list[Loop]:
        """Those of the domains."""
        return [domain.loop for domain in self._domains.values()]

    @property
    def errors(self) -> Mapping[Domain, str]:
        """Why domains are not joined, by domain."""
        return {each: domain.error for each, domain in self._domains.items() if domain.error}

    @property
    def troubles(self) -> Mapping[Domain, str]:
        """Why domains are not received, by domain; "" where nothing is wrong."""
        return {each: domain.trouble for each, domain in self._domains.items()}

    @property
    def oddities(self) -> Mapping[Domain, str]:
        """What domains have that cannot be read, and is left out."""
        return {each: domain.odd for each, domain in self._domains.items()}

    def not_ready_reason(self, wanted: Iterable[Domain]) -> str | None:
        """Why messages of these domains are not received; None when they are."""
        failed, joining, looks = self.errors, self.joining, self.last_looks
        if failed:
            return "; ".join(f"cannot join {place(each)}: {why}" for each, why in failed.items())
        if joining:
            return f"{', '.join(map(place, joining))} is still being joined"
        if not all(looks.get(each) for each in wanted):
            return "the ROS graph has not been looked at yet"
        troubles = {each: why for each, why in self.troubles.items() if why}
        if troubles:
            return "; ".join(f"{place(each)}: {why}" for each, why in troubles.items())
        since = time.monotonic() - STALLED
        turns = ((each, of.last_turn) for each, of in self._domains.items() if of.joined)
        stalled = [place(each) for each, last_turn in turns if last_turn < since]
        if stalled:
            return f"no message was taken for {STALLED:.0f} s in {', '.join(stalled)}"
        return None
