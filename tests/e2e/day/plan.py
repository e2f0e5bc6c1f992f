"""The day of six robots: its events, and every mail and text message that they cause.

From this one list come the scenario of the virtual robots, what the test does to the servers, the
expected messages and docs/reference/a-day.md. The day lasts some minutes: fleet.yml and the rules
have short durations.
"""

import re
from dataclasses import dataclass
from datetime import datetime, timezone
from typing import Any

import yaml

START = 15.0  # seconds from the robots' start to the first event; all are OK by then
# The day's durations in seconds, for fleet.yml and escalation.yml.
CONFIRM = 5
STALE = 4
ESCALATE = 90
# Flap detection looks at 21 states, one per interval: longer than the time between two changes, so
# that every change counts even if it is late.
FLAP_INTERVAL = 3
FLAP_PERIOD = 2  # seconds between two changes of a flapping component
FAULTS = {"restart_grace": "8s", "confirm_after": f"{CONFIRM}s"}
# A message may be so much later than the durations allow on a busy machine, and never earlier.
LATE = 60.0


@dataclass(frozen=True)
class Expected:
    """A mail or text message that must be sent, not before ``earliest`` (second of the day).

    ``text`` is the mail's subject, or the beginning of the text message.
    """

    text: str
    earliest: float
    by: str = "mail"

    @property
    def latest(self) -> float:
        """The last second at which it may arrive."""
        return self.earliest + LATE


Messages = tuple[Expected, ...]


@dataclass(frozen=True)
class Event:
    """Something that happens at a second of the day, for ``lasts`` seconds.

    ``act`` is what the test does, after the message ``after`` has arrived; without it the virtual
    robots do ``what``.
    """

    at: float
    description: str
    robot: str = ""
    component: str = ""
    what: str = ""
    lasts: float | None = None
    act: str = ""
    after: str = ""
    messages: Messages = ()


def _problem(what: str, state: str, mail: float, sms: float | None = None) -> Messages:
    """The mail, and the text message if the alert sends one."""
    mail_ = Expected(f"** PROBLEM ** {what} is {state}", mail)
    if sms is None:
        return (mail_,)
    return (mail_, Expected(f"PROBLEM {_in_words(what, state)}", sms, "SMS"))


def _recovery(what: str, state: str, mail: float, *, sms: bool = True) -> Messages:
    mail_ = Expected(f"** RECOVERY ** {what} is no longer {state}", mail)
    words = re.sub(r" (is|are) ", r" \1 no longer ", _in_words(what, state))
    return (mail_, Expected(f"RECOVERY {words}", mail, "SMS")) if sms else (mail_,)


def _in_words(what: str, state: str) -> str:
    """How a text message names it: with the alert's summary."""
    if "site" in what:
        return "demo: Many robots of fleet demo, site hall, are silent."
    robot, _, component = what.removeprefix("demo/").partition(" ")
    if component:
        return f"demo: {component} of {robot} is {state}."
    return f"demo: {robot} is {state.lower()}."


def _fault(
    at: float, where: tuple[int, int], lasts: float, description: str, **later: float
) -> Event:
    """An ERROR of a robot's motor: text message, mail and recovery as soon as possible.

    ``later`` has later seconds for them: ``fires``, ``mailed``, ``resolved``.
    """
    robot, motor = (f"robot_{where[0]}", f"Motor {where[1]}")
    fires = later.get("fires", at + CONFIRM)
    messages = (
        *_problem(f"demo/{robot} {motor}", "CRITICAL", later.get("mailed", fires), fires),
        *_recovery(f"demo/{robot} {motor}", "CRITICAL", later.get("resolved", at + lasts)),
    )
    return Event(at, description, robot, motor, "error", lasts, messages=messages)


def _silence(at: float, robot: int, lasts: float, description: str) -> Event:
    # Robots publish once a second: the last message may be a second older.
    fires = at - 1 + STALE + CONFIRM
    what = f"demo/robot_{robot}"
    messages = (*_problem(what, "SILENT", fires, fires), *_recovery(what, "SILENT", at + lasts))
    return Event(at, description, f"robot_{robot}", what="hang", lasts=lasts, messages=messages)


def _change(at: float, level: str, description: str, messages: Messages) -> Event:
    return Event(at, description, "robot_1", "Motor 1", level, messages=messages)


