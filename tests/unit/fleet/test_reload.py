"""Another config takes over: what it leaves unchanged loses nothing."""

import dataclasses
import re

import pytest

from ros_diagnostics_exporter.config.fleet import (
    CauseSettings,
    Check,
    ComponentRule,
    Discovery,
    FaultSettings,
    Fleet,
    Profile,
    Robot,
    Shared,
    Source,
    ValueRule,
)
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.fleet.state import PASS_ON
from ros_diagnostics_exporter.fleet.unmatched import GRACE
from ros_diagnostics_exporter.model import Array, Endpoint, Status, Topic
from support.configs import load_text
from support.state_driver import ERROR, OK, STALE, WARN, StateDriver, raw_fleet, raw_robot, tree

HOT, LASER = Status(ERROR, "Motor", "Hot"), Status(OK, "Laser", values=(("Voltage", "12 V"),))


def faulty() -> StateDriver:
    driver = StateDriver(fleet=raw_fleet("r")).raw(LASER)
    driver.at(1)
    driver.raw(HOT)
    return driver


def test_robots_come_and_go_while_a_fault_goes_on_unbroken():
    driver = faulty()
    before = driver.samples()

    for names in (("r", "new"), ("r",), ("r", "other")):
        driver.configure(raw_fleet(*names))
        after = driver.samples()
        for name, samples in before.items():
            assert samples.items() <= after[name].items(), name
    assert set(driver.state.robots) == {"r", "other"}
    assert [event.after for event in driver.events if event.robot == "new"] == [
        "known",
        "forgotten",
    ]


def test_a_changed_profile_is_followed_without_a_reset():
    driver = faulty()
    rules = (ComponentRule(re.compile("Motor"), levels={ERROR: WARN}, stale_after=3.0),)
    checks = (Check("all"), Check("motors", (re.compile("Motor"),)))
    values = (ValueRule(key=re.compile("Voltage"), metric="ros_voltage_volts"),)
    profile = Profile(name="softer", components=rules, checks=checks, values=values)
    driver.configure(raw_fleet("r", profile=profile))

    motor = driver.component("Motor")
    assert (motor.level, motor.reported, motor.changes) == (WARN, ERROR, 1)
    assert driver.sample("robot_messages_total") == 2
    assert driver.sample("check_components", check="motors", level="warn") == 1
    assert driver.sample("component_stale_after_seconds", component="Motor") == 3
    assert driver.sample("component_value", component="Laser") is None
    assert b"ros_voltage_volts{" in driver.exposition.render()


def test_a_fleet_that_is_renamed_is_renamed_in_every_sample():
    driver = faulty()
    before = driver.samples()
    driver.configure(name="renamed")

    after = driver.samples()
    assert before.keys() == after.keys()
    for name, series in after.items():
        assert {dict(labels)["fleet"] for labels in series} == {"renamed"}, name


def test_a_robot_keeps_its_history_when_it_moves_to_another_topic():
    driver = faulty()
    moved = Robot("r", topic_raw="/elsewhere/diagnostics", source=Source.RAW)
    driver.configure(Fleet("f", (moved,)))
    assert driver.state.wanted_topics(0) == {"/elsewhere/diagnostics": False}

    driver.at(2)
    driver.receive("/elsewhere/diagnostics", HOT)
    assert driver.problem_since("Motor") == driver.now.wall - 1


def test_a_discovered_robot_that_is_declared_stays_the_same_robot_and_back():
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg")
    discovery = Discovery(pattern, "/{robot}/diagnostics_agg")
    driver = StateDriver(fleet=Fleet("f", discoveries=(discovery,)))
    driver.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(1)}, driver.now)
    driver.agg(*tree(Motor=[HOT]))

    declared = Robot("r", topic_agg="/r/diagnostics_agg", topic_raw="/r/diagnostics")
    for fleet in (Fleet("f", (declared,), (discovery,)), Fleet("f", discoveries=(discovery,))):
        driver.configure(fleet)
        assert driver.level("Motor") == ERROR

    driver.configure(Fleet("f"))
    assert not driver.state.robots
    assert driver.state.wanted_topics(0) == {}


BY_TOPIC = Discovery(re.compile(r"/(?P<robot>[^/]*)/?diagnostics"), "", source=Source.RAW)
RAW_ON = Endpoint(1)


