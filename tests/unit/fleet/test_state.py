"""Robots that are found, limited and dropped, and what of them the fleet shows."""

import re
from math import inf

import pytest

from ros_diagnostics_exporter.config.fleet import (
    Discovery,
    Fleet,
    Limits,
    Maintenance,
    Robot,
    Shared,
    Source,
)
from ros_diagnostics_exporter.fleet.registry import TIME_TO_PUBLISH
from ros_diagnostics_exporter.model import Array, Downtime, Endpoint, Stream, Topic
from ros_diagnostics_exporter.robots.limits import MAX_TEXT
from support.state_driver import HOT, MOTOR, WALL, StateDriver, tree

RAW = "/r/diagnostics"
BY_TOPIC = Discovery(
    re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics", source=Source.RAW
)


def look(driver: StateDriver, *robots: str) -> None:
    """Find the topics of these robots, each with a publisher."""
    endpoints = {f"/{name}/diagnostics": Endpoint(1) for name in robots}
    driver.state.update_graph(0, endpoints, driver.now)


def test_a_topic_of_another_type_counts_once_and_again_after_a_reload(caplog):
    wanted = Discovery(re.compile("/(?P<robot>[^/]+)/diagnostics"), "{robot}", source=Source.RAW)
    driver = StateDriver(fleet=Fleet("f"))
    others = {"/r/diagnostics": ("std_msgs/msg/String",), "/r/odom": ("nav_msgs/msg/Odometry",)}
    driver.state.note_other_types(0, others, driver.now)
    assert driver.state.rejected["wrong_type"] == 0
    driver.configure(Fleet("f", discoveries=(wanted,)))
    driver.state.note_other_types(0, {**others, "/s/odom": ()}, driver.now)
    assert driver.state.rejected["wrong_type"] == 1
    assert not driver.state.robots_over_limit
    assert caplog.text.count("another type, std_msgs/msg/String") == 1


# -- fleet --------------------------------------------------


def discovering(**more) -> StateDriver:
    discovery = Discovery(
        re.compile(r"/(?P<robot>[^/]+)/diagnostics_agg"), "/{robot}/diagnostics_agg", **more
    )
    return StateDriver(fleet=Fleet("f", discoveries=(discovery,)))


def test_a_robot_is_in_maintenance_from_the_moment_it_is_known():
    """Else a scrape after a restart would end the downtime, and the next begin it anew."""
    every = Maintenance("m", {"robot": (re.compile(".*"),)}, "always")
    found = Discovery(re.compile(r"/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    driver = StateDriver(fleet=Fleet("f", (Robot("r"),), (found,), maintenance=(every,)))
    driver.state.update_graph(0, {"/new/diagnostics": Endpoint(1)}, driver.now)

    assert driver.sample("robot_maintenance", robot="r") == 1
    assert driver.sample("robot_maintenance", robot="new") == 1


def test_a_downtime_of_many_robots_is_one_sample_for_each_site_with_its_end_and_robots():
    of_sites = Maintenance("floor", {"site": (re.compile("hall|yard"),)}, "new", start=WALL + 10)
    sites = ("hall", "hall", "yard", "lab")
    robots = tuple(Robot(f"r{n}", labels={"site": each}) for n, each in enumerate(sites))
    driver = StateDriver(fleet=Fleet("f", robots, maintenance=(of_sites,)))
    planned = [("", WALL + 20), ("Motor", WALL + 20), ("", WALL + 5)]
    downtimes = [Downtime("r0", part, WALL, end, "ann", "\u202ex") for part, end in planned]
    driver.state.plan(downtimes, driver.now)
    ann = {("\\u202ex", "hall", "r0", "ann"): WALL + 20}
    floor = {("floor", "hall", "r0, r1", ""): inf, ("floor", "yard", "r2", ""): inf}

    found = []
    for seconds in (2, 12, 22):
        samples = driver.at(seconds).samples().get("downtime_end_timestamp_seconds", {})
        found.append({_of_downtime(**dict(labels)): end for labels, end in samples.items()})
    assert found == [ann, ann | floor, floor]


def _of_downtime(
    downtime: str, site: str, robots: str, author: str = "", fleet: str = "f"
) -> tuple[str, ...]:
    assert fleet == "f"
    return downtime, site, robots, author


def test_a_downtime_of_many_robots_names_the_first_five_of_them():
    robots = tuple(Robot(f"r{number}") for number in range(8))
    every = Maintenance("m", {"robot": (re.compile(".*"),)}, "always", end=WALL + 60)
    weekly = Maintenance("m", {"robot": (re.compile("r7"),)}, "later", end=WALL + 90)
    driver = StateDriver(fleet=Fleet("f", robots, maintenance=(every, weekly)))

    [(labels, end)] = driver.samples()["downtime_end_timestamp_seconds"].items()
    assert dict(labels)["robots"] == "r0, r1, r2, r3, r4 and 3 more"
    assert end == WALL + 90  # the later of two of one name


def test_a_robot_is_discovered_by_its_topic_and_wants_both_of_its_topics():
    driver = discovering()
    driver.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(1)}, driver.now)

    assert driver.state.wanted_topics(0) == {"/r/diagnostics_agg": False, "/r/diagnostics": False}
    assert driver.agg(*tree(Motor=[MOTOR])).sample("robot_up", robot="r") == 1
    assert driver.state.wanted_topics(0) == {"/r/diagnostics_agg": False}


