"""What is known about one robot: whether it is heard, why not, and by which config it is judged.

Its components are `members`, and arrays reach them by `intake`; this file owns the robot as a
whole.
"""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Mapping

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.model import Array, Instant
from ros_diagnostics_exporter.state.bounds import Budget
from ros_diagnostics_exporter.state.component import Component, Identity
from ros_diagnostics_exporter.state.components import Members
from ros_diagnostics_exporter.state.network import Endpoint, Network
from ros_diagnostics_exporter.state.persisted import RememberedRobot
from ros_diagnostics_exporter.state.reasons import TOLD, Rejection, Silence
from ros_diagnostics_exporter.state.updates import RawIntake, TreeIntake
from ros_diagnostics_exporter.state.versions import Versions

log = logging.getLogger(__name__)

# Rows of an array that are looked at, for each component that a robot may have: an aggregator lists
# its groups, too, and a component in each of its groups.
ROWS_OF_COMPONENT = 4

Changed = Callable[["Robot", Component, int, Instant], None]  # told the level before


class Robot:
    """One robot; see the module. All of it is guarded by the lock of the State that holds it.

    ``declared`` tells that fleet.yml names it; ``found_mono`` is when it was added, ``seen_mono``
    when its topics' publishers last changed; ``last_mono`` and ``last_wall`` are when the last
    array arrived, ``clock_offset`` seconds between the last stamp and its receipt.
    """

    def __init__(
        self,
        settings: config.Robot,
        limits: config.Limits,
        budget: Budget,
        changed: Changed,
        now: Instant,
        *,
        declared: bool,
    ) -> None:
        self.settings = settings
        self.declared = declared
        self.found_mono = self.seen_mono = now.mono
        self.limits = limits
        self.up = False
        self.source = settings.source
        self.first_raw: float | None = None
        self.last_mono: float | None = None
        self.last_wall = 0.0
        self.messages = 0
        self.bytes = 0
        self.clock_offset: float | None = None
        self.undecodable = False
        self.network = Network()
        self.maintenance = False
        self.rejected: Counter[str] = Counter()
        self._said: set[Rejection] = set()
        self.versions = Versions()
        self.members = Members(
            settings.profile,
            limits,
            budget=budget,
            versions=self.versions,
            reject=self.refuse,
            changed=lambda component, before, now: changed(self, component, before, now),
        )
        self._tree = TreeIntake(self.members, self.versions, limits, self.refuse)
        self._raw = RawIntake(self.members)

    @property
    def components(self) -> Mapping[Identity, Component]:
        """The components by their identity."""
        return self.members.all

    @property
    def groups(self) -> Mapping[str, tuple[int, str]]:
        """The robot's own groups: path -> (level, message) as its aggregator reported them."""
        return self._tree.groups

    def configure(self, settings: config.Robot, limits: config.Limits, now: Instant) -> None:
        """Follow another config; what is known stays, as far as it is still wanted."""
        if settings.source is not self.settings.source:
            self.source = settings.source
        if _road(settings) != _road(self.settings):
            self.network = Network()
        judged_anew = (settings.profile, limits) != (self.settings.profile, self.limits)
        self.settings, self.limits = settings, limits
        self.versions.inventory += 1
        self.versions.structure += 1
        if judged_anew:
            self._tree.start_over(limits)
            self._said.clear()
            self.members.configure(settings.profile, limits, now)

    # -- what comes in -----------------------------------------------------------------------

    def receive(self, array: Array, now: Instant, *, raw: bool) -> None:
        """Take in one array from the raw or the aggregated topic."""
        self.up = True
        self.undecodable = False
        self.last_mono, self.last_wall = now
        self.messages += 1
        self.bytes += array.size
        if array.stamp > 0:
            self.clock_offset = now.wall - array.stamp
        self.versions.receipt += 1
        statuses = array.statuses
        most = ROWS_OF_COMPONENT * self.limits.components
        if len(statuses) > most:
            self.refuse("component_limit", statuses[most].name)
            statuses = statuses[:most]
        intake = self._raw if raw else self._tree
        intake.take(statuses, now)

    def reject(self, reason: Rejection) -> None:
        """Count something that was not taken in."""
        self.rejected[reason] += 1
        self.versions.receipt += 1

    def refuse(self, reason: Rejection, what: str) -> None:
        """Count it, and say it the first time; ``what`` is an example of the robot's own words."""
        self.reject(reason)
        if reason not in self._said:
            self._said.add(reason)
            log.warning(
                "robot %r: %s, for example %.80r; said once, counted in robot_rejected_total as %s",
                self.settings.name,
                TOLD[reason],
                what,
                reason,
            )

    @property
    def silent_reason(self) -> Silence | None:
        """Why nothing arrives, in one word; None while the robot is up."""
        if self.up:
            return None
        if self.network.domain_up and self.undecodable:
            return "undecodable"
        if self.network.obstacle is not None:
            return self.network.obstacle
        if self.network.publishers:
            return "mute"
        return "publisher_gone" if self.last_wall else "never_seen"

    # -- time --------------------------------------------------------------------------------

    def tick(self, now: Instant) -> bool:
        """Let time pass: silence, late components, flapping. True if the robot fell silent."""
        self.members.calm(now)
        if not self.up or self.last_mono is None:
            return False
        if now.mono - self.last_mono > self.settings.profile.stale_after:
            self.up = False
            self.versions.receipt += 1
            self.members.lose_all(now)
            return True
        self.members.find_late(now)
        return False

    def is_forgettable(self, now: Instant) -> bool:
        """Whether it was discovered and is long gone, and nothing of it was not OK.

        A component that was not OK when it was last received is still there, and keeps its robot.
        """
        network = self.network
        if self.declared or self.up or self.components:
            return False
        if network.publishers or network.obstacle is not None:
            return False
        last = self.seen_mono if self.last_mono is None else self.last_mono
        return now.mono - last > self.settings.profile.forget_after

    def see(self, topic: str, endpoint: Endpoint | None, now: Instant) -> None:
        """Take what the graph shows of one of its topics."""
        if self.network.see(topic, endpoint):
            self.seen_mono = now.mono
            self.versions.receipt += 1

    def remember(self, now: Instant) -> RememberedRobot:
        """What a later process should know."""
        settings = self.settings
        return RememberedRobot(
            domain_id=settings.domain_id,
            topic=settings.topic_agg or settings.topic_raw or "",
            source=self.source.value,
            last_seen=self.last_wall,
            components=[each.remember(now) for each in self.components.values() if each.level >= 0],
        )

    def restore(self, known: RememberedRobot, now: Instant) -> None:
        """Put back what a former process knew: all of it STALE until it is heard."""
        if self.settings.source is config.Source.AUTO:
            self.source = config.Source(known.source)
        self.last_wall = known.last_seen
        if known.last_seen:
            self.last_mono = now.mono - max(0.0, now.wall - known.last_seen)
        for each in known.components:
            name, _group, parting = each.identity
            if parting:
                self._raw.part(name)
            component = self.members.obtain(each.identity, each.group, now)
            if component is not None:
                component.restore(each, now)
        self.versions.levels += 1
        self.versions.receipt += 1


def _road(settings: config.Robot) -> tuple[int, str | None, str | None]:
    return settings.domain_id, settings.topic_agg, settings.topic_raw