def found(topic: str) -> StateDriver:
    """A robot that discovery found by its topic, with a fault of its own."""
    driver = StateDriver(fleet=Fleet("f", discoveries=(BY_TOPIC,)))
    for second in range(60):
        driver.state.update_graph(0, {topic: RAW_ON}, driver.now)
        receive(driver, HOT, topic=topic)
        driver.at(second + 1)
    assert [each.identity.component for each in driver.state.faults()] == ["Motor"]
    return driver


def followed(driver: StateDriver, fleet: Fleet, path, *, restart: bool) -> StateDriver:
    """Another config, by a reload or by a restart."""
    if restart:
        driver.keep(path)
        return driver.restart(path, fleet=fleet)
    driver.configure(fleet)
    return driver


@pytest.mark.parametrize("restart", [False, True])
def test_a_robot_declared_by_another_name_than_discovery_gave_it_is_one_robot(tmp_path, restart):
    declared = Robot("Lift 1", topic_raw="/r/diagnostics", source=Source.RAW)
    fleet = Fleet("f", (declared,), (BY_TOPIC,))
    driver = followed(found("/r/diagnostics"), fleet, tmp_path / "state", restart=restart)
    driver.state.update_graph(0, {"/r/diagnostics": RAW_ON}, driver.now)
    driver.stand(60, HOT)

    assert [*driver.state.robots] == ["Lift 1"]
    assert [each.identity.robot for each in driver.state.faults()] == ["Lift 1"]
    driver.close()


def test_a_declared_robot_that_moves_to_a_discovered_one_s_topic_replaces_it():
    driver = found("/r/diagnostics")
    for topic in ("/x/diagnostics", "/r/diagnostics"):
        declared = Robot("Lift 1", topic_raw=topic, source=Source.RAW)
        driver.configure(Fleet("f", (declared,), (BY_TOPIC,)))
    assert [*driver.state.robots] == ["Lift 1"]


@pytest.mark.parametrize("discoveries", [(), (BY_TOPIC,)])
@pytest.mark.parametrize("restart", [False, True])
def test_a_topic_declared_shared_is_no_robot_s_any_more(tmp_path, restart, discoveries):
    fleet = Fleet("f", discoveries=discoveries, shared=(Shared("/x/diagnostics", raw=True),))
    driver = followed(found("/x/diagnostics"), fleet, tmp_path / "state", restart=restart)
    assert not driver.state.robots
    assert not driver.state.faults()

    receive(driver, Status(OK, "Motor", hardware_id="r1"), topic="/x/diagnostics")
    driver = followed(driver, fleet, tmp_path / "state", restart=restart)
    assert [*driver.state.robots] == ["r1"]
    driver.close()


@pytest.mark.parametrize("restart", [False, True])
@pytest.mark.parametrize("publishes", [False, True])
def test_a_silent_robot_taken_out_of_the_config_goes_though_a_pattern_fits(
    tmp_path, restart, publishes
):
    driver = StateDriver(fleet=Fleet("f", (raw_robot("r"),), (BY_TOPIC,))).raw_every(1, 40, HOT)
    assert {each.identity.state for each in driver.at(120).state.faults()} == {"silent", "critical"}
    driver.state.update_graph(0, {"/r/diagnostics": Endpoint(int(publishes))}, driver.now)
    fleet = Fleet("f", discoveries=(BY_TOPIC,))
    driver = followed(driver, fleet, tmp_path / "state", restart=restart)

    assert bool(driver.state.faults()) == (publishes and not restart)
    reasons = {each.reason for each in driver.events if each.kind == "fault_ended"}
    assert reasons == (set() if driver.state.faults() else {"removed"})
    if publishes:
        driver.state.update_graph(0, {"/r/diagnostics": Endpoint(1)}, driver.now)
    assert [*driver.state.robots] == ["r"] * publishes
    driver.close()


def test_the_budget_is_whole_again_when_all_robots_have_gone():
    driver = faulty()
    driver.configure(Fleet("f"))

    assert driver.state._registry.series.used == 0


# -- shared topics ----------------------------------------------------------------------


