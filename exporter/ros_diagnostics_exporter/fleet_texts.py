"""What /api/v1/fleet says of times, downtimes, queries and topics, in words for people."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

from ros_diagnostics_exporter.model import Unclaimed


def clock(unix: float, now: float, *, local: bool, seconds: bool = True) -> str:
    """A Unix time as "18:00:05 UTC", with the date where that is another than today's."""
    convert = time.localtime if local else time.gmtime
    then, today = convert(unix), convert(now)
    date = "" if then[:3] == today[:3] else "%Y-%m-%d "
    return time.strftime(f"{date}%H:%M{':%S' if seconds else ''}{'' if local else ' UTC'}", then)


def span(seconds: float) -> str:
    """A duration in the largest unit that fits, as "3 min"."""
    whole = max(0, int(seconds))
    for size, unit in ((86_400, "d"), (3_600, "h"), (60, "min")):
        if whole >= size:
            return f"{whole // size} {unit}"
    return f"{whole} s"


def maintenance_text(
    owner: dict[str, Any], now: float, *, component: str = "", local: bool = False
) -> str:
    """Until when a robot or one of its components is in maintenance, who planned it and why.

    As "maintenance until 18:00 UTC (ann: new battery)".
    """
    planned = [each for each in owner.get("downtimes", ()) if each["component"] in ("", component)]
    ends = [each["until"] for each in planned]
    if owner["maintenance"]:
        ends.append(math.inf if owner["maintenance_until"] is None else owner["maintenance_until"])
    end = max(ends, default=math.inf)
    until = "" if end == math.inf else f" until {clock(end, now, local=local, seconds=False)}"
    who = "; ".join(f"{each['author']}: {each['comment']}" for each in planned)
    return f"maintenance{until}{who and f' ({who})'}"


def downtime_texts(robot: dict[str, Any], now: float, *, local: bool = False) -> list[str]:
    """A robot's maintenance and those of its components, each as a text."""
    names = sorted({each["component"] for each in robot.get("downtimes", ())} - {""})
    texts = [maintenance_text(robot, now, local=local)] if robot["maintenance"] else []
    return texts + [
        f"{name}: {maintenance_text(robot, now, component=name, local=local)}" for name in names
    ]


def ahead_texts(robot: dict[str, Any], now: float) -> list[str]:
    """The downtimes that lie ahead of a robot and of its components, each as a text."""
    texts = []
    for each in robot["downtimes_ahead"]:
        begin, end = (
            clock(each[key], now, local=False, seconds=False) for key in ("from", "until")
        )
        of = f"{each['component']}: " if each["component"] else ""
        texts.append(f"{of}downtime from {begin} until {end} ({each['author']}: {each['comment']})")
    return texts


def unread_text(fleet: Mapping[str, Any], *, local: bool = False) -> str:
    """That no Prometheus reads the faults and nobody is notified of them; "" while one does."""
    since = fleet.get("unread_since")
    if since is None:
        return ""
    then = clock(since, fleet["time"], local=local)
    return f"Prometheus has not read the faults since {then}: nobody is notified"


def query_text(query: Mapping[str, Any]) -> str:
    """How the running exporter's query is answered; why it is not, in Prometheus' words."""
    answered = f"{query['rows']} components, {query['skipped']} elements of no robot of this fleet"
    how = {None: "not answered yet", "": answered}.get(query["error"], query["error"])
    return f"{query['name']}: {how}"


def unclaimed_texts(fleet: Mapping[str, Any]) -> list[str]:
    """The topics of /api/v1/fleet that no entry of fleet.yml matches, with the entry to paste."""
    return [f"{Unclaimed(**each)}" for each in fleet.get("unclaimed", ())]
