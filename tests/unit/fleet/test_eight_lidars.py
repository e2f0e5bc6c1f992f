"""A car with eight lidars, as one was recorded: the two at the front go blind at once."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.model import Status
from support.state_driver import ERROR, OK, STALE, StateDriver

PLACES = ("front", "left", "rear", "right")
LIDARS = tuple(f"blockage: lidar {place}_{side}" for place in PLACES for side in ("upper", "lower"))
UPPER, LOWER = LIDARS[:2]
FLEET = """
fleet: cars
profiles:
  default:
    stale_after: 5s
    capabilities:
      front view: {any: [front_upper, front_lower]}
      view around: {at_least: {k: 5, of: lidar}}
      autonomous driving: [{capability: front view}, {capability: view around}, Steering]
robots: [{name: r, topic: /r/diagnostics, source: raw}]
"""


class Car(StateDriver):
    """Publishes all lidars twice a second."""

    def __init__(self, tmp_path):
        (tmp_path / "fleet.yml").write_text(FLEET)
        super().__init__(fleet=load(tmp_path / "fleet.yml"))
        self.levels = dict.fromkeys((*LIDARS, "Steering"), OK)

    def drive(self, seconds: float, **levels: int) -> Car:
        """Publish these levels, by the end of a lidar's name, from now on."""
        for end, level in levels.items():
            (name,) = (each for each in self.levels if each.endswith(end))
            self.levels[name] = level
        messages = {OK: "", ERROR: "blocked 100 %", STALE: ""}
        statuses = (Status(level, name, messages[level]) for name, level in self.levels.items())
        self.raw_every(0.5, self.now.mono + seconds, *tuple(statuses))
        return self

    @property
    def changes(self) -> list[str]:
        """The faults that began and ended."""
        return [
            f"{each.kind.removeprefix('fault_')} {each.severity} {each.state} "
            f"{each.check or each.component}".rstrip()
            for each in self.events
            if each.kind in ("fault_began", "fault_ended")
        ]


@pytest.fixture
def car(tmp_path):
    return Car(tmp_path).drive(40)


def test_two_lidars_that_go_blind_are_one_notification(car):
    car.drive(0.5, front_upper=ERROR).drive(60, front_lower=ERROR)
    assert car.changes == ["began critical lost front view"]
    (fault,) = car.state.faults()
    assert fault.evidence == (
        "blockage: lidar front_upper CRITICAL: blocked 100 %;\n"
        "blockage: lidar front_lower CRITICAL: blocked 100 %"
    )
    assert fault.work == "has lost front view and autonomous driving, still has view around"

    car.drive(60, front_upper=OK)
    assert car.changes[1:] == [
        "began warning no_reserve front view",
        "ended critical lost front view",
    ] or car.changes[1:] == [
        "ended critical lost front view",
        "began warning no_reserve front view",
    ]

    car.drive(600, front_lower=OK)
    assert car.changes[3:] == ["ended warning no_reserve front view"]


def test_one_that_flickers_in_the_meantime_changes_nothing(car):
    car.drive(60, front_upper=ERROR)
    for _ in range(3):
        car.drive(3, front_lower=ERROR).drive(20, front_lower=OK)
    assert car.changes == ["began warning no_reserve front view"]


def test_those_at_the_sides_are_only_missed_with_the_third(car):
    car.drive(60, left_upper=ERROR, right_upper=ERROR)
    assert sorted(car.changes) == [
        "began critical critical blockage: lidar left_upper",
        "began critical critical blockage: lidar right_upper",
    ]
    car.drive(60, rear_upper=ERROR)
    assert car.changes[2:] == ["began warning no_reserve view around"]
    car.drive(60, rear_lower=ERROR)
    assert car.changes[3:] == ["began critical lost view around"]


def test_silence_and_a_restart_neither_end_nor_repeat_it(car, tmp_path):
    car.drive(60, front_upper=ERROR, front_lower=ERROR)
    car.at(car.now.mono + 30)
    assert car.changes == ["began critical lost front view", "began critical silent"]
    rows = car.fault_rows()
    again = Car(tmp_path)
    again.levels = car.levels
    again.restore_faults(rows)
    again.drive(120)
    assert again.changes == ["ended critical silent"]
    again.drive(30, front_upper=OK, front_lower=OK)
    assert again.changes[1:] == ["ended critical lost front view"]
