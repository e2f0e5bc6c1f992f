"""Each key of fleet.yml, across a reload and a restart.

After a reload everything is judged as if the exporter had been started with that config: a reader
that keeps an old value is found here, whichever it is. After a restart everything is judged as if
there had been none.
"""

import json

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from support.config_examples import DEFINITIONS, PROPERTIES, whole
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver, tree

BEFORE = 3  # seconds until the reload: nothing is a fault yet, which no reload ends
AFTER = 65  # ... after it, or after the start
ROBOTS = [{"name": each, "namespace": f"/{each}", "labels": {"site": "hall"}} for each in "rs"]
VALUES = (("x", "1"), ("Charge", "9 %"), ("Temperature", "95"), ("mode", "auto"))
STATUSES = (
    Status(ERROR, "Motor", "Hot", "m", VALUES),
    Status(STALE, "Camera", "gone", "", VALUES),
    Status(WARN, "x", "worn", "", VALUES),
    Status(OK, "Lift", "OK", "", VALUES),
    Status(OK, "Battery", "OK", "", VALUES),
    Status(ERROR, "laser: scan", "off", "", VALUES),
)
FOUND = {"/q/diagnostics": Endpoint(1), "/q/diagnostics_agg": Endpoint(1)}
COUNTED = ("_total", "_seconds", "_ratio")  # how often, or when: not what is judged
SETTLED = 75  # ... after which all that was known before a restart is known again
ANSWERED = 15  # seconds between two answers of a query
KEPT = {
    ("Robot", "source"): "a component keeps the group that the aggregator gave it",
    ("Shared", "pattern"): "a robot that a status named before is known until it is forgotten",
}


def play(driver: StateDriver, seconds: int) -> None:
    """Receive all topics of all robots once a second."""
    end = driver.now.mono + seconds
    while driver.now.mono < end:
        for domain in driver.state.fleet.domain_ids:
            driver.state.update_graph(domain, FOUND, driver.now)
            driver.state.update_nodes(domain, [("driver", "/r")], driver.now)
            for name in driver.state.wanted_topics(domain):
                rows = tree(Group=list(STATUSES)) if name.endswith("_agg") else STATUSES
                driver.state.receive(Topic(domain, name), Array(0.0, rows, 100), driver.now)
        if driver.now.mono % ANSWERED == 0:
            for query in driver.state.fleet.queries:
                answer = {"r": [Status(ERROR, "uplink", "0, below 0.5")]}
                driver.state.receive_answer(query.feed, answer, driver.now)
        driver.now = Instant(driver.now.mono + 1, driver.now.wall + 1)
        driver.state.tick(driver.now)


def judged(driver: StateDriver) -> dict[str, object]:
    """The faults, and what is served of robots and components."""
    served = {
        name: series for name, series in driver.samples().items() if not name.endswith(COUNTED)
    }
    return {**served, "faults": driver.fault_names()}


def started(fleet: Fleet) -> dict[str, object]:
    driver = StateDriver(fleet=fleet)
    play(driver, AFTER)
    return judged(driver)


def reloaded(before: Fleet, after: Fleet) -> dict[str, object]:
    driver = StateDriver(fleet=before)
    play(driver, BEFORE)
    driver.configure(after)
    play(driver, AFTER)
    return judged(driver)


@pytest.fixture
def fleets(tmp_path):
    """Loads the config that has an entry of a class with some keys."""
    for folder in ("robots", "maintenance", "queries"):
        (tmp_path / f"{folder}.d").mkdir()
        (tmp_path / "fleet" / folder).mkdir(parents=True)

    def loaded(name: str, entry: dict[str, object]) -> Fleet:
        path = tmp_path / "fleet.yml"
        path.write_text(json.dumps({"robots": ROBOTS, **whole(name, entry)}), "utf-8")
        return load(path)

    return loaded


KEYS = [each for each in PROPERTIES if each[0] != "Zenoh"]  # what has other sources


@pytest.mark.parametrize(("name", "key"), [each for each in KEYS if each not in KEPT])
def test_a_key_that_a_reload_adds_or_removes_is_judged_as_after_a_start(fleets, name, key):
    without = fleets(name, {})
    with_it = fleets(name, {key: DEFINITIONS[name]["properties"][key]["examples"][0]})
    assert reloaded(without, with_it) == started(with_it), "added"
    assert reloaded(with_it, without) == started(without), "removed"


@pytest.mark.parametrize(("name", "key"), KEYS)
def test_a_restart_changes_nothing_that_is_judged(fleets, tmp_path, name, key):
    fleet = fleets(name, {key: DEFINITIONS[name]["properties"][key]["examples"][0]})
    unbroken = StateDriver(fleet=fleet)
    play(unbroken, AFTER + SETTLED)
    for before in (BEFORE, AFTER):  # nothing is a fault yet, and all is
        driver = StateDriver(fleet=fleet)
        play(driver, before)
        restarted = driver.again(tmp_path / f"{before}.db")
        play(restarted, SETTLED)
        assert judged(restarted) == judged(unbroken), before
        restarted.close()
