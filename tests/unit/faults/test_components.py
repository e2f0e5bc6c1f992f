"""Faults of components: confirmation, nesting, what ends them and what does not."""

import pytest

from ros_diagnostics_exporter.faults.model import ComponentName
from support.fault_histories import (
    ERROR,
    OK,
    STALE,
    WALL,
    WARN,
    back,
    level,
    maintenance,
    moved,
    play,
    robot_settings,
    silent,
)

CRITICAL = "component/critical r1 motor"
WARNING = "component/warning r1 motor"
SILENT = "robot/silent r1"


def test_an_error_is_a_fault_after_confirm_after_until_it_is_received_better():
    play(
        (20, level("motor", ERROR)),
        (29, None),
        (30, None, f"began {CRITICAL}"),
        (59, None),
        (60, level("motor", OK), f"recovered {CRITICAL}"),
    )


def test_an_error_that_ends_before_confirm_after_is_none():
    play((20, level("motor", ERROR)), (29, level("motor", OK)), (100, None))


def test_a_fault_shorter_than_a_scrape_is_one_where_confirm_after_is_zero():
    play(
        (20, level("motor", ERROR, confirm_after=0), f"began {CRITICAL}"),
        (20.2, level("motor", OK, confirm_after=0), f"recovered {CRITICAL}"),
    )


def test_a_component_may_have_a_confirm_after_of_its_own():
    play(
        (0, level("motor", WARN)),
        (0, level("arm", WARN, confirm_after=30)),
        (10, None, f"began {WARNING}"),
        (29, None),
        (30, None, "began component/warning r1 arm"),
    )


def test_a_confirmed_warning_that_gets_worse_is_critical_at_once_and_goes_on_under_it():
    play(
        (0, level("motor", WARN)),
        (10, None, f"began {WARNING}"),
        (50, level("motor", ERROR), f"began {CRITICAL}"),
        (70, level("motor", WARN), f"recovered {CRITICAL}"),
        (90, level("motor", OK), f"recovered {WARNING}"),
    )


@pytest.mark.parametrize(("to", "state"), [(ERROR, "critical"), (STALE, "stale")])
def test_what_gets_better_and_worse_again_is_another_fault(to, state):
    fault = f"component/{state} r1 motor"
    last = play(
        (0, level("motor", to)),
        (10, None, f"began {fault}"),
        (20, level("motor", WARN), f"recovered {fault}", f"began {WARNING}"),
        (40, level("motor", to), f"began {fault}"),
    )

    since = {each.identity.state.value: each.since - WALL for each in last.faults.faults()}
    assert since == {"warning": 0, state: 40}
    parts = None, ComponentName("", "motor"), ComponentName("", "arm")
    assert [last.faults.in_trouble("r1", part) for part in parts] == [True, True, False]
    last.go(50, level("motor", OK))
    assert not last.faults.in_trouble("r1")


def test_stale_is_a_state_of_its_own_and_ends_with_a_fresh_status():
    play(
        (0, level("camera", STALE)),
        (10, None, "began component/stale r1 camera"),
        (60, level("camera", OK), "recovered component/stale r1 camera"),
    )


def test_stale_ends_neither_a_warning_nor_a_critical():
    play(
        (0, level("motor", WARN)),
        (10, None, f"began {WARNING}"),
        (20, level("motor", STALE), "began component/stale r1 motor"),
        (30, level("motor", ERROR), f"began {CRITICAL}"),
        (40, level("motor", STALE)),
        (50, level("motor", WARN), f"recovered {CRITICAL}", "recovered component/stale r1 motor"),
        (60, level("motor", OK), f"recovered {WARNING}"),
    )


def test_stale_is_critical_too_where_the_config_says_so_and_nothing_where_it_is_planned():
    play(
        (0, level("camera", STALE, stale_is_critical=True)),
        (0, level("arm", STALE, planned_stale=True)),
        (10, None, "began component/critical r1 camera", "began component/stale r1 camera"),
        (40, level("arm", ERROR, planned_stale=True)),
        (50, None, "began component/critical r1 arm"),
        (60, level("arm", STALE, planned_stale=True)),
        (70, level("arm", OK, planned_stale=True), "recovered component/critical r1 arm"),
    )


