"""One robot with action servers in a state whose time the test sets."""

from __future__ import annotations

from pathlib import Path

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.decode.goals import EXECUTING, Goal
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from support.configs import load_text
from support.goal_lists import encode_goals
from support.state_driver import LASER, OK, SETTLED, StateDriver

DOCK, GOTO, SPIN = "dock_robot", "navigate_to_pose", "spin"
FLEET = """
fleet: f
robots: [{name: r, namespace: /r, source: raw}]
profiles:
  default:
    actions:
      - {match: navigate_to_pose, aborted: {warning: 2, critical: 4, within: 10m}, longer_than: 15m}
      - {match: dock_robot, aborted: {critical: 1}}
      - {match: "spin|backup|wait", ignore_result: true, started: {warning: 3, within: 10m}}
"""


def topic(action: str) -> str:
    return f"/r/{action}{STATUS}"


class Mission:
    """One robot whose drivers report, and the goals of whose actions are seen."""

    def __init__(self, fleet: Fleet, driver: StateDriver | None = None) -> None:
        self.driver = driver or StateDriver(fleet=fleet)
        self.types = {topic(each): [GOALS_TYPE] for each in (DOCK, GOTO, SPIN, "follow_path")}
        self.goals: dict[str, list[Goal]] = {}
        self.number = 0
        self.stand(int(SETTLED))
        for each in (DOCK, GOTO, SPIN, "follow_path"):
            self.send(each)

    @classmethod
    def of(cls, folder: Path, text: str) -> Mission:
        """The robot of a fleet.yml with this text."""
        return cls(load_text(folder, text))

    def look(self) -> set[str]:
        """One look at the graph; the topics that are subscribed."""
        state, now = self.driver.state, self.driver.now
        state.update_nodes(0, [("bt_navigator", "/r")], now)
        return set(state.watched_topics(0, self.types, now))

    def stand(self, seconds: int) -> Mission:
        for _ in range(seconds):
            self.look()
            self.driver.stand(1, LASER)
        return self

    def send(self, action: str) -> Mission:
        state, now = self.driver.state, self.driver.now
        state.receive_goals(0, topic(action), encode_goals(self.goals.get(action, ())), now)
        return self

    def begin(self, action: str) -> Mission:
        self.number += 1
        key = self.number.to_bytes(16, "big")
        self.goals[action] = [Goal(key, float(self.number), EXECUTING)]
        return self.send(action)

    def end(self, action: str, status: int) -> Mission:
        self.goals[action] = [each._replace(status=status) for each in self.goals[action]]
        return self.send(action)

    def run(self, action: str, status: int, times: int = 1) -> Mission:
        for _ in range(times):
            self.begin(action).stand(5).end(action, status)
        return self

    def level(self, action: str) -> int:
        return self.driver.level(action)

    def message(self, action: str) -> str:
        return self.driver.component(action).message

    @property
    def faults(self) -> set[str]:
        return {each.identity.component for each in self.driver.state.faults()}


MODES = """
    modes: {component: Mode, key: mode, autonomous: [auto, mission],
            interventions: {component: E-stop, key: pressed, equals: true}}
"""


def drive(mission: Mission, mode: str, pressed: str = "false", seconds: int = 5) -> None:
    components = (
        Status(OK, "Mode", "", "", (("mode", mode),)),
        Status(OK, "E-stop", "", "", (("pressed", pressed),)),
    )
    mission.driver.stand(seconds, LASER, *components)
