"""Recordings are judged as the running exporter judges what it receives."""

import re

import pytest

from ros_diagnostics_exporter.config.conditions import Condition
from ros_diagnostics_exporter.config.fleet import ComponentRule, Discovery, Fleet, Robot, Source
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.regex import Pattern
from support.bags import BEGIN, TOPIC, every_second, fleet, judged, texts, write_bag, write_json


@pytest.fixture
def replayed(tmp_path):
    """What comes of a robot that is recorded in these seconds, with these outages."""

    def replayed(seconds, outages, of=None, storage="sqlite3", topic=TOPIC, **how):
        rows = every_second(seconds, outages, topic=topic)
        return judged(of or fleet(), write_bag(tmp_path / "bag", rows, storage), **how)

    return replayed


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_a_bag_gives_its_faults_with_begin_and_end(replayed, storage):
    outages = {"motor": range(40, 90), "laser": range(150, 200)}
    result = replayed(range(200), outages, storage=storage)

    assert texts(result) == ["40 50 90 motor critical", "150 160 lasts laser critical"]
    assert (result.messages, result.robots, result.unknown) == (200, ("r",), ())
    assert (result.begin, result.end) == (BEGIN, BEGIN + 199)


def test_what_is_over_before_it_is_confirmed_is_a_short_outage(replayed):
    result = replayed(range(100), {"motor": [40, 41, 42]})

    assert result.notifications == []
    (outage,) = result.outages
    assert (outage.component, outage.worst, outage.verdict) == ("motor", "ERROR", "short")
    assert (outage.begin, outage.end) == (BEGIN + 40, BEGIN + 43)


def test_an_outage_is_as_bad_as_its_worst_level(tmp_path):
    levels = [0, 1, 2, 1, 0]
    rows = [(float(n), TOPIC, (Status(each, "motor"),)) for n, each in enumerate(levels)]
    (outage,) = judged(fleet(), write_bag(tmp_path / "bag", rows)).outages
    assert (outage.worst, outage.seconds) == ("ERROR", 3)


def test_what_is_in_trouble_from_the_first_message_on_is_an_outage(replayed):
    found = replayed(range(60), {"motor": range(45), "arm": [0, 1]}).outages

    assert [(each.component, each.seconds, each.verdict) for each in found] == [
        ("arm", 2, "short"),
        ("motor", 45, "notified"),
    ]


def test_a_silent_robot_is_notified_and_its_components_are_not(replayed):
    result = replayed([*range(60), *range(120, 200)], {"motor": []})

    assert texts(result) == ["59 79.25 120 r silent"]
    (outage,) = [each for each in result.outages if each.worst == "silent"]
    assert (outage.robot, outage.component, outage.verdict) == ("r", "", "notified")
    assert (outage.begin, outage.end) == (BEGIN + 59, BEGIN + 120)


def test_between_two_recordings_nothing_is_known(tmp_path):
    """As while the exporter is stopped: the fault goes on, and the pause is no silence."""
    first = write_bag(tmp_path / "1", every_second(range(60), {"motor": range(40, 60)}))
    second = write_bag(
        tmp_path / "2", every_second(range(1000, 1100), {"motor": range(1000, 1050)})
    )

    assert texts(judged(fleet(), second, first)) == ["40 50 1050 motor critical"]


def test_a_declared_robot_that_was_not_recorded_is_not_missed(replayed):
    other = Robot("other", topic_raw="/other/diagnostics", source=Source.RAW)
    of_two = Fleet("f", (*fleet().robots, other))

    assert texts(replayed(range(2000), {"motor": []}, of_two)) == []


def test_robots_are_discovered_in_a_recording(replayed):
    discovery = Discovery(re.compile("/(?P<robot>[^/]+)/diagnostics"), "/{robot}/diagnostics")
    discovering = Fleet("f", discoveries=(discovery,))

    result = replayed(range(100), {"motor": range(40, 90)}, discovering)

    assert result.robots == ("r",)
    assert texts(result) == ["40 50 90 motor critical"]


def test_topics_of_no_robot_are_named(replayed):
    result = replayed(range(10), {"motor": []}, topic="/diagnostics")

    assert (result.messages, result.unknown) == (0, ("/diagnostics",))


def test_what_was_recorded_on_a_robot_is_put_below_its_namespace(replayed):
    outages = {"motor": range(40, 90)}
    result = replayed(range(100), outages, topic="/diagnostics", namespace="/r")
    assert texts(result) == ["40 50 90 motor critical"]


def test_a_condition_is_judged_as_by_the_running_exporter(tmp_path):
    rows = every_second(range(120), {"motor": range(40, 90), "brake": range(40, 70)})
    brake = Condition("brake is ERROR", (Pattern("brake"),), levels=(2,))
    rule = ComponentRule(Pattern("motor"), unless=(brake,))

    result = judged(fleet(components=(rule,)), write_json(tmp_path / "recording.json", rows))

    assert texts(result) == ["40 50 70 brake critical", "70 80 90 motor critical"]
    (outage,) = [each for each in result.outages if each.component == "motor"]
    assert (outage.begin, outage.end) == (BEGIN + 40, BEGIN + 90)
    assert outage.verdict == "notified"

    always = ComponentRule(Pattern("motor"), when=(brake,))
    result = judged(fleet(components=(always,)), tmp_path / "recording.json")
    assert texts(result) == ["40 50 70 brake critical", "40 50 70 motor critical"]


def test_what_a_condition_suppresses_all_the_time_is_counted_so(tmp_path):
    rows = every_second(range(120), {"motor": range(40, 90), "brake": []})
    brake = Condition("brake is OK", (Pattern("brake"),), levels=(0,))
    rule = ComponentRule(Pattern("motor"), unless=(brake,))

    result = judged(fleet(components=(rule,)), write_json(tmp_path / "recording.json", rows))

    assert texts(result) == []
    assert [each.verdict for each in result.outages] == ["suppressed"]
