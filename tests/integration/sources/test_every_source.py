"""What every source of topics does, whichever way they come: order, silence, reload, limits."""

from collections.abc import Iterator
from dataclasses import dataclass

import pytest
from std_msgs.msg import String

from ros_diagnostics_exporter.config.fleet import Fleet, Limits, Profile, Robot, Zenoh
from ros_diagnostics_exporter.config.keys import validated
from ros_diagnostics_exporter.model import ALL_PARTS, Status
from support.recordings import CASES, aggregated
from support.ros_publisher import Publisher, publisher
from support.zenoh_robots import Bridge
from testbed.polling import until

COOL, HOT = Status(0, "Motor", "OK"), Status(2, "Motor", "Hot")
QUICK = Profile(stale_after=1.0)
# Families whose samples say when, or by which way, something was received, and how often in a time.
OF_THE_WAY = (
    *("timestamp", "exporter_", "robot_info", "clock_offset", "canary", "interval"),
    *("silent_reason", "flap_ratio", "fault_", "robot_link_", "expected_nodes", "week_"),
)


@dataclass
class Way:
    """One way by which topics come."""

    robots: Publisher | Bridge
    domain: dict[str, object]  # of a robot in fleet.yml
    text: object  # the type of a text
    zenoh: Zenoh | None = None

    def robot(self, name: str, profile: Profile = QUICK, source: str = "raw") -> Robot:
        made = {"name": name, "namespace": f"/{name}", "source": source, **self.domain}
        return validated(Robot, made, {"default": profile})

    def fleet(self, *robots: Robot) -> Fleet:
        return Fleet("f", robots, zenoh=self.zenoh)


@pytest.fixture
def by_dds(ros_domain) -> Iterator[Way]:
    with publisher(ros_domain) as robots:
        yield Way(robots, {"domain_id": ros_domain}, String)


@pytest.fixture
def by_zenoh(router, bridge) -> Way:
    return Way(bridge, {"zenoh": "/"}, "std_msgs/msg/String", Zenoh((router.locator,)))


@pytest.fixture(params=["by_dds", "by_zenoh"])
def way(request) -> Way:
    return request.getfixturevalue(request.param)


def offer(way: Way, *names: str) -> None:
    for name in names:
        way.robots.offer(f"/{name}/diagnostics")
    way.robots.wait_for_listeners()


def test_what_was_sent_last_counts_and_the_same_twice_is_received_twice(way, run_exporter):
    running = run_exporter(way.fleet(way.robot("r")))
    offer(way, "r")

    for number in range(50):
        way.robots.send("/r/diagnostics", HOT._replace(message=f"{number}"))
    for _ in range(2):
        way.robots.send("/r/diagnostics", COOL._replace(message="last"))

    running.wait_for("robot_messages_total", 52, robot="r")
    [component] = running.service.state.robots["r"].components
    assert (component.level, component.message) == (0, "last")
    assert not any(running.samples("robot_rejected_total").values())


def test_silence_has_its_reason_and_a_restart_of_the_publisher_ends_it(way, run_exporter):
    running = run_exporter(way.fleet(*map(way.robot, ("r", "never", "typed"))))
    offer(way, "r")
    way.robots.offer("/typed/diagnostics", kind=way.text)
    way.robots.send("/r/diagnostics", HOT)
    running.wait_for("robot_up", 1, robot="r")
    running.wait_for("robot_silent_reason", 1, robot="never", reason="never_seen")
    running.wait_for("robot_silent_reason", 1, robot="typed", reason="wrong_type")
    way.robots.withdraw("/typed/diagnostics")

    running.wait_for("robot_silent_reason", 1, robot="r", reason="mute")
    way.robots.withdraw("/r/diagnostics")
    running.wait_for("robot_silent_reason", 1, robot="r", reason="publisher_gone")
    assert running.sample("component_level", robot="r", component="Motor") == 3

    offer(way, "r")
    way.robots.send("/r/diagnostics", COOL)
    running.wait_for("robot_up", 1, robot="r")

    def is_cool() -> bool:  # once the graph has shown that who said HOT did not come back
        way.robots.send("/r/diagnostics", COOL)
        return running.sample("component_level", robot="r", component="Motor") == 0

    until(is_cool, "the new publisher is believed")


