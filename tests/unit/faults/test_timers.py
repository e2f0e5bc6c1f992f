"""Timers: one for each key, in a bounded heap."""

from ros_diagnostics_exporter.loops import Timers


def test_a_timer_may_be_set_back_to_an_earlier_time_and_forth():
    timers: Timers[str] = Timers()
    for due in (5.0, 3.0, 5.0):
        timers.set("a", due)

    assert timers.next == 5.0
    assert timers.pop() == ["a"]
    assert len(timers) == 0


def test_the_heap_stays_as_small_as_what_is_live():
    timers: Timers[int] = Timers()
    for turn in range(10_000):
        timers.set(turn % 10, float(turn))
        assert timers.entries <= 2 * 10 + 64
    for key in range(10):
        timers.clear(key)

    assert timers.entries <= 64


def test_a_timer_at_the_latest_only_moves_forward():
    timers = Timers()
    for due in (5.0, 3.0, 4.0):
        timers.set_at_latest("a", due)
    timers.set_at_latest("b", float("inf"))
    assert (timers.next, len(timers)) == (3.0, 1)