def test_the_same_name_in_two_groups_is_two_components():
    play(
        (0, level("motor", ERROR, group="/left")),
        (5, level("motor", ERROR, group="/right")),
        (10, None, "began component/critical r1 /left motor"),
        (15, None, "began component/critical r1 /right motor"),
        (20, level("motor", OK, group="/left"), "recovered component/critical r1 /left motor"),
    )


def test_a_component_that_moves_to_another_group_keeps_its_fault_and_its_clock():
    last = play(
        (0, level("motor", ERROR, group="/a")),
        (5, moved("motor", "/a", "/b")),
        (10, None, "began component/critical r1 /b motor"),
        (
            20,
            moved("motor", "/b", "/c"),
            "removed component/critical r1 /b motor",
            "began component/critical r1 /c motor",
        ),
        (30, level("motor", ERROR, group="/b")),
        (35, level("motor", OK, group="/b")),
    )

    assert [each.since for each in last.faults.faults()] == [WALL]
    assert last.go(40, level("motor", OK, group="/c"))[0].what == "recovered"


def test_labels_are_those_of_the_beginning_for_the_life_of_a_fault():
    last = play(
        (0, robot_settings(site="hall", team="red")),
        (0, level("motor", ERROR)),
        (0, level("arm", ERROR, confirm_after=30)),
        (10, None, f"began {CRITICAL}"),
        (20, robot_settings(site="yard", team="blue")),
        (30, None, "began component/critical r1 arm"),
    )

    labels = {each.identity.component: dict(each.labels) for each in last.faults.faults()}
    assert labels == {
        "motor": {"site": "hall", "team": "red"},
        "arm": {"site": "yard", "team": "blue"},
    }


def test_evidence_is_fixed_once():
    last = play((0, level("motor", ERROR)), (10, None, f"began {CRITICAL}"))
    fault = next(iter(last.faults.faults()))

    described = last.faults.describe(fault, "x" * 5000)
    assert described.evidence == "x" * 4096
    assert last.faults.describe(described, "another") is described
    last.reborn(11)

    assert next(iter(last.faults.faults())).evidence == "x" * 4096


def test_another_confirm_after_holds_for_what_is_not_confirmed():
    play(
        (0, level("motor", ERROR)),
        (0, level("arm", ERROR)),
        (5, level("motor", ERROR, confirm_after=30)),
        (7, level("arm", ERROR, confirm_after=1), "began component/critical r1 arm"),
        (30, None, f"began {CRITICAL}"),
    )


# -- silence -----------------------------------------------------------------------------------


def test_nothing_begins_while_the_robot_is_silent_and_nothing_ends():
    play(
        (0, level("motor", ERROR)),
        (5, level("arm", ERROR)),
        (10, None, f"began {CRITICAL}"),
        (12, silent()),
        (22, None, f"began {SILENT}"),
        (
            90,
            back("r1", level("motor", OK), level("arm", ERROR)),
            f"recovered {SILENT}",
            f"recovered {CRITICAL}",
            "began component/critical r1 arm",
        ),
    )


def test_what_turns_stale_right_after_its_robots_return_is_no_change():
    for second, ratio in ((29, 0.0), (30, 1.25 / 20)):
        last = play(
            (0, silent()),
            (10, None, f"began {SILENT}"),
            (20, back("r1", level("motor", OK)), f"recovered {SILENT}"),
            (second, level("motor", STALE)),
        )
        assert [each.flap_ratio for each in last.faults.followed("r1").values()] == [ratio]


def test_why_a_problem_is_suppressed():
    last = play((0, level("motor", ERROR)), (5, maintenance(planned=True)))

    view = next(last.faults.problems(last.at(last.second)))
    assert (view.since - WALL, view.due - WALL, view.fault) == (0, 10, None)
    assert view.suppressed == "maintenance"
