"""Waiting has a deadline and says what it waited for."""

from __future__ import annotations

import pytest

from testbed.polling import until


def test_the_answer_is_returned():
    answers = iter([None, "", "there"])

    assert until(lambda: next(answers), "it", every=0) == "there"


def test_the_condition_is_asked_a_last_time_at_the_deadline():
    asked = []

    with pytest.raises(TimeoutError, match=r"after 0 s still waiting for a wonder"):
        until(lambda: asked.append(1), "a wonder", seconds=0)

    assert asked == [1]


def test_what_may_tell_the_last_state():
    with pytest.raises(TimeoutError, match="3 robots"):
        until(lambda: False, lambda: f"{1 + 2} robots", seconds=0)
