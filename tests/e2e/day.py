"""The day of six robots: what happens to them, and every mail that has to come of it.

One list tells the story; the scenario for the virtual robots, what the test does to the servers,
the expected mails and docs/a-day.md are made from it. A day has some minutes: its clocks are
shortened in the one file of settings and in fleet.yml.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timedelta, timezone
from typing import Any

import yaml

START = 15.0  # seconds from the robots' start to the first event: all are well by then


@dataclass(frozen=True)
class Event:
    """Something that happens ``at`` so many seconds of the day, for ``lasts`` seconds.

    ``act`` is what the test does; without it the robots do ``what`` by themselves.
    """

    at: float
    tells: str
    robot: str = ""
    component: str = ""
    what: str = ""
    lasts: float | None = None
    act: str = ""
    mails: tuple[str, ...] = ()


def _motor(robot: int, motor: int, *words: str) -> tuple[str, ...]:
    subject = f"demo/robot_{robot} Motor {motor}"
    return tuple(
        f"** PROBLEM ** {subject} is {word[1:]}"
        if word.startswith("+")
        else f"** RECOVERY ** {subject} is no longer {word[1:]}"
        for word in words
    )


def _fault(at: float, robot: int, motor: int, lasts: float, tells: str, **more: Any) -> Event:
    mails = more.pop("mails", _motor(robot, motor, "+CRITICAL", "-CRITICAL"))
    where = {"robot": f"robot_{robot}", "component": f"Motor {motor}"}
    return Event(at, tells, what="error", lasts=lasts, mails=mails, **where, **more)


def _turn(at: float, what: str, tells: str, *words: str) -> Event:
    return Event(at, tells, "robot_1", "Motor 1", what, mails=_motor(1, 1, *words))


SILENT = "** PROBLEM ** demo/robot_{} is SILENT"
HEARD = "** RECOVERY ** demo/robot_{} is no longer SILENT"

DAY = (
    _turn(0, "warn", "A motor warns.", "+WARNING"),
    _turn(18, "error", "It gets worse: told at once.", "+CRITICAL"),
    _turn(34, "warn", "It gets better, and still warns.", "-CRITICAL"),
    _turn(50, "ok", "It is well.", "-WARNING"),
    Event(
        0,
        "A motor flaps for 40 s, then rests.",
        "robot_2",
        "Motor 2",
        "flap",
        40,
        mails=(
            "** FLAPPING ** demo/robot_2 Motor 2 started flapping",
            "** FLAPPING ** demo/robot_2 Motor 2 stopped flapping",
        ),
    ),
    Event(
        0,
        "A robot falls silent and returns.",
        "robot_3",
        what="hang",
        lasts=25,
        mails=(SILENT.format(3), HEARD.format(3)),
    ),
    _fault(0, 4, 1, 28, "A motor fails; it is repaired while its robot is silent."),
    Event(
        18,
        "The robot with the failed motor falls silent.",
        "robot_4",
        what="hang",
        lasts=30,
        mails=(SILENT.format(4), HEARD.format(4)),
    ),
    _fault(0, 5, 1, 70, "A motor fails and is acknowledged: nobody else is told."),
    Event(14, "The acknowledgement.", "robot_5", act="acknowledge"),
    _fault(
        0,
        6,
        1,
        70,
        "A motor fails and nobody acknowledges it.",
        mails=(
            *_motor(6, 1, "+CRITICAL", "-CRITICAL"),
            "** ESCALATION 1 ** demo/robot_6 Motor 1 is CRITICAL and not acknowledged",
        ),
    ),
    Event(
        85,
        "Planned downtime of a robot, for 30 s.",
        "robot_1",
        act="maintain",
        mails=("** MAINTENANCE ** demo/robot_1 began", "** MAINTENANCE ** demo/robot_1 ended"),
    ),
    _fault(92, 1, 2, 10, "A motor fails within the downtime and is repaired.", mails=()),
    _fault(98, 1, 3, 37, "A motor fails within the downtime and outlives it."),
    _fault(135, 2, 1, 45, "A motor fails."),
    Event(150, "The exporter is killed, and back after some scrapes.", act="kill exporter"),
    _fault(185, 3, 1, 40, "A motor fails."),
    Event(200, "Prometheus is restarted.", act="restart prometheus"),
    Event(210, "Alertmanager is restarted.", act="restart alertmanager"),
    Event(230, "The mail server refuses mails for 25 s.", act="refuse mails", lasts=25),
    _fault(232, 4, 2, 35, "A motor fails meanwhile."),
    Event(
        280,
        "The site is cut off for 25 s.",
        act="cut off",
        lasts=25,
        mails=(
            "** PROBLEM ** demo site hall is SILENT",
            "** RECOVERY ** demo site hall is no longer SILENT",
        ),
    ),
)


def scenario() -> str:
    """What the virtual robots play."""
    events = [
        {
            "at": START + event.at,
            "robot": event.robot,
            **({"component": event.component} if event.component else {}),
            "what": event.what,
            **({"for": event.lasts} if event.lasts else {}),
        }
        for event in DAY
        if not event.act
    ]
    robots = [{"kind": "thesis", "count": 6}]
    return yaml.safe_dump(
        {"description": "the day of six robots", "robots": robots, "events": events}
    )


def fleet_config(domain_id: int, maintenance: tuple[float, float] | None = None) -> str:
    """A fleet.yml with short clocks; ``maintenance`` from and until (Unix time) for robot_1."""
    config: dict[str, Any] = {
        "fleet": "demo",
        "profiles": {
            "default": {"stale_after": "4s", "confirm_after": "5s", "flap_interval": "1s"}
        },
        "discovery": [
            {
                "topic": "/{robot}/diagnostics_agg",
                "domain_ids": [domain_id],
                "labels": {"site": "hall"},
            }
        ],
    }
    if maintenance is not None:
        start, end = (
            datetime.fromtimestamp(at, timezone.utc).isoformat(timespec="seconds")
            for at in maintenance
        )
        config["maintenance"] = [
            {
                "name": "inspection",
                "comment": "once a day",
                "selector": {"robot": "robot_1"},
                "start": start,
                "end": end,
            }
        ]
    return yaml.safe_dump(config)


def page(told: list[tuple[float, str]]) -> str:
    """docs/a-day.md: what happened when, and which mail came when (seconds of the day)."""
    happened = [
        (event.at, f"{event.robot} {event.component}".strip(), event.tells) for event in DAY
    ]
    rows = [(at, f"{where}: {tells}" if where else tells, "") for at, where, tells in happened]
    rows += [(at, "", f"`{subject}`") for at, subject in told]
    lines = [
        f"| {timedelta(seconds=round(at))} | {what} | {mail} |"
        for at, what, mail in sorted(rows, key=lambda row: row[0])
    ]
    return "\n".join(
        [
            "# A day of six robots",
            "",
            "What happens to six virtual robots and to the servers that watch them, and every mail",
            "that comes of it: written by the end-to-end test that asserts this list, complete and",
            "without an extra. Its clocks are short (confirm_after 5 s, escalation after 50 s).",
            "",
            "| time | what happens | mail |",
            "|---|---|---|",
            *lines,
            "",
        ]
    )
