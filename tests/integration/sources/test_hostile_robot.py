"""A robot that sends what no robot should, over real DDS, harms no other."""

import pytest
from rich.console import Console

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.config.fleet import Fleet, Limits, Robot, Shared, Source
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.web.pages import landing
from ros_diagnostics_tools.commands.status import view

EVIL = "/bad/diagnostics"


@pytest.fixture
def running(ros_domain, robots, run_exporter):
    """An exporter with a hostile robot and a good one."""
    fleet = Fleet(
        "f",
        tuple(
            Robot(name, ros_domain, topic_raw=f"/{name}/diagnostics", source=Source.RAW)
            for name in ("bad", "good")
        ),
        limits=Limits(message_bytes=16 << 20),
    )
    started = run_exporter(fleet)
    for robot in fleet.robots:
        robots.offer(robot.topic_raw)
    robots.wait_for_listeners()
    return started


def test_ten_thousand_components_and_texts_without_end_are_bounded(running, robots, caplog):
    """Some megabytes in one message: what does not fit is counted, and logged once by reason."""
    long = tuple(("key " * 100_000, "1" * 100_000) for _ in range(3))
    flood = [Status(2, f"Part {number}", "broken", "", ()) for number in range(10_000)]
    for number in (1, 2):
        robots.send(EVIL, *flood, Status(2, "Long " * 100_000, "m" * 1_000_000, "", long))
        running.wait_for("robot_messages_total", number, robot="bad")
    robots.send("/good/diagnostics", Status(0, "Motor"))

    running.wait_for("component_level", 0, robot="good", component="Motor")
    levels = [labels for labels in running.samples("component_level") if ("robot", "bad") in labels]
    assert len(levels) == Limits().components
    assert running.sample("robot_rejected_total", robot="bad", reason="label_length") == 2
    logged = [each.message for each in caplog.records if each.message.startswith("robot 'bad'")]
    assert len(logged) == 2
    assert max(map(len, logged)) < 300


def test_robots_of_a_shared_topic_with_digits_of_any_script_are_on_the_page(
    ros_domain, robots, run_exporter
):
    names = ["robot_10", "robot_2", "robot\u00b2", "\u0663robot", "\u0663"]
    running = run_exporter(Fleet("f", shared=(Shared("/diagnostics", True, ros_domain),)))
    robots.offer("/diagnostics")
    robots.wait_for_listeners()
    robots.send("/diagnostics", *(Status(2, "\u202erotoM", "hot\u2066", name) for name in names))

    running.wait_for("component_level", 2, robot="robot\u00b2", component="\u202erotoM")
    known = {dict(labels)["robot"] for labels in running.samples("robot_up")}
    assert known == set(names)
    fleet = fleet_snapshot(running.service.state, read_clocks())
    page = landing(fleet, "/metrics")
    assert page.replace("\n", "").isprintable()
    assert r"\u202erotoM" in page
    assert r"hot\u2066" in page
    assert page.rindex("robot_2") < page.rindex("robot_10")
    console = Console(width=200)
    with console.capture() as captured:
        console.print(view(fleet))
    assert "\u0663robot" in captured.get()
