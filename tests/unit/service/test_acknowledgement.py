"""Which silences are acknowledgements of a fleet, and what of them is shown."""

from __future__ import annotations

import copy
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from prometheus_client.parser import text_string_to_metric_families

from ros_diagnostics_exporter import alertmanager
from ros_diagnostics_exporter.alertmanager import clean, moment, read
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import Status
from support.silences import BEGAN, MOTOR, listed
from support.state_driver import ERROR, StateDriver


def test_what_the_command_makes_is_read():
    assert read([listed()], "f") == [MOTOR]


def test_a_silent_robot_has_no_component():
    (found,) = read([listed(component=None)], "f")

    assert (found.robot, found.group, found.component, found.state) == ("r", "", "", "")
    assert found.since == BEGAN


@pytest.mark.parametrize(
    "other",
    [
        listed(labels={"fleet": "g"}),
        listed(status={"state": "expired"}),
        listed(status={"state": "pending"}),
        listed(since="yesterday"),
        listed(robot="r" * 2000),
        listed(component="\ud800"),
        listed(startsAt="soon"),
        listed(matchers=[{"name": "robot", "value": "r", "isRegex": False, "isEqual": True}]),
        listed(matchers=[each for each in listed()["matchers"] if each["name"] != "since"]),
        listed(matchers=[each | {"isRegex": True} for each in listed()["matchers"]]),
        listed(matchers=[each | {"isEqual": False} for each in listed()["matchers"]]),
        listed(
            matchers=[
                *listed()["matchers"],
                {"name": "step", "value": "1", "isRegex": False, "isEqual": True},
            ]
        ),
    ],
    ids=str,
)
def test_other_silences_are_passed_over(other):
    assert read([other, listed()], "f") == [MOTOR]


def test_of_several_for_one_component_the_newest_holds():
    """The old one is for an earlier fault; it goes on being in force for days."""
    old = listed(since="2025-12-01 10:00:00 +0000 UTC", startsAt="2025-12-01T10:05:00.250Z")

    assert read([listed(), old], "f") == read([old, listed()], "f") == [MOTOR]


def test_no_more_are_kept_than_a_fleet_can_have(monkeypatch):
    monkeypatch.setattr(alertmanager, "MOST", 3)
    many = [
        listed(component=f"Motor {number}", startsAt=f"2026-01-01T10:{number:02}:00.000Z")
        for number in range(10)
    ]

    assert {each.component for each in read(many, "f")} == {"Motor 7", "Motor 8", "Motor 9"}


@pytest.mark.parametrize("answer", [None, {}, "silences", 7, True])
def test_an_answer_that_is_no_list_is_none_of_alertmanagers(answer):
    with pytest.raises(ValueError, match="no list of silences"):
        read(answer, "f")


JSON = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=5,
)


@given(st.data())
def test_whatever_stands_in_a_silence_hurts_nobody(data):
    broken = copy.deepcopy(listed())
    where = data.draw(st.sampled_from(sorted(broken)))
    broken[where] = data.draw(JSON)

    found = read([broken, data.draw(JSON), listed()], "f")

    assert MOTOR in found or where in {"createdBy", "comment", "startsAt", "endsAt"}


@pytest.mark.parametrize(
    ("text", "unix"),
    [
        ("2026-01-01 10:00:00 +0000 UTC", 1767261600),
        ("2026-01-01 10:00:00.5 +0000 UTC", 1767261600.5),
        ("2026-01-01T10:00:00Z", 1767261600),
        ("2026-01-01T10:00:00.123456789Z", 1767261600.123456),
        ("2026-01-01T11:00:00.000+01:00", 1767261600),
    ],
)
def test_moments_are_read_as_rules_and_alertmanager_write_them(text, unix):
    assert math.isclose(moment(text), unix, abs_tol=1e-6)


def test_words_become_one_printable_line_of_bounded_length():
    assert clean("  two\nlines\tand \x1b[31mred\u202e ", 100) == "two lines and [31mred"
    assert clean("x" * 500, 10) == "x" * 9 + "…"
    assert clean("\ud800é", 10) == "é"


def test_those_of_known_robots_are_served():
    driver = StateDriver()
    driver.raw(Status(ERROR, "Motor 1"))
    stranger = MOTOR._replace(robot="stranger")
    hostile = MOTOR._replace(component='"} 1\nx{a="', comment='say "no" \\ more')
    exposition = Exposition(driver.state, lambda: [MOTOR, stranger, hostile])

    samples = [
        (sample.name.removeprefix("ros_diagnostics_acknowledged_"), sample.labels, sample.value)
        for family in text_string_to_metric_families(exposition.render().decode())
        for sample in family.samples
        if "acknowledged" in sample.name
    ]

    fault = {"fleet": "f", "robot": "r", "group": "/Motor", "state": "critical"}
    words = {"author": "ann"}
    assert samples == [
        (
            "timestamp_seconds",
            fault | words | {"component": "Motor 1", "comment": MOTOR.comment},
            MOTOR.at,
        ),
        (
            "timestamp_seconds",
            fault | words | {"component": hostile.component, "comment": hostile.comment},
            MOTOR.at,
        ),
        ("since_timestamp_seconds", fault | {"component": "Motor 1"}, BEGAN),
        ("since_timestamp_seconds", fault | {"component": hostile.component}, BEGAN),
    ]
    assert sum(exposition.series.values()) == exposition.render().count(b"\n") - sum(
        line.startswith(b"#") for line in exposition.render().splitlines()
    )
