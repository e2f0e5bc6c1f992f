"""A fleet with robots in every state, and a second fleet whose robot is OK.

Each robot is named after its state. The files in cells/ have what the dashboards must show.
"""

import json
from pathlib import Path

from ros_diagnostics_exporter.canary import ALERT, Canary
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from ros_diagnostics_exporter.notifications import parse
from ros_diagnostics_exporter.sources.link import LinkReading
from support.served_fleet import ServedFleet
from support.state_driver import ERROR, OK, WARN, tree

LINK = LinkReading(expected=100, lost=1, delay=0.25, jitter=0.0625)
HALL = """
fleet: hall
canary: 1m
profiles:
  default:
    stale_after: 3s
    confirm_after: 1s
    values:
      - {key: Level, thresholds: {low: {warning: 30, critical: 15}}}
      - {key: Temperature, thresholds: {high: {warning: 80}}}
      - {key: Voltage (V), thresholds: {low: {warning: 22}}}
      - {key: Cycles, thresholds: {high: {warning: 1000}}}
  slow: {confirm_after: 1h, capabilities: {driving: [Motor]}}
  l: {capabilities: {view: [Laser]}}
  c:
    capabilities:
      power: {any: [Battery, Spare]}
      driving: [Motor, {capability: power}]
  lasers: {checks: {lasers: {match: [Laser], expect: 2}}}
  loose: {components: [{match: Sensor, confirm_after: 1h}]}
  docked: {components: [{match: Arm, planned_stale: true}]}
robots:
  - name: well
    namespace: /well
    profile: c
    labels: {site: north, robot_group: carriers, kind: cart}
  - {name: warned, namespace: /warned, labels: {site: north, robot_group: carriers}}
  - {name: broken, namespace: /broken, profile: l, labels: {site: north, robot_group: carriers}}
  - {name: stale, namespace: /stale, labels: {site: south, robot_group: carriers}}
  - {name: silent, namespace: /silent, profile: c, labels: {site: south, robot_group: carriers}}
  - {name: pending, namespace: /pending, labels: {site: south}}
  - {name: maintained, namespace: /maintained, labels: {site: south}}
  - {name: flapping, namespace: /flapping, profile: loose}
  - {name: fresh, namespace: /fresh, profile: slow}
  - {name: short, namespace: /short, profile: lasers}
  - {name: docked, namespace: /docked, profile: docked}
  - {name: cut_off, namespace: /cut_off, labels: {uplink: short}}
capabilities:
  driving in the hall: {any: [{can: driving}]}
queries:
  - {expr: asked by nobody, component: uplink, group: Network, confirm_after: 1s, uplink: true}
maintenance:
  - name: overhaul
    selector: {robot: maintained}
    comment: new motor
    weekly: [Mon-Sun 00:00-24:00]
"""
ANNEX = """
fleet: annex
faults: {restart_grace: 1s}
profiles:
  default:
    values:
      - {component: Battery, key: Level, metric: ros_battery_charge_ratio, unit: ratio, scale: 0.01}
robots:
  - {name: well, namespace: /well, labels: {site: north}}
discovery: [{topic: "/nobody/{robot}/diagnostics_agg", domain_ids: [7]}]
"""
NEVER_RECEIVED = "pending"
BECOME_SILENT = ("silent", "cut_off")
SCRAPES_BEFORE = 3  # with messages of robots that become silent, and components that become stale


def _status(name: str, level: int = OK, message: str = "", *values: tuple[str, str]) -> Status:
    return Status(level, name, message or ("OK" if level == OK else ""), f"id of {name}", values)


def _battery(level: int = OK, message: str = "", percent: int = 80) -> Status:
    return _status(
        "Battery",
        level,
        message,
        ("Level", f"{percent} %"),
        ("Voltage (V)", "24.5"),
        ("Cycles", "7"),
    )


def _motor(level: int = OK, message: str = "", degrees: int = 40) -> Status:
    return _status("Motor 1", level, message, ("Temperature", f"{degrees} degC"))


