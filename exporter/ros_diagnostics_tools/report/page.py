"""The report as a page: HTML of its own, for a mail and to print, and as text."""

from __future__ import annotations

from collections.abc import Iterable
from datetime import datetime, timezone
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from ros_diagnostics_exporter.fleet_texts import span
from ros_diagnostics_exporter.mission_numbers import NUMBERS, number_texts
from ros_diagnostics_exporter.texts import one_line
from ros_diagnostics_tools.report.missions import work_of

# Colour of an availability and of a text on it, from the best; read with the number in it.
_SHADES = (
    (0.9995, "#1F7F63", "#FFFFFF"),
    (0.99, "#8FD3BD", "#000000"),
    (0.95, "#FFD92F", "#000000"),
)
_WORST = "#C1121F", "#FFFFFF"
_NONE = "#FFFFFF", "#59636E"


def page(report: dict[str, Any]) -> str:
    """The report's numbers as HTML; all texts of robots are escaped."""
    return _ENVIRONMENT.get_template("report.html").render(
        title=subject_line(report),
        rows=summary(report),
        report=report,
        numbers=NUMBERS,
        missions=[
            (each["robot"], texts)
            for each in report["missions"]
            if (texts := number_texts(work_of(each)))
        ],
    )


def text(report: dict[str, Any]) -> str:
    """The summary as text, for a reader of mails that shows no HTML."""
    lines = [f"{name}: {now} (week before: {before})" for name, now, before in summary(report)]
    return "\n".join([subject_line(report), "", *lines, *report["because"]]) + "\n"


def subject_line(report: dict[str, Any]) -> str:
    """The title, as a mail's subject."""
    return one_line(f"{report['fleet']}: robots, week until {_date(report['end'])}")


def summary(report: dict[str, Any]) -> list[tuple[str, str, str]]:
    """Each number of the week by its name, and that of the week before."""
    target = report["target"]
    weeks = report["week"], report["week_before"]
    shown = {
        "Availability": [percent(week["availability"]) for week in weeks],
        f"Budget left for {target * 100:g} % (robot minutes)": [_budget(week) for week in weeks],
        "Critical faults": [str(week["faults"]) for week in weeks],
        "Time to acknowledge": [_took(week["to_acknowledge"]) for week in weeks],
        "Time to recover": [_took(week["to_recover"]) for week in weeks],
        "Notifications": [str(week["notifications"]) for week in weeks],
        "Capabilities lost, of all robots": [span(week["lost_seconds"]) for week in weeks],
    }
    return [(name, now, before) for name, (now, before) in (shown | _work(weeks)).items()]


def _work(weeks: Iterable[dict[str, Any]]) -> dict[str, list[str]]:
    """The numbers of missions in both weeks; those that neither has are left out."""
    texts = [number_texts(work_of(week["missions"])) if week["missions"] else {} for week in weeks]
    return {
        f"Missions: {name}": [each.get(name, "-") for each in texts]
        for name in NUMBERS
        if any(name in each for each in texts)
    }


def percent(share: float | None) -> str:
    """A share as a percentage; what is not 100 % is not rounded to it."""
    if share is None:
        return "-"
    return "100 %" if share == 1 else f"{min(share * 100, 99.99):.2f} %"


def _budget(week: dict[str, Any]) -> str:
    left = week["budget_minutes"]
    return "-" if left is None else f"{round(left)}"


def _took(times: dict[str, Any]) -> str:
    if not times["number"]:
        return "- (of 0)"
    return f"{span(times['median'])}, at most {span(times['longest'])} (of {times['number']})"


def _shade(share: float | None) -> str:
    if share is None:
        colour, ink = _NONE
    else:
        colour, ink = next(((c, i) for least, c, i in _SHADES if share >= least), _WORST)
    return f"background:{colour};color:{ink}"


def _date(unix: float) -> str:
    return datetime.fromtimestamp(unix, timezone.utc).strftime("%Y-%m-%d %H:%M UTC")


_ENVIRONMENT = Environment(
    loader=PackageLoader(__package__),
    autoescape=True,
    finalize=lambda value: value if hasattr(value, "__html__") else one_line(str(value)),
    undefined=StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)
_ENVIRONMENT.filters |= {"date": _date, "percent": percent, "shade": _shade, "span": span}
