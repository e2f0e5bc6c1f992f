"""Modes and goals -> seconds of autonomy and interventions; time is given."""

import pytest
from pydantic import TypeAdapter

from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.robots.autonomy import Autonomy, AutonomyLearned
from ros_diagnostics_exporter.robots.goals import GoalEnd

AUTO, MANUAL = True, False


def step(autonomy, mono, *, autonomous, stopped=False, running=0):
    return autonomy.update(
        autonomous=autonomous, stopped=stopped, running=running, now=Instant(mono, 0.0)
    )


@pytest.fixture
def autonomy():
    """A robot that is autonomous from 0 s on."""
    made = Autonomy()
    assert not step(made, 0.0, autonomous=AUTO)
    return made


def test_the_time_counts_while_it_is_autonomous_and_known(autonomy):
    step(autonomy, 10.0, autonomous=None)
    step(autonomy, 20.0, autonomous=AUTO)
    step(autonomy, 25.0, autonomous=MANUAL)

    assert autonomy.read(99.0) == 15.0


def test_leaving_autonomous_with_a_goal_under_way_is_an_intervention(autonomy):
    assert step(autonomy, 10.0, autonomous=MANUAL, running=1)
    assert not step(autonomy, 11.0, autonomous=MANUAL, running=1)
    assert autonomy.interventions == 1


@pytest.mark.parametrize(
    ("result", "expected"), [("succeeded", 0), ("aborted", 1), ("cancelled", 1), ("unknown", 1)]
)
def test_leaving_it_after_a_goal_is_one_unless_the_goal_succeeded(autonomy, result, expected):
    autonomy.note_end(GoalEnd(result, 5.0))
    step(autonomy, 10.0, autonomous=MANUAL)

    assert autonomy.interventions == expected


def test_what_succeeded_before_it_was_autonomous_does_not_count(autonomy):
    autonomy.note_end(GoalEnd("succeeded", 5.0))
    step(autonomy, 10.0, autonomous=MANUAL)
    step(autonomy, 20.0, autonomous=AUTO)

    assert step(autonomy, 30.0, autonomous=MANUAL)


def test_who_was_not_seen_leaving_it_has_left_it_all_the_same(autonomy):
    assert not step(autonomy, 10.0, autonomous=None)
    assert step(autonomy, 90.0, autonomous=MANUAL)


def test_an_emergency_stop_and_what_follows_from_it_are_one_intervention(autonomy):
    assert step(autonomy, 10.0, autonomous=AUTO, stopped=True)
    assert not step(autonomy, 11.0, autonomous=MANUAL, stopped=True)
    assert not step(autonomy, 30.0, autonomous=MANUAL)
    assert not step(autonomy, 40.0, autonomous=AUTO)
    assert step(autonomy, 50.0, autonomous=AUTO, stopped=True)
    assert not step(autonomy, 55.0, autonomous=AUTO)
    assert step(autonomy, 60.0, autonomous=AUTO, stopped=True)
    assert autonomy.interventions == 3


def test_a_stop_of_a_robot_that_is_driven_by_hand_is_none():
    assert not step(Autonomy(), 10.0, autonomous=MANUAL, stopped=True)


def test_a_restart_of_the_exporter_counts_nothing_twice(autonomy):
    step(autonomy, 10.0, autonomous=AUTO, stopped=True)
    adapter = TypeAdapter(AutonomyLearned)
    later = Autonomy()
    later.restore(adapter.validate_json(adapter.dump_json(autonomy.learned(Instant(12.0, 0.0)))))

    assert not step(later, 2.0, autonomous=AUTO, stopped=True)
    assert not step(later, 5.0, autonomous=MANUAL, stopped=True)
    assert (later.interventions, later.read(9.0)) == (1, 15.0)
