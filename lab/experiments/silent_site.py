"""The half of `experiments.silent` that runs on the host `office`: servers, robots, what is done.

The robots' processes are started on the host `robot`, from here. Writes what was found as JSON.
"""

from __future__ import annotations

import json
import os
import re
import signal
import sys
import time
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

from testbed import configuration, domains, http, programs, servers
from testbed.mail import Inbox, MailServer
from testbed.polling import until
from testbed.ports import free_port
from testbed.processes import Process

FLEET = "silent"
RENAMED = "imu_v"  # never expected: else it would be gone when the node has its name again
HANGS = "hung"  # the robot whose only node hangs, and goes on to publish other diagnostics
LEARN = 10.0  # seconds in place of a day
STALE = 20.0  # seconds without a message, on a machine that is busy
CONFIRM = 10.0  # as by default
ALONE = 45.0  # seconds in which all topics were read twice, so that they are learned
SEEN = 150.0  # seconds in which a fault begins: a lease of 20 s, rounds of 20 s, a busy machine
SETTLE = 20.0  # seconds in which what is wrong would follow
NOTIFIED = 120.0  # seconds in which its mail comes


class Injection(NamedTuple):
    """What is done to one robot, which has its name: the node, and the component that is to fail.

    ``component`` is "" where nothing is to be a fault.
    """

    robot: str
    what: str
    node: str
    component: str
    inject: Callable[[Robot], object]
    mend: Callable[[Robot], object]


class Robot:
    """The process of a robot's node that something is done to."""

    def __init__(self, site: Site, each: Injection) -> None:
        self._site, self._name = site, each.node
        self._robot = each.robot
        self._options = [each.component] if each.robot == HANGS else []
        self.process = self.twin = self.start()

    def start(self, name: str = "", *options: str) -> Process:
        """Start a node, by default as it is well."""
        return self._site.start_robot(self._arguments(name, options))

    def _arguments(self, name: str, options: Sequence[str]) -> list[str]:
        return ["node", self._robot, name or self._name, *options, *self._options]

    def again(self) -> None:
        """Have the node again as it is well."""
        self.process.kill()
        self.process = self.start()

    def double(self) -> None:
        """Start it a second time."""
        self.twin = self.start()

    def replace(self, name: str = "", *options: str) -> None:
        """End it, and start it in another way at once."""
        new = self._site.prepare_robot(self._arguments(name, options))
        self.process.stop()
        new.signal(signal.SIGUSR2)
        new.wait_for_output("ready", 120)
        self.process = new

    def signal(self, number: signal.Signals) -> None:
        """Send its process a signal."""
        self.process.signal(number)


INJECTIONS = (
    Injection(
        "killed",
        "its process is killed (SIGKILL)",
        "lidar",
        "node lidar",
        lambda it: it.process.kill(),
        Robot.again,
    ),
    Injection(
        "ended",
        "its process ends (SIGTERM)",
        "lift",
        "node lift",
        lambda it: it.process.stop(),
        Robot.again,
    ),
    Injection(
        "stopped",
        "its process is stopped (SIGSTOP)",
        "amcl",
        "node amcl",
        lambda it: it.signal(signal.SIGSTOP),
        lambda it: it.signal(signal.SIGCONT),  # of a process that was away for its lease
    ),
    Injection(
        HANGS,
        "its executor hangs",
        "camera",
        "Camera",
        lambda it: it.signal(signal.SIGUSR1),
        Robot.again,
    ),
    Injection(
        "doubled",
        "it is started a second time",
        "planner",
        "node planner",
        Robot.double,
        lambda it: it.twin.stop(),
    ),
    Injection(
        "renamed",
        "it is started again by another name",
        "imu",
        "node imu",
        lambda it: it.replace(RENAMED),
        lambda it: it.replace(),
    ),
    Injection(
        "changed",
        "its publisher offers best effort where reliable is subscribed",
        "gps",
        "topic data",
        lambda it: it.replace("", "best_effort"),
        lambda it: it.replace(),
    ),
    Injection(
        "restarted", "it is started again", "arm", "", lambda it: it.replace(), lambda _it: None
    ),
)


