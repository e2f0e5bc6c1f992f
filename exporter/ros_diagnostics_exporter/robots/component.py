"""What is known about one component: its level, since when, and its values.

A level changes only here, so that since, changes and the level before stale always agree.
"""

from __future__ import annotations

import re
from dataclasses import KW_ONLY, InitVar, dataclass, field
from math import inf
from typing import NamedTuple

from ros_diagnostics_exporter.config.fleet import ComponentRule
from ros_diagnostics_exporter.model import Feed, Instant, Level, Status
from ros_diagnostics_exporter.robots.marks import Mark, Marks, marking
from ros_diagnostics_exporter.robots.persisted import PersistedComponent, PersistedSaid
from ros_diagnostics_exporter.robots.values import ComponentValues

OK, WARN, ERROR, STALE = (int(level) for level in Level)

# Raw components have no announced period: a component is late after three times its longest recent
# gap, but never before five seconds (updaters publish once a second).
GAPS_KEPT = 10
GAP_FACTOR = 3.0
LEAST_STALE_AFTER = 5.0
# Received once, or several times at one moment, a component has not yet shown how often it is
# published; monitors that publish once a minute exist (Autoware).
STALE_AFTER_FIRST = 90.0
FIRST_GAP = STALE_AFTER_FIRST / GAP_FACTOR  # seconds between two statuses, after the first

_DIGITS = re.compile(r"[0-9]+")


class Said(NamedTuple):
    """What one of several publishers said last, when (monotonic), and how long after it before.

    ``is_beyond``: a value of it is beyond a threshold.
    """

    status: Status
    at: float
    gap: float
    is_beyond: bool = False


FIELDS = "fields:"  # in identities of what is made of fields of topics, in place of a group
QUERY = "query:"  # ... of what a query or the ROS graph measures, followed by its name

# Name, group where that is part of it, hardware_id where the name is not unique.
Identity = tuple[str, str, str]


