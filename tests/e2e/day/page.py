"""Writes docs/reference/a-day.md: events, and when each mail and text message arrived."""

from datetime import timedelta

from e2e.day.plan import CONFIRM, DAY, ESCALATE, EXPECTED, LATE

SMS = "SMS"
TOGETHER = 3.0  # seconds between a mail and its text message
HEAD = f"""\
# A day of six robots

What happens to six virtual robots and to the servers, and every mail and text message that follows.
An end-to-end test wrote this page and checks that these messages are sent, and no others. Its
durations are short (confirm_after {CONFIRM} s, escalation after {ESCALATE} s). In brackets: the
earliest possible time. The test fails if a message arrives before that or more than {LATE:g} s
after. What is critical is sent as a text message, too; listed are those that come without their
mail.

| time | what happens | sent by | message |
|---|---|---|---|
"""


def page(messages: list[tuple[float, str, str]]) -> str:
    """Return the page of a day; each message is second of the day, mail or SMS, and text."""
    earliest = {(each.by, each.text): each.earliest for each in EXPECTED}
    rows = [(event.at, _event(event.robot, event.component, event.description)) for event in DAY]
    mails = [at for at, by, _ in messages if by != SMS]
    rows += [
        (at, f"| | {by} | `{text}` [{_clock(earliest[by, text])}] |")
        for at, by, text in messages
        if by != SMS or min(abs(at - each) for each in mails) > TOGETHER
    ]
    ordered = sorted(rows, key=lambda row: row[0])
    return HEAD + "".join(f"| {_clock(at)} {row}\n" for at, row in ordered)


def _event(robot: str, component: str, description: str) -> str:
    where = f"{robot} {component}".strip()
    return f"| {where}: {description} | | |" if where else f"| {description} | | |"


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))[2:]