def shared(**more) -> StateDriver:
    settings = Shared("/diagnostics", raw=True, **more)
    return StateDriver(fleet=Fleet("f", shared=(settings,)))


def receive(driver: StateDriver, *statuses: Status, topic: str = "/diagnostics") -> None:
    driver.state.receive(Topic(0, topic), Array(0.0, statuses, 100), driver.now)


def test_robots_on_one_topic_are_told_apart_by_hardware_id():
    driver = shared()
    receive(
        driver,
        Status(OK, "Motor", hardware_id="r1"),
        Status(OK, "Laser", hardware_id="r1"),
        Status(ERROR, "Motor", hardware_id="r2"),
        Status(ERROR, "Motor"),
    )

    assert driver.sample("component_level", robot="r1", component="Motor") == OK
    assert driver.sample("component_level", robot="r2", component="Motor") == ERROR
    assert driver.state.rejected["no_robot"] == 1
    assert driver.state.wanted_topics(0) == {"/diagnostics": True}
    assert [each.bytes for each in driver.state.robots.values()] == [50, 25]
    assert driver.state.topics_of("r1") == (Topic(0, "/diagnostics"),)


def test_a_pattern_gives_the_names_of_robot_and_component_unless_the_robots_is_none():
    driver = shared(by="name", pattern=re.compile("(?P<robot>.*)/(?P<component>.*)"))
    receive(driver, Status(OK, "r1/Motor"), Status(OK, " /Motor"), Status(OK, "/Motor"))

    assert set(driver.state.robots) == {"r1"}
    assert driver.sample("component_level", robot="r1", component="Motor") == OK
    assert driver.state.rejected["no_robot"] == 2


def test_a_robot_on_a_shared_topic_falls_silent_alone():
    driver = shared(profile=Profile(stale_after=5.0))
    r1, r2 = Status(OK, "Motor", hardware_id="r1"), Status(OK, "Motor", hardware_id="r2")
    receive(driver, r1, r2)
    for second in range(1, 8):
        driver.at(second)
        receive(driver, r1)

    assert driver.sample("robot_up", robot="r1") == 1
    assert driver.sample("robot_up", robot="r2") == 0
    assert driver.sample("component_level", robot="r2") == STALE


def test_a_declared_robot_on_a_shared_topic_is_known_before_it_comes():
    declared = Robot("r1", topic_raw="/diagnostics", source=Source.RAW, labels={"site": "hall"})
    settings = Shared("/diagnostics", raw=True)
    driver = StateDriver(fleet=Fleet("f", robots=(declared,), shared=(settings,)))
    assert driver.sample("robot_up", robot="r1") == 0

    receive(driver, Status(OK, "Motor", hardware_id="r1"), Status(OK, "Motor", hardware_id="r2"))

    assert driver.sample("robot_up", robot="r1") == driver.sample("robot_up", robot="r2") == 1
    assert driver.sample("robot_info", robot="r1", site="hall") == 1


def test_a_robot_that_is_declared_on_a_shared_topic_leaves_the_others_of_it_alone():
    driver = shared()
    motors = [Status(OK, "Motor", hardware_id=f"r{n}") for n in (1, 2)]
    receive(driver, *motors)
    declared = tuple(Robot(f"r{n}", topic_raw="/diagnostics", source=Source.RAW) for n in (1, 3))
    driver.configure(robots=declared)
    receive(driver, *motors)
    messages = driver.samples()["robot_messages_total"].items()
    assert {dict(labels)["robot"]: n for labels, n in messages} == {"r1": 2, "r2": 2, "r3": 0}


def test_an_aggregate_shared_by_robots_is_complete_for_each_of_them():
    settings = Shared("/diagnostics_agg", raw=False)
    driver = StateDriver(fleet=Fleet("f", shared=(settings,)))
    r1, r2 = (Status(OK, f"Motor {n}", hardware_id=f"r{n}") for n in (1, 2))
    laser = Status(OK, "Laser", hardware_id="r1")
    receive(driver, *tree(Motor=[r1, r2], Laser=[laser]), topic="/diagnostics_agg")
    receive(driver, *tree(Motor=[r1, r2]), topic="/diagnostics_agg")

    assert driver.sample("component_level", robot="r1", component="Laser") == STALE
    assert driver.sample("component_level", robot="r1", component="Motor 1", group="/Motor") == OK
    assert driver.sample("component_level", robot="r2", component="Motor 2") == OK
    assert {level for level, _text in driver.state.robots["r1"].groups.values()} == {OK}