def _statuses(robot: str, number: int) -> tuple[Status, ...]:
    """The statuses that a robot sends before a scrape, the ``number``-th since the start."""
    usual = {"Power": (_battery(),), "Motor": (_motor(),)}
    statuses: dict[str, dict[str, tuple[Status, ...]]] = {
        "warned": {"Power": (_battery(WARN, "Low charge", 20),), "Motor": (_motor(degrees=41),)},
        "broken": {
            "Power": (_battery(percent=78),),
            "Motor": (_motor(ERROR, "Motor failure", 42),),
            "Laser": (_status("Laser 1", WARN, "Dirty"),),
            "Odd": (Status(9, "Odd level", "there is no level 9", ""),),
        },
        "stale": {**usual, "Camera": (_status("Cam 1"),) if number < SCRAPES_BEFORE else ()},
        "maintained": {"Power": (_battery(),), "Motor": (_motor(ERROR, "No motor", 75),)},
        # Its battery keeps the robot itself in one state.
        "flapping": {
            "Power": (_battery(WARN, "Low charge", 25),),
            "Motor": (_motor(),),
            "Sensor": (_status("Sensor 1", (OK, WARN)[number % 2], "Loose"),),
        },
        "fresh": {"Power": (_battery(),), "Motor": (_motor(ERROR, "Motor failure", 39),)},
        "short": {**usual, "Laser": (_status("Laser 1"),)},
        "docked": {**usual, "Tool": (_status("Arm"),) if number < SCRAPES_BEFORE else ()},
    }
    return tree(**statuses.get(robot, usual))


def every_state(folder: Path) -> ServedFleet:
    """The fleet "hall"."""
    return _served(folder / "hall.yml", HALL)


def all_well(folder: Path) -> ServedFleet:
    """The fleet "annex": its only robot has the name of one in the hall."""
    return _served(folder / "annex.yml", ANNEX)


def _served(path: Path, text: str) -> ServedFleet:
    path.write_text(text)
    scrapes = iter(range(1_000_000))

    def send(state: FleetState, now: Instant) -> None:
        number = next(scrapes)
        if state.fleet.canary is not None:
            _exchange_canary(served.canary, state.fleet, number, now.wall)
        for robot in list(state.robots.values()):
            name = robot.settings.name
            topic = robot.settings.topic_agg or ""
            if name == NEVER_RECEIVED:
                continue
            state.update_graph(0, _endpoints(state), now)
            if name not in BECOME_SILENT or number < SCRAPES_BEFORE:
                stamp = now.wall - (7.0 if name == "warned" else 0.5)
                state.receive(Topic(0, topic), Array(stamp, _statuses(name, number), 900), now)

        state.update_links(0, {"/broken/diagnostics_agg": LINK}, now)
        for query in state.fleet.queries:
            gone = Status(ERROR, query.component, "no answer")
            state.receive_answer(query.feed, {"short": (gone,)}, now)

    served = ServedFleet(load(path), send)
    send(served.state, served.started)
    return served


def _exchange_canary(canary: Canary, fleet: Fleet, number: int, wall: float) -> None:
    """The canary comes back, after 3 s or each fourth time after 20 s, and the next one begins."""
    mono = 100.0 * number
    if canary.start is not None:
        alert = {
            "status": "firing",
            "labels": {"alertname": ALERT, "fleet": fleet.name},
            "annotations": {"canary": str(canary.start)},
        }
        message = {"version": "4", "receiver": "canary", "alerts": [alert]}
        took = 3 if number % 4 else 20
        back = Instant(mono - 100 + took, wall)
        canary.receive(parse(json.dumps(message).encode()), fleet.name, back)
    canary.tick(fleet.canary, Instant(mono, wall))


def _endpoints(state: FleetState) -> dict[str, Endpoint]:
    return {
        robot.settings.topic_agg or "": Endpoint(1)
        for robot in state.robots.values()
        if robot.settings.name not in {*BECOME_SILENT, NEVER_RECEIVED}
    }
