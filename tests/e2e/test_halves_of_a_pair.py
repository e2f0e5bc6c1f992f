"""Two exporters with one fleet.yml, of which one is deaf, empty, late or renamed.

Each fault is one alert, which fires without a gap from its beginning to evidence of its end.
"""

from __future__ import annotations

import pytest

from support.orders import Orders
from testbed import http
from testbed.polling import until
from testbed.site import Site

pytestmark = [pytest.mark.slow, pytest.mark.timeout(900)]

ROBOTS = [f"robot_{number}" for number in range(1, 5)]
FLEET = """
fleet: hall
profiles: {default: {stale_after: 4s, confirm_after: 2s}}
faults: {restart_grace: 8s, common: {robots: 3, share: 0.5}, site: {robots: 3, share: 0.5}}
"""
Alert = tuple[str, str, str]  # name, robot, component

MOTOR: Alert = ("ComponentCritical", "robot_1", "Motor 1")
SILENT: Alert = ("RobotSilent", "robot_1", "")
SITE: Alert = ("FleetPartDown", "", "")
COMMON: Alert = ("CommonCause", "", "Motor 1")


class Half:
    """An exporter, with a configuration and a database of its own."""

    def __init__(self, site: Site, name: str, empty_domain: int) -> None:
        self._domain, self._empty = site.domain_id, empty_domain
        self.server = site.make_exporter(site.folder / f"{name}.yml", name=name)
        self.database, self.address = self.server.database, self.server.address
        self.write()

    def write(self, *, name: str = "", deaf_to: list[str] | None = None) -> None:
        """Write fleet.yml with a name, and robots whose messages do not come here."""
        lines = [FLEET, *([f"exporter: {name}"] if name else []), "robots:"]
        for robot in ROBOTS:
            domain = self._empty if robot in (deaf_to or []) else self._domain
            lines.append(f"  - {{name: {robot}, namespace: /{robot}, domain_id: {domain}}}")
        self.server.config.write_text("\n".join(lines) + "\n")

    def stop(self) -> None:
        self.server.process.stop()

    def kill(self) -> None:
        self.server.process.kill()

    def serves(self, *parts: str) -> bool:
        """Whether a line of its metrics has all parts."""
        if not self.server.answers("/-/ready"):
            return False
        lines = http.get(self.address, "/metrics").decode().splitlines()
        return any(all(part in line for part in parts) for line in lines)


class Pair:
    """Both halves, their robots, and what fires about them."""

    def __init__(self, site: Site) -> None:
        empty_domain = site.lease()
        self.first, self.second = (Half(site, name, empty_domain) for name in ("first", "second"))
        self._site, self._engine = site, site.engine
        self._orders = site.use(Orders(site.domain_id))

    def start(self, half: Half, *, receives: list[str]) -> None:
        """Start a half and wait until Prometheus has it settled, receiving just these robots."""
        server = half.server
        self._site.start(server)
        until(lambda: server.receives() == receives, lambda: f"{server.receives()}", 120)
        settled = f'ros_diagnostics_exporter_settled{{instance="{half.address}"}} == 1'
        until(lambda: bool(self._engine.query(settled)), "it has settled", 120)

    def restart(self, half: Half, *, receives: list[str]) -> None:
        half.stop()
        self.start(half, receives=receives)

    def orders(self, **levels: str) -> None:
        """Set the level of Motor 1 of robots."""
        self._orders.give([(f"{robot}/Motor 1", level) for robot, level in levels.items()])

    def order(self, robot: str, order: str) -> None:
        self._orders.give([(robot, order)])

    def firing(self) -> set[Alert]:
        return {_alert(labels) for labels in self._engine.firing() if "fault" in labels}

    def becomes(self, *alerts: Alert) -> None:
        """Wait until just these fire, and whatever comes late has come."""
        self._reached(*alerts)
        self.evaluations(8)
        self._reached(*alerts)

    def _reached(self, *alerts: Alert) -> None:
        until(
            lambda: self.firing() == set(alerts),
            lambda: f"{alerts}; firing: {self.firing()}",
            90,
            every=0.5,
        )

    def evaluations(self, number: int) -> None:
        """Wait for so many more evaluations of the rules."""
        count = 'sum(prometheus_rule_group_iterations_total{rule_group=~".*faults"})'
        wanted = self._engine.value(count) + number
        until(lambda: self._engine.value(count) >= wanted, f"{number} evaluations", 90)

    def fired(self) -> dict[Alert, int]:
        """How many times each alert has begun to fire."""
        found: dict[Alert, set[str]] = {}
        for series in self._engine.series('ALERTS_FOR_STATE{fault!="", step=""}[1h]'):
            times = {value for _at, value in series["values"]}
            found.setdefault(_alert(series["metric"]), set()).update(times)
        return {alert: len(times) for alert, times in found.items()}


def _alert(labels: dict[str, str]) -> Alert:
    name = labels["alertname"].removeprefix("RosDiagnostics")
    return name, labels.get("robot", ""), labels.get("component", "")


@pytest.fixture
def pair(site: Site) -> Pair:
    """A pair of which the first half is started."""
    site.start_robots(len(ROBOTS))
    pair = Pair(site)
    site.start_alertmanager()
    site.start_prometheus(interval=1, tenth=True)
    site.wait_until_ready()
    pair.start(pair.first, receives=ROBOTS)
    return pair


