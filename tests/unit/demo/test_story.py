"""The story waits for its mails, and only exactly those will do."""

from __future__ import annotations

import pytest

from demo.script import Fault, Pace, Step, cut_short, expected, step, verdict
from testbed.mail import Mail

FAULT = Fault("robot_7", "Motor 1", "hot")
PACE = Pace(well=10, told=5)
PROBLEM, RECOVERY = expected(FAULT)


def mails(*subjects: str) -> list[Mail]:
    return [Mail(0.0, "a@b", ("c@d",), subject, "text", "") for subject in subjects]


def test_the_mails_name_robot_and_component():
    assert PROBLEM == "** PROBLEM ** demo/robot_7 Motor 1 is CRITICAL"
    assert RECOVERY == "** RECOVERY ** demo/robot_7 Motor 1 is no longer CRITICAL"


@pytest.mark.parametrize(
    ("at", "since", "arrived", "then"),
    [
        (Step.WELL, 9.9, [], Step.WELL),
        (Step.WELL, 10.0, [], Step.BROKEN),
        (Step.BROKEN, 99.0, [], Step.BROKEN),
        (Step.BROKEN, 0.0, [PROBLEM], Step.TOLD),
        (Step.TOLD, 4.9, [PROBLEM], Step.TOLD),
        (Step.TOLD, 5.0, [PROBLEM], Step.REPAIRED),
        (Step.REPAIRED, 99.0, [PROBLEM], Step.REPAIRED),
        (Step.REPAIRED, 0.0, [PROBLEM, RECOVERY], Step.OVER),
        (Step.OVER, 99.0, [PROBLEM, RECOVERY], Step.OVER),
    ],
)
def test_the_story_goes_on_when_its_time_or_its_mail_has_come(at, since, arrived, then):
    assert step(at, since, mails(*arrived), FAULT, PACE) is then


def test_exactly_the_expected_mails_are_right():
    assert verdict(mails(PROBLEM, RECOVERY), FAULT) == []


@pytest.mark.parametrize(
    ("arrived", "wrong"),
    [
        ([], ["never came", "never came"]),
        ([PROBLEM], [f"never came: {RECOVERY}"]),
        ([PROBLEM, PROBLEM, RECOVERY], [f"not expected: {PROBLEM}"]),
        ([PROBLEM, RECOVERY, "lunch"], ["not expected: lunch"]),
    ],
)
def test_every_other_set_of_mails_is_told_mail_by_mail(arrived, wrong):
    sentences = verdict(mails(*arrived), FAULT)

    assert len(sentences) == len(wrong)
    for sentence, part in zip(sentences, wrong, strict=True):
        assert part in sentence


def test_a_story_that_was_cut_short_says_where_it_stood_and_how_to_give_it_more_time():
    assert "while the motor is repaired, the email about that is awaited" in cut_short(
        Step.REPAIRED
    )
    assert "--seconds 150" in cut_short(Step.REPAIRED)
