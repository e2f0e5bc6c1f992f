"""A car with eight lidars, as one was recorded: the two at the front go blind at once."""

from ros_diagnostics_exporter.model import Status
from support.configs import load_text
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
        super().__init__(fleet=load_text(tmp_path, FLEET))
        self.levels = dict.fromkeys((*LIDARS, "Steering"), OK)

    def drive(self, seconds: float, **levels: int) -> list[str]:
        """Publish these levels, by the end of a lidar's name, from now on; what began and ended."""
        for end, level in levels.items():
            (name,) = (each for each in self.levels if each.endswith(end))
            self.levels[name] = level
        messages = {OK: "", ERROR: "blocked 100 %", STALE: ""}
        statuses = (Status(level, name, messages[level]) for name, level in self.levels.items())
        seen = len(self.events)
        self.raw_every(0.5, self.now.mono + seconds, *tuple(statuses))
        return [
            f"{each.kind.removeprefix('fault_')} {each.severity} {each.state} {each.check}".rstrip()
            for each in self.events[seen:]
            if each.kind in ("fault_began", "fault_ended")
        ]


def test_two_lidars_that_go_blind_are_one_notification(tmp_path):
    car = Car(tmp_path)
    assert car.drive(40) + car.drive(0.5, front_upper=ERROR) == []
    assert car.drive(60, front_lower=ERROR) == ["began critical lost front view"]
    (fault,) = car.state.faults()
    assert fault.evidence == (
        "lidar front_upper CRITICAL: blocked 100 %;\nlidar front_lower CRITICAL: blocked 100 %"
    )
    assert fault.capabilities == "has lost autonomous driving, still has view around"

    rows, again = car.fault_rows(), Car(tmp_path)
    again.levels = car.levels
    again.restore_faults(rows)
    assert again.drive(120) == []
    assert sorted(again.drive(60, front_upper=OK)) == [
        "began warning no_reserve front view",
        "ended critical lost front view",
    ]
    assert again.drive(600, front_lower=OK) == ["ended warning no_reserve front view"]
