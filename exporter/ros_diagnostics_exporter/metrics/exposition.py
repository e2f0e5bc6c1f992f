"""State -> text, from cached prefixes: nothing unchanged is rendered again.

Each robot keeps, for each family, the bytes of its samples, and each fault its own; the marks of
robots show which are out of date. A scrape renders those and joins the rest. The samples are the
same in both formats, only the headers differ
(https://prometheus.io/docs/instrumenting/exposition_formats/, OpenMetrics 1.0).
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from functools import lru_cache
from typing import NamedTuple

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.durations import written
from ros_diagnostics_exporter.faults.model import (
    End,
    Fault,
    Identity,
    Scope,
    as_texts,
    exporter_of,
    fault_id,
)
from ros_diagnostics_exporter.firing import REMOVED, SEPARATOR, THE_ROBOT
from ros_diagnostics_exporter.fleet.capabilities import robot_counts
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.cache import LEVELS, STATES, RobotText
from ros_diagnostics_exporter.metrics.families import Family
from ros_diagnostics_exporter.model import ALL_PARTS, Part
from ros_diagnostics_exporter.notifications import Key
from ros_diagnostics_exporter.robots.rejections import OVER_LIMIT
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.silences import Acknowledgement, identity_of
from ros_diagnostics_exporter.texts import as_sample, encodable, escape, first_few, one_line

# A robot's own labels by these names are left out: they would be read as the fault's identity.
_RESERVED = {label for family in metrics.FAULT_FAMILIES for label in family.labels} - {
    "site",
    "team",
}


class _Lines(NamedTuple):
    """What is rendered of one fault; ``labels`` without braces, ``key`` as `identity_of`."""

    fault: Fault
    labels: str
    key: tuple[str, ...]
    start: str


class FaultText:
    """The text of the families of faults."""

    def __init__(self) -> None:
        self._source: tuple[object, ...] = ()
        self._lines: dict[Identity, _Lines] = {}

    def render(
        self,
        fleet: Fleet,
        faults: Iterable[Fault],
        ends: Iterable[End] = (),
        acknowledgements: Iterable[Acknowledgement] = (),
        *,
        notified: Mapping[Key, Mapping[str, float]] | None = None,
        parts: Collection[Part] = ALL_PARTS,
    ) -> dict[str, bytes]:
        """By the family's name, those of ``parts``.

        Args:
            fleet: Of which the names are part of the labels.
            faults: All that last.
            ends: What ended of late.
            acknowledgements: Those in force, the newest last; of other faults, too.
            notified: Of each fault, when each receiver was last notified; None: not known.
            parts: Of the exposition.
        """
        source = fleet.name, fleet.exporter, fleet.shard
        known = self._lines if source == self._source else {}
        lines: dict[Identity, _Lines] = {}
        for fault in sorted(faults, key=lambda fault: fault.identity):
            kept = known.get(fault.identity)
            if kept is None or kept.fault is not fault:
                kept = _render(fleet, fault)
            lines[fault.identity] = kept
        self._source, self._lines = source, lines
        all_lines = lines.values()
        samples: dict[Family, Iterable[str]] = {  # generators: what is not wanted is not rendered
            metrics.FAULT_START: (each.start for each in all_lines),
            metrics.FAULT_END: (_end(fleet, each) for each in ends),
            metrics.FAULT_ACKNOWLEDGED: _acknowledged(all_lines, acknowledgements),
            metrics.FAULT_NOTIFIED: _notified(all_lines, notified),
        }
        return {
            family.name: "".join(each).encode()
            for family, each in samples.items()
            if family.part in parts
        }


def _all_labels(fleet: Fleet, fault: Fault) -> dict[str, str]:
    identity = as_texts(fault.identity, fault.labels)
    own = {name: text for name, text in fault.labels.items() if name not in _RESERVED}
    source = {"fleet": fleet.name, "exporter": exporter_of(fleet, fault.identity)}
    return {**source, "fault": fault_id(fleet, fault.identity), **identity, **own}


def _end(fleet: Fleet, end: End) -> str:
    if end.fault is None:
        labels = {"fleet": fleet.name, "exporter": fleet.exporter, "robot": end.robot}
    else:
        labels = _all_labels(fleet, end.fault)
    of_end = {"reason": end.reason, "evidence": _known_of_end(end)}
    return _sample(metrics.FAULT_END, label_pairs(labels), of_end, end.at)


def _known_of_end(end: End) -> str:
    """Who or what ended it, and when: of a sample, rules pass on the text only."""
    known = [REMOVED if end.reason == "removed" else end.message]
    if end.fault is not None:
        at = time.strftime("%Y-%m-%d %H:%M:%S", time.gmtime(end.at))
        known.append(f"ended {at} UTC, after {written(int(end.at) - int(end.fault.since))}")
    return SEPARATOR.join(filter(None, known))


def _render(fleet: Fleet, fault: Fault) -> _Lines:
    identity = _all_labels(fleet, fault)
    labels = label_pairs(identity)
    can = fault.capabilities and f"{THE_ROBOT}{fault.capabilities}"
    known = {"evidence": SEPARATOR.join(filter(None, (fault.evidence, can)))}
    return _Lines(
        fault,
        labels,
        tuple(encodable(text) for text in identity_of(identity)),
        _sample(metrics.FAULT_START, labels, known, fault.since),
    )


def _acknowledged(
    lines: Iterable[_Lines], acknowledgements: Iterable[Acknowledgement]
) -> Iterator[str]:
    """The samples of the faults that are acknowledged, each by its newest acknowledgement."""
    by_fault: dict[tuple[str, ...], list[Acknowledgement]] = {}
    for each in acknowledgements:
        by_fault.setdefault(each.fault, []).append(each)
    for line in lines if by_fault else ():
        named = by_fault.get(line.key, ())
        found = [each for each in named if each.is_of(line.fault.since)]
        if found:
            newest = found[-1]
            words = {"author": newest.author, "comment": newest.comment}
            yield _sample(metrics.FAULT_ACKNOWLEDGED, line.labels, words, newest.at)


def _notified(
    lines: Iterable[_Lines], notified: Mapping[Key, Mapping[str, float]] | None
) -> Iterator[str]:
    """Who was notified when; of a fault of which nobody was, one sample without a receiver: 0."""
    if notified is None:
        return
    for line in lines:
        receivers = notified.get(line.key[1:]) or {"": 0.0}
        for receiver, at in receivers.items():
            yield _sample(metrics.FAULT_NOTIFIED, line.labels, {"receiver": receiver}, at)


def _sample(family: Family, labels: str, more: Mapping[str, str], value: float = 1) -> str:
    further = label_pairs(more)
    return f"{family.name}{{{labels}{further and ','}{further}}} {as_sample(round(value, 4))}\n"


def label_pairs(labels: Mapping[str, str]) -> str:
    """The labels of a sample that are not empty, without braces."""
    return ",".join(f'{name}="{escape(text)}"' for name, text in labels.items() if text)


_MOST_NAMED = 5  # robots of a downtime
_OF_DOWNTIME = ("downtime", "author", "site", "team")
_LARGER = (Scope.SITE, Scope.COMMON, Scope.CAPABILITY)  # faults that have members
_NO_FLEET_CAPABILITIES = {
    metrics.FLEET_CAPABILITY_STATE.name: b"",
    metrics.FLEET_CAPABILITY_ROBOTS.name: b"",
}


class _Gathered(NamedTuple):
    """One family of all robots: its chunks, and how many samples they have."""

    chunks: list[bytes]
    series: int


class Exposition:
    """The fleet's families as text.

    ``acknowledged`` is asked at each scrape which acknowledgements hold, ``notified`` who was
    notified of which fault; None where that is not known.
    """

    def __init__(
        self,
        state: FleetState,
        acknowledged: Callable[[], Iterable[Acknowledgement]] = tuple,
        notified: Callable[[], Mapping[Key, Mapping[str, float]] | None] = lambda: None,
    ) -> None:
        self._state = state
        self._acknowledged = acknowledged
        self._notified = notified
        self._texts: dict[str, RobotText] = {}
        self._gathered: dict[str, _Gathered] = {}
        self._faults = FaultText()
        self._lock = threading.Lock()
        self._series: dict[Part, dict[str, int]] = {}
        # Families that count robots, or what they have: robots' texts say when a count may differ.
        self._counts = {
            metrics.SITE_RECEIVED.name: self._received,
            metrics.FLEET_COMPONENTS.name: self._components,
        }

    @property
    def series(self) -> dict[str, int]:
        """How many series each family had when it was last rendered."""
        return {name: n for part in self._series.values() for name, n in part.items()}

    def render(self, *, openmetrics: bool = False, parts: Collection[Part] = ALL_PARTS) -> bytes:
        """All samples of all robots; without OpenMetrics' closing ``# EOF``."""
        return b"".join(self.pieces(openmetrics=openmetrics, parts=parts))

    def pieces(self, *, openmetrics: bool, parts: Collection[Part]) -> list[bytes]:
        """As `render`, but in the pieces that are kept: nothing is copied."""
        if not {Part.FAULTS, Part.ROBOTS}.intersection(parts):
            return []
        with self._lock:
            texts = self._update(everything=Part.ROBOTS in parts)
            promoted = sorted({name for text in texts for name in text.promoted})
            ours = metrics.FLEET_FAMILIES + metrics.FAULT_FAMILIES
            text: list[bytes] = []
            series: dict[Part, dict[str, int]] = {part: {} for part in parts}
            more = self._more(parts)
            for family in (*ours, *map(_promoted_family, promoted)):
                if family.part not in parts:
                    continue
                found = self._gathered.get(family.name) or self._gather(family.name)
                other = more.get(family.name, b"")
                if found.chunks or other:
                    text.append(header(family, openmetrics=openmetrics))
                    text.extend(found.chunks)
                    text.append(other)
                    series[family.part][family.name] = found.series + other.count(b"\n")
            self._series |= series
            return text

    def _gather(self, name: str) -> _Gathered:
        """One family of all robots, kept until one of them has changed."""
        texts = self._texts.values()
        if name in self._counts:
            text = self._counts[name]()
            found = _Gathered([text] if text else [], text.count(b"\n"))
        else:
            chunks = [chunk for each in texts if (chunk := each.chunks.get(name))]
            found = _Gathered(chunks, sum([chunk.count(b"\n") for chunk in chunks]))
        self._gathered[name] = found
        return found

    def _more(self, parts: Collection[Part]) -> dict[str, bytes]:
        """What no robot's text has: samples by the family's name."""
        fleet, (faults, ends) = self._state.fleet, self._state.served()
        acknowledged, notified = self._acknowledged(), self._notified()
        of_faults = self._faults.render(
            fleet, faults, ends, acknowledged, notified=notified, parts=parts
        )
        if Part.FAULTS not in parts:
            return of_faults
        return {
            metrics.ROBOT_SILENT_REASON.name: self._over_limit(),
            **of_faults,
            metrics.FAULT_MEMBER.name: self._members(faults),
            **(self._fleet_capabilities() if fleet.capabilities else _NO_FLEET_CAPABILITIES),
            metrics.DOWNTIME_END.name: self._downtimes(),
        }

    def _members(self, faults: Iterable[Fault]) -> bytes:
        """Of each larger fault the robots, or components of them, that it is about."""
        fleet, name = self._state.fleet, metrics.FAULT_MEMBER.name
        samples = []
        for fault in faults:
            if fault.identity.scope in _LARGER:
                id_, exporter = fault_id(fleet, fault.identity), exporter_of(fleet, fault.identity)
                labels = {"fleet": fleet.name, "exporter": exporter, "fault": id_}
                for robot, component in self._state.members(fault):
                    member = {"robot": robot, **component._asdict()}
                    samples.append(f"{name}{{{label_pairs(labels | member)}}} 1\n")
        return "".join(samples).encode()

    def _fleet_capabilities(self) -> dict[str, bytes]:
        """What the fleet can do, and how many robots of each capability can."""
        fleet = self._state.fleet
        own = {"fleet": fleet.name, "exporter": fleet.exporter}
        states, robots = [], []
        for name, view in self._state.needs(None).items():
            labels = label_pairs({**own, "capability": name})
            states.append(f"{{{labels}}} {STATES[view.state]}")
            numbers = robot_counts(view)
            robots += [
                f'{{{labels},state="{state}"}} {number}' for state, number in numbers.items()
            ]
        found = {metrics.FLEET_CAPABILITY_STATE: states, metrics.FLEET_CAPABILITY_ROBOTS: robots}
        return {
            family.name: "".join(f"{family.name}{each}\n" for each in samples).encode()
            for family, samples in found.items()
        }

    def _received(self) -> bytes:
        """How many robots of each site are received; a fleet without sites has one, unnamed."""
        fleet, name = self._state.fleet, metrics.SITE_RECEIVED.name
        received: dict[str, int] = {}
        for text in self._texts.values():
            site = text.robot.settings.labels.get("site", "")
            received[site] = received.get(site, 0) + text.robot.up
        own = label_pairs({"fleet": fleet.name, "exporter": fleet.exporter})
        return "".join(
            f"{name}{{{own}{site and ','}{label_pairs({'site': site})}}} {number}\n"
            for site, number in sorted(received.items())
        ).encode()

    def _components(self) -> bytes:
        """How many components of all robots stand at each level."""
        fleet, name = self._state.fleet, metrics.FLEET_COMPONENTS.name
        counts = zip(*[each.levels for each in self._texts.values()], strict=True)
        own = label_pairs({"fleet": fleet.name, "exporter": fleet.exporter})
        return "".join(
            f'{name}{{{own},level="{level}"}} {sum(of_robots)}\n'
            for level, of_robots in zip(LEVELS, counts, strict=bool(self._texts))
        ).encode()

    def _downtimes(self) -> bytes:
        """When each planned downtime ends, and which robots of each site and team it is of."""
        fleet = self._state.fleet
        own = {"fleet": fleet.name, "exporter": fleet.exporter}
        robots: dict[tuple[str, ...], set[str]] = {}
        ends: dict[tuple[str, ...], float] = {}
        for robot in [text.robot for text in self._texts.values() if text.robot.maintenance]:
            place = tuple(robot.settings.labels.get(each, "") for each in ("site", "team"))
            for downtime, author, end in robot.planned:
                key = (one_line(downtime), one_line(author), *place)
                robots.setdefault(key, set()).add(one_line(robot.settings.name))
                ends[key] = max(end, ends.get(key, end))
        return "".join(
            _sample(
                metrics.DOWNTIME_END,
                label_pairs(own | dict(zip(_OF_DOWNTIME, key, strict=True))),
                {"robots": first_few(sorted(robots[key]), _MOST_NAMED)},
                end,
            )
            for key, end in sorted(ends.items())
        ).encode()

    def _over_limit(self) -> bytes:
        """Robots that are rejected by a limit have one sample: the reason why they are silent."""
        fleet, name = escape(self._state.fleet.name), metrics.ROBOT_SILENT_REASON.name
        return "".join(
            f'{name}{{fleet="{fleet}",robot="{escape(robot)}",reason="{OVER_LIMIT}"}} 1\n'
            for robot in self._state.robots_over_limit
        ).encode()

    def _update(self, *, everything: bool) -> list[RobotText]:
        """Every robot's text, up to date; without ``everything``, what faults are judged by."""
        texts = list(
            self._state.visit(
                lambda robot: self._update_robot(robot, everything=everything),
                lambda robot: self._kept(robot, everything=everything),
            )
        )
        if texts != [*self._texts.values()]:
            self._texts = {text.robot.settings.name: text for text in texts}
            self._gathered.clear()
        changed: set[str] = set()
        for text in texts:
            if text.changed:
                changed |= text.changed
                text.changed.clear()
        for name in changed:
            self._gathered.pop(name, None)
        return texts

    def _kept(self, robot: RobotState, *, everything: bool) -> RobotText | None:
        """The text of a robot of which nothing has changed."""
        text = self._texts.get(robot.settings.name)
        if text is None or not text.is_of(robot, self._state.fleet):
            return None
        return text if text.is_current(everything=everything) else None

    def _update_robot(self, robot: RobotState, *, everything: bool) -> RobotText:
        fleet = self._state.fleet
        text = self._texts.get(robot.settings.name)
        if text is None or not text.is_of(robot, fleet):
            text = RobotText(fleet.name, fleet.exporter, robot, self._state)
        text.update(everything=everything)
        return text


@lru_cache(maxsize=1024)  # asked for each family at each scrape
def header(family: Family, *, openmetrics: bool) -> bytes:
    """The HELP and TYPE lines; OpenMetrics names a counter without its ``_total``."""
    name = family.name.removesuffix("_total") if openmetrics else family.name
    help_ = family.help.replace("\\", r"\\").replace("\n", r"\n")
    return f"# HELP {name} {help_}\n# TYPE {name} {family.type}\n".encode()


def _promoted_family(name: str) -> Family:
    return Family(name, "gauge", "A key-value that the config promotes.", ())
