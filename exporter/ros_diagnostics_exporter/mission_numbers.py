"""How well robots do their work: success, interventions per hour, hours between them. Pure.

Each number goes with what it is a share of, and success with the share that nobody knows.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any, NamedTuple

HOUR = 3_600.0
NUMBERS = SUCCESS, PER_HOUR, BETWEEN = (
    "Success",
    "Interventions per hour",
    "Hours between interventions",
)


class Work(NamedTuple):
    """What was counted of the missions of one robot, or of many.

    Attributes:
        results: How many goals ended in which way; rules of Prometheus give fractions.
        interventions: How often somebody had to help; None where no mode says so.
        autonomous: The seconds in which robots worked by themselves; None as above.
    """

    results: Mapping[str, float]
    interventions: float | None = None
    autonomous: float | None = None

    @property
    def decided(self) -> float:
        """The goals that robots ended themselves: those that count for ``success``."""
        return self.results.get("succeeded", 0) + self.results.get("aborted", 0)

    @property
    def ended(self) -> float:
        """All goals that no other replaced."""
        return sum(self.results.values()) - self.results.get("preempted", 0)

    @property
    def success(self) -> float | None:
        """The share of ``decided`` that succeeded, 0..1; None of no goal."""
        return self.results.get("succeeded", 0) / self.decided if self.decided else None

    @property
    def unknown(self) -> float | None:
        """The share of ``ended`` of which nobody knows how they ended, 0..1; None of no goal."""
        return self.results.get("unknown", 0) / self.ended if self.ended else None

    @property
    def per_hour(self) -> float | None:
        """Interventions for each hour of autonomy; None of no hour."""
        if self.interventions is None or not self.autonomous:
            return None
        return self.interventions * HOUR / self.autonomous

    @property
    def hours_between(self) -> float | None:
        """Hours of autonomy for each intervention; None of no intervention."""
        if not self.interventions or self.autonomous is None:
            return None
        return self.autonomous / HOUR / self.interventions

    def as_json(self) -> dict[str, float | None]:
        """The numbers as the API has them."""
        return {
            "success": _rounded(self.success),
            "decided": self.decided,
            "unknown": _rounded(self.unknown),
            "ended": self.ended,
            "interventions_per_hour": _rounded(self.per_hour),
            "hours_between_interventions": _rounded(self.hours_between),
        }


def together(works: Iterable[Work]) -> Work:
    """The work of many robots: their goals, interventions and hours added up."""
    results: dict[str, float] = {}
    interventions, autonomous = None, None
    for each in works:
        for result, number in each.results.items():
            results[result] = results.get(result, 0) + number
        interventions = _added(interventions, each.interventions)
        autonomous = _added(autonomous, each.autonomous)
    return Work(results, interventions, autonomous)


def number_texts(work: Work) -> dict[str, str]:
    """The three numbers in words, by their names; those that do not apply are left out."""
    texts = {}
    if work.ended:
        texts[SUCCESS] = success_text(work)
    if work.interventions is not None and work.autonomous is not None:
        hours = f"{shown(work.interventions)} in {shown(work.autonomous / HOUR)} h of autonomy"
        texts[PER_HOUR] = f"{shown(work.per_hour)} ({hours})"
        texts[BETWEEN] = shown(work.hours_between)
    return texts


def success_text(work: Work) -> str:
    """As "80 % of 20 goals; 2 of 24 unknown": the share, and the goals that it is of."""
    decided = f"{share_text(work.success)} of {_goals(work.decided)}"
    unknown = round(work.results.get("unknown", 0))
    return decided + (f"; {unknown} of {_goals(work.ended)} unknown" if unknown else "")


def share_text(share: float | None) -> str:
    """A share in whole percent; what is not 0 % or 100 % is not rounded to that."""
    if share is None:
        return "-"
    percent = share * 100 if share in (0, 1) else min(max(round(share * 100), 1), 99)
    return f"{percent:.0f} %"


def shown(number: float | None) -> str:
    """A number for people: "41.3", "0.02", "3", and "-" for None."""
    if number is None:
        return "-"
    if float(number).is_integer():
        return f"{number:.0f}"
    return f"{number:.1f}" if abs(number) >= 1 else f"{number:.2g}"


def work_of(robot: Mapping[str, Any]) -> Work:
    """The work of a robot as /api/v1/missions has it: the goals of its missions alone."""
    results = [each["results"] for each in robot["actions"] if each["mission"]]
    goals = together(Work(each) for each in results).results
    return Work(goals, robot.get("interventions"), robot.get("autonomous_seconds"))


def _goals(number: float) -> str:
    return "1 goal" if round(number) == 1 else f"{round(number)} goals"


def _added(total: float | None, number: float | None) -> float | None:
    return number if total is None else total + (number or 0)


def _rounded(number: float | None) -> float | None:
    return None if number is None else round(number, 4)
