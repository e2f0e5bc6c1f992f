"""Two nodes of one robot that publish one status name, and what holds of them whatever happens.

They report on a change or repeat it, with hardware_ids or without; they are started again, their
robot falls silent, the exporter is started again or reloads, and the graph shows all of it late.
What each said last is noted here.
"""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from random import Random

from ros_diagnostics_exporter.config.fleet import ComponentRule
from ros_diagnostics_exporter.faults.model import Row
from ros_diagnostics_exporter.model import Instant, Status
from ros_diagnostics_exporter.regex import Pattern
from support.state_driver import ERROR, OK, WALL, WARN, StateDriver

NAME = "rosserial"
LATEST = 30.0  # seconds within which it is known what counts: the graph is looked at every ten
MOTOR = Status(OK, "Motor")


@dataclass
class Node:
    """A node, how often it was started, and what it said since."""

    name: str
    starts: int = 0
    level: int | None = None

    @property
    def publisher(self) -> str:
        """Its name in the middleware."""
        return f"{self.name} {self.starts}"


@dataclass
class Twins:
    """A robot with two of them."""

    driver: StateDriver
    repeats: bool
    has_ids: bool  # they have hardware_ids
    nodes: tuple[Node, Node] = field(default_factory=lambda: (Node("left"), Node("right")))
    ended: int = 0  # events that were checked
    # hardware_ids of components by label: one whose fault is over may have another label now
    ids: dict[str, str] = field(default_factory=dict)

    def say(self, node: Node, level: int) -> None:
        """A node says something, after what was due before it."""
        self.driver.at(self.driver.now.mono)
        self.check()
        node.level = level
        hardware_id = node.name if self.has_ids else ""
        status = Status(level, NAME, str(level), hardware_id)
        self.driver.raw(status, publisher=node.publisher)
        self.check()

    def go(self, seconds: int) -> None:
        """The robot is received for some seconds."""
        for _ in range(seconds):
            self.driver.raw(MOTOR, publisher="motor")
            for node in self.nodes if self.repeats else ():
                if node.level is not None:
                    self.say(node, node.level)
            self.driver.at(self.driver.now.mono + 1)
            if self.driver.now.mono % 10 == 0:
                self.driver.graph("motor", *(each.publisher for each in self.nodes))
            self.check()

    def start_again(self, node: Node, level: int | None) -> None:
        """A node is started again, and says what it is like or nothing."""
        node.starts, node.level = node.starts + 1, None
        if level is not None:
            self.say(node, level)

    def fall_silent(self, seconds: int) -> None:
        """Nothing is received for some seconds."""
        self.driver.at(self.driver.now.mono + seconds)
        self.check()

    def restart(self) -> None:
        """The exporter is started again, with what it has written."""
        before, again = self.driver, StateDriver(fleet=self.driver.state.fleet)
        again.now = Instant(before.now.mono, WALL + before.now.mono)
        again.state.restore({"r": before.robot.persist(before.now)}, again.now)
        rows = json.loads(json.dumps(before.fault_rows()))
        again.restore_faults([Row(kind, tuple(key), fields) for kind, key, fields in rows])
        self.driver, self.ended = again, 0

    def of(self, component: str) -> list[Node]:
        """The nodes that publish a component: once they are told apart, one."""
        hardware_id = self.ids.get(component, "")
        return [each for each in self.nodes if hardware_id in ("", each.name)]

    def reload(self, confirm_after: float) -> None:
        """Another fleet.yml."""
        (robot,) = self.driver.state.fleet.robots
        profile = replace(robot.profile, confirm_after=confirm_after, boot_grace=2 * confirm_after)
        fleet = replace(self.driver.state.fleet, robots=(replace(robot, profile=profile),))
        self.driver.state.configure(fleet, self.driver.now)

    def check(self) -> None:
        """Nothing recovers that a node said last is ERROR."""
        events = self.driver.events
        now = {each.label: each.identity[2] for each in self.driver.robot.components}
        self.ids = {**self.ids, **now}
        for each in events[self.ended :]:
            if each.reason == "recovered" and each.component and each.state == "critical":
                said = {node.name: node.level for node in self.of(each.component)}
                assert ERROR not in said.values(), (self.driver.now.mono, each.component, said)
        self.ended = len(events)

    def check_end(self) -> None:
        """What is ERROR is a fault in time, and what nobody says any more is none."""
        self.go(int(LATEST))
        self.go(15)
        self.go(90)  # what is repeated, and was said once, counts for so long
        found = {each[1] for each in self.driver.fault_names() if each[-1].startswith(NAME)}
        if "flapping" in found:
            return  # which says more
        is_error = any(node.level == ERROR for node in self.nodes)
        is_known = is_error or all(node.level is not None for node in self.nodes)
        assert not is_known or ("critical" in found) is is_error, found


def play(seed: int) -> None:
    """Play up to 15 steps, the same for the same seed.

    Raises:
        AssertionError: something does not hold.
    """
    random = Random(seed)
    repeats = random.random() < 0.5
    rule = ComponentRule(Pattern(NAME), reports="always" if repeats else "on_change")
    twins = Twins(StateDriver(components=(rule,)), repeats, random.random() < 0.5)
    twins.driver.graph("motor", *(each.publisher for each in twins.nodes))
    for node in twins.nodes:
        twins.say(node, OK)
    twins.go(30)
    for _ in range(random.randrange(2, 15)):
        node, level = random.choice(twins.nodes), random.choice((OK, OK, WARN, ERROR, ERROR))
        what = random.choice(("say", "say", "say", "start_again", "silence", "restart", "reload"))
        if what == "restart":
            twins.restart()
        elif what == "reload":
            twins.reload(random.choice((5.0, 10.0)))
        elif what == "silence":
            twins.fall_silent(random.choice((5, 15, 100)))
        elif what == "start_again":
            twins.start_again(node, random.choice((None, level)))
        else:
            twins.say(node, level)
        twins.go(random.choice((0, 1, 12, 40)))
    twins.check_end()