class Site:
    """Exporter, Prometheus, Alertmanager and a mail server on this host."""

    def __init__(self, stack: ExitStack, folder: Path, mode: str) -> None:
        self._stack, self._folder, self._started = stack, folder, 0
        self._environment = domains.environment(0) | {"ROS_LOG_DIR": str(folder / "ros-log")}
        del self._environment["ROS_AUTOMATIC_DISCOVERY_RANGE"]  # the robots are on another host
        self.inbox = Inbox()
        addresses = configuration.Addresses(*(f"127.0.0.1:{free_port()}" for _ in range(5)))
        self._exporter = addresses.exporter
        configs = configuration.write(folder, 0, addresses, configuration.Clocks())
        configs.fleet.write_text(fleet(mode))
        mail = MailServer(addresses.smtp, self.inbox)
        mail.start()
        stack.callback(mail.stop)
        stack.enter_context(
            servers.running(
                servers.Server(
                    Process(
                        "exporter",
                        programs.exporter(
                            configs.fleet,
                            addresses.exporter,
                            folder / "exporter.db",
                            addresses.alertmanager,
                        ),
                        self._environment,
                        folder / "exporter.log",
                    ),
                    addresses.exporter,
                ),
                servers.prometheus(folder, configs.prometheus, addresses.prometheus),
                servers.alertmanager(folder, configs.alertmanager, addresses.alertmanager),
                seconds=180.0,
            )
        )

    def start_robot(self, arguments: list[str]) -> Process:
        """Start nodes on the robots' host, and wait until they are there."""
        process = self.prepare_robot(arguments)
        process.signal(signal.SIGUSR2)
        process.wait_for_output("ready", 120)
        return process

    def prepare_robot(self, arguments: list[str]) -> Process:
        """Start a process that has its nodes once it gets SIGUSR2: importing takes seconds."""
        self._started += 1
        name = f"robot-{self._started}"
        argv = [sys.executable, "-m", "experiments.silent_nodes", *arguments]
        process = Process(
            name,
            ["ip", "netns", "exec", "robot", *argv],
            self._environment | {"PYTHONPATH": os.environ["PYTHONPATH"]},
            self._folder / f"{name}.log",
        )
        self._stack.callback(process.stop)
        process.start().wait_for_output("imported", 120)
        return process

    def faults(self) -> set[tuple[str, str]]:
        """(robot, component) of each fault that lasts."""
        found = http.get_json(self._exporter, "/api/v1/faults")["faults"]
        return {(each["robot"], each["component"]) for each in found}

    def began(self) -> list[tuple[str, str, float]]:
        """(robot, component, Unix time) of each fault that ever began."""
        found = http.get_json(self._exporter, "/api/v1/events?kind=fault_began&limit=1000")
        return [
            (each["robot"], each.get("component", ""), each["time"]) for each in found["events"]
        ]

    def expected_nodes(self) -> dict[str, float]:
        """How many nodes of each robot are expected."""
        text = http.get(self._exporter, "/metrics").decode()
        pattern = r'^ros_diagnostics_robot_expected_nodes\{.*robot="(\w+)".*\} (\S+)$'
        return {robot: float(count) for robot, count in re.findall(pattern, text, re.MULTILINE)}

    def mails(self, kind: str, robot: str, component: str) -> int:
        """How often one receiver was notified of it: PROBLEM or RECOVERY."""
        subject = f"** {kind} ** {FLEET}/{robot} {component} is "
        counted = Counter(
            mail.recipients for mail in self.inbox.mails() if mail.subject.startswith(subject)
        )
        return max(counted.values(), default=0)


def fleet(mode: str) -> str:
    """The robots, by their names; what is learned in a day is learned at once."""
    graph = f'graph: {{mode: "{mode}", learn_after: {LEARN:g}s, ignore: [{RENAMED}]}}'
    times = f"stale_after: {STALE:g}s, confirm_after: {CONFIRM:g}s"
    return "\n".join(
        [
            f"fleet: {FLEET}",
            f"profiles: {{default: {{{times}, {graph}}}}}",
            "robots:",
            *(
                f"  - {{name: {each.robot}, namespace: /{each.robot}, source: raw}}"
                for each in INJECTIONS
            ),
            "",
        ]
    )


def play(site: Site, quiet: float) -> Iterator[dict[str, object]]:
    """Do everything, each to its own robot; wait ``quiet`` seconds at the end. A row of each."""
    site.start_robot(["robots", *(each.robot for each in INJECTIONS if each.robot != HANGS)])
    robots = {each: Robot(site, each) for each in INJECTIONS}
    both = {each.robot: 1.0 if each.robot == HANGS else 2.0 for each in INJECTIONS}
    until(lambda: site.expected_nodes() == both, lambda: f"{site.expected_nodes()}", SEEN)
    time.sleep(ALONE)
    at_first = site.began()
    wanted = {(each.robot, each.component) for each in INJECTIONS if each.component}
    injected = {}
    for each, robot in robots.items():
        injected[each] = time.time()
        each.inject(robot)
    _wait(lambda: wanted <= site.faults(), SEEN)
    time.sleep(SETTLE)
    began = [each for each in site.began() if each not in at_first]
    for each, robot in robots.items():
        each.mend(robot)
    _wait(lambda: not site.faults(), SEEN)
    time.sleep(quiet)
    notified = [(kind, *each) for kind in ("PROBLEM", "RECOVERY") for each in wanted]
    _wait(lambda: all(site.mails(*each) for each in notified), NOTIFIED)
    all_began = site.began()
    for each in INJECTIONS:
        key = each.robot, each.component
        times = [at - injected[each] for *of, at in began if tuple(of) == key]
        wrong = [name for robot, name, _at in all_began if robot == each.robot]
        if times:
            wrong.remove(each.component)
        yield {
            "injected": each.what,
            "seen": each.component if times else "",
            "expected": each.component,
            "after": round(min(times), 1) if times else "",
            "problems": site.mails("PROBLEM", *key) if each.component else 0,
            "recoveries": site.mails("RECOVERY", *key) if each.component else 0,
            "wrong": ", ".join(sorted(wrong)),
        }


def _wait(condition: Callable[[], bool], seconds: float) -> None:
    """Until something is so, or the time is over: what was found then is the result."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end:
        time.sleep(0.5)


def main() -> None:
    """Write the rows: FOLDER, mode of `graph`, seconds without a fault at the end."""
    folder, mode, quiet = Path(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    with ExitStack() as stack:
        rows = list(play(Site(stack, folder, mode), quiet))
    (folder / "rows.json").write_text(json.dumps(rows))


if __name__ == "__main__":
    main()
