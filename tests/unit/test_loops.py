"""The one kind of thread: what fails or hangs is counted, and ends nothing."""

import threading
from collections.abc import Iterator

import pytest

from ros_diagnostics_exporter import loops
from ros_diagnostics_exporter.loops import Clocks, Loop
from testbed.polling import until


class Work:
    """Counts its turns; fails while ``fails``, hangs while ``goes_on`` is not set."""

    def __init__(self) -> None:
        self.turns = 0
        self.ends = 0
        self.fails = False
        self.goes_on = threading.Event()
        self.goes_on.set()

    def turn(self) -> None:
        self.turns += 1
        assert self.goes_on.wait(30)
        if self.fails:
            raise ZeroDivisionError

    def end(self) -> None:
        self.ends += 1


@pytest.fixture
def work() -> Iterator[Work]:
    made = Work()
    yield made
    made.goes_on.set()


@pytest.fixture
def loop(work) -> Iterator[Loop]:
    made = Loop("tick", 0.001, work.turn, end=work.end)
    made.start()
    yield made
    work.goes_on.set()
    assert made.stop(30)


def test_an_exception_is_counted_and_logged_once_and_the_loop_goes_on(work, loop, caplog):
    work.fails = True
    until(lambda: loop.errors > 3, "turns fail")
    at = loop.last_turn
    work.fails = False
    until(lambda: loop.last_turn > at, "a turn succeeds")

    assert loop.alive
    assert caplog.text.count("loop tick: a turn failed") == 1
    assert "ZeroDivisionError" in caplog.text


def test_a_loop_that_fails_has_no_last_turn(work, caplog):
    work.fails = True
    failing = Loop("tick", 0.001, work.turn)
    failing.start()
    until(lambda: failing.errors > 3, "turns fail")
    assert failing.last_turn == 0
    assert failing.stop(30)


def test_errors_are_logged_again_later(work, loop, caplog, monkeypatch):
    monkeypatch.setattr(loops, "LOG_INTERVAL", 0.0)
    work.fails = True
    until(lambda: caplog.text.count("loop tick: a turn failed") > 2, "it is logged again")


def test_a_turn_that_hangs_is_known_and_does_not_hold_up_who_stops_it(work, loop):
    work.goes_on.clear()
    until(lambda: loop.hangs(0.01), "it hangs")
    assert not loop.hangs(1_000)
    assert not loop.stop(0)

    work.goes_on.set()
    assert loop.stop(30)
    assert not loop.hangs(0)
    assert work.ends == 1


def test_a_loop_that_waits_does_not_hang_and_can_be_woken(work):
    seldom = Loop("seldom", 3_600, work.turn)
    seldom.start()
    until(lambda: work.turns == 1 and not seldom.hangs(0), "the first turn has ended")
    seldom.wake()
    until(lambda: work.turns == 2, "the second turn, at once")
    assert seldom.stop(30)
    assert work.turns == 2


def test_one_that_was_not_started_stops(work):
    assert Loop("never", 1, work.turn).stop(0)
    assert work.turns == 0


def test_the_time_in_which_the_process_stood_still_does_not_count(caplog):
    readings = iter([0.0, 0.0, 0.25, 25.25, 25.5, 100.0, 101.0, 200.0, 300.0])
    clocks = Clocks(lambda: next(readings))
    clocks.keep_watch()
    assert clocks.read().mono == 0.25
    assert clocks.read().mono == 2.25  # 25 s later
    assert clocks.read().mono == 2.5
    assert "this process stood still for 25.0 s" in caplog.text
    assert clocks.read().mono == 4.5
    clocks.end_watch()
    assert [clocks.read().mono for _ in range(3)] == [5.5, 104.5, 204.5]  # nobody reads it often
