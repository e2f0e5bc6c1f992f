"""The day of six robots: what happens to them, and every mail and text message it has to bring.

One list tells the story; the scenario for the virtual robots, what the test does to the servers,
what is expected and docs/a-day.md are made from it. A day has some minutes: its clocks are
shortened in the one file of settings and in fleet.yml.
"""

from __future__ import annotations

from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

import yaml

START = 15.0  # seconds from the robots' start to the first event: all are well by then
# The day's clocks, in seconds; written to fleet.yml and to the settings of the rules.
CONFIRM = 5
STALE = 4
ESCALATE = 90
# The robot's 21 states that flap detection looks at: longer apart than two changes (2 s), so that
# every change counts in full and no change can be late by so much that a rest is counted before it.
FLAP_INTERVAL = 3
FLAP_PERIOD = 2  # of a virtual robot's component
SETTINGS = {"exporter_down_after": 30, "restart_grace": 8, "escalate_first": ESCALATE}
# A message may come so much later than the day's clocks make it: machines are busy at times. It may
# never come earlier.
LATE = 60.0


@dataclass(frozen=True)
class Telling:
    """A mail or text message that has to come, not before ``earliest`` (second of the day).

    ``words`` are the mail's subject, or how the text message begins.
    """

    words: str
    earliest: float
    by: str = "mail"

    @property
    def latest(self) -> float:
        """The last second at which it may come."""
        return self.earliest + LATE


Tellings = tuple[Telling, ...]


@dataclass(frozen=True)
class Event:
    """Something that happens ``at`` so many seconds of the day, for ``lasts`` seconds.

    ``act`` is what the test does, and not before somebody got the message ``when``; without it the
    robots do ``what`` by themselves.
    """

    at: float
    tells: str
    robot: str = ""
    component: str = ""
    what: str = ""
    lasts: float | None = None
    act: str = ""
    when: str = ""
    told: Tellings = ()


def _problem(what: str, state: str, mail: float, sms: float | None = None) -> Tellings:
    """The mail, and the text message where it is one that wakes people."""
    told = Telling(f"** PROBLEM ** {what} is {state}", mail)
    return (told,) if sms is None else (told, Telling(f"PROBLEM {_said(what, state)}", sms, "SMS"))


def _recovery(what: str, state: str, mail: float, *, sms: bool = True) -> Tellings:
    told = Telling(f"** RECOVERY ** {what} is no longer {state}", mail)
    words = _said(what, state).replace(": ", ": no longer: ")
    return (told, Telling(f"RECOVERY {words}", mail, "SMS")) if sms else (told,)


def _said(what: str, state: str) -> str:
    """How a text message names it: by the alert's summary."""
    if "site" in what:
        return "demo: Many robots of fleet demo, site hall, are silent."
    robot, _, component = what.removeprefix("demo/").partition(" ")
    if component:
        return f"demo: {component} of {robot} is {state}."
    return f"demo: {robot} is {state.lower()}."


def _fault(at: float, where: tuple[int, int], lasts: float, tells: str, **when: float) -> Event:
    """An ERROR of a robot's motor, told at once and by mail, and over as soon as it may be.

    ``when`` names later seconds for them: ``told``, ``mailed``, ``over``.
    """
    robot, motor = (f"robot_{where[0]}", f"Motor {where[1]}")
    told = when.get("told", at + CONFIRM)
    tellings = (
        *_problem(f"demo/{robot} {motor}", "CRITICAL", when.get("mailed", told), told),
        *_recovery(f"demo/{robot} {motor}", "CRITICAL", when.get("over", at + lasts)),
    )
    return Event(at, tells, robot, motor, "error", lasts, told=tellings)


def _silence(at: float, robot: int, lasts: float, tells: str) -> Event:
    # Robots publish once a second: the last message may have come a second before.
    told = at - 1 + STALE + CONFIRM
    what = f"demo/robot_{robot}"
    tellings = (*_problem(what, "SILENT", told, told), *_recovery(what, "SILENT", at + lasts))
    return Event(at, tells, f"robot_{robot}", what="hang", lasts=lasts, told=tellings)


def _turn(at: float, what: str, tells: str, told: Tellings) -> Event:
    return Event(at, tells, "robot_1", "Motor 1", what, told=told)


