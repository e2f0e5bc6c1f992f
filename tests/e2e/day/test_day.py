"""The day of six robots through all real servers: every expected message is sent, and no other.

What the exporter recorded of them equals the mailbox and the text messages, line by line.

A_DAY=docs/reference/a-day.md writes the day as a page.
"""

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from e2e.day.page import HEAD, SMS, page
from e2e.day.plan import DAY, EXPECTED, LATE
from e2e.day.record import of_message
from e2e.day.stack import Day, RejectingInbox
from support.shipped_rules import ROOT
from support.sns import Phone, start_server
from testbed.polling import until
from testbed.site import Site

TOO_MANY = 15  # seconds after the last expected message, in which one too many would arrive


@pytest.fixture
def day(tmp_path: Path) -> Iterator[Day]:
    inbox = RejectingInbox()
    with Site(tmp_path, inbox) as site:
        sns_server = start_server(site)
        phone = Phone(sns_server)
        phone.start()
        yield Day(site, inbox, sns_server, phone)
    phone.stop()


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_day_of_six_robots(day: Day):
    """Each problem is followed by exactly one recovery; none is missing, extra, early or late."""
    day.start_robots()
    for event in sorted(DAY, key=lambda each: each.at):
        if event.act:
            day.reach(event.at)
            day.act(event)
    expected = Counter((each.by, each.text) for each in EXPECTED)

    def missing() -> list[tuple[str, str]]:
        arrived = Counter((by, text) for _, by, text in day.messages())
        return sorted((expected - arrived).elements())

    day.reach(max(each.earliest for each in EXPECTED))
    until(lambda: not missing(), lambda: f"{missing()}; arrived: {day.messages()}", LATE)
    day.reach(max(at for at, _, _ in day.messages()) + TOO_MANY)
    messages = day.messages()
    assert Counter((by, text) for _, by, text in messages) == expected
    assert untimely(messages) == []
    assert_problems_come_before_recoveries(messages)
    assert day.recorded() == sorted(
        filter(None, (of_message(by, text) for _, by, text in messages))
    )
    if "A_DAY" in os.environ:
        Path(os.environ["A_DAY"]).write_text(page(messages))


def untimely(messages: list[tuple[float, str, str]]) -> list[str]:
    """Return the messages that arrived too early or too late."""
    allowed = {(each.by, each.text): each for each in EXPECTED}
    return [
        f"{by} at {at:.1f}, not within {limits.earliest:g} to {limits.latest:g}: {text}"
        for at, by, text in messages
        for limits in [allowed[by, text]]
        if not limits.earliest <= at <= limits.latest
    ]


def assert_problems_come_before_recoveries(messages: list[tuple[float, str, str]]) -> None:
    open_problems: Counter[str] = Counter()
    for _, by, text in messages:
        kind, _, rest = text.removeprefix("** ").partition(" ")
        what = by + rest.replace("no longer ", "")
        if kind == "PROBLEM":
            open_problems[what] += 1
        elif kind == "RECOVERY":
            open_problems[what] -= 1
            assert open_problems[what] == 0, text
    assert not +open_problems


def test_the_page_has_every_event_and_message_of_the_day():
    written = (ROOT / "docs" / "reference" / "a-day.md").read_text()

    found = {each: written.count(f"| {each.by} | `{each.text}`") for each in EXPECTED}
    mails = [each for each in EXPECTED if each.by != SMS]
    assert {each: found[each] for each in mails} == dict.fromkeys(mails, 1)
    texts = [each for each in EXPECTED if each.by == SMS and found[each]]
    assert len(texts) == written.count(f"| {SMS} |") > 0
    assert written.startswith(HEAD)
    assert [each.description for each in DAY if f"{each.description} |" not in written] == []