WORSE = "demo/robot_1 Motor 1"
NO_LONGER = "is no longer CRITICAL, or in maintenance now"
DAY = (
    _change(0, "warn", "A motor warns.", _problem(WORSE, "WARNING", CONFIRM)),
    _change(
        25, "error", "It turns CRITICAL, which fires at once.", _problem(WORSE, "CRITICAL", 25, 25)
    ),
    _change(55, "warn", "It is only a WARNING again.", _recovery(WORSE, "CRITICAL", 55)),
    _change(85, "ok", "It is OK.", _recovery(WORSE, "WARNING", 85, sms=False)),
    Event(
        0,
        "A motor flaps for 40 s, then is OK.",
        "robot_2",
        "Motor 2",
        "flap",
        40,
        messages=(
            # Seven of the 20 changes weigh 0.4, where flapping begins. It ends 16 steady states
            # after the last change, which is at most a period before the end.
            Expected("** FLAPPING ** demo/robot_2 Motor 2 started flapping", 6 * FLAP_PERIOD),
            Expected(
                "** FLAPPING ** demo/robot_2 Motor 2 stopped flapping",
                40 - FLAP_PERIOD + 15 * FLAP_INTERVAL,
            ),
        ),
    ),
    _silence(0, 3, 40, "A robot falls silent and returns."),
    _fault(0, (4, 1), 55, "A motor fails; it is repaired while its robot is silent.", resolved=75),
    _silence(40, 4, 35, "The robot with the failed motor falls silent."),
    _fault(0, (5, 1), 145, "A motor fails and is acknowledged: no escalation."),
    Event(
        15,
        "The acknowledgement.",
        "robot_5",
        act="acknowledge",
        after="PROBLEM demo: Motor 1 of robot_5 is CRITICAL.",
    ),
    _fault(0, (6, 1), 145, "A motor fails and nobody acknowledges it."),
    Event(
        CONFIRM + ESCALATE,
        "Nobody has acknowledged it.",
        "robot_6",
        act="wait",
        messages=(
            Expected(
                "** ESCALATION 1 ** demo/robot_6 Motor 1 is CRITICAL and not acknowledged",
                CONFIRM + ESCALATE,
            ),
            Expected(
                "ESCALATION 1 demo: Motor 1 of robot_6 is CRITICAL and not acknowledged.",
                CONFIRM + ESCALATE,
                "SMS",
            ),
            Expected(f"** ESCALATION 1 ENDED ** demo/robot_6 Motor 1 {NO_LONGER}", 145),
            Expected(f"ESCALATION 1 ENDED demo: Motor 1 of robot_6 {NO_LONGER}.", 145, "SMS"),
        ),
    ),
    Event(
        105,
        "Planned downtime of a robot, for 40 s.",
        "robot_1",
        act="maintain",
        lasts=40,
        messages=(
            Expected("** MAINTENANCE ** demo downtime inspection of robot_1 began", 105),
            # fleet.yml has whole seconds.
            Expected("** MAINTENANCE ** demo downtime inspection of robot_1 ended", 144),
        ),
    ),
    Event(
        117, "A motor fails within the downtime, repaired.", "robot_1", "Motor 2", "error", lasts=10
    ),
    _fault(119, (1, 3), 60, "A motor fails within the downtime and outlives it.", fires=144),
    _fault(160, (2, 1), 45, "A motor fails."),
    Event(
        175,
        "The exporter is killed, and restarted after 8 s.",
        act="kill exporter",
        after="PROBLEM demo: Motor 1 of robot_2 is CRITICAL.",
    ),
    _fault(215, (3, 1), 60, "A motor fails."),
    Event(
        230,
        "Prometheus is restarted.",
        act="restart prometheus",
        after="PROBLEM demo: Motor 1 of robot_3 is CRITICAL.",
    ),
    Event(250, "Alertmanager is killed, and restarted after 8 s.", act="kill alertmanager"),
    Event(290, "The mail server rejects mails for 25 s.", act="reject mails", lasts=25),
    _fault(292, (4, 2), 45, "A motor fails meanwhile.", mailed=315),
    Event(
        355,
        "The site is cut off for 25 s.",
        act="cut off",
        lasts=25,
        messages=(
            *_problem("demo site hall", "SILENT", *[355 - 1 + STALE + CONFIRM] * 2),
            *_recovery("demo site hall", "SILENT", 380),
        ),
    ),
)
EXPECTED = tuple(message for event in DAY for message in event.messages)


def scenario() -> str:
    """The scenario of the virtual robots."""
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
    """A fleet.yml with short durations; ``maintenance`` from and until (Unix time) for robot_1."""
    clocks = {"stale_after": STALE, "confirm_after": CONFIRM, "flap_interval": FLAP_INTERVAL}
    robots = {"topic": "/{robot}/diagnostics_agg", "domain_ids": [domain_id]}
    config: dict[str, Any] = {
        "fleet": "demo",
        "profiles": {"default": {name: f"{seconds}s" for name, seconds in clocks.items()}},
        "discovery": [{**robots, "labels": {"site": "hall"}}],
        "faults": FAULTS,
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