WORSE = "demo/robot_1 Motor 1"
DAY = (
    _turn(0, "warn", "A motor warns.", _problem(WORSE, "WARNING", CONFIRM)),
    _turn(25, "error", "It gets worse: told at once.", _problem(WORSE, "CRITICAL", 25, 25)),
    _turn(55, "warn", "It gets better, and still warns.", _recovery(WORSE, "CRITICAL", 55)),
    _turn(85, "ok", "It is well.", _recovery(WORSE, "WARNING", 85, sms=False)),
    Event(
        0,
        "A motor flaps for 40 s, then rests.",
        "robot_2",
        "Motor 2",
        "flap",
        40,
        told=(
            # Seven of the 20 changes weigh 0.4, which is where flapping begins. Sixteen steady
            # states after the last change, which came at most a period before the end, it is calm.
            Telling("** FLAPPING ** demo/robot_2 Motor 2 started flapping", 6 * FLAP_PERIOD),
            Telling(
                "** FLAPPING ** demo/robot_2 Motor 2 stopped flapping",
                40 - FLAP_PERIOD + 15 * FLAP_INTERVAL,
            ),
        ),
    ),
    _silence(0, 3, 40, "A robot falls silent and returns."),
    _fault(0, (4, 1), 55, "A motor fails; it is repaired while its robot is silent.", over=75),
    _silence(40, 4, 35, "The robot with the failed motor falls silent."),
    _fault(0, (5, 1), 145, "A motor fails and is acknowledged: nobody else is told."),
    Event(
        15,
        "The acknowledgement.",
        "robot_5",
        act="acknowledge",
        when="PROBLEM demo: Motor 1 of robot_5 is CRITICAL.",
    ),
    _fault(0, (6, 1), 145, "A motor fails and nobody acknowledges it."),
    Event(
        CONFIRM + ESCALATE,
        "Nobody has acknowledged it.",
        "robot_6",
        act="wait",
        told=(
            Telling(
                "** ESCALATION 1 ** demo/robot_6 Motor 1 is CRITICAL and not acknowledged",
                CONFIRM + ESCALATE,
            ),
        ),
    ),
    Event(
        105,
        "Planned downtime of a robot, for 40 s.",
        "robot_1",
        act="maintain",
        lasts=40,
        told=(
            Telling("** MAINTENANCE ** demo/robot_1 began", 105),
            Telling("** MAINTENANCE ** demo/robot_1 ended", 144),  # fleet.yml has whole seconds
        ),
    ),
    Event(
        117, "A motor fails within the downtime, repaired.", "robot_1", "Motor 2", "error", lasts=10
    ),
    _fault(119, (1, 3), 60, "A motor fails within the downtime and outlives it.", told=144),
    _fault(160, (2, 1), 45, "A motor fails."),
    Event(
        175,
        "The exporter is killed, and back after some scrapes.",
        act="kill exporter",
        when="PROBLEM demo: Motor 1 of robot_2 is CRITICAL.",
    ),
    _fault(215, (3, 1), 60, "A motor fails."),
    Event(
        230,
        "Prometheus is restarted.",
        act="restart prometheus",
        when="PROBLEM demo: Motor 1 of robot_3 is CRITICAL.",
    ),
    Event(250, "Alertmanager is restarted.", act="restart alertmanager"),
    Event(290, "The mail server refuses mails for 25 s.", act="refuse mails", lasts=25),
    _fault(292, (4, 2), 45, "A motor fails meanwhile.", mailed=315),
    Event(
        355,
        "The site is cut off for 25 s.",
        act="cut off",
        lasts=25,
        told=(
            *_problem("demo site hall", "SILENT", *[355 - 1 + STALE + CONFIRM] * 2),
            *_recovery("demo site hall", "SILENT", 380),
        ),
    ),
)
EXPECTED = tuple(telling for event in DAY for telling in event.told)


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
    clocks = {"stale_after": STALE, "confirm_after": CONFIRM, "flap_interval": FLAP_INTERVAL}
    robots = {"topic": "/{robot}/diagnostics_agg", "domain_ids": [domain_id]}
    config: dict[str, Any] = {
        "fleet": "demo",
        "profiles": {"default": {name: f"{seconds}s" for name, seconds in clocks.items()}},
        "discovery": [{**robots, "labels": {"site": "hall"}}],
    }
    if maintenance is not None:
        start, end = (
            datetime.fromtimestamp(at, timezone.utc).isoformat(timespec="seconds")
            for at in maintenance
        )
        selector = {"robot": "robot_1"}
        window = {"name": "inspection", "comment": "once a day", "selector": selector}
        config["maintenance"] = [{**window, "start": start, "end": end}]
    return yaml.safe_dump(config)
