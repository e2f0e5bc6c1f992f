"""Every expression of every panel, annotation and variable returns the expected cells."""

import time

import pytest

from e2e.dashboards.cells import View, differences, found_cells, views
from e2e.dashboards.watched_fleet import WatchedFleet
from support.committed_dashboards import BOARDS, Query, filled, queries

QUERIES = {(each.board, each.place, each.ref): each for each in queries()}
VIEWS = views()
RANGE = 10  # seconds of a range query; its last point is compared
ANNOTATION_RANGE = 240  # long enough for all changes since the start


def run_query(watched: WatchedFleet, query: Query, view: View, now: float):
    expr = filled(query.expr, view.variables)
    if query.instant:
        return watched.site.engine.series(expr, now)
    seconds = ANNOTATION_RANGE if query.ref == "annotation" else RANGE
    return watched.site.engine.query_range(expr, now - seconds, now, 1)


@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_expressions_return_the_expected_cells(view: View, watched: WatchedFleet):
    now = watched.history_end if view.at == "recorded" else time.time()
    wrong = [
        f"{panel} / {ref}: {line}"
        for panel, results in view.cells.items()
        for ref, expected in results.items()
        for line in differences(
            expected,
            found_cells(
                run_query(watched, QUERIES[view.board, panel, ref], view, now), watched.fleets, now
            ),
            now,
        )
    ]

    assert not wrong, "\n".join(wrong)


def test_every_expression_is_expected_to_return_cells_in_at_least_one_view():
    with_cells = {
        (view.board, panel, ref)
        for view in VIEWS
        for panel, results in view.cells.items()
        for ref, expected in results.items()
        if expected
    }

    assert set(QUERIES) - with_cells == set()
    assert {view.board for view in VIEWS} == set(BOARDS)