@marking(
    hardware_id=Mark.SERIES,
    suppressed_because=Mark.DETAILS,
    resumes=Mark.DETAILS,
    stale_at_source=Mark.DETAILS,
)
@dataclass(slots=True, eq=False, repr=False)
class Component:
    """One component of one robot.

    ``reported`` is the level that the robot reported, ``level`` the one after the config's
    overrides; both are STALE while nothing fresh is known. ``reported_before`` is what it reported
    before that. ``since`` is Unix time, ``received`` and ``listed`` monotonic: the last fresh
    status, and the last array that contained the component. ``missing``: the last array of its
    aggregator does not.
    """

    identity: Identity
    name: str  # truncated, with its hardware_id where needed
    rule: ComponentRule | None
    values: ComponentValues
    now: InitVar[Instant]
    _: KW_ONLY
    marks: Marks[Component]
    group: str = ""
    label: str = ""  # its name everywhere: no two of a group are the same
    feed: Feed | None = None  # None: the robot's own topics
    hardware_id: str = ""
    level: int = -1  # nothing received yet
    reported: int = STALE
    reported_before: int | None = None
    message: str = ""
    before_stale: int | None = None
    suppressed_because: str = ""  # the condition of fleet.yml by which its trouble is no fault now
    changes: int = 0
    since: float = field(init=False)
    received: float | None = None
    raw_received: float | None = None
    listed: float = field(init=False)
    missing: bool = False
    threshold: float = inf  # seconds after which it was late, when it was received last
    gaps: tuple[float, ...] = ()  # none where only an aggregator lists it
    last: Status | None = None
    publisher: str = ""  # of the status that counts; "": not known
    said: dict[str, Said] | None = None  # by each publisher, the latest last, where these differ
    key_values: int = 0  # key-values that count against the robot's limit
    # Level and since of before a start, until it is received or listed.
    resumes: tuple[int, float] | None = None
    stale_at_source: bool = False  # it was received as STALE
    has_lapsed: bool = False  # its ends_after is over, for all that was wrong with it

    def __post_init__(self, now: Instant) -> None:
        self.since, self.listed = now.wall, now.mono

    @property
    def is_exact(self) -> bool:
        """Whether its name is known as it was published, not only as an aggregator has it."""
        return not self.identity[1]

    @property
    def is_of_fields(self) -> bool:
        """Whether it is made of fields of a topic, and no array has it."""
        return self.identity[1] == FIELDS

    @property
    def is_published(self) -> bool:
        """Whether arrays of the robot have it: it is of no field of a topic, and of no query."""
        return not self.identity[1].startswith((FIELDS, QUERY))

    @property
    def is_stale(self) -> bool:
        """Whether nothing fresh is known, whatever the config makes of that."""
        return self.reported == STALE

    @property
    def is_on_change(self) -> bool:
        """Whether it is published only when something changes: then it is not late."""
        return self.rule is not None and self.rule.reports == "on_change" and self.feed is None

    @property
    def plans_stale(self) -> bool:
        """Whether it is planned that it is STALE: by fleet.yml, or by what measures it."""
        if self.feed is not None and self.feed.planned_stale:
            return True
        return self.rule is not None and self.rule.planned_stale

    @property
    def is_uplink(self) -> bool:
        """Whether it measures what other robots are reached through."""
        return self.feed is not None and self.feed.uplink

    @property
    def has_numbers(self) -> bool:
        """Whether the numbers in its key-values are series."""
        return self.feed is None or self.feed.numbers or self.values.judges

    @property
    def is_reported_once(self) -> bool:
        """Whether a driver published it once since it is known."""
        return self.raw_received is not None and not self.gaps

    @property
    def published(self) -> int | None:
        """The level that was published last, whatever is known now; None: never since it is known.

        An aggregator says STALE of what it does not receive; that was not published.
        """
        return self.reported if self.reports else self.reported_before

    def skip(self, seconds: float) -> None:
        """Do not count so many seconds, in which nobody could publish it, towards `ends_at`."""
        self.listed += seconds
        self.received = self.listed if self.received is None else self.received + seconds
        if self.raw_received is not None:
            self.raw_received += seconds

    def skip_to(self, mono: float) -> None:
        """Count towards `ends_at` from then on."""
        if self.last_report > -inf:
            self.skip(mono - self.last_report)

    @property
    def last_report(self) -> float:
        """When it was published last, without the time that does not count, monotonic."""
        times = (self.received, self.raw_received)
        return max((each for each in times if each is not None), default=-inf)

    @property
    def ends_at(self) -> float:
        """When trouble published only on a change is over; it waits while its robot is silent."""
        after = None if self.rule is None else self.rule.ends_after
        if after is None or self.has_lapsed or not self.reports or self.last_report == -inf:
            return inf
        return after + self.last_report

    @property
    def reports(self) -> bool:
        """Whether its message is not of before it became STALE for want of another."""
        return not self.is_stale or self.stale_at_source

    @property
    def is_of_several(self) -> bool:
        """Whether several nodes publish it, as far as is known, and nothing tells them apart."""
        return self.said is not None and len(self.said) > 1

    @property
    def trouble_text(self) -> str:
        """The message, for people; of a component that says nothing any more, that it is old."""
        if self.is_of_several:
            return f"{self.message} (several nodes publish it, the worse counts)"
        if self.reports:
            return self.message
        return "no longer reports" + (f"; its last message: {self.message}" if self.message else "")

    def effective_level(self, reported: int) -> int:
        """The level after the config's overrides; one that ROS does not know is ERROR."""
        if self.rule is not None and reported in self.rule.levels:
            return self.rule.levels[reported]
        return reported if reported <= STALE else self.effective_level(ERROR)

    def set_message(self, message: str, *, always: bool) -> None:
        """Set the message that is exported.

        One that differs only in its digits is not set, unless ``always``: a measurement in the
        message must not make a new series every second.
        """
        if message == self.message:
            return
        if not always and _DIGITS.sub("0", message) == _DIGITS.sub("0", self.message):
            return
        self.message = message
        if self.level != OK:
            self.marks.note(Mark.DETAILS)

    def set_reported(self, reported: int, now: Instant) -> bool:
        """Set the reported level; True if ``level`` changed."""
        self._report(reported)
        level, former = self.effective_level(reported), self.level
        resumes = self.resumes
        if resumes is not None:
            self.resumes = None
        if reported != STALE and resumes is not None and level == resumes[0]:
            self._set_level(level, resumes[1], None)  # as an earlier process knew it
        elif level != former:
            before_stale = former if level == STALE and former >= OK else None
            self.changes += former >= OK
            self._set_level(level, now.wall, before_stale)
        return level != former

    def follow_rule(self, now: Instant) -> bool:
        """Apply the rule anew to what it reported; True if ``level`` changed.

        That is no receipt: what an earlier process knew is still waited for.
        """
        resumes = self.resumes
        changed = self.set_reported(self.reported, now)
        self.resumes = resumes
        return changed and resumes is None

    def _report(self, reported: int) -> None:
        if (reported == STALE) != (self.reported == STALE):  # then its numbers are not exported
            self.marks.note(Mark.SERIES)
            self.marks.note(Mark.VALUE, self)
            if reported == STALE:
                self.reported_before = self.reported
        self.reported = reported

    def _set_level(self, level: int, since: float, before_stale: int | None) -> None:
        self.level, self.since, self.before_stale = level, since, before_stale
        self.marks.note(Mark.LEVEL, self)

    @property
    def last_recorded(self) -> int:
        """The level of its last event: of an earlier process, until it is received or STALE."""
        return self.level if self.resumes is None else self.resumes[0]

    @property
    def was_ok(self) -> bool:
        """Whether it was OK when it was last received, and its values within their thresholds.

        STALE that fleet.yml plans counts as the level before it.
        """
        level = None if self.last is None else self.effective_level(self.last.level)
        if level is None or (level == STALE and self.plans_stale):
            level = self.before_stale
        return level in (None, OK) and not self.values.beyond

    def persist(self, now: Instant) -> PersistedComponent:
        """What a later process should know."""
        level, since = self.level, self.since
        if self.resumes is not None:  # not received since the last start
            level, since = self.resumes
        return PersistedComponent(
            identity=self.identity,
            group=self.group,
            name=None if self.name == full_name(self.identity) else self.name,
            hardware_id=self.hardware_id,
            level=level,
            reported=self.published,
            before_stale=self.before_stale,
            since=since,
            message=self.message,
            listed=now.wall - (now.mono - self.listed),
            said=self._persisted_said(),
        )

    def _persisted_said(self) -> dict[str, PersistedSaid]:
        """What each publisher said last, where something of it is wrong."""
        if self.said is not None:
            return {
                name: PersistedSaid(each.status.level, each.is_beyond, each.status.hardware_id)
                for name, each in self.said.items()
            }
        said = PersistedSaid(self.published or OK, self.values.beyond, self.hardware_id)
        is_wrong = said.level != OK or said.is_beyond
        return {self.publisher: said} if self.publisher and is_wrong else {}

    def restore(self, persisted: PersistedComponent, now: Instant) -> None:
        """Restore what an earlier process knew: STALE until it is received."""
        before = persisted.before_stale if persisted.level == STALE else persisted.level
        self.hardware_id = persisted.hardware_id
        self.listed = now.mono - (now.wall - persisted.listed)
        self.message = persisted.message
        self._report(STALE)
        # A database of an earlier version has no reported level.
        self.reported_before = before if persisted.reported is None else persisted.reported
        level, is_stale = self.effective_level(STALE), persisted.level == STALE
        since = persisted.since if is_stale else now.wall
        self._set_level(level, since, before if level == STALE else None)
        if not is_stale:
            self.resumes = persisted.level, persisted.since
        name, _group, _id = self.identity
        self.said = {
            publisher: Said(
                Status(said.level, name, self.message, said.hardware_id or self.hardware_id),
                now.mono,
                FIRST_GAP,
                said.is_beyond,
            )
            for publisher, said in persisted.said.items()
        } or None

    def note_raw(self, mono: float) -> None:
        """Note the receipt of a raw status, and the gap before it.

        A gap counts for at most twice the threshold: one long silence does not make the threshold
        useless, while a driver that has become slower is recognized after a few of its periods.
        """
        if self.raw_received is not None:
            gap = min(mono - self.raw_received, 2 * self.threshold)
            self.gaps = (*self.gaps, gap)[-GAPS_KEPT:]
        self.raw_received = mono

    def stale_after(self, default: float, *, raw: bool) -> float:
        """Seconds without a fresh status after which the component is STALE."""
        if self.feed is not None:  # whose answers come at their own times
            return self.feed.stale_after
        if self.rule is not None and self.is_on_change:
            return inf
        if self.rule is not None and self.rule.stale_after is not None:
            return self.rule.stale_after
        if not raw:
            return default
        if len(self.gaps) < GAPS_KEPT and sum(self.gaps) < LEAST_STALE_AFTER:
            return max(STALE_AFTER_FIRST, default)
        return max(LEAST_STALE_AFTER, GAP_FACTOR * max(self.gaps))


def full_name(identity: Identity) -> str:
    """The name of a component before it is truncated."""
    name, _group, hardware_id = identity
    return f"{name} [{hardware_id}]" if hardware_id else name or "(unnamed)"