def test_the_addresses_are_those_of_the_config_and_empty_without_one():
    robots = (Robot("r", address="10.0.0.1"), Robot("s"))
    state = StateDriver(fleet=Fleet("f", robots)).state
    assert state.addresses() == {"r": "10.0.0.1", "s": ""}


def test_a_topic_without_publisher_is_no_robot():
    driver = discovering()
    driver.state.update_graph(0, {"/r/diagnostics_agg": Endpoint(0)}, driver.now)

    assert not driver.state.robots


@pytest.mark.parametrize(
    ("domain_id", "robot", "is_found"),
    [
        (0, "r1", True),
        (7, "r1", True),
        (1, "r1", False),
        pytest.param(0, "r9", False, id="excluded"),
        pytest.param(0, "r1b", False, id="only a part of its name is included"),
    ],
)
def test_a_discovery_finds_the_robots_of_its_domains_that_it_includes(domain_id, robot, is_found):
    only = {"include": (re.compile("r[0-9]"),), "exclude": (re.compile("r9"),)}
    driver = discovering(domain_ids=(0, 7), **only)
    topic = f"/{robot}/diagnostics_agg"
    driver.state.update_graph(domain_id, {topic: Endpoint(1)}, driver.now)

    assert bool(driver.state.robots) is is_found


def test_the_reason_of_silence_follows_the_graph():
    driver = StateDriver(stale_after=5.0)

    def graph(**endpoint) -> None:
        endpoints = {RAW: Endpoint(1, **endpoint)} if driver.now.mono < 10 else {}
        driver.state.update_graph(0, endpoints, driver.now)

    graph()
    assert driver.robot.silent_reason == "mute"
    graph(wrong_type="std_msgs/msg/String")
    assert driver.robot.silent_reason == "wrong_type"
    graph()
    assert driver.raw(MOTOR).robot.silent_reason is None
    driver.at(10)
    graph()
    assert driver.robot.silent_reason == "publisher_gone"
    driver.state.reject_undecodable(Topic(0, RAW), "bad bytes", driver.now)
    assert driver.robot.silent_reason == "undecodable"
    driver.state.domain_failed(0, "broken", driver.now)
    assert driver.robot.silent_reason == "domain_unreachable"
    shown = {
        dict(labels)["reason"]: v for labels, v in driver.samples()["robot_silent_reason"].items()
    }
    assert shown == {"domain_unreachable": 1}


def test_the_graph_of_one_domain_says_nothing_of_another():
    here, there = (
        Robot(name, domain_id=domain_id, topic_raw="/diagnostics", source=Source.RAW)
        for name, domain_id in (("here", 0), ("there", 1))
    )
    driver = StateDriver(fleet=Fleet("f", (here, there)))
    driver.state.update_graph(0, {"/diagnostics": Endpoint(2)}, driver.now)
    driver.state.update_graph(1, {}, driver.now)

    assert driver.sample("robot_publishers", robot="here") == 2
    assert driver.sample("robot_publishers", robot="there") == 0


# -- limits --------------------------------------------------


