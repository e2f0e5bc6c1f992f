"""Lists of goals as an action server publishes them -> how each goal ended; time is given."""

import pytest
from hypothesis import HealthCheck, given, settings
from pydantic import TypeAdapter

from ros_diagnostics_exporter.decode.goals import (
    ABORTED,
    ACCEPTED,
    CANCELED,
    CANCELING,
    EXECUTING,
    SUCCEEDED,
    Goal,
)
from ros_diagnostics_exporter.robots.goals import MOST_RUNNING, RETURN, Goals, GoalsLearned
from support.goal_histories import histories, play, recount


def goal(number: int, status: int, stamp: float | None = None) -> Goal:
    return Goal(number.to_bytes(16, "big"), float(number) if stamp is None else stamp, status)


def seen(*lists: tuple[float, list[Goal]], goals: Goals | None = None) -> Goals:
    """What is known after lists at some seconds, and ten seconds more."""
    goals = goals or Goals()
    for mono, each in lists:
        goals.see(each, mono)
    goals.tick(lists[-1][0] + 10)
    return goals


def results(goals: Goals) -> dict[str, int]:
    return {word: count for word, count in goals.counts.results.items() if count}


def running(number: int) -> tuple[float, list[Goal]]:
    return 1.0, [goal(number, EXECUTING)]


START = (0.0, list[Goal]())


@pytest.mark.parametrize(
    ("status", "word"),
    [(SUCCEEDED, "succeeded"), (ABORTED, "aborted"), (CANCELED, "cancelled")],
)
def test_a_goal_ends_as_its_server_says(status, word):
    goals = seen(
        START,
        (1.0, [goal(1, ACCEPTED)]),
        (2.0, [goal(1, EXECUTING)]),
        (4.0, [goal(1, CANCELING)]),
        (8.0, [goal(1, status)]),
        (9.0, [goal(1, status)]),
    )

    assert results(goals) == {word: 1}
    assert (goals.counts.started, goals.counts.seconds, goals.running) == (1, 7.0, 0)
    assert goals.counts.durations == [0, 1, 0, 0, 0, 0]


def test_a_goal_that_runs_is_counted_when_it_ends():
    goals = seen(START, running(1))

    assert (results(goals), goals.running, goals.longest(13.0)) == ({}, 1, 12.0)


def test_who_joins_late_counts_what_runs_and_not_what_had_ended():
    goals = seen(
        (0.0, [goal(1, SUCCEEDED), goal(2, EXECUTING)]),
        (5.0, [goal(1, SUCCEEDED), goal(2, ABORTED)]),
    )

    assert results(goals) == {"aborted": 1}
    assert goals.counts.started == 0, "when it began nobody knows"
    assert sum(goals.counts.durations) == 0


def test_a_goal_whose_end_the_server_no_longer_keeps_is_unknown():
    assert results(seen(START, running(1), (900.0, [goal(2, EXECUTING)]))) == {"unknown": 1}


def test_a_goal_that_began_and_ended_between_two_lists_has_no_duration():
    goals = seen(START, (5.0, [goal(1, SUCCEEDED)]))

    assert results(goals) == {"succeeded": 1}
    assert sum(goals.counts.durations) == 0


@pytest.mark.parametrize("after", [0.0, 0.9])
def test_a_goal_that_ends_as_a_newer_one_was_accepted_is_preempted(after):
    goals = seen(
        START,
        running(1),
        (5.0, [goal(1, EXECUTING), goal(2, ACCEPTED)]),
        (5.0 + after, [goal(1, ABORTED), goal(2, EXECUTING)]),
    )

    assert results(goals) == {"preempted": 1}


def test_a_goal_that_aborts_long_after_a_newer_one_was_accepted_is_aborted():
    goals = seen(
        START,
        running(1),
        (5.0, [goal(1, EXECUTING), goal(2, ACCEPTED)]),
        (6.5, [goal(1, ABORTED), goal(2, EXECUTING)]),
    )

    assert results(goals) == {"aborted": 1}


def test_a_newer_goal_that_aborts_was_not_replaced_by_an_older_one():
    both = [goal(1, EXECUTING), goal(2, EXECUTING)]

    assert results(seen(START, (1.0, both), (1.5, [both[0], goal(2, ABORTED)]))) == {"aborted": 1}


def test_a_client_that_tries_again_at_once_does_not_hide_the_abort():
    goals = seen(
        START,
        running(1),
        (5.0, [goal(1, ABORTED)]),
        (5.1, [goal(1, ABORTED), goal(2, ACCEPTED)]),
    )

    assert results(goals) == {"aborted": 1}


