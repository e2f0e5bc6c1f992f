"""One robot: whether it is up, why not, and how its arrays update its components."""

from __future__ import annotations

import logging
from collections import Counter, deque
from collections.abc import Callable, Container, Mapping, Sequence
from math import inf

from ros_diagnostics_exporter.config import fleet as config
from ros_diagnostics_exporter.events import Event
from ros_diagnostics_exporter.model import (
    Array,
    Domain,
    Downtime,
    Endpoint,
    Feed,
    Instant,
    Level,
    Status,
)
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.components import Components
from ros_diagnostics_exporter.robots.level_events import LevelEvents
from ros_diagnostics_exporter.robots.limits import SeriesLimit
from ros_diagnostics_exporter.robots.maintenance import (
    PlannedBy,
    components_in_maintenance,
    lasting,
)
from ros_diagnostics_exporter.robots.marks import Mark, Marks, marking
from ros_diagnostics_exporter.robots.missions import Missions
from ros_diagnostics_exporter.robots.network import Network
from ros_diagnostics_exporter.robots.persisted import Origin, PersistedRobot
from ros_diagnostics_exporter.robots.reading import AutoSource
from ros_diagnostics_exporter.robots.rejections import (
    LOG_TEXTS,
    REASONS,
    RejectionReason,
    SilentReason,
)
from ros_diagnostics_exporter.robots.tree import AggregatedUpdates
from ros_diagnostics_exporter.robots.updates import (
    FieldUpdates,
    MeasuredUpdates,
    RawUpdates,
    query_of,
)
from ros_diagnostics_exporter.sources.link import LinkReading

log = logging.getLogger(__name__)

_AUTO, _AGG, _RAW = config.Source.AUTO, config.Source.AGG, config.Source.RAW  # asked at each array

# Statuses of an array that are read, for each component that a robot may have: an aggregator lists
# its groups, too, and a component in each of its groups.
ROWS_OF_COMPONENT = 4
SEEN_AGAIN = 2.0  # seconds after which a robot that nothing was received of is looked for
TIME_TO_RETURN = 600.0  # seconds after a start in which nothing is forgotten for its absence
FLEETING = 60.0  # seconds for which a newcomer has to be received until its silence is a fault
FLEETING_KEPT = 600.0  # ... and for which one is kept that was received for less