def test_a_reload_leaves_what_it_does_not_change_and_takes_the_rest_out(way, run_exporter):
    stays, goes, comes = (way.robot(name) for name in ("stays", "goes", "comes"))
    running = run_exporter(way.fleet(stays, goes))
    offer(way, "stays", "goes")
    for name in ("stays", "goes"):
        way.robots.send(f"/{name}/diagnostics", HOT)
        running.wait_for("robot_messages_total", 1, robot=name)

    running.service.reloader.configure(way.fleet(stays, comes))
    until(lambda: not way.robots.listeners("/goes/diagnostics"), "the old topic is left")
    offer_new = "/comes/diagnostics"
    way.robots.offer(offer_new)
    until(lambda: way.robots.listeners(offer_new), "the new topic is subscribed")
    for name in ("stays", "goes", "comes"):
        way.robots.send(f"/{name}/diagnostics", HOT)

    running.wait_for("robot_messages_total", 1, robot="comes")
    running.wait_for("robot_messages_total", 2, robot="stays")
    assert "goes" not in running.service.state.robots


def test_beyond_the_queue_the_newest_is_received_and_the_rest_is_counted(
    way, run_exporter, monkeypatch, caplog
):
    monkeypatch.setattr("ros_diagnostics_exporter.decode.cdr.MAX_MESSAGES", 3)
    running = run_exporter(way.fleet(way.robot("flood"), way.robot("calm")))
    offer(way, "flood", "calm")

    for _ in range(299):
        way.robots.send("/flood/diagnostics", HOT)
    way.robots.send("/flood/diagnostics", COOL._replace(message="newest"))
    way.robots.send("/calm/diagnostics", COOL)

    running.wait_for("robot_up", 1, robot="calm")

    def all_known() -> bool:
        received = running.sample("robot_messages_total", robot="flood") or 0
        dropped = running.sample("robot_rejected_total", robot="flood", reason="rate") or 0
        return received + dropped == 300

    until(all_known, "each message is received or counted")
    [component] = running.service.state.robots["flood"].components
    assert component.message == "newest"
    assert "/flood/diagnostics: more arrives than is decoded" in caplog.text


@pytest.mark.parametrize(
    "data",
    [
        b"",
        b"\x00",
        b"\x00\x01\x00\x00" + b"\xff" * 24,
        b"\x00\x01\x00\x00" + b"m" * Limits().message_bytes,
    ],
    ids=["empty", "one byte", "lies about its length", "too long"],
)
def test_bytes_that_are_no_message_are_counted_and_harm_no_other(way, run_exporter, data):
    running = run_exporter(way.fleet(way.robot("bad"), way.robot("good")))
    offer(way, "bad", "good")

    if data or isinstance(way.robots, Bridge):  # DDS sends no message without bytes
        way.robots.send_bytes("/bad/diagnostics", data)
        running.wait_for("robot_rejected_total", 1, robot="bad", reason="undecodable")
        running.wait_for("robot_silent_reason", 1, robot="bad", reason="undecodable")
    way.robots.send("/good/diagnostics", HOT)
    running.wait_for("component_level", 2, robot="good")

    way.robots.send("/bad/diagnostics", COOL)
    running.wait_for("robot_up", 1, robot="bad")


def test_texts_that_try_to_be_something_else_are_texts(way, run_exporter):
    running = run_exporter(way.fleet(way.robot("r")))
    offer(way, "r")
    name = '"} 1\nros_diagnostics_robot_up{robot="other"} 1 <script>'

    way.robots.send("/r/diagnostics", Status(7, name, "\x1b[31m", name, ((name, name),)))

    running.wait_for("component_level", 2, robot="r")
    [(labels, _level)] = running.samples("component_level").items()
    assert dict(labels)["component"] == name
    assert running.sample("robot_up", robot="other") is None
    assert running.sample("robot_rejected_total", robot="r", reason="bad_level") == 1


def test_the_same_recordings_give_the_same_metrics(by_dds, by_zenoh, run_exporter):
    recorded = [case for case in CASES if aggregated(case)]
    patient = Profile(stale_after=300.0)
    found = []
    for way in (by_dds, by_zenoh):
        running = run_exporter(way.fleet(*(way.robot(each, patient, "agg") for each in recorded)))
        for case in recorded:
            way.robots.offer(f"/{case}/diagnostics_agg")
        way.robots.wait_for_listeners()
        for case in recorded:
            for _t, array in aggregated(case):
                way.robots.send(f"/{case}/diagnostics_agg", *array.statuses)
        for case in recorded:
            running.wait_for("robot_messages_total", len(aggregated(case)), robot=case)
        running.wait_for("robot_publishers", 1, robot=recorded[0])
        found.append(of_robots(running))

    assert len(found[0]) > 1000
    assert found[0] == found[1]


def of_robots(running) -> set[str]:
    """The lines of /metrics that say what was received."""
    pieces = running.service.render_metrics(openmetrics=False, parts=ALL_PARTS)
    lines = b"".join(pieces).decode().splitlines()
    kept = (line for line in lines if line.startswith("ros_diagnostics_"))
    return {line for line in kept if not any(each in line.partition("{")[0] for each in OF_THE_WAY)}
