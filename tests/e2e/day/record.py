"""The day's messages as the exporter recorded them, and what each mail and text message is of."""

import re
from typing import Any, NamedTuple

SITE = "site hall"
_MAIL = re.compile(
    r"\*\* (?P<kind>PROBLEM|RECOVERY|ESCALATION|FLAPPING) (?:\d )?(?P<ended>ENDED )?\*\* "
    r"demo[/ ](?P<what>.*?) (?:is|started|stopped) (?P<rest>.*)"
)
_SMS = re.compile(
    r"(?P<kind>PROBLEM|RECOVERY|ESCALATION) (?:\d )?(?P<ended>ENDED )?"
    r"demo: (?P<what>.*?) (?:is|are) (?P<rest>.*)\."
)


class Line(NamedTuple):
    """One notification: by mail or SMS; a fault that lasts, escalates or is over; of what.

    The end of an escalation is a RECOVERY too, as its event is.
    """

    by: str
    kind: str
    what: str
    state: str


def of_message(by: str, text: str) -> Line | None:
    """The line of a mail's subject or a text message; None for one that is of no fault."""
    found = (_MAIL if by == "mail" else _SMS).fullmatch(text)
    if found is None:
        assert "MAINTENANCE" in text, text
        return None
    kind, what, rest = found["kind"], found["what"], found["rest"]
    if found["ended"]:
        kind = "RECOVERY"
    elif kind == "FLAPPING":
        kind = "PROBLEM" if "started" in text else "RECOVERY"
    if " of " in what:
        component, _of, robot = what.partition(" of ")
        what = f"{robot} {component}" if component.startswith("Motor") else SITE
    state = re.sub("^no longer | and not acknowledged$|, or in maintenance now$", "", rest)
    return Line(by, kind, what, state.upper())


def of_event(event: dict[str, Any]) -> Line:
    """The line of an event of kind `notified`."""
    by = "SMS" if event["receiver"].startswith("sms") else "mail"
    kind = {"resolved": "RECOVERY", "firing": "ESCALATION" if event.get("step") else "PROBLEM"}
    what = f"{event['robot']} {event.get('component', '')}".strip() if "robot" in event else SITE
    return Line(by, kind[event["after"]], what, event["state"].upper())