def test_more_robots_than_the_limit_are_refused_and_counted():
    fleet = Fleet("f", tuple(Robot(f"r{n}") for n in range(3)), limits=Limits(robots=2))
    driver = StateDriver(fleet=fleet)

    assert len(driver.state.robots) == 2
    assert driver.state.rejected["robot_limit"] == 1
    assert driver.sample("robot_silent_reason", robot="r2", reason="limit") == 1

    driver.configure(Fleet("f", fleet.robots[1:], limits=Limits(robots=2)))
    assert set(driver.state.robots) == {"r1", "r2"}
    assert driver.sample("robot_silent_reason", reason="limit") is None


# -- robots that never publish --------------------------------------------------


def crowded(limit: int) -> StateDriver:
    return StateDriver(fleet=Fleet("f", discoveries=(BY_TOPIC,), limits=Limits(robots=limit)))


def test_a_robot_that_never_published_gives_way_once_it_had_time_to():
    driver = crowded(2)
    look(driver, "mute", "r")
    driver.raw(MOTOR)
    for seconds in (1, TIME_TO_PUBLISH - 1):
        driver.at(seconds)
        look(driver, "mute", "r", "new")
        assert set(driver.state.robots) == {"mute", "r"}

    driver.at(TIME_TO_PUBLISH)
    look(driver, "mute", "r", "new")
    assert set(driver.state.robots) == {"r", "new"}
    look(driver, "mute", "r", "new")
    assert driver.sample("robot_silent_reason", robot="mute", reason="limit") == 1
    assert driver.sample("robot_silent_reason", robot="new", reason="limit") is None


def test_a_robot_that_published_never_gives_way():
    driver = crowded(1)
    look(driver, "r")
    driver.raw(MOTOR)
    driver.now = driver.now._replace(mono=100_000.0)
    look(driver, "r", "new")
    assert set(driver.state.robots) == {"r"}


def test_every_robot_that_waits_has_its_turn():
    """However many only announce their topic, and however their names are sorted."""
    driver = crowded(5)
    mute = [f"a{n}" for n in range(20)]
    seen = set()
    for turn in range(1, 8):
        look(driver, *mute, "z")
        seen |= driver.state.robots.keys()
        if "z" in driver.state.robots:
            break
        driver.at(turn * TIME_TO_PUBLISH)
    assert seen == {*mute, "z"}


def test_a_declared_robot_needs_not_wait():
    driver = crowded(1)
    look(driver, "mute")
    driver.configure(robots=(Robot("r", topic_raw=RAW),))
    assert set(driver.state.robots) == {"r"}


def test_what_is_received_is_recorded_as_it_came():
    driver = StateDriver()
    recorded = []
    driver.state.recorder = lambda *message: recorded.append(message)
    topic, array = Topic(0, "/r/diagnostics"), Array(0.0, (HOT,), 3, b"raw")
    driver.state.receive(topic, array, driver.now)

    assert recorded == [(Stream(topic), b"raw", driver.now)]
    assert set(driver.state.topics_of("r")) == {topic, Topic(0, "/r/diagnostics_agg")}
    assert driver.state.topics_of("nobody") == ()


def test_long_texts_are_cut_and_counted_and_others_are_not():
    driver = StateDriver()
    for length in (MAX_TEXT, MAX_TEXT + 1):
        status = MOTOR._replace(message="x" * length)
        driver.state.receive(Topic(0, RAW), Array(0.0, (status,), length + 100), driver.now)
        rejected = driver.sample("robot_rejected_total", reason="label_length") or 0
        assert rejected == (length > MAX_TEXT)
        assert len(driver.component("Motor 1").last.message) == MAX_TEXT


def test_messages_that_are_dropped_count_for_the_robot_of_the_topic_or_for_nobody():
    robot = Robot("r", topic_raw=RAW, source=Source.RAW)
    shared = Shared("/diagnostics", raw=True)
    driver = StateDriver(fleet=Fleet("f", (robot, Robot("s")), shared=(shared,)))
    driver.receive(shared.topic, HOT._replace(hardware_id="of_the_shared_one"))
    driver.state.reject_dropped(Topic(0, RAW), 3)
    driver.state.reject_dropped(Topic(1, RAW), 4)  # another domain
    driver.state.reject_dropped(Topic(0, shared.topic), 5)

    assert driver.sample("robot_rejected_total", robot="r", reason="rate") == 3
    assert [each.rejected["rate"] for each in driver.state.robots.values()] == [3, 0, 0]
    assert driver.state.rejected["rate"] == 5