def test_a_robot_of_a_shared_topic_takes_nothing_from_another_topic():
    settings = (Shared("/diagnostics", raw=True), Shared("/hall/diagnostics", raw=True))
    driver = StateDriver(fleet=Fleet("f", shared=settings))
    receive(driver, Status(OK, "Motor", hardware_id="r1"))
    for _ in range(2):
        receive(driver, Status(ERROR, "Motor", hardware_id="r1"), topic="/hall/diagnostics")

    assert driver.sample("component_level", robot="r1", component="Motor") == OK
    assert driver.state.rejected["duplicate_robot"] == 1


# -- watching ----------------------------------------------------------------------------


class BetweenHolds:
    """The lock of a state; ``work`` is called whenever it was released, as another thread would."""

    def __init__(self, lock, work):
        self._lock, self._work, self._works = lock, work, False

    def __enter__(self):
        self._lock.acquire()

    def __exit__(self, *_error):
        self._lock.release()
        if not self._works:
            self._works = True
            self._work()
            self._works = False


def test_between_robots_that_follow_a_reload_others_have_the_lock():
    names = [f"r{n}" for n in range(3 * PASS_ON)]
    driver = StateDriver(fleet=raw_fleet(*names))
    softer = Profile(components=(ComponentRule(re.compile("Motor"), levels={ERROR: WARN}),))
    followed = []

    def receive():
        robots = driver.state.robots.values()
        followed.append(sum(each.settings.profile is softer for each in robots))
        for name in names:
            topic = Topic(0, f"/{name}/diagnostics")
            driver.state.receive(topic, Array(0.0, (HOT,), 1), driver.now)

    driver.state._lock = BetweenHolds(driver.state._lock, receive)
    driver.configure(raw_fleet(*names, profile=softer))

    assert sorted(set(followed)) == [PASS_ON, 2 * PASS_ON, 3 * PASS_ON]
    for robot in driver.state.robots.values():
        (motor,) = robot.components
        assert (motor.level, motor.reported) == (WARN, ERROR)


def test_what_is_discovered_while_a_reload_is_about_to_declare_it_follows_the_config():
    known = tuple(raw_robot(f"r{n}") for n in range(PASS_ON))
    driver = StateDriver(fleet=Fleet("f", known, discoveries=(BY_TOPIC,)))
    found = []

    def discover():
        driver.state.update_graph(0, {"/new/diagnostics": Endpoint(1)}, driver.now)
        found.append(driver.state.robots["new"])

    driver.state._lock = BetweenHolds(driver.state._lock, discover)
    profile = Profile(stale_after=77.0)
    new = raw_robot("new", profile=profile)
    driver.configure(Fleet("f", (*known, new), discoveries=(BY_TOPIC,)))

    robot = driver.state.robots["new"]
    assert found[0] is robot
    assert robot.declared
    assert robot.settings is new
    driver.receive("/new/diagnostics", HOT)
    assert driver.sample("robot_messages_total", robot="new") == 1


def test_what_is_watched_in_the_graph_follows_before_the_reload_ends():
    driver = StateDriver(graph=Graph(mode="on"))
    driver.state.update_nodes(0, [("driver", "/r")], driver.now)
    assert driver.state.accept_graph("r", driver.now) == 1

    driver.follow_profile(Profile(graph=Graph(mode="off")))
    with pytest.raises(LookupError):
        driver.state.accept_graph("r", driver.now)


def test_an_entry_that_a_reload_takes_out_is_not_reported_as_matching_nothing():
    wrong = Profile(components=(ComponentRule(re.compile("Mottor"), levels={ERROR: WARN}),))
    fleet = raw_fleet("r", profile=wrong)
    driver = StateDriver(fleet=dataclasses.replace(fleet, profiles={wrong.name: wrong}))
    for seconds in range(1, int(GRACE) + 60, 30):
        driver.at(seconds)
        driver.raw(LASER)
        driver.state.find_unmatched(driver.now)
    assert [each.entry for each in driver.state.unmatched.entries] == ["Mottor"]

    driver.configure(raw_fleet("r"))
    assert driver.state.unmatched.entries == ()