@marking(
    settings=Mark.CONFIG,
    limits=Mark.CONFIG,
    declared=Mark.CONFIG,
    shared=Mark.CONFIG,
    source=Mark.CONFIG,
    maintenance=Mark.DOWNTIME,
    planned=Mark.DOWNTIME,
    maintained=Mark.DOWNTIME,
    up=Mark.RECEIPT,
    undecodable=Mark.RECEIPT,
    network=Mark.RECEIPT,
)
class RobotState:
    """One robot, protected by the lock of its State.

    ``declared``: fleet.yml names it; ``shared``: its topic is one that robots share.
    ``found_mono`` is when it was added, ``seen_mono`` when the publishers of its topics last
    changed; ``last_mono`` and ``last_wall`` are when the last array was received, ``clock_offset``
    is its receipt minus its stamp in seconds, ``clock_behind`` the same or, without stamps, what
    the link says.
    """

    def __init__(
        self,
        settings: config.Robot,
        limits: config.Limits,
        series: SeriesLimit,
        events: deque[Event],
        now: Instant,
        *,
        declared: bool,
    ) -> None:
        self.marks = Marks[Component]()
        self.settings = settings
        self.declared = declared
        self.shared = False
        self.series = series
        self.found_mono = self.seen_mono = now.mono
        self.listened_since = now.mono  # since when its domain is received, monotonic
        self.limits = limits
        self.up = False
        self.source = settings.source
        self.is_never_silent = settings.source is config.Source.QUERIES
        self.look_at = inf  # when its State looks at it again, monotonic
        self.is_newcomer = False  # it was found while others were known
        self._first_mono = inf
        self.last_mono: float | None = None
        self.last_wall = 0.0
        self.messages = 0
        self.bytes = 0
        self.clock_offset: float | None = None
        self.clock_behind: float | None = None
        self.undecodable = False
        self.network = Network(self.marks)
        self.maintenance = False
        self.planned: frozenset[PlannedBy] = frozenset()  # the downtimes that hold
        self.downtimes: tuple[Downtime, ...] = ()  # that people planned
        self.maintained: frozenset[str] = frozenset()  # names of components in one of their own
        self.rejected = Counter[str](dict.fromkeys(REASONS, 0))
        self.rejected_at: dict[str, float] = {}  # when last, by reason, Unix time
        self._logged: set[RejectionReason] = set()
        self._events = events
        self._auto = AutoSource()
        self._has_raw = False  # components of raw arrays that were received
        self._last_raw = inf  # when a raw array was received, monotonic
        self._levels = LevelEvents(settings.name, events)
        self.components = Components(
            settings.profile, limits, series, self.marks, self.reject, self._levels.record
        )
        self._aggregated = AggregatedUpdates(self.components, self.marks, limits, self.reject)
        self._raw = RawUpdates(self.components, self.reject)
        self.measured = MeasuredUpdates(self.components)
        self.missions: Missions | None = None  # of the actions that were seen
        self._fields = FieldUpdates(self.components)

    @property
    def groups(self) -> Mapping[str, tuple[int, str]]:
        """The robot's own groups: path -> (level, message) as its aggregator reported them."""
        return self._aggregated.groups

    def configure(self, settings: config.Robot, limits: config.Limits, now: Instant) -> None:
        """Apply another config; what is known stays, as far as it is still wanted."""
        if settings.source is not self.settings.source:
            self.source, self._auto = settings.source, AutoSource()
            self.is_never_silent = settings.source is config.Source.QUERIES
            if not accepts(settings.source, raw=False):
                self._aggregated.drop_groups()
        if _topics_of(settings) != _topics_of(self.settings):
            is_same_domain = settings.domain_id == self.settings.domain_id
            domain_up = self.network.domain_up or not is_same_domain
            uplink_up = self.network.uplink_up
            self.network = Network(self.marks, domain_up=domain_up, uplink_up=uplink_up)
        rules_changed = (settings.profile, limits) != (self.settings.profile, self.limits)
        self.settings, self.limits = settings, limits
        if rules_changed:
            self._aggregated.reset(limits)
            self._logged.clear()
            self.components.configure(settings.profile, limits, now)

    # -- messages ----------------------------------------------------------------------------

    def accepts(self, now: Instant, *, raw: bool) -> bool:
        """Whether arrays of this kind of topic count; what ``auto`` means is decided here."""
        if self.settings.source is _AUTO:
            self.source = self._auto.decide(self.source, now, raw=raw)
        return self.source not in (_AUTO, _AGG if raw else _RAW)

    def wants(self, *, raw: bool) -> bool:
        """Whether this kind of topic is subscribed: with ``auto`` an aggregate may still come."""
        is_auto = self.settings.source is config.Source.AUTO
        return accepts(self.source, raw=raw) or (is_auto and not raw)

    @property
    def topic(self) -> str:
        """The topic that it is read from, or found by; "" where there is none."""
        raw, aggregated = self.settings.topic_raw, self.settings.topic_agg
        both = (raw, aggregated) if self.source is config.Source.RAW else (aggregated, raw)
        return next(filter(None, (*both, self.settings.topic)), "")

    def _leave_raw(self, now: Instant, *, alone: bool) -> None:
        """Go on with the aggregate; where that is ``alone``, without what it does not list."""
        self._has_raw = False
        raw = [
            each for each in self.components if each.is_published and each.raw_received is not None
        ]
        for component in raw:
            if self._aggregated.lists(component):
                component.raw_received, component.gaps = None, ()
            elif alone:
                self.forget(component, now)
        if not alone:
            return  # for as long as no raw array comes
        message = f"diagnostics are read from {self.topic} in place of {self.settings.topic_raw}"
        self._events.append(Event(now.wall, "graph", self.settings.name, message=message))

    def receive(self, array: Array, now: Instant, *, raw: bool) -> None:
        """Update the robot and its components from an array of the raw or aggregated topic."""
        if self.undecodable:
            self.undecodable = False
        self._note_received(now)
        components, stale_after = self.components, self.settings.profile.stale_after
        if not components.has_arrays or now.mono - components.last_array > stale_after:
            components.resume_arrays(now)
        components.last_array = now.mono
        self.messages += 1
        self.bytes += array.size
        if array.stamp > 0:
            self.clock_offset = self.clock_behind = now.wall - array.stamp
        statuses = array.statuses
        limit = ROWS_OF_COMPONENT * self.limits.components
        if len(statuses) > limit:
            self.reject("component_limit", statuses[limit].name)
            statuses = statuses[:limit]
        if raw:
            self._raw.apply(statuses, now, array.publisher)
            self._has_raw, self._last_raw = True, now.mono
        else:
            alone = self.source is _AGG
            self._aggregated.apply(statuses, now, alone=alone)
            if self._has_raw and (alone or now.mono - self._last_raw > stale_after):
                self._leave_raw(now, alone=alone)

    def _note_received(self, now: Instant) -> None:
        gap = 0.0 if self.last_mono is None else now.mono - self.last_mono
        if not self.up or gap > self.settings.profile.stale_after:
            self.components.resume(now, gap, published=False)
        if not self.up:
            self.record("received", now)
            self.up = True
        self._first_mono = min(self._first_mono, now.mono)
        self.last_mono, self.last_wall = now
        self.marks.note(Mark.RECEIPT)

    def measure(self, feed: Feed, statuses: Sequence[Status], now: Instant) -> None:
        """Update components from an answer of a query; only without ROS it makes the robot up."""
        self.measured.apply(feed, statuses, now)
        if statuses and self.is_never_silent:
            self._note_received(now)

    def receive_fields(self, statuses: Sequence[Status], now: Instant) -> None:
        """Update components from the fields of a topic that fleet.yml asks for."""
        self._note_received(now)
        names = {each.component for each in self.settings.profile.topics}
        self._fields.apply([each for each in statuses if each.name in names], now)

    def is_shown_by_nodes(self, now: Instant) -> bool:
        """Whether it is up, too, if any of its nodes is in the ROS graph.

        That is so of a robot of which no diagnostics came yet, where fleet.yml asks for more.
        While it is received by its topics nobody has to look.
        """
        last, fresh = self.last_mono or 0.0, self.settings.profile.stale_after / 4
        if self.up and now.mono - last < min(fresh, SEEN_AGAIN):
            return False
        source, profile = self.settings.source, self.settings.profile
        asks = source is config.Source.NONE or profile.topics or profile.graph.watch.asks
        if not asks or self.messages or source is config.Source.QUERIES:
            return False
        return not any(each.is_published for each in self.components)

    def note_seen(self, now: Instant) -> None:
        """Note that a node of it is in the ROS graph."""
        self._note_received(now)

    def follow_feeds(self, feeds: Mapping[str, Feed], now: Instant) -> None:
        """Forget the components of feeds, and of topics, that the config no longer has."""
        names = {each.component for each in self.settings.profile.topics}
        for component in (*self.measured.follow(feeds), *self._fields.lost(names)):
            self.forget(component, now)

    def count_rejected(
        self, reason: RejectionReason, count: int = 1, now: Instant | None = None
    ) -> None:
        """Count something that was rejected, by default of the last message."""
        self.rejected[reason] += count
        self.rejected_at[reason] = self.last_wall if now is None else now.wall
        self.marks.note(Mark.REJECTED)

    def reject_undecodable(self, now: Instant) -> None:
        """Count a message that could not be decoded: why the robot is silent, if it is."""
        self.count_rejected("undecodable", now=now)
        self.undecodable = True

    def reject(self, reason: RejectionReason, example: str) -> None:
        """Count it, and log it the first time; ``example`` is a text that the robot sent."""
        self.count_rejected(reason)
        if reason not in self._logged:
            self._logged.add(reason)
            log.warning(
                "robot %r: %s, for example %.80r; logged once, counted in robot_rejected_total "
                "as %s",
                self.settings.name,
                LOG_TEXTS[reason],
                example,
                reason,
            )

    @property
    def silent_reason(self) -> SilentReason | None:
        """Why nothing is received; None while the robot is up."""
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

    def tick(self, now: Instant) -> None:
        """Let time pass: silence, late components."""
        self._levels.tick(now)
        last = self.last_mono if self.up and not self.is_never_silent else None
        if last is not None and now.mono - last > self.settings.profile.stale_after:
            self.up = False
            self.components.mark_all_stale(now)
            self.record("silent", now)
        else:
            self.components.mark_late_stale(now, up=self.up)

    @property
    def next_tick(self) -> float:
        """After which time, monotonic, `tick` may have something to do; receiving changes it."""
        due = self.components.next_late
        if self.missions is not None:
            due = min(due, self.missions.due)
        if self._levels.minutes:  # asked with each message, and most robots have none
            due = min(due, self._levels.next_tick)
        if self.up and self.last_mono is not None and not self.is_never_silent:
            due = min(due, self.last_mono + self.settings.profile.stale_after)
        return due

    def update_maintenance(self, fleet: config.Fleet, now: Instant) -> None:
        """Set whether planned downtimes of it and of its components hold now."""
        labels = {**self.settings.labels, "fleet": fleet.name, "robot": self.settings.name}
        self.planned = lasting(fleet, labels, now.wall, self.downtimes)
        self.maintained = components_in_maintenance(self.downtimes, now.wall)
        self.maintenance = bool(self.planned)

    def forget(self, component: Component, now: Instant) -> None:
        """Remove a component with all that is known about it."""
        self._levels.record(component, component.level, now, "forgotten")
        self.components.remove(component)

    def forget_absent_components(
        self, now: Instant, has_problem: Callable[[Component], bool]
    ) -> None:
        """Remove the components that are long absent, were OK and have no problem."""
        if not self._had_time(now):
            return
        for component in list(self.components.forgettable(now)):
            if not has_problem(component):
                self.forget(component, now)

    def is_forgettable(self, now: Instant) -> bool:
        """Whether it was discovered, is long absent, and nothing of it was not OK.

        A component that was not OK when it was last received is still known, and keeps its robot.
        """
        network = self.network
        if self.declared or self.up or not self._had_time(now):
            return False
        if any(query_of(each.identity) is None for each in self.components):
            return False
        if network.publishers or network.obstacle is not None:
            return False
        last = self.seen_mono if self.last_mono is None else self.last_mono
        return now.mono - last > self.settings.profile.forget_after

    @property
    def is_published(self) -> bool:
        """Whether anybody publishes on its topics, of whom it is known that it is this robot."""
        return self.network.publishers > 0 and not self.shared

    @property
    def is_fleeting(self) -> bool:
        """Whether it is a newcomer that was received for less than a minute: it may be invented."""
        if self.declared or not self.is_newcomer:
            return False
        return self.last_mono is None or self.last_mono - self._first_mono < FLEETING

    def is_forgettable_newcomer(self, now: Instant) -> bool:
        """Whether it was received for less than a minute, and for ten minutes it is gone."""
        if self.up or self.is_published or not self.is_fleeting:
            return False
        last = self.seen_mono if self.last_mono is None else self.last_mono
        return now.mono - last > FLEETING_KEPT

    def _had_time(self, now: Instant) -> bool:
        """Whether it is known for long enough to have been received, after a start too.

        For how long nothing was received before the start, only the wall clock says, which may
        have been set meanwhile.
        """
        enough = min(TIME_TO_RETURN, self.settings.profile.forget_after)
        return now.mono - self.found_mono > enough

    def update_endpoint(self, topic: str, endpoint: Endpoint | None, now: Instant) -> None:
        """Set what the graph shows of one of its topics."""
        if self.network.update(topic, endpoint):
            self.seen_mono = now.mono
        if endpoint is not None and endpoint.writers and topic != self.settings.topic_agg:
            self._raw.follow_writers(endpoint.writers, now)

    def update_link(self, reading: LinkReading | None) -> None:
        """Set how its messages arrive."""
        self.network.link = reading
        if self.clock_offset is None:
            self.clock_behind = reading and reading.behind

    def set_reading(self, now: Instant, *, lossy: bool, unread: Container[str]) -> None:
        """Set whether so many messages are lost that what is STALE may be well; what is unread."""
        if (lossy, unread) != (self.network.lossy, self.components.unread):
            self.network.lossy = lossy
            self.components.follow_reading(now, lossy=lossy, unread=unread)

    @property
    def fails_as_uplink(self) -> bool:
        """Whether the robots that are reached through it are not: what is STALE is as it was."""
        return any(
            each.is_uplink and Level.ERROR in (each.level, each.before_stale)
            for each in self.components
        )

    # -- events ------------------------------------------------------------------------------

    def record(self, after: str, now: Instant) -> None:
        """Record an event of the whole robot."""
        self._events.append(Event(now.wall, "robot", self.settings.name, after=after))

    # -- persistence -------------------------------------------------------------------------

    def persist(self, now: Instant) -> PersistedRobot:
        """What a later process should know."""
        settings = self.settings
        return PersistedRobot(
            domain_id=settings.domain_id,
            topic=settings.topic_agg or settings.topic_raw or settings.topic or "",
            source=self.source.value,
            last_seen=self.last_wall,
            components=[each.persist(now) for each in self.components if each.level >= 0],
            origin=self._origin,
        )

    @property
    def _origin(self) -> Origin:
        if self.declared:
            return "declared"
        return "shared" if self.shared else "discovered"

    def restore(self, persisted: PersistedRobot, now: Instant) -> None:
        """Restore what an earlier process knew: all of it STALE until it is received."""
        if self.settings.source is config.Source.AUTO:
            self.source = config.Source(persisted.source)
        persisted = persisted.seen_at(persisted.last_seen, now.wall)
        self.last_wall = persisted.last_seen
        if persisted.last_seen:
            self.up = self.is_never_silent
            self.last_mono = now.mono - (now.wall - persisted.last_seen)
            self.components.last_array = self.last_mono
        for each in persisted.components:
            if self.components.restore(each, now) is not None:
                self.measured.restored(each.identity)
        self.marks.note(Mark.RECEIPT)


def accepts(source: config.Source, *, raw: bool) -> bool:
    """Whether arrays of this kind of topic count, or with ``auto`` may count."""
    return source is not (_AGG if raw else _RAW)


def _topics_of(settings: config.Robot) -> tuple[Domain, str | None, str | None]:
    return settings.domain_id, settings.topic_agg, settings.topic_raw
