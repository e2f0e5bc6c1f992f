import pytest

from ros_diagnostics_exporter.mission_numbers import (
    Work,
    number_texts,
    share_text,
    shown,
    success_text,
    together,
    work_of,
)

MORNING = Work({"succeeded": 16, "aborted": 4, "cancelled": 2, "preempted": 9, "unknown": 2})


def test_success_is_of_the_goals_that_the_robot_ended_itself():
    assert (MORNING.success, MORNING.decided) == (0.8, 20)


def test_what_is_unknown_is_of_all_goals_that_no_other_replaced():
    assert (MORNING.unknown, MORNING.ended) == (2 / 24, 24)


def test_interventions_go_with_the_hours_of_autonomy():
    work = Work({}, 3, 6 * 3600.0)

    assert (work.per_hour, work.hours_between) == (0.5, 2.0)


@pytest.mark.parametrize("work", [Work({}), Work({"preempted": 3}), Work({}, 0, 0.0)])
def test_of_nothing_there_is_no_share(work):
    assert [work.success, work.unknown, work.per_hour, work.hours_between] == [None] * 4


def test_an_intervention_before_any_time_of_autonomy_is_no_rate():
    assert Work({}, 1, 0.0).per_hour is None
    assert Work({}, 0, 3600.0).per_hour == 0.0


def test_of_many_robots_goals_interventions_and_hours_are_added_up():
    found = together([MORNING, Work({"succeeded": 1}, 2, 60.0), Work({"aborted": 1}, 1, 30.0)])

    assert found.results["succeeded"] == 17
    assert (found.interventions, found.autonomous) == (3, 90.0)
    assert together([MORNING]).interventions is None


def test_each_number_is_written_with_what_it_is_of():
    assert number_texts(MORNING._replace(interventions=2, autonomous=4.14 * 3600)) == {
        "Success": "80 % of 20 goals; 2 of 24 goals unknown",
        "Interventions per hour": "0.48 (2 in 4.1 h of autonomy)",
        "Hours between interventions": "2.1",
    }


def test_numbers_that_do_not_apply_are_left_out():
    assert number_texts(Work({"preempted": 1})) == {}
    assert number_texts(Work({}, 0, 3600.0)) == {
        "Interventions per hour": "0 (0 in 1 h of autonomy)",
        "Hours between interventions": "-",
    }


def test_fractions_of_goals_are_rounded_for_people():
    assert success_text(Work({"succeeded": 0.98, "unknown": 0.4})) == "100 % of 1 goal"


@pytest.mark.parametrize(
    ("share", "text"),
    [(None, "-"), (0.0, "0 %"), (0.001, "1 %"), (0.5, "50 %"), (0.999, "99 %"), (1.0, "100 %")],
)
def test_a_share_that_is_not_whole_is_not_rounded_to_it(share, text):
    assert share_text(share) == text


@pytest.mark.parametrize(
    ("number", "text"), [(None, "-"), (3.0, "3"), (41.26, "41.3"), (0.0213, "0.021"), (0, "0")]
)
def test_small_numbers_keep_their_digits(number, text):
    assert shown(number) == text


def test_of_a_robot_the_goals_of_its_missions_count():
    actions = [
        {"mission": True, "results": {"succeeded": 2, "aborted": 1}},
        {"mission": True, "results": {"succeeded": 1}},
        {"mission": False, "results": {"aborted": 9}},
    ]
    found = work_of({"actions": actions, "interventions": 1, "autonomous_seconds": 7.0})

    assert found == Work({"succeeded": 3, "aborted": 1}, 1, 7.0)
