"""Which silences are acknowledgements of a fleet, and what of them is shown."""

import math
from dataclasses import replace

import pytest
from prometheus_client.parser import text_string_to_metric_families

from ros_diagnostics_exporter import silences
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.faults.model import Fault, State
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.exposition import Exposition, FaultText
from ros_diagnostics_exporter.model import Part, Status
from ros_diagnostics_exporter.silences import IDENTITY, clean, identity_of, moment
from support.as_listed import read
from support.silences import BEGAN, FAULT, LABELS, MOTOR, listed
from support.state_driver import ERROR, OK, WALL, StateDriver


def test_what_the_command_makes_is_read():
    assert read([listed()], "f") == [MOTOR]


def matcher(name: str, value: str) -> dict:
    return {"name": name, "value": value, "isRegex": False, "isEqual": True}


ROBOT = {"scope": "robot", "state": "silent", "group": "", "component": ""}
SITE = ROBOT | {"scope": "site", "site": "hall", "robot": ""}
VALUE = {"scope": "value", "key": "Voltage", "bound": "low"}
CHECK = ROBOT | {"scope": "check", "state": "critical", "check": "motors"}


@pytest.mark.parametrize("labels", [ROBOT, SITE, VALUE, CHECK], ids=lambda each: each["scope"])
def test_a_fault_of_any_kind_is_named_by_its_identity(labels):
    (found,) = read([listed(labels=labels)], "f")

    assert found == MOTOR._replace(fault=identity_of(LABELS | labels))


@pytest.mark.parametrize(
    "other",
    [
        listed(labels={"fleet": "g"}),
        listed(status={"state": "expired"}),
        listed(status={"state": "pending"}),
        listed(since="yesterday"),
        listed(labels={"robot": "r" * 2000}),
        listed(labels={"component": "\ud800"}),
        listed(startsAt="soon"),
        listed(matchers=[{"name": "robot", "value": "r", "isRegex": False, "isEqual": True}]),
        *(
            listed(matchers=[each for each in listed()["matchers"] if each["name"] != name])
            for name in ("alertname", "fleet", "scope", "state", "since")
        ),
        listed(matchers=[*listed()["matchers"], matcher("robot", "r2")]),
        listed(matchers=[each | {"isRegex": True} for each in listed()["matchers"]]),
        listed(matchers=[each | {"isEqual": False} for each in listed()["matchers"]]),
        listed(matchers=[*listed()["matchers"], matcher("step", "1")]),
        listed(matchers=[*listed()["matchers"], matcher("team", "blue")]),
        listed(matchers=[*listed()["matchers"], matcher("of", "RosDiagnosticsExporterDown")]),
    ],
    ids=str,
)
def test_other_silences_are_passed_over(other):
    assert read([other, listed()], "f") == [MOTOR]


def test_the_newest_come_last():
    old = listed(since="2025-12-01 10:00:00 +0000 UTC", startsAt="2025-12-01T10:05:00.250Z")
    first, last = read([listed(), old], "f")

    assert (first, last) == (first, MOTOR)
    assert first.at < last.at
    assert read([old, listed()], "f") == [first, last]


def test_no_more_are_kept_than_a_fleet_can_have(monkeypatch):
    monkeypatch.setattr(silences, "MOST", 3)
    many = [
        listed(
            labels={"component": f"Motor {number}"}, startsAt=f"2026-01-01T10:{number:02}:00.000Z"
        )
        for number in range(10)
    ]

    found = [each.fault[IDENTITY.index("component")] for each in read(many, "f")]
    assert found == ["Motor 7", "Motor 8", "Motor 9"]


@pytest.mark.parametrize("answer", [None, {}, "silences", 7, True])
def test_an_answer_that_is_no_list_is_none_of_alertmanagers(answer):
    with pytest.raises(ValueError, match="no list of silences"):
        read(answer, "f")


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


