"""What holds of the faults of a small fleet, by what was delivered of it."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from math import inf
from typing import Any

from ros_diagnostics_exporter.events import Event as Observed
from ros_diagnostics_exporter.faults.model import (
    Change,
    Fault,
    Identity,
    ProblemView,
    Reason,
    Scope,
    State,
    as_texts,
    severity_of,
)
from simulation.own import OwnParts
from simulation.small_fleet import (
    BACK,
    CAUSES,
    CHARGE,
    COMMON_NEEDS,
    CONFIRM,
    DRIVING,
    ENOUGH,
    FEWEST,
    FEWEST_TO_GO_ON,
    FLAP_INTERVAL,
    FLAP_TIME,
    FLEETS,
    HOSTS,
    MAY_FLAP,
    PARTS,
    PATIENCE,
    RECENT,
    ROBOTS,
    SETTINGS,
    SITE_NEEDS,
    STEEPEST,
    STEPS,
    UPLINK,
    WAITS,
    Charge,
    Truth,
)
from support.fault_histories import BATTERY, ERROR, OK, STALE, WALL, WARN, Event, Player

UPLINK_FAULT = Identity(Scope.COMPONENT, State.CRITICAL, robot=UPLINK, component="ping")
BY_A_PERSON = {Reason.MAINTENANCE, Reason.HOURS, Reason.CONDITION}
CRITICALLY_LOW = {each.severity: each.value for each in BATTERY}["critical"]
SOON = 0.01  # seconds by which a time may be early
UPLINK_TIME = 15.0  # seconds in which a query has noticed that an uplink does not answer
TO_RETURN = 60.0  # seconds at most for what a fault suppressed to be healthy after it


@dataclass
class Delivered:
    """An engine, and what was delivered to it."""

    player: Player = field(default_factory=lambda: Player(FLEETS[0]))
    truth: dict[tuple[str, str], Truth] = field(default_factory=dict)
    up: set[str] = field(default_factory=set)
    second: float = 0.0
    began: list[Identity] = field(default_factory=list)
    lasting: set[Identity] = field(default_factory=set)  # began and not ended
    planned: set[str] = field(default_factory=set)  # robots in a downtime
    planned_parts: dict[str, frozenset[str]] = field(default_factory=dict)  # their components
    grace: float = 0.0  # until then what is absent begins no fault
    booted: dict[str, float] = field(default_factory=dict)  # until when a robot boots
    received: set[tuple[str, str]] = field(default_factory=set)  # since its robot came back
    charges: dict[str, Charge] = field(default_factory=lambda: {each: Charge() for each in ROBOTS})
    silent_since: dict[str, float] = field(default_factory=dict)
    back_at: dict[str, float] = field(default_factory=dict)  # when a robot last was back
    cut: set[str] = field(default_factory=set)  # robots whose domain cannot be joined
    cut_at: float = -inf  # when that began or ended of any
    own: OwnParts = field(default_factory=OwnParts)
    clock_set_at: float = -inf  # when the wall clock was last set
    step_before: tuple[float, float] = -inf, 0.0  # until when trends had which step
    began_at: dict[Identity, float] = field(default_factory=dict)  # when a fault last began
    over_at: dict[Identity, float] = field(default_factory=dict)  # ... and ended
    planned_at: dict[str, float] = field(default_factory=dict)  # when a downtime began or ended
    forgotten: tuple[str, str] | None = None  # a component that a person takes out now
    taken_out: dict[str, str] = field(default_factory=dict)  # by robot, until it is received again
    taken_at: dict[str, float] = field(default_factory=dict)  # when, of each robot the last

    def engine(self, *happened: Event) -> None:
        """Let time pass, then these; nothing begins or ends that may not."""
        self._changed(self.player.go(self.second, *happened))

    def _changed(self, changes: Iterable[Change]) -> None:
        changes = list(changes)
        over = {fault.identity for what, fault, _at in changes if what != "began"}
        for what, fault, wall in changes:
            at = wall - WALL - self.player.clock_set
            if fault.identity.scope is Scope.EXPORTER:
                self._own_changed(what, fault, at)
            elif what == "began":
                self._began(fault.identity, at)
                self._assert_unexplained(fault.identity, at, over)
            else:
                self._ended(fault.identity, at, recovered=what == "recovered")
                self.over_at[fault.identity] = at

    # -- what begins -------------------------------------------------------------------------

    def _began(self, identity: Identity, at: float) -> None:
        """A fault of something that was due and that no downtime covers; and of that just one."""
        self.began.append(identity)
        assert identity not in self.lasting, f"began twice: {identity}"
        self.lasting.add(identity)
        self.began_at[identity] = at
        assert not self._boots(identity, at), f"began while its robot boots: {identity}"
        assert not self._is_planned(identity), f"began in a downtime: {identity}"
        is_absent = identity.state in (State.SILENT, State.STALE) and self.clock_set_at == -inf
        assert not is_absent or at >= self.grace - SOON, f"began after a restart: {identity}"
        assert not self._is_cut_off(identity), f"began without its domain: {identity}"
        if identity.scope is Scope.COMPONENT:
            self._component_began(identity, at)
        if identity.scope is Scope.ROBOT and identity.state is State.SILENT:
            assert identity.robot not in self.up, f"began of a robot that is up: {identity}"
        if identity.state is State.MANY:
            bad = self._bad_of(identity.robot)
            needed = self.player.settings.many.number
            assert 2 * len(bad) >= needed, f"began with {bad}: {identity}"
        if identity.scope is Scope.VALUE:
            self._value_began(identity, at)
        if identity.scope is Scope.FLAPPING:
            self._flapping_began(identity, at)
        if identity.scope is Scope.CAPABILITY:
            self._capability_began(identity, at)

    def _component_began(self, identity: Identity, at: float) -> None:
        known = self.truth[identity.robot, identity.component]
        assert known.fresh, f"began while its robot is silent: {identity}"
        assert known.level in CAUSES[identity.state], f"began of {known.level}: {identity}"
        is_due = at >= known.wrong + CONFIRM - SOON
        assert is_due, f"began before it was due: {identity}"

    def _flapping_began(self, identity: Identity, at: float) -> None:
        """One with enough changes; or with enough to go on, where it was explained before."""
        if self.clock_set_at > -inf:
            return  # the hours of warnings are of the clock that was set
        known = self.truth[identity.robot, identity.component]
        changes, fewest, within = known.changes, FEWEST, FLAP_TIME + FLAP_INTERVAL
        if identity.state is State.INTERMITTENT:
            intermittent = self.player.settings.intermittent
            changes, fewest, within = known.brief, intermittent.changes, intermittent.within + SOON
            just_now = [each for each in known.sure if each > at - 2 * FLAP_INTERVAL]
            assert len(just_now) < MAY_FLAP, f"began of what may flap: {identity}"
        elif any(
            last - first < within
            for first, last in zip(changes, changes[fewest - 1 :], strict=False)
        ):
            fewest = FEWEST_TO_GO_ON
        lately = [each for each in changes if each > at - within]
        assert len(lately) >= fewest, f"began with {len(lately)} changes: {identity}"

    def _value_began(self, identity: Identity, at: float) -> None:
        charge = self.charges[identity.robot]
        assert identity.robot in self.up, f"began while its robot is silent: {identity}"
        assert charge.counts, f"began while a condition keeps it from that: {identity}"
        assert charge.known, f"began of what is no number: {identity}"
        if identity.state is not State.FALLING:
            since = charge.below.get(identity.state.value, inf)
            assert at >= since + CONFIRM - SOON, f"began before it was due: {identity}"
            return
        assert charge.may_fall, f"began without its threshold: {identity}"
        assert "critical" not in charge.below, f"began of what is too low: {identity}"
        if charge.first == -inf:
            return
        step = self.step
        assert at >= charge.first + STEPS * step - SOON, f"began with few samples: {identity}"
        sampled = min(charge.since_then(at - step))  # the last sample is as old at most
        fall = max(charge.since_then(at - (STEPS + 1) * step)) - sampled
        assert fall > 0, f"began of what did not fall: {identity}"
        lowest = sampled - STEEPEST * fall
        assert lowest < CRITICALLY_LOW * BACK, f"began of what falls slowly: {identity}"

    def _capability_began(self, identity: Identity, at: float) -> None:
        """One that is lost has too few parts that are not, for their confirm_after.

        A part that is in a downtime may count as it was before.
        """
        state, robot, name = identity.state, identity.robot, identity.check
        assert (name, state) != ("signal", State.DEGRADED), f"began of what is fine: {identity}"
        if not robot and state is State.LOST:
            in_use = [each for each in ROBOTS if each not in self.planned]
            least = len(in_use) - min(DRIVING, len(in_use)) + 1
            lost = [each for each in in_use if each in self.up and self._may_not_drive(each)]
            assert len(lost) >= least, f"began with {lost}: {identity}"
        if robot and state is State.LOST and name != "driving":
            for part in PARTS[name]:
                if (robot, part) not in self.truth:
                    continue  # a person took it out
                known = self.truth[robot, part]
                is_due = at >= known.wrong + CONFIRM - SOON or len(known.changes) >= FEWEST
                assert is_due or self._is_planned_part(robot, part), f"began early: {identity}"

    def _may_not_drive(self, robot: str) -> bool:
        charge, known = self.charges[robot], self.truth[robot, "motor"]
        is_bad = known.level is not OK or len(known.changes) >= FEWEST
        is_bad = is_bad or self._is_planned_part(robot, "motor")
        return is_bad or bool(charge.below) or not (charge.known and charge.counts)

    def _bad_of(self, robot: str) -> list[str]:
        """The components of a robot that may count as many: not those that nobody reaches.

        What flaps counts whatever it says at the moment.
        """
        unreached = HOSTS if robot in self.cut or self._uplink_fails() else {}
        return [
            name
            for (owner, name), known in self.truth.items()
            if owner == robot
            and (known.level is not OK or len(known.changes) >= FEWEST)
            and name not in unreached
        ]

    def _uplink_fails(self) -> bool:
        return UPLINK_FAULT in self.lasting and not self._uplink_flapped()

    def _uplink_flapped(self) -> bool:
        """Whether it did, so that its fault may last although it is healthy."""
        return any(each.robot == UPLINK and each.scope is Scope.FLAPPING for each in self.began)

    def _is_cut_off(self, identity: Identity) -> bool:
        """Whether it only says that its robot is not reached, whose domain cannot be joined."""
        is_presence = identity.scope is Scope.ROBOT and identity.state is not State.MANY
        is_absent = is_presence or identity.state is State.STALE or identity.component in HOSTS
        return is_absent and identity.robot in self.cut

    def _assert_unexplained(self, identity: Identity, at: float, over: set[Identity]) -> None:
        """No larger fault says it already, or did until just now."""
        others = self.lasting - {identity}
        larger = {each for each in others if self._says(each, identity)}
        assert larger <= over, f"began although {larger - over} says it: {identity}"
        if self.clock_set_at > -inf or identity.robot in self.planned:
            return
        planned_at = self.planned_at.get(identity.robot, -inf)
        for each, ended in self.over_at.items():
            is_cause = each.scope in (Scope.SITE, Scope.COMMON) or each.robot == UPLINK
            if not (is_cause and self._says(each, identity)) or planned_at >= ended:
                continue
            lasted = min(TO_RETURN, ended - self.began_at[each] + CONFIRM)
            time = lasted if self._was_there(identity, ended) else 0.0
            is_just_over = ended <= at < ended + time + CONFIRM - SOON
            if identity.scope is Scope.FLAPPING:  # what changed since then, nothing explains
                changes = self.truth[identity.robot, identity.component].changes
                own = 2  # that it failed and was repaired with the others counts, too
                is_just_over &= sum(change >= ended for change in changes) + own < FEWEST
            assert not is_just_over, (each, identity)

    def _was_there(self, identity: Identity, at: float) -> bool:
        """Whether a problem was there already when something larger ended."""
        if identity.scope is Scope.ROBOT and identity.state is State.SILENT:
            return self.silent_since[identity.robot] < at
        if identity.scope is Scope.COMPONENT:
            return self.truth[identity.robot, identity.component].since < at
        return False

    def _says(self, larger: Identity, identity: Identity) -> bool:
        """Whether a fault says that another one is there, while both last."""
        is_silence = identity.scope is Scope.ROBOT and identity.state is not State.MANY
        if larger == UPLINK_FAULT:
            is_measured = identity.component in HOSTS and identity.scope is not Scope.VALUE
            is_said = is_silence or is_measured or identity.scope is Scope.SITE
            return is_said and not self._uplink_flapped()
        if larger.scope is Scope.SITE:
            return is_silence
        if larger.scope is Scope.COMMON:
            is_component = identity.scope in (Scope.COMPONENT, Scope.FLAPPING)
            return is_component and identity.component == larger.component
        return larger.robot == identity.robot and self._says_of_robot(larger, identity)

    def _says_of_robot(self, larger: Identity, identity: Identity) -> bool:
        """Whether a fault of a robot says that another one of it is there."""
        if identity.scope is Scope.CAPABILITY:
            is_lost = larger.state is identity.state is State.LOST
            return is_lost and (larger.check, identity.check) == ("driving", "docking")
        if identity.state is State.FALLING:
            return larger.scope is Scope.VALUE
        if identity.scope not in (Scope.COMPONENT, Scope.FLAPPING):
            return False
        if larger.state is State.MANY:
            return larger.severity == "critical" or severity_of(identity) == "warning"
        if larger.state is State.LOST:
            is_part = identity.component in PARTS[larger.check]
            return is_part and (identity.scope, identity.state) == (Scope.COMPONENT, State.CRITICAL)
        return larger.component == identity.component and self._says_itself(larger, identity)

    def _says_itself(self, larger: Identity, identity: Identity) -> bool:
        """Whether a fault of a component says that another one of it is there."""
        if identity.state is State.INTERMITTENT:
            # While nothing is received of a robot, what is planned to be STALE counts as that.
            may_be_planned = SETTINGS[identity.component].planned_stale
            return larger.scope in (Scope.COMPONENT, Scope.FLAPPING) and not may_be_planned
        return larger.state is State.FLAPPING and identity.scope is Scope.COMPONENT

    # -- what ends ---------------------------------------------------------------------------

    def _own_changed(self, what: str, fault: Fault, at: float) -> None:
        """A fault of a part of the exporter, of which it knows itself how it is."""
        kind = "fault_began" if what == "began" else "fault_ended"
        texts: dict[str, Any] = as_texts(fault.identity, {})
        event = Observed(at, kind, **texts, reason=what)
        assert (fault.identity in self.lasting) is (what != "began"), f"{what} twice: {event}"
        (self.lasting.add if what == "began" else self.lasting.remove)(fault.identity)
        # One that was restored counts by a wall clock that was set meanwhile.
        found = self.own.ended(event) if what != "began" else self.own.began(event, at)
        wrong = [] if what == "began" and self.clock_set_at > -inf else [*found]
        assert not wrong, wrong

    def _ended(self, identity: Identity, at: float, *, recovered: bool) -> None:
        """A fault that lasted; nothing that is broken, silent or in a downtime recovers."""
        assert identity in self.lasting, f"ended twice: {identity}"
        self.lasting.remove(identity)
        if not recovered:
            assert self._is_taken_out(identity), f"removed by nobody: {identity}"
            return
        assert not self._is_planned(identity), f"recovered in a downtime: {identity}"
        if identity.scope is Scope.COMPONENT:
            known = self.truth[identity.robot, identity.component]
            assert known.fresh, f"recovered while its robot is silent: {identity}"
            worse = {State.CRITICAL: (ERROR,), State.STALE: (ERROR, STALE)}
            broken = worse.get(identity.state, (ERROR, WARN, STALE))
            assert known.level not in broken, f"recovered with {known.level}: {identity}"
        if identity.scope is Scope.ROBOT and identity.state is State.SILENT:
            assert identity.robot in self.up, f"recovered of a silent robot: {identity}"
        if identity.scope is Scope.SITE:
            silent = {
                each for each, at in self.silent_since.items() if at < self.began_at[identity]
            }
            silent -= self.up | self.planned | self.cut
            # After its downtime a robot has time to return before it is counted.
            silent = {each for each in silent if not self._was_planned(each)}
            assert 2 * len(silent) < SITE_NEEDS, f"recovered although {silent} are: {identity}"
        if identity.scope is Scope.VALUE:
            charge = self.charges[identity.robot]
            assert identity.robot in self.up, f"recovered while its robot is silent: {identity}"
            assert charge.known, f"recovered with what is no number: {identity}"
            if identity.state is State.FALLING:  # a threshold that is left, for good or not yet
                is_well = charge.number is not None and charge.number >= CRITICALLY_LOW
            else:
                is_well = identity.state.value not in charge.below
            assert is_well, f"recovered below its threshold: {identity}"
        if identity.scope is Scope.FLAPPING:
            self._came_to_rest(identity, at)
        if identity.scope is Scope.COMMON:
            left = self._counted_since(identity.component, self.began_at[identity])
            assert 2 * len(left) < COMMON_NEEDS, f"recovered although {left} last: {identity}"
        if identity.scope is Scope.CAPABILITY and identity.state is State.LOST:
            self._capability_recovered(identity)

    def _is_taken_out(self, identity: Identity) -> bool:
        """Whether a person takes out what it is about; or a part, so that too little is left."""
        robot, component = self.forgotten or ("", "")
        if identity.scope is Scope.CAPABILITY:
            is_now = self.taken_at.get(identity.robot) == self.second
            return not identity.robot or is_now or not self.charges[identity.robot].may_fall
        of_robot, of_all = identity.state is State.MANY, identity.scope is Scope.COMMON
        about = "" if of_all else robot, "" if of_robot else component
        is_forgotten = (identity.robot, identity.component) == about and bool(self.forgotten)
        return is_forgotten or self._is_without_threshold(identity)

    def _is_without_threshold(self, identity: Identity) -> bool:
        """Whether it rests on a threshold that fleet.yml has no longer."""
        if identity.scope is not Scope.VALUE or identity.state is State.WARNING:
            return False
        return not self.charges[identity.robot].may_fall

    def _came_to_rest(self, identity: Identity, at: float) -> None:
        known = self.truth[identity.robot, identity.component]
        if identity.state is State.INTERMITTENT:
            assert known.fresh, f"recovered while its robot is silent: {identity}"
            assert known.level is OK, f"recovered with {known.level}: {identity}"
            intermittent = self.player.settings.intermittent
            left = [each for each in known.dated if each > at - intermittent.within + SOON]
            assert 2 * len(left) < intermittent.changes, f"recovered with {left}: {identity}"
            return
        lately = self._recent(known, self.silent_since.get(identity.robot, self.second))
        assert lately < FEWEST, f"recovered with {lately} changes in {RECENT} s: {identity}"

    def _was_planned(self, robot: str) -> bool:
        """Whether it was in a downtime so lately that its silence may not count yet."""
        return self.second - self.planned_at.get(robot, -inf) <= WAITS

    def _counted_since(self, name: str, at: float) -> list[str]:
        """The robots on which a component was an ERROR at a time, and goes on to be one."""
        if SETTINGS[name].depends_on or self.cut_at >= at:
            return []
        found = ((robot, self.truth.get((robot, name), Truth())) for robot in ROBOTS)
        return [
            robot
            for robot, known in found
            if known.fresh and known.level is ERROR and max(known.since, known.boots) < at
            if not (robot in self.planned or self._is_planned_part(robot, name))
            if not (SETTINGS[name].measured and robot in self.cut)
        ]

    def _capability_recovered(self, identity: Identity) -> None:
        """As many parts were received OK as it takes; nothing is known of those of a silent robot.

        What the fleet can do is as bad as it was, whatever robots are in a downtime.
        """
        robot, name = identity.robot, identity.check
        if not robot:
            lost = [each for each in ROBOTS if self._is_broken(each, "motor")]
            assert len(lost) <= len(ROBOTS) - DRIVING, f"recovered without {lost}: {identity}"
            return
        assert robot in self.up, f"recovered while its robot is silent: {identity}"
        lost = [each for each in PARTS[name] if self._is_broken(robot, each)]
        assert len(lost) < len(PARTS[name]), f"recovered without {lost}: {identity}"

    def _is_broken(self, robot: str, name: str) -> bool:
        """Whether a component is ERROR now, and was before a larger fault ended, or a downtime."""
        known = self.truth.get((robot, name), Truth())
        lasted = known.before if robot in self.planned else self.second - known.since
        return known.fresh and known.level is ERROR and lasted > PATIENCE

    def _recent(self, known: Truth, at: float) -> int:
        return sum(each > at - RECENT for each in known.sure)

    def _is_planned(self, identity: Identity) -> bool:
        """Whether what a fault is about is in a downtime."""
        robot, name = identity.robot, identity.component
        return robot in self.planned or self._is_planned_part(robot, name)

    def _is_planned_part(self, robot: str, name: str) -> bool:
        return name in self.planned_parts.get(robot, frozenset())

    def _boots(self, identity: Identity, at: float) -> bool:
        """Whether what a fault is about has time, because its robot boots."""
        if identity.scope is Scope.VALUE:
            return self.charges[identity.robot].boots > at + SOON
        if identity.scope is Scope.COMPONENT:
            parts = [self.truth[identity.robot, identity.component]]
        elif identity.state is State.MANY:
            parts = [each for (robot, _), each in self.truth.items() if robot == identity.robot]
        else:
            return False
        wrong = [each for each in parts if each.level is not OK]
        return bool(wrong) and all(each.boots > at + SOON for each in wrong)

    # -- what has to be there ----------------------------------------------------------------

    @property
    def step(self) -> float:
        """Seconds between two samples of a trend."""
        return self.player.settings.falling.over / STEPS

    def check(self) -> None:
        """What is freshly bad, due and no fault has a lasting fault that explains it."""
        faults = self.player.faults
        lasting = {fault.identity for fault in faults.faults()}
        views = {view.identity: view for view in faults.problems(self.player.at(self.second))}
        for identity in self._bad():
            if identity in lasting:
                continue
            assert identity in views, identity
            view = views[identity]
            now = self.player.at(self.second)
            waits_since = faults._book.problems[identity].waits_since
            waits = waits_since is not None and now.mono <= waits_since + WAITS
            is_planned = view.suppressed is not Reason.MAINTENANCE or self._is_planned(identity)
            assert is_planned, f"is in no downtime: {view}"
            if view.suppressed in BY_A_PERSON or view.due > now.wall or waits:
                continue
            is_unreached = view.suppressed is Reason.UNREACHABLE
            if is_unreached:
                assert self._is_of_reach(identity), f"is received, and suppressed: {view}"
            if is_unreached and view.by is None and identity.robot in self.cut:
                continue
            assert self._is_reported(view.by, views, lasting), view
        for identity in self._known_at_once():
            assert identity in views, f"is not seen: {identity}"

    def _is_of_reach(self, identity: Identity) -> bool:
        is_presence = identity.scope is Scope.ROBOT and identity.state is not State.MANY
        return is_presence or identity.component in HOSTS

    def _bad(self) -> Iterator[Identity]:
        """What is certainly wrong, and was for so long that it is a fault or explained."""
        latest = self.second - CONFIRM - PATIENCE
        for (robot, name), known in self.truth.items():
            of = {"group": known.group, "component": name}
            if known.fresh and known.level == ERROR and known.since < latest:
                yield Identity(Scope.COMPONENT, State.CRITICAL, robot=robot, **of)
            if known.fresh and self._recent(known, self.second) >= ENOUGH:
                yield Identity(Scope.FLAPPING, State.FLAPPING, robot=robot, **of)
        gone = [max(self.silent_since[each], self.grace) for each in ROBOTS if each not in self.up]
        is_reached = self.truth.get((UPLINK, "ping"), Truth()).level is OK and not self.cut
        # What the uplink said of them has time to return first.
        returns = self.over_at.get(UPLINK_FAULT, -inf) + TO_RETURN
        since = max([*gone, self.cut_at, returns])
        if len(gone) == len(ROBOTS) and is_reached and not self.planned and since < latest:
            yield Identity(Scope.SITE, State.SILENT, site="hall")
        for robot, since in self.silent_since.items():
            planned_at = self.planned_at.get(robot, -inf)
            if max(since, self.grace, self.cut_at, planned_at) < latest - UPLINK_TIME:
                yield Identity(Scope.ROBOT, State.SILENT, robot=robot)
        for robot, charge in self.charges.items():
            is_received = robot in self.up and charge.known and charge.counts
            for severity in charge.below if is_received else ():
                if charge.since < latest:
                    yield Identity(
                        *(Scope.VALUE, State(severity), "", robot, "", CHARGE[0]),
                        key=CHARGE[1],
                        bound="low",
                    )

    def _known_at_once(self) -> Iterator[Identity]:
        """What is a problem from the moment on at which it is received, whatever explains it."""
        intermittent = self.player.settings.intermittent
        for (robot, name), known in self.truth.items():
            first = self.second - intermittent.within + SOON
            lately = [
                each for each in known.sure if each > max(first, self.back_at.get(robot, 0.0))
            ]
            enough = name in HOSTS and known.fresh and len(lately) >= intermittent.changes
            if enough and self._has_no_fault_since(robot, name, lately[0]):
                yield Identity(Scope.FLAPPING, State.INTERMITTENT, robot=robot, component=name)
        for robot in self.up - self.planned_at.keys():
            parts = [self.truth[robot, each] for each in PARTS["view"]]
            at_rest = self.second - FLAP_TIME - FLAP_INTERVAL
            levels = sorted(each.level for each in parts if each.fresh and each.since < at_rest)
            if levels == [OK, ERROR] and all(each.changes[-1:] < [at_rest] for each in parts):
                yield Identity(Scope.CAPABILITY, State.NO_RESERVE, robot=robot, check="view")

    def _has_no_fault_since(self, robot: str, name: str, at: float) -> bool:
        """Whether nothing about a robot or its component was a fault since then."""
        about = {
            each
            for each in self.began_at
            if each.robot in (robot, UPLINK) or each.component == name or each.site
        }
        is_over = about.isdisjoint(self.lasting)
        return is_over and all(self.over_at.get(each, -inf) < at for each in about)

    def _is_reported(
        self, by: Identity | None, views: Mapping[Identity, ProblemView], lasting: set[Identity]
    ) -> bool:
        """Whether what explains it is a fault, or is explained by one, or waits for hours."""
        if by is None:
            return False
        if by in lasting:
            return True
        view = views[by]
        # What is named need not be the only one that explains: where a fault explained it until
        # now, one that is not due yet may be named first.
        if view.suppressed in BY_A_PERSON or view.due > self.player.at(self.second).wall:
            return True
        return self._is_reported(view.by, views, lasting)
