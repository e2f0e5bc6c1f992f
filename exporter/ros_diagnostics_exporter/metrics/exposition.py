"""State -> text, from cached prefixes: nothing unchanged is rendered again.

Each robot keeps, for each family, the bytes of its samples; version numbers of the state show
which of them are out of date. A scrape renders those and joins the rest. The samples are the same
in both formats, only the headers differ
(https://prometheus.io/docs/instrumenting/exposition_formats/, OpenMetrics 1.0).
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Mapping
from typing import NamedTuple

from ros_diagnostics_exporter.alertmanager import Acknowledgement
from ros_diagnostics_exporter.fleet.fleet_capabilities import counts
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.cache import STATES, RobotText
from ros_diagnostics_exporter.metrics.families import Family
from ros_diagnostics_exporter.metrics.fault_text import FaultText, label_pairs
from ros_diagnostics_exporter.model import ALL_PARTS, Part
from ros_diagnostics_exporter.notifications import Key
from ros_diagnostics_exporter.robots.rejections import OVER_LIMIT
from ros_diagnostics_exporter.robots.robot import RobotState
from ros_diagnostics_exporter.texts import escape, one_line


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

    @property
    def series(self) -> dict[str, int]:
        """How many series each family had when it was last rendered."""
        return {name: n for part in self._series.values() for name, n in part.items()}

    def render(self, *, openmetrics: bool = False, parts: Collection[Part] = ALL_PARTS) -> bytes:
        """All samples of all robots; without OpenMetrics' closing ``# EOF``."""
        return b"".join(self.pieces(openmetrics=openmetrics, parts=parts))

    def pieces(
        self, *, openmetrics: bool = False, parts: Collection[Part] = ALL_PARTS
    ) -> list[bytes]:
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
                found, other = self._gather(family.name), more.get(family.name, b"")
                if found.chunks or other:
                    text.append(header(family, openmetrics=openmetrics))
                    text.extend(found.chunks)
                    text.append(other)
                    series[family.part][family.name] = found.series + other.count(b"\n")
            self._series |= series
            return text

    def _gather(self, name: str) -> _Gathered:
        """One family of all robots; that of the last time where no robot's has changed."""
        if name not in self._gathered:
            texts = self._texts.values()
            self._gathered[name] = _Gathered(
                [chunk for each in texts if (chunk := each.chunks.get(name))],
                sum([each.series.get(name, 0) for each in texts]),
            )
        return self._gathered[name]

    def _more(self, parts: Collection[Part]) -> dict[str, bytes]:
        """What no robot's text has: samples by the family's name."""
        fleet, (faults, ends) = self._state.fleet, self._state.served()
        acknowledged, notified = self._acknowledged(), self._notified()
        return {
            metrics.ROBOT_SILENT_REASON.name: self._over_limit(),
            **self._faults.render(
                fleet.name,
                fleet.exporter,
                faults,
                ends,
                acknowledged,
                notified=notified,
                parts=parts,
            ),
            metrics.SITE_RECEIVED.name: self._received(),
            **self._fleet_capabilities(),
            metrics.DOWNTIME_ROBOTS.name: self._downtimes(),
        }

    def _fleet_capabilities(self) -> dict[str, bytes]:
        """What the fleet can do, and how many robots of each capability can."""
        fleet = self._state.fleet
        own = {"fleet": fleet.name, "exporter": fleet.exporter}
        states, robots = [], []
        for name, view in self._state.fleet_needs().items():
            labels = label_pairs({**own, "capability": name})
            states.append(f"{{{labels}}} {STATES[view.ability]}")
            numbers = counts(view)
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

    def _downtimes(self) -> bytes:
        """How many robots of each site and team are in each planned downtime."""
        fleet, name = self._state.fleet, metrics.DOWNTIME_ROBOTS.name
        own = {"fleet": fleet.name, "exporter": fleet.exporter}
        robots = [text.robot for text in self._texts.values() if text.robot.maintenance]
        numbers = Counter(
            label_pairs(
                own
                | {"downtime": one_line(downtime), "author": one_line(author)}
                | {each: robot.settings.labels.get(each, "") for each in ("site", "team")}
            )
            for robot in robots
            for downtime, author in robot.planned
        )
        return "".join(
            f"{name}{{{labels}}} {number}\n" for labels, number in sorted(numbers.items())
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
            self._state.visit(lambda robot: self._update_robot(robot, everything=everything))
        )
        if texts != [*self._texts.values()]:
            self._texts = {text.robot.settings.name: text for text in texts}
            self._gathered.clear()
        for text in texts:
            while text.changed:
                self._gathered.pop(text.changed.pop(), None)
        return texts

    def _update_robot(self, robot: RobotState, *, everything: bool) -> RobotText:
        fleet = self._state.fleet
        text = self._texts.get(robot.settings.name)
        source = fleet.name, fleet.exporter
        if text is None or text.robot is not robot or (text.fleet, text.exporter) != source:
            text = RobotText(*source, robot, self._state.followed, self._state.abilities)
        text.update(everything=everything)
        return text


def header(family: Family, *, openmetrics: bool) -> bytes:
    """The HELP and TYPE lines; OpenMetrics names a counter without its ``_total``."""
    name = family.name.removesuffix("_total") if openmetrics else family.name
    help_ = family.help.replace("\\", r"\\").replace("\n", r"\n")
    return f"# HELP {name} {help_}\n# TYPE {name} {family.type}\n".encode()


def _promoted_family(name: str) -> Family:
    return Family(name, "gauge", "A key-value that the config promotes.", ())
