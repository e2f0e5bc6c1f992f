"""What a robot sends for its goals: bytes of a real action server on a cable of its own.

The kernel counts them, with all headers, in times of the same length: no goal runs, or one goal
after the other. It needs root and `ip`.
"""

from __future__ import annotations

import argparse
import threading
from statistics import median
from typing import Any

from experiments.robot import Cable, cable
from experiments.site import started
from support.action_robot import ActionRobot
from testbed import http
from testbed.polling import until
from testbed.site import Site

ACTION, GOALS, PERIOD = "go", 10, 30.0  # seconds
TIMES = 5  # of each; discovery comes in some, so medians are compared
FLEET = """
fleet: bench
robots: [{{name: r, namespace: /r, domain_id: {domain}}}]
profiles: {{default: {{actions: [{{match: go, aborted: {{critical: 1}}}}]}}}}
"""
START = 120.0


class Wire:
    """A robot with an action server, and the cable to the exporter that counts its goals."""

    def __init__(self, site: Site, link: Cable, robot: ActionRobot) -> None:
        self._site, self._link, self._robot = site, link, robot
        self._pause = threading.Event()

    def action(self) -> dict[str, Any]:
        """What the exporter has of the action; empty before it was found."""
        found = http.get_json(self._site.addresses.exporter, "/api/v1/missions?robot=r")["robots"]
        return found[0]["actions"][0] if found else {}

    def sent(self, goals: int) -> tuple[int, int]:
        """The bytes that the robot sends and receives in a period with so many goals."""
        before = self._link.counters()
        for _ in range(goals):
            self._robot.tell("begin", ACTION)
            self._pause.wait(PERIOD / goals / 2)
            self._robot.tell("succeed", ACTION)
            self._pause.wait(PERIOD / goals / 2)
        if not goals:
            self._pause.wait(PERIOD)
        after = self._link.counters()
        return after[0] - before[0], after[1] - before[1]


def of_a_goal() -> tuple[float, float]:
    """Bytes that a robot sends and receives for one goal, beside those without."""
    with started() as site, cable() as link:
        site.start_exporter(site.write("fleet.yml", FLEET.format(domain=site.domain_id)))
        inside = ("ip", "netns", "exec", link.namespace)
        environment = site.environment()
        with ActionRobot("/r", ACTION, environment=environment, before=inside) as robot:
            site.wait_until_ready()
            wire = Wire(site, link, robot)
            until(lambda: wire.action().get("reached"), "the action is found", START)
            # What has ended in the first list of an action does not count, so a goal has to run.
            robot.tell("begin", ACTION)
            until(lambda: wire.action()["running"] == 1, "a goal is seen", START)
            robot.tell("succeed", ACTION)
            until(lambda: wire.action()["results"]["succeeded"] == 1, "its end is seen", START)
            pairs = [(wire.sent(0), wire.sent(GOALS)) for _ in range(TIMES)]
            all_seen = 1 + TIMES * GOALS
            until(lambda: wire.action()["results"]["succeeded"] == all_seen, "all", START)
    sent, received = (
        (median(busy[way] for _calm, busy in pairs) - median(calm[way] for calm, _busy in pairs))
        / GOALS
        for way in (0, 1)
    )
    return sent, received


def main() -> None:
    """Print them."""
    argparse.ArgumentParser("./run bench goal_bytes", description=__doc__).parse_args()
    sent, received = of_a_goal()
    print(f"a robot sends {sent:.0f} bytes for a goal, and receives {received:.0f}")


if __name__ == "__main__":
    main()