@pytest.mark.parametrize(("after", "word"), [(0.5, "preempted"), (1.5, "cancelled")])
def test_a_client_that_cancels_and_sends_another_goal_replaces_it(after, word):
    goals = seen(
        START,
        running(1),
        (5.0, [goal(1, CANCELED)]),
        (5.0 + after, [goal(1, CANCELED), goal(2, ACCEPTED)]),
    )

    assert results(goals) == {word: 1}


def test_an_id_that_comes_again_is_another_goal():
    ended, again = [goal(1, SUCCEEDED)], [goal(1, EXECUTING, 3.0)]
    ended_again = [goal(1, SUCCEEDED, 3.0)]

    gone = seen(START, running(1), (2.0, ended), (3.0, []), (4.0, again), (5.0, ended_again))
    at_once = seen(START, running(1), (2.0, ended), (5.0, ended_again))

    assert results(gone) == results(at_once) == {"succeeded": 2}


def test_the_clock_of_the_robot_makes_no_difference():
    goals = seen(
        START,
        (1.0, [goal(1, EXECUTING, 1e9)]),
        (2.0, [goal(1, SUCCEEDED, 1e9)]),
        (3.0, [goal(1, SUCCEEDED, 1e9), goal(2, EXECUTING, -5.0)]),
        (5.0, [goal(1, SUCCEEDED, 1e9), goal(2, ABORTED, -5.0)]),
    )

    assert results(goals) == {"succeeded": 1, "aborted": 1}
    assert goals.counts.seconds == 3.0


def test_a_server_that_is_restarted_leaves_its_goals_unknown():
    goals = seen(START, running(1))

    assert [each.result for each in goals.restart(20.0)] == ["unknown"]
    goals.see([goal(1, EXECUTING)], 21.0)
    goals.see([goal(1, SUCCEEDED)], 25.0)
    assert results(goals) == {"unknown": 1, "succeeded": 1}, "the new server may use the id, too"


def test_a_robot_that_returns_in_time_says_how_its_goal_ended():
    goals = seen(START, running(1))
    goals.leave(20.0)
    assert (goals.running, goals.longest(30.0), goals.due) == (0, 0.0, 20.0 + RETURN)
    goals.see([goal(1, SUCCEEDED)], 20.0 + RETURN - 1)

    assert results(goals) == {"succeeded": 1}
    assert sum(goals.counts.durations) == 0, "when it ended nobody knows"


def test_a_robot_that_returns_too_late_leaves_its_goal_unknown():
    goals = seen(START, running(1))
    goals.leave(20.0)

    assert goals.tick(20.0 + RETURN - 1) == []
    assert [each.result for each in goals.tick(20.0 + RETURN)] == ["unknown"]
    goals.see([goal(1, EXECUTING)], 700.0)
    goals.see([goal(1, SUCCEEDED)], 800.0)
    assert results(goals) == {"unknown": 1}, "one goal is counted once"


def restarted(goals: Goals, mono: float) -> Goals:
    """A later process, which reads what this one wrote."""
    adapter = TypeAdapter(GoalsLearned)
    later = Goals()
    later.restore(adapter.validate_json(adapter.dump_json(goals.learned(mono))), mono)
    return later


def test_a_restart_of_the_exporter_changes_no_count():
    goals = seen(START, running(1), (2.0, [goal(1, SUCCEEDED), goal(2, EXECUTING)]))
    kept = [goal(1, SUCCEEDED), goal(2, ABORTED), goal(3, SUCCEEDED), goal(4, EXECUTING)]

    later = seen((15.0, kept), goals=restarted(goals, 14.0))

    assert results(later) == {"succeeded": 2, "aborted": 1}, "the third ended meanwhile"
    assert (later.running, later.counts.seconds) == (1, 1.0)


def test_after_a_restart_of_the_exporter_the_last_list_is_not_counted_again():
    ended = [goal(1, SUCCEEDED)]
    goals = seen(START, running(1), (2.0, ended))

    assert results(seen((15.0, ended), goals=restarted(goals, 14.0))) == {"succeeded": 1}


def test_goals_beyond_a_number_are_not_followed():
    many = [goal(number, EXECUTING) for number in range(MOST_RUNNING + 5)]

    goals = seen(START, (1.0, many))

    assert goals.running == MOST_RUNNING


def check(history) -> None:
    played = play(history)
    counts = played.goals.counts

    assert results(played.goals) == recount(played)
    assert sum(counts.results.values()) + played.goals.running <= played.server.accepted
    if played.is_whole:
        assert (counts.started, counts.results["unknown"]) == (played.server.accepted, 0)


@given(histories(30))
@settings(max_examples=300)
def test_whatever_happens_a_recount_of_what_was_received_says_the_same(history):
    check(history)


@pytest.mark.slow
@pytest.mark.timeout(900)  # four minutes and more beside other work
@given(histories(60))
@settings(max_examples=10_000, suppress_health_check=[HealthCheck.too_slow])
def test_ten_thousand_histories_are_recounted(history):
    check(history)
