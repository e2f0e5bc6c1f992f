"""Values that fall towards their critical low threshold."""

from collections import deque

import pytest

from ros_diagnostics_exporter.config.fleet import Falling, FaultSettings, Threshold
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    ComponentSettings,
    Reason,
    ValueReport,
    Verdict,
)
from ros_diagnostics_exporter.faults.trends import forecast
from support.fault_histories import (
    BATTERY,
    OK,
    STALE,
    Event,
    Player,
    back,
    forget,
    level,
    moved,
    player,
    silent,
    texts,
    value,
)

FALLING = "value/falling r1 battery charge low"
EMPTY = BATTERY[1:]  # 10 %
MINUTE = 60.0


def battery(settings: FaultSettings | None = None) -> Player:
    return player(["r1"], settings or FaultSettings())


def follow(known: Player, numbers, first: float = 0, thresholds=EMPTY) -> list[str]:
    """A number each minute, from this minute on; what changed, after its minute."""
    found = []
    for minute, number in enumerate(numbers, int(first)):
        changes = known.go(minute * MINUTE, value(number, thresholds))
        found += [f"{minute} {each}" for each in texts(changes)]
    return found


def reported(report: ValueReport) -> Event:
    name = ComponentName("", "battery")
    return lambda faults, now: faults.values_changed(
        "r1", name, ComponentSettings(10.0), [report], now
    )


def drain(start: float, minutes: int, each: float = 1.0):
    return [start - each * minute for minute in range(minutes)]


def test_a_value_begins_to_fall_once_it_will_be_too_low_within_half_an_hour():
    # 10 % are 50 minutes from 60 %; two more minutes confirm it.
    assert follow(battery(), drain(60, 26)) == [f"24 began {FALLING}"]
    assert follow(battery(), drain(99, 120, 0.1)) == []


def test_nothing_is_known_before_a_quarter_of_an_hour():
    assert follow(battery(), drain(30, 20)) == [f"18 began {FALLING}"]


def test_it_goes_on_while_the_value_is_too_low():
    known = battery()
    found = follow(known, drain(60, 70, 1.0))
    assert found == [f"24 began {FALLING}", "52 began value/critical r1 battery charge low"]
    assert follow(known, [5.0] * 30, 70) == []
    later = [each[3:] for each in follow(known, [80.0] * 30, 100)]
    assert [each.lstrip() for each in later] == [
        "recovered value/critical r1 battery charge low",
        f"recovered {FALLING}",
    ]


def test_a_value_that_is_in_warning_already_does_not_fall_as_well():
    known = battery()
    follow(known, [19.0, 19.0], thresholds=BATTERY)
    assert follow(known, drain(18, 25, 0.25), 2, thresholds=BATTERY) == []
    [_, falling] = known.faults.problems(known.at(27 * MINUTE))
    assert falling.suppressed is Reason.FAULT


@pytest.mark.parametrize(
    "threshold", [Threshold("low", "warning", 10.0), Threshold("high", "critical", 10.0)]
)
def test_only_a_critical_low_threshold_counts(threshold):
    numbers = drain(60, 30) if threshold.bound == "low" else [-each for each in drain(60, 30)]
    assert follow(battery(), numbers, thresholds=(threshold,)) == []


def test_the_threshold_that_counts_may_be_any_of_several():
    thresholds = (Threshold("high", "critical", 95.0), *EMPTY)
    assert follow(battery(), drain(60, 26), thresholds=thresholds) == [f"24 began {FALLING}"]


def test_a_value_that_does_not_count_now_does_not_fall():
    known = battery()
    for minute, number in enumerate(drain(60, 40)):
        report = ValueReport("charge", number, EMPTY, most=Verdict.NO_DATA)
        known.go(minute * MINUTE, reported(report))
    assert list(known.faults.faults()) == []


def test_silence_and_stale_are_no_end_and_no_samples():
    known = battery()
    follow(known, drain(60, 26))
    changes = known.go(26 * MINUTE, silent())
    changes += known.go(60 * MINUTE, back("r1", level("battery", OK), value(35.0, EMPTY)))
    changes += known.go(65 * MINUTE, level("battery", STALE), value(None, EMPTY))
    changes += known.go(90 * MINUTE, level("battery", OK), value(35.0, EMPTY))
    changes += known.go(104 * MINUTE)
    assert f"recovered {FALLING}" not in texts(changes)
    assert texts(known.go(106 * MINUTE)) == [f"recovered {FALLING}"]


def test_a_restart_is_no_end():
    known = battery()
    follow(known, drain(60, 26))
    known.reborn(26 * MINUTE)
    assert follow(known, [34.0] * 14, 27) == []
    assert texts(known.go(50 * MINUTE)) == [f"recovered {FALLING}"]


def test_a_threshold_that_is_taken_out_of_the_config_ends_it():
    known = battery()
    follow(known, drain(60, 26))
    assert texts(known.go(26 * MINUTE, value(34.0, BATTERY[:1]))) == [f"removed {FALLING}"]
    assert texts(known.go(80 * MINUTE)) == []


@pytest.mark.parametrize(
    ("start", "event"), [(45, forget("r1", "battery")), (60, moved("battery", "", "other"))]
)
def test_a_component_that_is_gone_does_not_fall(start, event):
    known = battery()
    follow(known, drain(start, 16))
    assert known.go(16 * MINUTE, event) == []
    assert known.go(100 * MINUTE) == []
    assert list(known.faults.problems(known.at(100 * MINUTE))) == []


def test_the_times_are_those_of_the_config():
    settings = FaultSettings(falling=Falling(over=300.0, ahead=600.0))
    assert follow(battery(settings), drain(60, 45)) == [f"42 began {FALLING}"]


def test_the_forecast_is_that_of_the_line_through_the_samples():
    assert forecast(deque([4.0, 3.0, 2.0, 1.0]), 5) == pytest.approx(-4.0)
    # As predict_linear() has it: slope 0.9, 3.6 at the last.
    assert forecast(deque([1.0, 2.0, 2.0, 4.0]), 0) == pytest.approx(3.6)


@pytest.mark.parametrize("others", [(10,), (3, 12), range(18)])
def test_what_is_no_number_erases_nothing(others):
    """As long as more than half of the samples are: nine of 16 after minute 27."""
    numbers = drain(60.5, 40)
    for minute in others:
        numbers[minute] = float("nan")
    begun = 29 if len(others) == 18 else 24
    assert follow(battery(), numbers)[:1] == [f"{begun} began {FALLING}"]


def test_what_falls_and_then_is_no_number_goes_on():
    known = battery()
    assert follow(known, drain(60, 30)) == [f"24 began {FALLING}"]
    assert follow(known, [float("nan")] * 60, 30) == []
    assert follow(known, [90.0] * 30, 90) == [f"99 recovered {FALLING}"]


def test_another_time_over_which_it_falls_begins_anew():
    known = battery()
    assert follow(known, drain(99, 20, 0.1)) == []  # in half an hour at 94 %

    def configure(faults, now):
        return faults.configure(FaultSettings(falling=Falling(over=60.0, ahead=36_000.0)), now)

    known.go(20 * MINUTE, configure)
    assert follow(known, [97.0] * 20, 20) == []
