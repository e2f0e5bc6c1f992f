"""The result of a replay as tables, JSON and CSV."""

from __future__ import annotations

import csv
import io
from dataclasses import dataclass
from typing import Any

from rich.console import Group, RenderableType
from rich.table import Table
from rich.text import Text

from ros_diagnostics_exporter.texts import natural, one_line
from ros_diagnostics_tools.backtest import words
from ros_diagnostics_tools.backtest.history import IDENTITY, Notification, Outage
from ros_diagnostics_tools.backtest.replay import Result
from ros_diagnostics_tools.terminal import make_table, plain

SHOWN = 50  # notifications in the table
_STYLES = {"critical": "bold red", "warning": "bold yellow"}


@dataclass
class Part:
    """All that happened to one component of a robot, or to the robot itself (component "")."""

    robot: str
    group: str
    component: str
    notified: int = 0
    flapping: int = 0
    short: int = 0
    longest_short: float = 0.0
    suppressed: int = 0
    trouble: float = 0.0


def parts(result: Result) -> list[Part]:
    """Every part with a fault or an outage, in the order of names."""
    found: dict[tuple[str, str, str], Part] = {}

    def part(robot: str, group: str, component: str) -> Part:
        return found.setdefault((robot, group, component), Part(robot, group, component))

    for each in result.notifications:
        began = each.began
        known = part(began.robot, began.group, began.component)
        known.notified += 1
        known.flapping += began.state == "flapping"
    for outage in result.outages:
        _add(part(outage.robot, outage.group, outage.component), outage)
    return [found[key] for key in sorted(found, key=lambda key: tuple(map(natural, key)))]


def _add(part: Part, outage: Outage) -> None:
    part.trouble += outage.seconds
    if outage.verdict == "short":
        part.short += 1
        part.longest_short = max(part.longest_short, outage.seconds)
    elif outage.verdict == "suppressed":
        part.suppressed += 1


# -- tables ------------------------------------------------------------------------------------


def tables(result: Result, seconds: float) -> Group:
    """What is printed on a terminal; ``seconds`` is how long the judging took."""
    shown: list[RenderableType] = []
    if result.notifications:
        shown += [_notifications(result), Text("")]
    if result.notifications or result.outages:
        shown += [_parts(result), Text("")]
    return Group(*shown, Text(summary(result, seconds)))


def _notifications(result: Result) -> Table:
    table = make_table("Began", "Notified", "Lasted", "Robot", "What", "State", right={"Notified"})
    for each in result.notifications[:SHOWN]:
        fault = each.began
        lasted = words.duration(each.duration(result.end))
        table.add_row(
            words.moment(each.since),
            f"+{words.duration(fault.time - each.since)}",
            f"{lasted}, lasts" if each.ended is None else lasted,
            plain(fault.robot),
            plain(words.place(fault)),
            Text(words.state(fault), style=_STYLES[fault.severity]),
        )
    if len(result.notifications) > SHOWN:
        table.add_row(f"and {len(result.notifications) - SHOWN} more: --output csv has all")
    return table


def _parts(result: Result) -> Table:
    numbers = ("Faults", "Flapping", "Short", "Longest", "Suppressed", "In trouble")
    table = make_table("Robot", "Component", *numbers, right=numbers)
    for each in parts(result):
        table.add_row(
            plain(each.robot),
            plain(f"{each.group} {each.component}".strip() if each.component else "(robot)"),
            str(each.notified),
            str(each.flapping),
            str(each.short),
            words.duration(each.longest_short) if each.short else "",
            str(each.suppressed),
            words.duration(each.trouble),
        )
    return table


def summary(result: Result, seconds: float) -> str:
    """One line: what was read, how fast, and how many notifications that made."""
    period = result.end - result.begin
    speed = period / seconds if seconds > 0 else 0.0
    lasting = sum(each.ended is None for each in result.notifications)
    short = sum(each.verdict == "short" for each in result.outages)
    return (
        f"fleet {one_line(result.fleet.name)}: {words.duration(period)} of "
        f"{words.count(len(result.robots), 'robot')}, {words.count(result.messages, 'message')}, "
        f"in {words.duration(seconds)} ({speed:,.0f} times real time): "
        f"{words.count(len(result.notifications), 'notification')}, {lasting} of them last, "
        f"{words.count(short, 'outage')} too short to notify"
    )


# -- for programs ------------------------------------------------------------------------------


def as_json(result: Result) -> dict[str, Any]:
    """All of it as JSON values; times are Unix time, durations seconds."""
    return {
        "fleet": result.fleet.name,
        "begin": result.begin,
        "end": result.end,
        "messages": result.messages,
        "undecodable_messages": result.undecodable,
        "robots": list(result.robots),
        "unknown_topics": list(result.unknown),
        "notifications": [notification(each, result.end) for each in result.notifications],
        "components": [
            {
                "robot": each.robot,
                "group": each.group,
                "component": each.component,
                "notifications": each.notified,
                "flapping": each.flapping,
                "too_short": each.short,
                "longest_too_short": each.longest_short,
                "suppressed": each.suppressed,
                "in_trouble": each.trouble,
            }
            for each in parts(result)
        ],
    }


def notification(sent: Notification, until: float) -> dict[str, Any]:
    """One of them as JSON values."""
    return {
        **dict(zip(IDENTITY, sent.identity, strict=True)),
        "since": sent.since,
        "notified": sent.began.time,
        "ended": sent.ended,
        "reason": "lasts" if sent.end is None else sent.end.reason,
        "duration": sent.duration(until),
        "evidence": sent.began.message,
        "details": sent.began.details or {},
    }


def as_csv(result: Result) -> str:
    """The notifications, a line each; times in UTC."""
    out = io.StringIO()
    columns = (*IDENTITY, "since", "notified", "ended", "reason", "duration", "evidence")
    writer = csv.DictWriter(out, columns, extrasaction="ignore", lineterminator="\n")
    writer.writeheader()
    for each in result.notifications:
        row = notification(each, result.end)
        for name in ("since", "notified", "ended"):
            row[name] = "" if row[name] is None else words.iso(row[name])
        writer.writerow(row)
    return out.getvalue()