def fault(since: float = BEGAN, labels: dict[str, str] | None = None, **identity: str) -> Fault:
    """The fault of LABELS."""
    of = FAULT.identity._replace(**identity)
    return replace(FAULT, identity=of, since=since, labels=labels or {})


def served(faults, acknowledgements, text=None, exporter="") -> list[tuple[dict[str, str], float]]:
    """Labels and value of every acknowledgement that a scrape shows."""
    fleet = Fleet("f", exporter=exporter)
    rendered = (text or FaultText()).render(fleet, faults, acknowledgements=acknowledgements)
    text = rendered[metrics.FAULT_ACKNOWLEDGED.name].decode()
    assert all(line.startswith(metrics.FAULT_ACKNOWLEDGED.name) for line in text.splitlines())
    return [
        ({name: text for name, text in sample.labels.items() if name != "fault"}, sample.value)
        for family in text_string_to_metric_families(text)
        for sample in family.samples
    ]


def test_a_fault_that_lasts_is_served_with_its_acknowledgement():
    words = {"author": "ann", "comment": "spare part ordered"}
    assert served([fault()], [MOTOR]) == [(LABELS | words, MOTOR.at)]
    assert served([], [MOTOR]) == []
    assert served([fault()], []) == []


def test_its_labels_are_those_of_the_fault():
    own = {"site": "hall", "team": "blue", "author": "me", "comment": "mine"}
    ack = MOTOR._replace(fault=identity_of(LABELS | {"site": "hall"}))
    [(labels, _at)] = served([fault(labels=own)], [ack], exporter="berlin")
    expected = {"site": "hall", "team": "blue", "author": "ann", "exporter": "berlin"}
    assert labels == LABELS | expected | {"comment": "spare part ordered"}


@pytest.mark.parametrize(
    ("since", "shown"), [(0, 1), (0.9, 1), (-0.9, 1), (1.1, 0), (-1.1, 0), (3600, 0)]
)
def test_an_acknowledgement_is_of_the_fault_that_began_then(since, shown):
    """Both halves of a pair see it begin, some tenths of a second apart."""
    assert len(served([fault(BEGAN + since)], [MOTOR])) == shown


@pytest.mark.parametrize(
    "other",
    [{"robot": "r2"}, {"component": "Motor 2"}, {"group": "/Arm"}, {"state": State.WARNING}],
    ids=str,
)
def test_an_acknowledgement_is_of_no_other_fault(other):
    assert served([fault(**other)], [MOTOR]) == []


def test_hostile_words_and_names_are_escaped():
    name = 'Motor "1"} 1\n\ud800'
    ack = MOTOR._replace(
        fault=identity_of(LABELS | {"component": 'Motor "1"} 1\n?'}), comment='say "no" \\ more'
    )
    [(labels, _at)] = served([fault(component=name)], [ack])
    assert (labels["component"], labels["comment"]) == ('Motor "1"} 1\n?', 'say "no" \\ more')


def test_it_comes_and_goes_while_the_fault_lasts():
    text, lasting = FaultText(), fault()
    shown = [len(served([lasting], found, text)) for found in ([], [MOTOR], [MOTOR], [])]
    assert shown == [0, 1, 1, 0]


def test_the_exposition_asks_for_them_at_each_scrape():
    driver = StateDriver().raw_every(1, 20, Status(OK, "Motor 1"))
    driver.raw_every(1, 40, Status(ERROR, "Motor 1"))
    labels = LABELS | {"group": ""}
    ack = MOTOR._replace(fault=identity_of(labels), since=WALL + 20)
    found = [ack]
    exposition = Exposition(driver.state, lambda: found)
    name = metrics.FAULT_ACKNOWLEDGED.name.encode()

    assert name in exposition.render(parts={Part.FAULTS})
    assert exposition.series[metrics.FAULT_ACKNOWLEDGED.name] == 1
    assert name not in exposition.render(parts={Part.ROBOTS})
    found.clear()
    assert name not in exposition.render()
