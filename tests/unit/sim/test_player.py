"""A fleet in real time."""

import re
import threading
from pathlib import Path

import pytest

from support.simulated_fleet import fleet_of, level_of, of
from testbed.polling import until
from virtual_robots.model import ERROR
from virtual_robots.simulation.components import UnknownFaultError
from virtual_robots.simulation.outputs import Output, Topic
from virtual_robots.simulation.player import Player


def test_all_that_is_due_is_taken_and_the_end_is_kept() -> None:
    taken: list[Output] = []
    player = Player(fleet_of(), lambda output, _: taken.append(output), pytest.fail)
    player.play(threading.Event(), until=1.5)
    expected = list(fleet_of().advance(1.5))
    assert taken == expected


def test_an_order_becomes_a_fault() -> None:
    fleet = fleet_of()
    player = Player(fleet, lambda *_: None, pytest.fail)
    player.inject("robot_1.Motor 2", "error: Over temperature: 95")
    last = of(fleet.advance(4.0), Topic.RAW)[-1]
    assert level_of(last, "Motor 2") == ERROR
    assert last.statuses[1].message == "Over temperature: 95"
    player.inject("robot_1.Motor 2", "ok")
    assert level_of(of(fleet.advance(6.0), Topic.RAW)[-1], "Motor 2") == 0
    with pytest.raises(UnknownFaultError):
        player.inject("robot_1.Motor 2", "explode")


def test_an_order_for_a_whole_robot_happens_to_it() -> None:
    fleet = fleet_of()
    player = Player(fleet, lambda *_: None, pytest.fail)
    player.inject("robot_1", "clock_jump: -30")
    last = of(fleet.advance(4.0), Topic.RAW)[-1]
    assert last.stamp == pytest.approx(last.at - 30)
    player.inject("robot_1", "hang")
    assert list(fleet.advance(8.0)) == []
    player.inject("robot_1", "resume")
    assert of(fleet.advance(12.0), Topic.RAW)


@pytest.mark.parametrize(
    ("order", "reason"),
    [
        ("dance", "'dance' cannot happen to a whole robot, only join, leave"),
        ("hang: long", "hang: 'long' is no number"),
        ("flood: 0", "flood: 0 must be between 0.001 and 10000"),
        ("hang: nan", "hang: nan must be between"),
    ],
)
def test_an_unknown_event_is_rejected_with_the_known_ones(order: str, reason: str) -> None:
    player = Player(fleet_of(), lambda *_: None, pytest.fail)
    with pytest.raises(ValueError, match=re.escape(reason)):
        player.inject("robot_1", order)


def test_robots_that_all_stand_still_are_waited_for() -> None:
    """Nothing is due any more, ever, unless somebody orders it."""
    fleet = fleet_of()
    stop = threading.Event()
    player = Player(fleet, lambda *_: None, pytest.fail)
    player.inject("robot_1", "hang")
    played = threading.Thread(target=player.play, args=(stop,))
    played.start()
    until(lambda: fleet.next_at() == float("inf"), "the end of all that was due")
    until(lambda: fleet.now > 2.0, "the fleet's time to advance")
    stop.set()
    played.join(timeout=10)
    assert not played.is_alive()


def test_a_fleet_that_cannot_keep_up_says_so_once() -> None:
    """Taking a message here is so slow that the next one is late."""
    warnings: list[str] = []
    busy = threading.Event()
    player = Player(fleet_of(), lambda *_: busy.wait(0.6), warnings.append)
    player.play(threading.Event(), until=4.0)
    assert len(warnings) == 1
    assert "s late: too many for this machine now" in warnings[0]


def test_settings_that_an_editor_is_replacing_are_waited_for(tmp_path: Path) -> None:
    settings = tmp_path / "robot.yaml"
    settings.write_text("number_of_motors: 5\n")
    fleet = fleet_of(settings=settings)
    player = Player(fleet, lambda *_: None, pytest.fail)
    settings.write_text("")
    player.play(threading.Event(), until=1.5)
    parts = fleet.robot("robot_1").driver.parts
    assert sum(each.name.startswith("Motor") for each in parts) == 5
