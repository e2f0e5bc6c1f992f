"""What the event log says of the last seven days, as families of the exporter's own.

Shift leaders see them on the dashboard of the week; `ros-diagnostics report --week` has the same.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

from ros_diagnostics_exporter.metrics.families import EXPORTER, PREFIX, Family
from ros_diagnostics_exporter.model import Part

Samples = Sequence[tuple[Sequence[str], float]]  # (labels after those of EXPORTER, value)


class Lengths(NamedTuple):
    """How long something took: of how many faults, the median and the longest, in seconds."""

    number: int
    median: float | None
    longest: float | None


class FaultyPart(NamedTuple):
    """What was faulty most: how often, and for how many seconds of the week."""

    robot: str
    part: str
    times: int
    seconds: float


class Week(NamedTuple):
    """Seven days: critical faults that were confirmed, times of them, worst parts, notifications.

    ``nights`` has the notifications of each night, by the date of its evening.
    """

    faults: int
    to_acknowledge: Lengths
    to_recover: Lengths
    notifications: int
    worst_parts: list[FaultyPart]
    nights: Mapping[str, int]


def _family(name: str, help_: str, *labels: str) -> Family:
    return Family(f"{PREFIX}week_{name}", "gauge", help_, (*EXPORTER, *labels), part=Part.EXPORTER)


def _quantiles(times: Lengths) -> Samples:
    found = (("0.5", times.median), ("1", times.longest))
    return [((quantile,), value) for quantile, value in found if value is not None]


ROWS: tuple[tuple[Family, Callable[[Week], Samples]], ...] = (
    (
        _family("faults", "Critical faults that were confirmed in the last seven days."),
        lambda week: [((), week.faults)],
    ),
    (
        _family("acknowledged_faults", "Those of week_faults that somebody acknowledged."),
        lambda week: [((), week.to_acknowledge.number)],
    ),
    (
        _family(
            "acknowledge_seconds",
            "Time from the confirmation of those to their acknowledgement: the median (quantile "
            "0.5) and the longest (1); absent if there are none.",
            "quantile",
        ),
        lambda week: _quantiles(week.to_acknowledge),
    ),
    (
        _family("recovered_faults", "Critical faults that recovered in the last seven days."),
        lambda week: [((), week.to_recover.number)],
    ),
    (
        _family(
            "recover_seconds",
            "Time from the begin of the trouble to the recovery of those: the median (quantile "
            "0.5) and the longest (1); absent if there are none.",
            "quantile",
        ),
        lambda week: _quantiles(week.to_recover),
    ),
    (
        _family(
            "notifications",
            "Notifications of faults, recoveries apart, that were sent in the last seven days; "
            "0 unless Alertmanager posts them to /api/v1/notifications.",
        ),
        lambda week: [((), week.notifications)],
    ),
    (
        _family(
            "night_notifications",
            "Those of week_notifications that were sent in a night, from 22:00 to 06:00 of the "
            "exporter's time zone, by the date of its evening.",
            "night",
        ),
        lambda week: [((night,), number) for night, number in week.nights.items()],
    ),
    (
        _family(
            "faulty_seconds",
            "How long the ten worst parts of robots were faulty in the last seven days; of a fault "
            "of many robots the site.",
            *("robot", "part"),
        ),
        lambda week: [((each.robot, each.part), each.seconds) for each in week.worst_parts],
    ),
    (
        _family("faulty_times", "How often those were faulty.", *("robot", "part")),
        lambda week: [((each.robot, each.part), each.times) for each in week.worst_parts],
    ),
)
