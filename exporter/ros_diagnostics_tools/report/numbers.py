"""All numbers of a weekly report, as JSON; the page shows these and no others."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ros_diagnostics_exporter.api.week import local, week
from ros_diagnostics_exporter.texts import natural
from ros_diagnostics_tools.report import missions
from ros_diagnostics_tools.report.availability import DAY, Availability, Recorded

DAYS = 7
MOST = 10  # capabilities that are named


def numbers(
    recorded: Recorded,
    faults: list[dict[str, Any]],
    times: tuple[float, float | None],
    target: float,
    moments: Iterable[dict[str, Any]] = (),
) -> dict[str, Any]:
    """The report of the week until ``times[0]``, beside the week before.

    Args:
        recorded: What Prometheus has of the fleet.
        faults: Each fault of both weeks.
        times: The end of the week, and from when on the event log is known (Unix time).
        target: The availability that is aimed at, 0..1.
        moments: The events of aborted goals and of interventions.
    """
    end, known_since = times
    ends = [end - DAY * back for back in reversed(range(DAYS))]
    by_day = [recorded.of_robots(each, 1) for each in ends]
    robots = sorted(recorded.of_robots(end, DAYS).items(), key=_worst_first)
    of_log = week(faults, end)
    works = missions.works(recorded, end, DAYS)
    return {
        "fleet": recorded.fleet,
        "begin": end - DAYS * DAY,
        "end": end,
        "time_zone": local(end).strftime("%Z (UTC%z)"),
        "events_since": known_since,
        "target": target,
        "week": _week(recorded, faults, end, target) | {"missions": missions.of_fleet(works)},
        "week_before": _week(recorded, faults, end - DAYS * DAY, target)
        | {"missions": missions.of_fleet(missions.works(recorded, end - DAYS * DAY, DAYS))},
        "day_begins": f"{local(end):%H:%M}",
        "days": [f"{local(each - DAY):%a %d %b}" for each in ends],
        "robots": [
            {
                "robot": robot,
                "availability": found.share,
                "days": [day[robot].share if robot in day else None for day in by_day],
            }
            for robot, found in robots
        ],
        "capabilities": _lost(recorded, end)[:MOST],
        "worst_parts": [each._asdict() for each in of_log.worst_parts],
        "nights": of_log.nights,
        "missions": missions.of_robots(works),
        "because": missions.because(moments, end - DAYS * DAY, end),
    }


def _week(
    recorded: Recorded, faults: list[dict[str, Any]], end: float, target: float
) -> dict[str, Any]:
    found, of_log = recorded.of_fleet(end, DAYS), week(faults, end)
    return {
        "availability": found.share,
        "budget_minutes": found.budget(target) / 60 if found.counted else None,
        "faults": of_log.faults,
        "to_acknowledge": of_log.to_acknowledge._asdict(),
        "to_recover": of_log.to_recover._asdict(),
        "notifications": of_log.notifications,
        "lost_seconds": sum(each["lost_seconds"] for each in _lost(recorded, end) if each["robot"]),
    }


def _lost(recorded: Recorded, end: float) -> list[dict[str, Any]]:
    """The capabilities that were lost in the week, the one that was for longest first."""
    found = [
        {
            "robot": robot,
            "capability": capability,
            "lost_seconds": seconds["lost"],
            "could": seconds.get("able", 0.0) / sum(seconds.values()),
        }
        for (robot, capability), seconds in recorded.of_capabilities(end, DAYS).items()
        if seconds.get("lost")
    ]
    return sorted(
        found, key=lambda each: (-each["lost_seconds"], natural(each["robot"]), each["capability"])
    )


def _worst_first(robot_share: tuple[str, Availability]) -> tuple[Any, ...]:
    robot, found = robot_share
    return 2.0 if found.share is None else found.share, natural(robot)
