"""A fleet whose robot and component have names that break links and queries unless encoded."""

from pathlib import Path

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from support.served_fleet import ServedFleet
from support.state_driver import ERROR, tree

ROBOT = "cart #1 & 50 %+"
COMPONENT = "A & B #2: 'left' + 50 % (x/y)"
KEY = "Rate (1/s) & #"
FLEET = f"""
fleet: odd
faults: {{restart_grace: 1s}}
profiles:
  default: {{stale_after: 1h, confirm_after: 1s}}
robots:
  - {{name: "{ROBOT}", namespace: /odd}}
"""
TOPIC = "/odd/diagnostics_agg"


class OddFleet:
    """Its component fails as long as `broken` is set."""

    def __init__(self, folder: Path) -> None:
        path = folder / "odd.yml"
        path.write_text(FLEET)
        self.broken = True
        self.served = ServedFleet(load(path), self._send)

    def _send(self, state: FleetState, now: Instant) -> None:
        level, message = (ERROR, 'It\'s "odd" <b>') if self.broken else (0, "OK")
        status = Status(level, COMPONENT, message, "id", ((KEY, "7"),))
        state.update_graph(0, {TOPIC: Endpoint(1)}, now)
        state.receive(Topic(0, TOPIC), Array(now.wall, tree(Odd=(status,)), 300), now)