@pytest.mark.parametrize("source", [Source.AGG, Source.AUTO])
def test_a_robot_that_is_read_from_its_aggregator_from_now_on_is_judged_by_it(source):
    driver = StateDriver().raw_every(1, 5, HOT, LASER)

    driver.configure(StateDriver(source).state.fleet)
    driver.agg_every(1, 60, *tree(Motors=[HOT._replace(level=OK)]))
    assert {each.name: each.level for each in driver.robot.components} == {"Motor": OK}
    switched = [event.message for event in driver.events if event.kind == "graph"]
    assert switched == ["diagnostics are read from /r/diagnostics_agg in place of /r/diagnostics"]


def test_a_robot_that_is_read_from_its_drivers_from_now_on_has_no_groups():
    driver = StateDriver(Source.AGG).agg_every(1, 5, *tree(Motors=[HOT]))
    driver.configure(StateDriver(Source.RAW).state.fleet)
    assert driver.robot.groups == {}


def test_a_site_that_is_renamed_while_it_is_silent_is_one_fault_of_its_new_name():
    """Once that was a RECOVERY, and half of its robots were faults of their own."""
    names = [f"r{number}" for number in range(6)]

    def of(site: str) -> Fleet:
        return raw_fleet(*names, labels={"site": site})

    driver = StateDriver(fleet=of("hall"))
    for _ in driver.seconds(60):
        for name in names:
            driver.receive(f"/{name}/diagnostics", LASER)
    assert driver.at(150).fault_names() == {("site", "silent", "hall")}
    driver.configure(of("yard"))
    assert driver.at(170).fault_names() == {("site", "silent", "yard")}
    changes = [(each.kind, each.reason) for each in driver.events if each.kind.startswith("fault")]
    assert changes == [("fault_began", ""), ("fault_ended", "removed"), ("fault_began", "")]


@pytest.mark.parametrize("names", [("a", "b", "c"), ("b", "a", "c")])
def test_robots_that_change_their_places_are_counted_where_they_are_then(names):
    """Once one site had both silent robots until the second had followed, and was silent after."""

    def of_sites(**sites: str) -> Fleet:
        robots = [raw_robot(each, labels={"site": sites[each]}) for each in names]
        return Fleet("f", tuple(robots), faults=FaultSettings(site=CauseSettings(2, 0.5)))

    driver = StateDriver(fleet=of_sites(a="hall", b="dock", c="hall"))
    for each in names:
        driver.receive(f"/{each}/diagnostics", LASER)
    for _second in driver.seconds(60):
        driver.receive("/c/diagnostics", LASER)
    alone = {("robot", "silent", "a"), ("robot", "silent", "b")}
    assert driver.fault_names() == alone
    driver.configure(of_sites(a="dock", b="hall", c="dock"))
    for _second in driver.seconds(90):
        driver.receive("/c/diagnostics", LASER)
    assert driver.fault_names() == alone


PROFILE = """
fleet: f
profiles: {{default: {{{}}}}}
robots: [{{name: r, topic: /r/diagnostics, source: raw}}]
"""
SEES = "confirm_after: 10s, capabilities: {view: {any: [Left, Right]}, drive: [{capability: view}]}"
BLIND = "confirm_after: 0s, components: [{match: Left, ignore: true}, {match: Right, ignore: true}]"


@pytest.mark.parametrize("left", [WARN, ERROR])
@pytest.mark.parametrize("right", [OK, ERROR])
def test_what_goes_with_a_reload_does_not_begin_in_it(tmp_path, left, right):
    """Once what a capability was without its other part began and was removed at one time."""
    driver = StateDriver(fleet=load_text(tmp_path, PROFILE.format(SEES)))
    driver.stand(40, Status(OK, "Left"), Status(OK, "Right"))
    driver.stand(40, Status(left, "Left"), Status(right, "Right"))
    before = len(driver.events)
    driver.configure(load_text(tmp_path, PROFILE.format(BLIND)))
    driver.stand(5, Status(left, "Left"), Status(right, "Right"))
    kinds = {each.kind for each in driver.events[before:]}
    assert "fault_ended" in kinds
    assert "fault_began" not in kinds
