"""State -> text, from cached prefixes: nothing unchanged is rendered again.

Each robot keeps, for each family, the bytes of its samples; version numbers of the state show
which of them are out of date. A scrape renders those and joins the rest. The samples are the same
in both formats, only the headers differ
(https://prometheus.io/docs/instrumenting/exposition_formats/, OpenMetrics 1.0).
"""

from __future__ import annotations

import threading
from collections import Counter
from collections.abc import Callable, Iterable

from ros_diagnostics_exporter.alertmanager import Acknowledgement
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.cache import RobotText, number
from ros_diagnostics_exporter.metrics.families import Family
from ros_diagnostics_exporter.metrics.fault_text import FaultText
from ros_diagnostics_exporter.state.rejections import OVER_LIMIT
from ros_diagnostics_exporter.state.robot import Robot
from ros_diagnostics_exporter.state.state import State
from ros_diagnostics_exporter.texts import escape


class Exposition:
    """The fleet's families as text.

    ``acknowledged`` is asked at each scrape which acknowledgements hold.
    """

    def __init__(
        self, state: State, acknowledged: Callable[[], Iterable[Acknowledgement]] = tuple
    ) -> None:
        self._state = state
        self._acknowledged = acknowledged
        self._texts: dict[str, RobotText] = {}
        self._faults = FaultText()
        self._lock = threading.Lock()
        self.series: Counter[str] = Counter()  # by family, at the last scrape

    def render(self, *, openmetrics: bool = False) -> bytes:
        """All samples of all robots; without OpenMetrics' closing ``# EOF``."""
        with self._lock:
            texts = self._update()
            promoted = sorted({name for text in texts for name in text.promoted})
            ours = metrics.FLEET_FAMILIES + metrics.FAULT_FAMILIES
            families = (*ours, *map(_promoted_family, promoted))
            parts: list[bytes] = []
            series: Counter[str] = Counter()
            more = {
                metrics.ROBOT_SILENT_REASON.name: self._over_limit(),
                **self._acknowledgements(),
                **self._faults.render(self._state.fleet.name, self._state.faults()),
            }
            for family in families:
                chunks = [chunk for text in texts if (chunk := text.chunks.get(family.name))]
                chunks.extend(filter(None, [more.get(family.name)]))
                if chunks:
                    parts.append(header(family, openmetrics=openmetrics))
                    parts.extend(chunks)
                    series[family.name] = sum(chunk.count(b"\n") for chunk in chunks)
            self.series = series
            return b"".join(parts)

    def _over_limit(self) -> bytes:
        """Robots that are rejected by a limit have one sample: the reason why they are silent."""
        fleet, name = escape(self._state.fleet.name), metrics.ROBOT_SILENT_REASON.name
        return "".join(
            f'{name}{{fleet="{fleet}",robot="{escape(robot)}",reason="{OVER_LIMIT}"}} 1\n'
            for robot in self._state.robots_over_limit
        ).encode()

    def _acknowledgements(self) -> dict[str, bytes]:
        """Those of known robots, both families of them."""
        fleet, when, since = escape(self._state.fleet.name), "", ""
        for each in self._acknowledged():
            if each.robot not in self._texts:
                continue
            fault = f'fleet="{fleet}"' + "".join(
                f',{name}="{escape(value)}"'
                for name in metrics.ACKNOWLEDGED_SINCE.labels[1:]
                if (value := getattr(each, name))
            )
            words = f',author="{escape(each.author)}",comment="{escape(each.comment)}"'
            when += f"{metrics.ACKNOWLEDGED.name}{{{fault}{words}}} {number(each.at)}\n"
            since += f"{metrics.ACKNOWLEDGED_SINCE.name}{{{fault}}} {number(each.since)}\n"
        return {
            metrics.ACKNOWLEDGED.name: when.encode(),
            metrics.ACKNOWLEDGED_SINCE.name: since.encode(),
        }

    def _update(self) -> list[RobotText]:
        """Every robot's text, up to date."""
        texts = list(self._state.visit(self._update_robot))
        self._texts = {text.robot.settings.name: text for text in texts}
        return texts

    def _update_robot(self, robot: Robot) -> RobotText:
        fleet = self._state.fleet.name
        text = self._texts.get(robot.settings.name)
        if text is None or text.robot is not robot or text.fleet != fleet:
            text = RobotText(fleet, robot)
        text.update()
        return text


def header(family: Family, *, openmetrics: bool) -> bytes:
    """The HELP and TYPE lines; OpenMetrics names a counter without its ``_total``."""
    name = family.name.removesuffix("_total") if openmetrics else family.name
    help_ = family.help.replace("\\", r"\\").replace("\n", r"\n")
    return f"# HELP {name} {help_}\n# TYPE {name} {family.type}\n".encode()


def _promoted_family(name: str) -> Family:
    return Family(name, "gauge", "A key-value that the config promotes.", ())
