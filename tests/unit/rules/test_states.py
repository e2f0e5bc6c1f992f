"""The state of a robot is the same on the exporter's pages and on the dashboards.

The pages compute it from the API, the dashboards by prometheus/rules/states.yml from the metrics.
Here random fleets are judged, and both are asked.
"""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from random import Random
from subprocess import run

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.model import Array, Instant, Status, Topic
from ros_diagnostics_exporter.severity import SEVERITIES, state_of
from support.shipped_rules import PROMETHEUS, read_yaml
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver

FLEETS, ROBOTS = 12, 6
UNSTEADY = 0.03  # share of the components that flap
CHANGES = 0.01  # of the others, in a second
CHARGES = 0.1  # of the robots' charges, in a second: many are beyond and not confirmed
GOES, COMES_AND_GOES = 0.004, 0.3  # of the robots, in a second; of one of them
LEVELS = ((OK, OK, OK, WARN), (OK, OK, STALE), (OK, OK, WARN, ERROR, STALE))  # one for each robot
COMPONENTS = ("Motor", "Arm", "Lift", "Lidar", "Board", "laser 1", "laser 2", "Mode")
LOW = {"low": {"warning": 20, "critical": 10}}
PROFILE = {
    "stale_after": "5s",
    "confirm_after": "4s",
    "components": [
        {"match": "Arm", "planned_stale": True},
        {"match": "Lift", "when": {"component": "Mode", "key": "mode", "equals": "auto"}},
        {"match": "Lidar", "depends_on": ["Board"]},
    ],
    "values": [{"component": "Motor", "key": "charge", "thresholds": LOW}],
    "checks": {"lasers": {"match": ["laser 1", "laser 2"], "expect": 2}},
    "capabilities": {
        "view": {"any": ["laser 1", "laser 2"]},
        "drive": ["Motor", {"capability": "view"}],
    },
}
GROUPS = ("faults", "pairs", "states")


def fleet_of(random: Random, name: str, path: Path) -> Fleet:
    """A fleet of several sites, of which some robots count STALE as CRITICAL."""
    robots = [
        {
            "name": f"robot_{number}",
            "namespace": f"/robot_{number}",
            "profile": random.choice(("default", "default", "strict")),
            "labels": {"site": random.choice(("north", "south"))},
        }
        for number in range(ROBOTS)
    ]
    profiles = {"default": PROFILE, "strict": {"extends": "default", "stale_is_critical": True}}
    config = {"fleet": name, "faults": {"restart_grace": "1s"}, "profiles": profiles}
    path.write_text(json.dumps({**config, "robots": robots}), "utf-8")
    return load(path)


def values_of(mode: str, charge: int) -> tuple[tuple[str, str], ...]:
    return ("mode", mode), ("charge", str(charge))


def lived(random: Random, fleet: Fleet) -> StateDriver:
    """The fleet after some minutes in which components fail and robots come and go."""
    driver = StateDriver(fleet=fleet)
    parts = [(robot.name, name) for robot in fleet.robots for name in COMPONENTS]
    unsteady = {each for each in parts if random.random() < UNSTEADY}
    levels = dict.fromkeys(parts, OK)
    possible = {robot.name: random.choice(LEVELS) for robot in fleet.robots}
    received = {robot.name: random.random() < 0.9 for robot in fleet.robots}
    charge = {robot.name: 80 for robot in fleet.robots}
    for _ in range(random.randrange(30, 200)):
        for robot, is_received in received.items():
            often = COMES_AND_GOES if robot == "robot_3" else GOES
            received[robot] = is_received != (random.random() < often)
        charge = {
            robot: random.choice((5, 15, 80)) if random.random() < CHARGES else number
            for robot, number in charge.items()
        }
        for robot, name in parts:
            if random.random() < (0.5 if (robot, name) in unsteady else CHANGES):
                levels[robot, name] = random.choice(possible[robot])
        for robot in (name for name, is_received in received.items() if is_received):
            mode = random.choice(("auto", "auto", "auto", "manual"))
            statuses = [
                Status(levels[robot, name], name, "seen", "", values_of(mode, charge[robot]))
                for name in COMPONENTS
                if levels[robot, name] != STALE or random.random() < 0.5
            ]
            topic = Topic(0, f"/{robot}/diagnostics")
            driver.state.receive(topic, Array(0.0, tuple(statuses), 100), driver.now)
        driver.now = Instant(driver.now.mono + 1, driver.now.wall + 1)
        driver.state.tick(driver.now)
    return driver


def scraped(driver: StateDriver) -> Iterator[dict[str, str]]:
    """Series of promtool: all that the exporter serves now, for a minute."""
    fleet = driver.state.fleet.name
    target = {"instance": fleet, "job": "ros-diagnostics"}
    served = {
        f"ros_diagnostics_{name}": {json.dumps(dict(labels)): value for labels, value in of.items()}
        for name, of in driver.samples().items()
    }
    served["up"] = {"{}": 1}
    served["ros_diagnostics_exporter_settled"] = {json.dumps({"fleet": fleet}): 1}
    for name, samples in served.items():
        for labels, value in samples.items():
            pairs = {**json.loads(labels), **target}.items()
            text = ",".join(f"{label}={json.dumps(each)}" for label, each in pairs)
            yield {"series": f"{name}{{{text}}}", "values": f"{value}x12"}


def on_dashboards(series: list[dict[str, str]], folder: Path) -> dict[tuple[str, str], float]:
    """The rank that the rules record of each robot, by fleet and robot."""
    asked = "sum by (fleet, robot) (robot:ros_diagnostics_state:rank)"
    test = {
        "interval": "5s",
        "input_series": series,
        # Nothing is expected, so promtool prints what it found.
        "promql_expr_test": [{"expr": asked, "eval_time": "55s", "exp_samples": []}],
    }
    files = [str(PROMETHEUS / "rules" / f"{each}.yml") for each in ("faults", "pairs", "states")]
    order = [f"ros-diagnostics.{each}" for each in GROUPS]
    document = {"rule_files": files, "evaluation_interval": "5s", "group_eval_order": order}
    path = folder / "test.yml"
    path.write_text(json.dumps({**document, "tests": [test]}), "utf-8")
    ended = run(["promtool", "test", "rules", path], capture_output=True, text=True, check=False)
    found = re.findall(r'\{fleet="(\w+)", robot="(\w+)"\} (\S+?),?\s', ended.stdout + ended.stderr)
    assert found, ended
    return {(fleet, robot): float(rank) for fleet, robot, rank in found}


def test_pages_and_dashboards_have_the_same_state_of_each_robot(tmp_path):
    random = Random(11)
    series: list[dict[str, str]] = []
    on_pages: dict[tuple[str, str], float] = {}
    for number in range(FLEETS):
        driver = lived(random, fleet_of(random, f"fleet_{number}", tmp_path / "fleet.yml"))
        series += scraped(driver)
        for robot in fleet_snapshot(driver.state, driver.now)["robots"]:
            on_pages[f"fleet_{number}", robot["robot"]] = SEVERITIES[state_of(robot)]
    assert len(set(on_pages.values())) > 4  # there is something to compare
    assert on_dashboards(series, tmp_path) == on_pages


def test_the_ranks_of_states_are_those_of_the_rules():
    groups = read_yaml(PROMETHEUS / "rules" / "states.yml")["groups"]
    named = (rule["labels"] for each in groups for rule in each["rules"] if "labels" in rule)
    ranks = {each["state"].upper(): float(each["rank"]) for each in named if "rank" in each}
    del ranks["UNKNOWN"]  # of what no exporter serves
    assert ranks == SEVERITIES