def test_what_ended_does_not_fire_again_by_a_half_that_went_deaf_in_it(pair: Pair):
    pair.start(pair.second, receives=ROBOTS)
    pair.orders(robot_1="error")
    until(lambda: pair.second.serves("fault_start", "robot_1"), "both have it", 60)
    pair.becomes(MOTOR)

    pair.second.write(deaf_to=["robot_1"])
    pair.restart(pair.second, receives=ROBOTS[1:])
    until(lambda: pair.second.serves("fault_start", "robot_1", "silent"), "it is silent there", 60)
    pair.becomes(MOTOR)
    pair.orders(robot_1="ok")
    pair.becomes()
    assert pair.second.serves("fault_start", "robot_1", "Motor 1")

    pair.first.kill()
    pair.becomes(SILENT)  # nobody receives it; that its motor failed is over
    pair.start(pair.first, receives=ROBOTS)
    pair.becomes()
    assert pair.fired() == {MOTOR: 1, SILENT: 1}

    pair.orders(robot_1="error")  # again, while the other half still has the first time
    pair.becomes(MOTOR)
    pair.second.write()
    pair.restart(pair.second, receives=ROBOTS)
    pair.becomes(MOTOR)
    pair.orders(robot_1="ok")
    pair.becomes()
    assert pair.fired() == {MOTOR: 2, SILENT: 1}


def test_a_half_that_lost_its_database_goes_on_with_what_fires(pair: Pair):
    pair.start(pair.second, receives=ROBOTS)
    pair.orders(robot_1="error")
    pair.order("robot_2", "hang")
    silent = ("RobotSilent", "robot_2", "")
    pair.becomes(MOTOR, silent)

    pair.second.stop()
    pair.second.database.unlink()
    pair.start(pair.second, receives=[name for name in ROBOTS if name != "robot_2"])
    until(lambda: pair.second.serves("fault_start", "robot_2", "silent"), "it has adopted it", 120)
    pair.becomes(MOTOR, silent)
    pair.first.kill()
    pair.becomes(MOTOR, silent)
    pair.order("robot_2", "resume")
    pair.becomes(MOTOR)
    pair.orders(robot_1="ok")
    pair.becomes()

    pair.start(pair.first, receives=ROBOTS)  # it was away when both ended
    pair.becomes()
    assert pair.fired() == {MOTOR: 1, silent: 1}


def test_a_half_that_is_started_in_a_fault_has_the_same_one(pair: Pair):
    pair.orders(robot_1="error")
    pair.order("robot_2", "hang")
    silent = ("RobotSilent", "robot_2", "")
    pair.becomes(MOTOR, silent)

    pair.start(pair.second, receives=[name for name in ROBOTS if name != "robot_2"])
    until(lambda: pair.second.serves("fault_start", "Motor 1"), "it has the motor's", 60)
    until(lambda: pair.second.serves("fault_start", "robot_2", "silent"), "it has adopted it", 120)
    pair.becomes(MOTOR, silent)
    pair.first.stop()
    pair.becomes(MOTOR, silent)
    pair.orders(robot_1="ok")
    pair.becomes(silent)
    pair.order("robot_2", "resume")
    pair.becomes()
    assert pair.fired() == {MOTOR: 1, silent: 1}


def test_halves_that_are_given_a_name_one_after_the_other_have_the_same_faults(pair: Pair):
    pair.start(pair.second, receives=ROBOTS)
    pair.orders(robot_1="error")
    pair.becomes(MOTOR)
    for half in (pair.second, pair.first):
        half.write(name="north")
        pair.restart(half, receives=ROBOTS)
        pair.becomes(MOTOR)
    pair.orders(robot_1="ok")
    pair.becomes()
    assert pair.fired() == {MOTOR: 1}


def test_many_robots_are_one_cause_to_the_half_that_receives_them(pair: Pair):
    pair.second.write(deaf_to=["robot_3", "robot_4"])
    pair.start(pair.second, receives=["robot_1", "robot_2"])
    pair.becomes()
    pair.orders(**dict.fromkeys(ROBOTS, "error"))
    until(lambda: pair.second.serves("fault_start", "robot_1", "Motor 1"), "one by one there", 60)
    pair.becomes(COMMON)
    pair.orders(**dict.fromkeys(ROBOTS, "ok"))
    pair.becomes()

    for robot in ROBOTS[:3]:
        pair.order(robot, "hang")
    pair.becomes(SITE)
    pair.restart(pair.first, receives=["robot_4"])
    pair.becomes(SITE)
    for robot in ROBOTS[:3]:
        pair.order(robot, "resume")
    pair.becomes()
    assert pair.fired() == {COMMON: 1, SITE: 1}


def test_a_common_cause_goes_on_alone_while_the_half_that_has_it_restarts(pair: Pair):
    pair.second.write(deaf_to=["robot_3", "robot_4"])
    pair.start(pair.second, receives=["robot_1", "robot_2"])
    pair.orders(**dict.fromkeys(ROBOTS, "error"))
    until(lambda: pair.second.serves("fault_start", "robot_1", "Motor 1"), "one by one there", 60)
    pair.becomes(COMMON)

    pair.first.kill()  # left is the half to which two of its robots have a fault each
    pair.becomes(COMMON)
    pair.start(pair.first, receives=ROBOTS)
    pair.becomes(COMMON)

    pair.orders(robot_1="error", robot_2="ok", robot_3="ok", robot_4="ok")
    pair.becomes(MOTOR)  # the common cause is over, and one robot still has it
    pair.orders(robot_1="ok")
    pair.becomes()
    assert pair.fired() == {COMMON: 1, MOTOR: 1}
