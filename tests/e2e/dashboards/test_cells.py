"""Each expression of each panel, mark and variable returns the cells that its panel claims."""

from __future__ import annotations

import time

import pytest

from e2e.dashboards.cells import View, differences, found_cells, views
from e2e.dashboards.watched_fleet import Watched
from support.committed_dashboards import BOARDS, Question, filled, questions

pytestmark = pytest.mark.e2e

QUESTIONS = {(each.board, each.place, each.ref): each for each in questions()}
VIEWS = views()
RANGE = 10  # seconds over which a graph is asked; its last point is compared
RANGE_OF_MARKS = 240  # all that happened since the start is marked


def ask(watched: Watched, question: Question, view: View, now: float):
    expr = filled(question.expr, view.choose)
    if question.instant:
        return watched.site.query(expr, now)
    seconds = RANGE_OF_MARKS if question.ref == "annotation" else RANGE
    return watched.site.query_range(expr, now - seconds, now, 1)


@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_expressions_return_the_cells_that_their_panels_claim(view: View, watched: Watched):
    now = watched.past_end if view.at == "past" else time.time()
    wrong = [
        f"{panel} / {ref}: {line}"
        for panel, answers in view.cells.items()
        for ref, expected in answers.items()
        for line in differences(
            expected,
            found_cells(ask(watched, QUESTIONS[view.board, panel, ref], view, now)),
            now,
        )
    ]

    assert not wrong, "\n".join(wrong)


def test_every_expression_is_asked_and_finds_something_at_least_once():
    with_cells = {
        (view.board, panel, ref)
        for view in VIEWS
        for panel, answers in view.cells.items()
        for ref, expected in answers.items()
        if expected
    }

    assert set(QUESTIONS) - with_cells == set()
    assert {view.board for view in VIEWS} == set(BOARDS)


def test_the_shares_of_availability_sum_to_one(watched: Watched):
    for report, by in (("robots", "robot"), ("groups", "robot_group"), ("fleets", "fleet")):
        question = QUESTIONS["ros-diagnostics-alerts", f"Availability of the {report}", "A"]
        sums: dict[str, float] = {}
        for cell in watched.site.query(filled(question.expr, {"__range": "5h"}), watched.past_end):
            if cell["metric"]["part"] not in {"available", "faults", "longest"}:
                name = cell["metric"][by]
                sums[name] = sums.get(name, 0.0) + float(cell["value"][1])

        assert sums
        assert sums == pytest.approx(dict.fromkeys(sums, 1.0))


@pytest.mark.parametrize(
    ("wanted", "value", "fits"),
    [
        ("3", 3.0, True),
        ("3", 3.1, False),
        ("0|1", 1.0, True),
        ("0|1", 2.0, False),
        ("1..2", 1.5, True),
        ("1..2", 2.5, False),
        ("ago 5..15", 990.0, True),
        ("ago 5..15", 1010.0, False),
        ("ms ago 5..15", 990_000.0, True),
    ],
)
def test_an_expected_value_fits_what_it_says(wanted: str, value: float, fits: bool):
    found = {(("robot", "a b, c"),): value}

    assert (differences([f"{{robot=a b, c}} {wanted}"], found, now=1000.0) == []) is fits


def test_missing_and_unexpected_cells_are_differences():
    found = {(("robot", "one"),): 1.0}

    assert len(differences(["{robot=two} 1"], found, now=0.0)) == 2
    assert len(differences(["? {robot=two} 1"], found, now=0.0)) == 1
