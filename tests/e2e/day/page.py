"""docs/a-day.md: what happened when, and which mail and text message came when."""

from __future__ import annotations

from datetime import timedelta

from e2e.day.plan import CONFIRM, DAY, ESCALATE, EXPECTED, LATE

HEAD = f"""\
# A day of six robots

What happens to six virtual robots and to the servers that watch them, and every mail and text
message that comes of it: written by the end-to-end test that asserts this list, complete, with no
extra, and each within its time. Its clocks are short (confirm_after {CONFIRM} s, escalation after
{ESCALATE} s). In brackets: the earliest that the clocks allow. The test fails if a message comes
before that, or more than {LATE:g} s after (a busy machine is late).

| time | what happens | told by | message |
|---|---|---|---|
"""


def page(told: list[tuple[float, str, str]]) -> str:
    """Return the page of a day; ``told`` is the second of the day, mail or SMS, and the words."""
    earliest = {(each.by, each.words): each.earliest for each in EXPECTED}
    rows = [(event.at, _happening(event.robot, event.component, event.tells)) for event in DAY]
    rows += [
        (at, f"| | {by} | `{words}` [{_clock(earliest[by, words])}] |") for at, by, words in told
    ]
    ordered = sorted(rows, key=lambda row: row[0])
    return HEAD + "".join(f"| {_clock(at)} {row}\n" for at, row in ordered)


def _happening(robot: str, component: str, tells: str) -> str:
    where = f"{robot} {component}".strip()
    return f"| {where}: {tells} | | |" if where else f"| {tells} | | |"


def _clock(seconds: float) -> str:
    return str(timedelta(seconds=round(seconds)))[2:]
