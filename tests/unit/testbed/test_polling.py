"""Waiting has a deadline, and its error says what for."""

from __future__ import annotations

import pytest

from testbed.polling import until


def test_the_result_is_returned():
    answers = iter([None, "", "there"])

    assert until(lambda: next(answers), "it", every=0) == "there"


def test_the_condition_is_called_a_last_time_at_the_deadline():
    calls = []

    with pytest.raises(TimeoutError, match=r"after 0 s still waiting for a wonder"):
        until(lambda: calls.append(1), "a wonder", seconds=0)

    assert calls == [1]


def test_the_error_may_have_the_last_state():
    with pytest.raises(TimeoutError, match="3 robots"):
        until(lambda: False, lambda: f"{1 + 2} robots", seconds=0)
