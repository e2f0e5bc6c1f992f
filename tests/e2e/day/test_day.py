"""The day of six robots over the whole road: every message that has to come, and no other.

With the environment variable A_DAY naming a file, the day is written there as a page
(docs/a-day.md).
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

import pytest

from e2e.day.page import page
from e2e.day.plan import DAY, EXPECTED, LATE
from e2e.day.stack import Day, MoodyInbox
from support.sns import Phone
from testbed.polling import until
from testbed.stack import Plan, running

TOO_MANY = 15  # seconds after the last expected message, in which one too many would come


@pytest.fixture
def day(tmp_path: Path, amazon: str) -> Iterator[Day]:
    inbox = MoodyInbox()
    phone = Phone(amazon)
    with running(tmp_path, Plan(robots=6), inbox) as stack:
        phone.start()
        yield Day(stack, inbox, amazon, phone)
    phone.stop()


@pytest.mark.slow
@pytest.mark.timeout(600)
def test_the_day_of_six_robots(day: Day):
    """Each problem is followed by exactly one recovery; none is missing, extra, early or late."""
    day.shorten_clocks()
    day.start_robots()
    for event in sorted(DAY, key=lambda each: each.at):
        if event.act:
            day.reach(event.at)
            day.act(event)
    expected = Counter((each.by, each.words) for each in EXPECTED)

    def missing() -> list[tuple[str, str]]:
        come = Counter((by, words) for _, by, words in day.told())
        return sorted((expected - come).elements())

    day.reach(max(each.earliest for each in EXPECTED))
    until(lambda: not missing(), lambda: f"{missing()}; there came {day.told()}", LATE)
    day.reach(max(at for at, _, _ in day.told()) + TOO_MANY)
    told = day.told()
    assert Counter((by, words) for _, by, words in told) == expected
    assert untimely(told) == []
    assert_problems_come_before_recoveries(told)
    if "A_DAY" in os.environ:
        Path(os.environ["A_DAY"]).write_text(page(told))


def untimely(told: list[tuple[float, str, str]]) -> list[str]:
    """Say which messages came before the day's clocks allow it, or too late."""
    allowed = {(each.by, each.words): each for each in EXPECTED}
    return [
        f"{by} at {at:.1f}, not within {limits.earliest:g} to {limits.latest:g}: {words}"
        for at, by, words in told
        for limits in [allowed[by, words]]
        if not limits.earliest <= at <= limits.latest
    ]


def assert_problems_come_before_recoveries(told: list[tuple[float, str, str]]) -> None:
    open_problems: Counter[str] = Counter()
    for _, by, words in told:
        kind, _, rest = words.removeprefix("** ").partition(" ")
        what = by + rest.replace("no longer: ", "").replace("is no longer", "is")
        if kind == "PROBLEM":
            open_problems[what] += 1
        elif kind == "RECOVERY":
            open_problems[what] -= 1
            assert open_problems[what] == 0, words
    assert not +open_problems


def test_the_page_of_the_day_has_every_message_of_the_list():
    written = (Path(__file__).resolve().parents[3] / "docs" / "a-day.md").read_text()

    found = {each: written.count(f"| {each.by} | `{each.words}`") for each in EXPECTED}
    assert found == dict.fromkeys(EXPECTED, 1)
