"""All numbers of a weekly report, as JSON; the page shows these and no others."""

from __future__ import annotations

from datetime import datetime, tzinfo
from typing import Any

from ros_diagnostics_exporter.texts import natural
from ros_diagnostics_tools.report import faults as of_faults
from ros_diagnostics_tools.report.availability import DAY, Availability, Recorded

DAYS = 7


def numbers(
    recorded: Recorded,
    faults: list[dict[str, Any]],
    times: tuple[float, float | None],
    target: float,
    zone: tzinfo,
) -> dict[str, Any]:
    """The report of the week until ``times[0]``, beside the week before.

    Args:
        recorded: What Prometheus has of the fleet.
        faults: Each fault of both weeks.
        times: The end of the week, and from when on the event log is known (Unix time).
        target: The availability that is aimed at, 0..1.
        zone: In which days and nights are named.
    """
    end, known_since = times
    ends = [end - DAY * back for back in reversed(range(DAYS))]
    by_day = [recorded.of_robots(each, 1) for each in ends]
    robots = sorted(recorded.of_robots(end, DAYS).items(), key=_worst_first)
    return {
        "fleet": recorded.fleet,
        "begin": end - DAYS * DAY,
        "end": end,
        "time_zone": datetime.fromtimestamp(end, zone).strftime("%Z (UTC%z)"),
        "events_since": known_since,
        "target": target,
        "week": _week(recorded, faults, end, target),
        "week_before": _week(recorded, faults, end - DAYS * DAY, target),
        "day_begins": f"{datetime.fromtimestamp(end, zone):%H:%M}",
        "days": [f"{datetime.fromtimestamp(each - DAY, zone):%a %d %b}" for each in ends],
        "robots": [
            {
                "robot": robot,
                "availability": found.share,
                "days": [day[robot].share if robot in day else None for day in by_day],
            }
            for robot, found in robots
        ],
        "worst_parts": [
            each._asdict() for each in of_faults.worst_parts(faults, end - DAYS * DAY, end)
        ],
        "nights": of_faults.by_night(
            of_faults.notified(faults, end - DAYS * DAY, end), end - DAYS * DAY, end, zone
        ),
    }


def _week(
    recorded: Recorded, faults: list[dict[str, Any]], end: float, target: float
) -> dict[str, Any]:
    begin = end - DAYS * DAY
    found = recorded.of_fleet(end, DAYS)
    return {
        "availability": found.share,
        "budget_minutes": found.budget(target) / 60 if found.counted else None,
        "faults": len(of_faults.begun(faults, begin, end)),
        "to_acknowledge": of_faults.to_acknowledge(faults, begin, end)._asdict(),
        "to_recover": of_faults.to_recover(faults, begin, end)._asdict(),
        "notifications": len(of_faults.notified(faults, begin, end)),
    }


def _worst_first(each: tuple[str, Availability]) -> tuple[Any, ...]:
    robot, found = each
    return 2.0 if found.share is None else found.share, natural(robot)
