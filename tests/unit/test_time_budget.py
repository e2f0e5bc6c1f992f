"""`./run test` names the folders of which the tests take more than their part of the time."""

from __future__ import annotations

from support import time_budget

LIMITS = {"e2e": 50, "unit": 30, "unit/rules": 15}
RUN = [("tests/e2e/a.py::b", 40.0), ("tests/e2e/a.py::b", 9.0), ("tests/unit/a.py::b", 30.0)]


def test_a_folder_that_takes_more_than_its_part_is_named():
    found = time_budget.exceeded([*RUN, ("tests/unit/rules/a.py::b", 21.0)], LIMITS)
    assert found == [
        "tests/unit/rules takes 21 % of the time of all tests; time_budget.yml allows 15 %"
    ]


def test_a_run_of_some_folders_says_nothing_of_their_parts():
    assert time_budget.exceeded(RUN, LIMITS) == []


def test_the_parts_of_folders_that_there_are_make_more_than_the_whole():
    budgets = time_budget.budgets()
    assert all((time_budget.FILE.parent / folder).is_dir() for folder in budgets)
    assert 100 < sum(budgets.values()) < 150
