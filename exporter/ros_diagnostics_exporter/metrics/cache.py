"""One robot's samples as bytes, a chunk a family, each rendered only when its part changed."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import lru_cache
from operator import attrgetter, itemgetter

from ros_diagnostics_exporter.config.fleet import Fleet, Profile
from ros_diagnostics_exporter.config.profiles import ALL
from ros_diagnostics_exporter.faults.model import CAPABILITY_STATES, ComponentName, Reason
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.families import Family
from ros_diagnostics_exporter.metrics.missions import mission_samples
from ros_diagnostics_exporter.metrics.states import check_state, states
from ros_diagnostics_exporter.model import Level
from ros_diagnostics_exporter.robots.component import Component
from ros_diagnostics_exporter.robots.maintenance import PlannedBy
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.robots.missions import Missions
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.robots.values import ExportedValue
from ros_diagnostics_exporter.texts import as_sample, escape, one_line

# What the labels of components and values have.
_NAMED = itemgetter(Mark.NAMES, Mark.SERIES, Mark.CONFIG)
STATES = {state: number for number, state in enumerate(CAPABILITY_STATES)}
LEVELS = tuple(level.name.lower() for level in Level)


class _Values:
    """The samples of one family of values: the labels of the component, those of the value, it.

    Three lists, because a tuple for each of the many takes three times as much memory.
    """

    __slots__ = ("labels", "own", "values")

    def __init__(self) -> None:
        self.labels: list[str] = []
        self.own: list[str] = []
        self.values: list[ExportedValue] = []

    def add(self, labels: str, own: str, value: ExportedValue) -> None:
        self.labels.append(labels)
        self.own.append(own)
        self.values.append(value)


class RobotText:
    """The text of one robot. ``update`` is to be called while holding the state's lock.

    ``chunks`` are the samples by family, ``changed`` the families whose chunks may be others than
    when it was last cleared, and those that count robots or components. ``levels`` is how many
    components stand at each level.
    """

    def __init__(self, fleet: str, exporter: str, robot: RobotState, state: FleetState) -> None:
        self.fleet = fleet
        self.exporter = exporter
        self.robot = robot
        self.chunks: dict[str, bytes] = {}
        self.changed: set[str] = set()
        self.promoted: set[str] = set()
        self.levels: Sequence[int] = (0,) * len(LEVELS)
        self._base = f'fleet="{escape(fleet)}",robot="{escape(robot.settings.name)}"'
        self._begin = "{" + self._base  # of the labels of each sample
        self._exporter_label = f',exporter="{escape(exporter)}"' if exporter else ""
        self._state = state
        self._read = -1  # the last change that was rendered
        self._read_everything = -1  # ... that was, of what most messages change
        self._presence: tuple[bool, str | None] | None = None
        # The components, and the own labels of each, rendered; two lists, as in `_Values`.
        self._components: list[Component] = []
        self._labels: list[str] = []
        self._values: dict[str, _Values] = {}  # by family
        self._reasons: set[str] = set()  # every reason that ever applied
        self._suppressed: Mapping[ComponentName, Reason] = {}  # as rendered
        self._depends = True  # a component on another one, or a capability on any

    def is_of(self, robot: RobotState, fleet: Fleet) -> bool:
        """Whether it is the text of this robot, by the names that the fleet has now."""
        is_named = self.fleet == fleet.name and self.exporter == fleet.exporter
        return self.robot is robot and is_named

    def is_current(self, *, everything: bool) -> bool:
        """Whether `update` would change nothing; may be asked without the lock."""
        noted = self.robot.marks.count
        if everything and (self._read_everything != noted or self._depends or self._suppressed):
            return False
        return self._read == noted

    def update(self, *, everything: bool = True) -> None:
        """Render what changed since the last call.

        Without ``everything`` what most messages change is rendered only later.
        """
        marks, read = self.robot.marks, self._read_everything
        values_at = max(*_NAMED(marks.at), marks.at[Mark.VALUE], marks.at[Mark.NUMBER])
        values_due = everything and values_at > read
        if values_due:
            self.robot.components.parse_values()  # which may note other series
        if marks.count > self._read:
            self._update_parts(self._read)
            self._read = marks.count
        if everything:
            if marks.at[Mark.RECEIPT] > read:
                self._render_receipt()
            if values_due:
                self._render_values()
            if self._depends or self._suppressed:
                self._render_suppressed()
            self._read_everything = marks.count

    def _update_parts(self, read: int) -> None:
        at = self.robot.marks.at
        named = max(_NAMED(at))
        if named > read:
            self._rename()
        if max(at[Mark.CONFIG], at[Mark.DOWNTIME]) > read:
            self._render_inventory()
        if max(named, at[Mark.DOWNTIME]) > read:
            self._render_downtimes()
        states_due = at[Mark.RECEIPT] > read and self._render_presence()
        if max(at[Mark.REJECTED], at[Mark.CONFIG]) > read:
            self._render_rejections()
        if max(named, at[Mark.LEVEL], at[Mark.DETAILS]) > read:
            self._render_levels()
            states_due = True
        if states_due:
            self._render_states()
        if at[Mark.GROUPS] > read:
            self._render_groups()
        if at[Mark.GOALS] > read and self.robot.missions is not None:
            self._render_missions(self.robot.missions)

    def _set(self, family: Family, lines: Iterable[str]) -> None:
        self._set_chunk(family.name, list(lines))

    def _set_chunk(self, name: str, lines: list[str]) -> None:
        self.chunks[name] = "".join(lines).encode()
        self.changed.add(name)

    def _remove(self, name: str) -> None:
        if self.chunks.pop(name, None) is not None:
            self.changed.add(name)

    def _set_one(self, family: Family, value: float, labels: str = "") -> None:
        """A family of which a robot has one sample."""
        self.chunks[family.name] = self._one(family, value, labels).encode()
        self.changed.add(family.name)

    def _one(self, family: Family, value: float, labels: str = "") -> str:
        return f"{family.name}{{{self._base}{labels}}} {as_sample(value)}\n"

    # -- series -------------------------------------------------------------------------

    def _rename(self) -> None:
        """Render the labels of every component and of every value anew."""
        self._components, self._labels = [], []
        self._values = {}
        for component in self.robot.components:
            labels = _labels_of_component(component.group, component.label)
            self._components.append(component)
            self._labels.append(labels)
            measured = component.feed is not None  # of most there is no need to ask for more
            if component.is_stale or (measured and not component.has_numbers):
                continue
            for value in component.values.all:
                for family in _families_of(value):
                    own = _labels_of_value(
                        value.key, None if family == value.metric else value.unit
                    )
                    self._values.setdefault(family, _Values()).add(labels, own, value)
        plain = {metrics.COMPONENT_VALUE.name}
        for name in (self.promoted | plain) - self._values.keys():
            self._remove(name)
        self.promoted = self._values.keys() - plain
        start = metrics.COMPONENT_INFO.name + self._begin
        self._set(
            metrics.COMPONENT_INFO,
            (
                f'{start}{labels},hardware_id="{escape(each.hardware_id)}"}} 1\n'
                for each, labels in zip(self._components, self._labels, strict=True)
                if each.level >= 0
            ),
        )
        self._render_rules()

    def _render_rules(self) -> None:
        """The config of single components."""
        profile = self.robot.settings.profile
        labelled = list(zip(self._components, self._labels, strict=True))
        for family, find in (
            (metrics.COMPONENT_STALE_AFTER, _own_stale_after),
            (metrics.COMPONENT_PLANNED_STALE, _planned_stale),
        ):
            start = family.name + self._begin
            self._set(
                family,
                (
                    f"{start}{labels}}} {as_sample(own)}\n"
                    for each, labels in labelled
                    if (own := find(each, profile)) is not None
                ),
            )
        family = metrics.COMPONENT_VALUE_THRESHOLD
        start = family.name + self._begin
        self._set(
            family,
            (
                f'{start}{labels},key="{escape(value.key)}",unit="{escape(value.unit)}"'
                f',bound="{bound.bound}",severity="{bound.severity}"}} {as_sample(bound.value)}\n'
                for each, labels in labelled
                for value in (each.values.all if each.values.judges else ())
                if value.rule is not None
                for bound in value.rule.thresholds
            ),
        )

    def _render_downtimes(self) -> None:
        """Until when it is in which downtime, and which components are in one of their own."""
        self._set(
            metrics.ROBOT_DOWNTIME_END,
            [
                self._one(metrics.ROBOT_DOWNTIME_END, round(last.end, 3), _labels_of(last))
                for last in sorted(self.robot.planned, key=attrgetter("end"))[-1:]
            ],
        )
        family = metrics.COMPONENT_MAINTENANCE
        start = family.name + self._begin
        self._set(
            family,
            (
                f"{start}{labels}}} 1\n"
                for each, labels in zip(self._components, self._labels, strict=True)
                if each.label in self.robot.maintained
            ),
        )

    def _render_inventory(self) -> None:
        robot, settings = self.robot, self.robot.settings
        profile = settings.profile
        self._depends = bool(profile.capabilities) or any(
            each.depends_on for each in profile.components
        )
        fixed = {
            "ros_namespace": settings.namespace,
            "domain_id": str(settings.domain_id) if settings.in_ros else "none",
            "topic": robot.topic,
            "profile": profile.name,
            "address": settings.address or "",
        }
        labels = _pairs({**settings.labels, **fixed})
        self.changed.add(metrics.SITE_RECEIVED.name)
        self._set_one(metrics.ROBOT_INFO, 1, self._exporter_label + labels)
        for family, value in (
            (metrics.ROBOT_STALE_AFTER, profile.stale_after),
            (metrics.ROBOT_MAINTENANCE, float(robot.maintenance)),
        ):
            self._set_one(family, value)
        self._set(
            metrics.CHECK_EXPECTED,
            (
                self._one(metrics.CHECK_EXPECTED, check.expect, f',check="{escape(check.name)}"')
                for check in profile.checks
                if check.expect is not None
            ),
        )

    # -- values ------------------------------------------------------------------------

    def _render_receipt(self) -> None:
        robot = self.robot
        for family, value in (
            (metrics.ROBOT_LAST_MESSAGE, round(robot.last_wall, 3)),
            (metrics.ROBOT_MESSAGES, robot.messages),
            (metrics.ROBOT_MESSAGE_BYTES, robot.bytes),
            (metrics.ROBOT_PUBLISHERS, robot.network.publishers),
        ):
            self._set_one(family, value)
        if robot.clock_offset is not None:
            self._set_one(metrics.ROBOT_CLOCK_OFFSET, round(robot.clock_offset, 6))
        link = robot.network.link
        shown: tuple[tuple[Family, float | None], ...] = (
            (metrics.ROBOT_EXPECTED_NODES, robot.network.expected_nodes),
            (metrics.ROBOT_WATCHED, robot.network.watched),
            (metrics.ROBOT_LINK_LOST, link and link.loss),
            (metrics.ROBOT_LINK_DELAY, link and link.delay),
            (metrics.ROBOT_LINK_JITTER, link and link.jitter),
            (metrics.ROBOT_LINK_CLOCK, link and link.behind),
        )
        for family, reading in shown:
            if reading is not None:
                self._set_one(family, round(reading, 6))
            elif family.name in self.chunks:
                self._remove(family.name)

    def _render_presence(self) -> bool:
        """Whether it is received, and why not; returns whether that changed."""
        presence = up, reason = self.robot.up, self.robot.silent_reason
        if presence == self._presence:
            return False
        self._presence = presence
        self.changed.add(metrics.SITE_RECEIVED.name)
        self._set_one(metrics.ROBOT_UP, float(up), self._exporter_label)
        if reason is not None:
            self._reasons.add(reason)
        reasons = {each: float(each == reason) for each in sorted(self._reasons)}
        self._by_reason(metrics.ROBOT_SILENT_REASON, reasons)
        return True

    def _render_rejections(self) -> None:
        self._by_reason(metrics.ROBOT_REJECTED, self.robot.rejected)
        last = {reason: round(at, 3) for reason, at in self.robot.rejected_at.items()}
        self._by_reason(metrics.ROBOT_REJECTED_AT, last, _pairs(self.robot.settings.labels))

    def _by_reason(self, family: Family, values: Mapping[str, float], labels: str = "") -> None:
        self._set(
            family,
            (
                self._one(family, value, f'{labels},reason="{each}"')
                for each, value in values.items()
            ),
        )

    def _render_levels(self) -> None:
        shown = [
            (each, labels)
            for each, labels in zip(self._components, self._labels, strict=True)
            if each.level >= 0
        ]
        for family, read in (
            (metrics.COMPONENT_LEVEL, attrgetter("level")),
            (metrics.COMPONENT_SINCE, _since),
            (metrics.COMPONENT_CHANGES, attrgetter("changes")),
        ):
            start = family.name + self._begin
            self._set(family, [f"{start}{labels}}} {read(each)!r}\n" for each, labels in shown])
        start = metrics.COMPONENT_MESSAGE.name + self._begin
        length = self.robot.limits.label_length
        self._set(
            metrics.COMPONENT_MESSAGE,
            (
                f'{start}{labels},message="{escape(component.trouble_text[:length])}"}} 1\n'
                for component, labels in shown
                if component.level != Level.OK
            ),
        )
        self._render_followed(shown)
        self._render_checks()
        family = metrics.CAPABILITY_STATE
        self._set(
            family,
            (
                self._one(family, STATES[each.state], f',capability="{escape(capability)}"')
                for capability, each in self._state.capabilities(self.robot).items()
            ),
        )

    def _render_states(self) -> None:
        found = states(self.robot, self._state.faults_of(self.robot))
        self._set_one(metrics.ROBOT_STATE, found.robot)
        if found.part:
            self._set_one(metrics.ROBOT_FLAPPING, 1, f',part="{found.part}"')
        else:
            self._remove(metrics.ROBOT_FLAPPING.name)
        start = metrics.COMPONENT_STATE.name + self._begin
        self._set_chunk(
            metrics.COMPONENT_STATE.name,
            [
                f"{start}{_labels_of_component(*name)}}} {rank!r}\n"
                for name, rank in found.components.items()
            ],
        )

    def _render_followed(self, shown: list[tuple[Component, str]]) -> None:
        """What faults/ keeps; where it keeps nothing, trouble began with the level."""
        found = self._state.followed(self.robot)
        since, ratio = metrics.COMPONENT_PROBLEM_SINCE, metrics.COMPONENT_FLAP_RATIO
        start_of_since, start_of_ratio = since.name + self._begin, ratio.name + self._begin
        begins, ratios = [], []
        for each, labels in shown:
            own = found.get(ComponentName(each.group, each.label)) if found else None
            if each.level != Level.OK:
                begin = each.since if own is None or own.since is None else own.since
                begins.append(f"{start_of_since}{labels}}} {round(begin, 3)!r}\n")
            if own is not None and own.flap_ratio:
                ratios.append(f"{start_of_ratio}{labels}}} {round(own.flap_ratio, 6)!r}\n")
        self._set(since, begins)
        self._set(ratio, ratios)

    def _render_suppressed(self) -> None:
        """Which components other faults explain: of that no mark is noted."""
        suppressed = self._state.suppressed_components(self.robot)
        if suppressed == self._suppressed:
            return
        self._suppressed, family = suppressed, metrics.COMPONENT_SUPPRESSED
        lines = []
        for (group, label), reason in suppressed.items():
            labels = f',group="{escape(group)}",component="{escape(label)}",reason="{reason.value}"'
            lines.append(self._one(family, 1, labels))
        self._set(family, lines)

    def _render_checks(self) -> None:
        expected = {each.name: each.expect for each in self.robot.settings.profile.checks}
        counted, states = [], []
        for check, counts in self.robot.components.count_checks():
            labels = f',check="{escape(check)}"'
            counted += [
                self._one(metrics.CHECK_COMPONENTS, count, f'{labels},level="{word}"')
                for word, count in zip(LEVELS, counts, strict=True)
            ]
            state = check_state(self.robot, counts, expected[check])
            states.append(self._one(metrics.CHECK_STATE, state, labels))
            if check == ALL:
                self.levels = counts
                self.changed.add(metrics.FLEET_COMPONENTS.name)
        self._set(metrics.CHECK_COMPONENTS, counted)
        self._set(metrics.CHECK_STATE, states)

    def _render_values(self) -> None:
        for name, values in self._values.items():
            texts = map(attrgetter("text"), values.values)
            rows = zip(values.labels, values.own, texts, strict=True)
            start = name + self._begin
            self._set_chunk(name, [f"{start}{labels}{own}{text}\n" for labels, own, text in rows])

    def _render_missions(self, missions: Missions) -> None:
        for family, lines in mission_samples(missions, self._base):
            if lines:
                self._set(family, lines)
            else:
                self._remove(family.name)

    def _render_groups(self) -> None:
        family = metrics.GROUP_LEVEL
        self._set(
            family,
            (
                self._one(family, level, f',group="{escape(path)}"')
                for path, (level, _message) in self.robot.groups.items()
            ),
        )


@lru_cache(maxsize=65_536)
def _labels_of_component(group: str, label: str) -> str:
    """A component's own labels: the robots of a fleet have the same ones, stored once."""
    return f',group="{escape(group)}",component="{escape(label)}"'


@lru_cache(maxsize=65_536)
def _labels_of_value(key: str, unit: str | None) -> str:
    """The end of a sample's labels; as above."""
    own = "" if unit is None else f',unit="{escape(unit)}"'
    return f',key="{escape(key)}"{own}}} '


def _pairs(labels: Mapping[str, str]) -> str:
    return "".join(f',{name}="{escape(value)}"' for name, value in labels.items())


def _labels_of(downtime: PlannedBy) -> str:
    author = f',author="{escape(one_line(downtime.author))}"' if downtime.author else ""
    return f',downtime="{escape(one_line(downtime.name))}"{author}'


def _families_of(value: ExportedValue) -> list[str]:
    """The names of the families that have a sample of it."""
    names = [] if value.metric is None else [value.metric]
    if value.metric is None or (value.rule is not None and value.rule.thresholds):
        names.append(metrics.COMPONENT_VALUE.name)
    return names


def _since(component: Component) -> float:
    return round(component.since, 3)


def _own_stale_after(component: Component, profile: Profile) -> float | None:
    own = None if component.rule is None else component.rule.stale_after
    return None if own == profile.stale_after else own


def _planned_stale(component: Component, _profile: Profile) -> float | None:
    return 1.0 if component.plans_stale else None
