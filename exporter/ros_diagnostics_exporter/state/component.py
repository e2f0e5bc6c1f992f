"""What is known about one component: its level, since when, and what came before.

A level changes only here, so that since, problem since, changes, the level before stale and the
flap history always tell the same story.
"""

from __future__ import annotations

import re
from collections import deque

from ros_diagnostics_exporter.config.fleet import ComponentRule
from ros_diagnostics_exporter.model import Instant, Level, Status
from ros_diagnostics_exporter.state.component_values import Values
from ros_diagnostics_exporter.state.flapping import SLOTS, FlapHistory
from ros_diagnostics_exporter.state.persisted import RememberedComponent

OK, WARN, ERROR, STALE = (int(level) for level in Level)

# Raw components have no announced period: a component is late when it is silent for three times
# its longest recent gap, but never before five seconds (updaters publish once a second).
GAPS_KEPT = 10
GAP_FACTOR = 3.0
LEAST_STALE_AFTER = 5.0
# Heard once, a component has no gap yet; monitors that publish once a minute exist (Autoware).
STALE_AFTER_FIRST = 90.0

_DIGITS = re.compile(r"[0-9]+")

Identity = tuple[str, str, str]  # name, its group where that is part of the identity, parting id


class Component:
    """One component of one robot.

    ``level`` is what counts (after the config's overrides), ``reported`` what the robot said;
    both are STALE while nothing fresh is known. ``since`` and ``problem_since`` are Unix time,
    ``heard`` and ``listed`` monotonic: the last fresh status, and the last array that had it.
    """

    __slots__ = (
        "_resume",
        "_was_ok",
        "before_stale",
        "changes",
        "flaps",
        "gaps",
        "group",
        "hardware_id",
        "heard",
        "heard_raw",
        "held",
        "identity",
        "last",
        "level",
        "listed",
        "message",
        "name",
        "problem_since",
        "reported",
        "rule",
        "since",
        "values",
    )

    def __init__(
        self,
        identity: Identity,
        name: str,
        rule: ComponentRule | None,
        values: Values,
        now: Instant,
    ) -> None:
        self.identity = identity
        self.name = name  # as in the label: bounded, told apart by hardware_id where needed
        self.group = ""
        self.rule = rule
        self.values = values
        self.hardware_id = ""
        self.level = -1  # nothing said yet
        self.reported = STALE
        self.message = ""
        self.before_stale: int | None = None
        self.since = now.wall
        self.problem_since: float | None = None
        self.changes = 0
        self.heard: float | None = None
        self.heard_raw: float | None = None
        self.listed = now.mono
        self.gaps: deque[float] = deque(maxlen=GAPS_KEPT)
        self.flaps: FlapHistory | None = None
        self.last: Status | None = None
        self.held = 0  # key-values that count against the robot's limit
        # (level, since, problem since) of a former process, as long as nothing was received since
        self._resume: tuple[int, float, float | None] | None = None
        self._was_ok = True

    @property
    def is_stale(self) -> bool:
        """Whether nothing fresh is known, whatever the config makes of that."""
        return self.reported == STALE

    def counted(self, said: int) -> int:
        """The level that counts for one that was said, by the config's overrides."""
        return self.rule.levels.get(said, said) if self.rule is not None else said

    def take_message(self, message: str, *, renew: bool) -> bool:
        """Keep the text to show; True if it is another one.

        Texts that differ only in their digits are one text, unless ``renew``: a measurement in
        the message must not make a new series every second.
        """
        if message == self.message:
            return False
        if not renew and _DIGITS.sub("0", message) == _DIGITS.sub("0", self.message):
            return False
        self.message = message
        return True

    def set_reported(self, said: int, now: Instant, flap_interval: float) -> bool:
        """Take a level as said or found (STALE); True if the level that counts changed."""
        self.reported = said
        level = self.counted(said)
        resume, self._resume = self._resume, None
        if said != STALE and resume is not None:
            if level == resume[0]:
                return self._go_on(*resume)
            if level != OK and resume[2] is not None:
                self.problem_since = resume[2]  # a problem goes on at another level
        if level == self.level:
            return False
        self._change(level, now, flap_interval)
        return True

    def _change(self, level: int, now: Instant, flap_interval: float) -> None:
        self.before_stale = self.level if level == STALE and self.level >= OK else None
        if self.flaps is None:
            self.flaps = FlapHistory(level, now.mono)
        else:
            self.flaps.change(level, now.mono, flap_interval)
            self.changes += 1
        self.level = level
        self.since = now.wall
        if level == OK:
            self.problem_since = None
        elif self.problem_since is None:
            self.problem_since = now.wall

    def _go_on(self, level: int, since: float, problem_since: float | None) -> bool:
        """Received for the first time since the start, as it was before: no change.

        Returns:
            Whether the level that counts is another one than so far.
        """
        changed = level != self.level
        self.level, self.since, self.problem_since = level, since, problem_since
        self.before_stale = None
        return changed

    @property
    def was_ok(self) -> bool:
        """Whether it was OK when it was last received, and its values within their thresholds.

        STALE that fleet.yml plans counts as the level before it.
        """
        if self.last is None:
            return self._was_ok
        level: int | None = self.counted(self.last.level)
        if level == STALE and self.rule is not None and self.rule.planned_stale:
            level = self.before_stale
        beyond = any(value.is_beyond_threshold for value in self.values.all)
        return level in (None, OK) and not beyond

    def remember(self, now: Instant) -> RememberedComponent:
        """What a later process should know."""
        level, since, problem_since = self.level, self.since, self.problem_since
        if self._resume is not None:  # not received since the last start
            level, since, problem_before = self._resume
            problem_since = problem_before if problem_since is None else problem_since
        return RememberedComponent(
            identity=self.identity,
            group=self.group,
            hardware_id=self.hardware_id,
            level=level,
            before_stale=self.before_stale,
            since=since,
            problem_since=problem_since,
            message=self.message,
            slots=tuple(self.flaps.slots) if self.flaps is not None else (level,) * SLOTS,
            listed=now.wall - (now.mono - self.listed),
            was_ok=self.was_ok,
        )

    def restore(self, known: RememberedComponent, now: Instant) -> None:
        """Put back what a former process knew: STALE until it is received."""
        before = known.before_stale if known.level == STALE else known.level
        self.hardware_id = known.hardware_id
        self.listed = now.mono - max(0.0, now.wall - known.listed)
        self.message = known.message
        self._was_ok = before in (None, OK) if known.was_ok is None else known.was_ok
        self.reported = STALE
        self.level = self.counted(STALE)
        self.before_stale = before if self.level == STALE else None
        self.since = known.since
        problem_since = now.wall if known.problem_since is None else known.problem_since
        if known.level != STALE:
            self._resume = known.level, known.since, None if known.level == OK else problem_since
            self.since = now.wall
        self.problem_since = None if self.level == OK else problem_since
        self.flaps = FlapHistory(known.level, now.mono)
        self.flaps.restore(list(known.slots), now.mono)

    def renew_raw(self, mono: float, threshold: float) -> None:
        """Note the receipt of a raw status, and the gap before it.

        A gap longer than the threshold ended a silence; it counts for at most twice the
        threshold, so that a dead driver's return does not blunt the watch, while a driver that
        has become slower is known after a few of its periods.
        """
        if self.heard_raw is not None:
            self.gaps.append(min(mono - self.heard_raw, 2 * threshold))
        self.heard_raw = mono

    def stale_after(self, default: float, *, raw: bool) -> float:
        """Seconds without a fresh status after which the component is STALE."""
        if self.rule is not None and self.rule.stale_after is not None:
            return self.rule.stale_after
        if not raw:
            return default
        if not self.gaps:
            return max(STALE_AFTER_FIRST, default)
        return max(LEAST_STALE_AFTER, GAP_FACTOR * max(self.gaps))
