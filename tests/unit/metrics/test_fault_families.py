"""The families of faults: what a scrape shows of what is confirmed."""

from __future__ import annotations

import re

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.faults.model import (
    End,
    Fault,
    Identity,
    Scope,
    State,
    as_texts,
    fault_id,
)
from ros_diagnostics_exporter.metrics import exposition
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.exposition import FaultText
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.notifications import key_of
from ros_diagnostics_exporter.silences import Acknowledgement, identity_of
from support.state_driver import ERROR, OK, WALL, WARN, StateDriver

MOTOR, HOT = Status(OK, "Motor"), Status(ERROR, "Motor", 'Hot "92"')
START = "fault_start_timestamp_seconds"
FAULT = fault_id(
    Fleet("f"), Identity(Scope.COMPONENT, State.CRITICAL, robot="r", component="Motor")
)


def driver_of(**labels: str) -> StateDriver:
    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW, labels=labels)
    return StateDriver(fleet=Fleet("f", (robot,)))


def in_fault(**labels: str) -> StateDriver:
    driver = driver_of(**labels)
    driver.raw_every(1, 20, MOTOR)
    driver.raw_every(1, 40, HOT)
    return driver


def test_a_fault_is_there_from_its_confirmation_to_its_end():
    driver = driver_of()
    driver.raw_every(1, 20, MOTOR)
    driver.raw_every(1, 29, HOT)
    assert START not in driver.samples()
    driver.raw_every(1, 32, HOT)
    identity = {"fleet": "f", "scope": "component", "state": "critical", "robot": "r"}
    identity |= {"component": "Motor", "severity": "critical", "fault": FAULT}
    identity |= {"evidence": 'Hot "92"'}
    assert driver.samples()[START] == {tuple(sorted(identity.items())): WALL + 20}

    driver.raw(MOTOR)
    assert START not in driver.samples()


def test_a_fault_of_a_robot_has_one_id_and_that_of_a_site_one_for_each_name_of_an_exporter():
    identities = [
        Identity(Scope.COMPONENT, State.CRITICAL, robot="r", component="Motor"),
        Identity(Scope.COMPONENT, State.WARNING, robot="r", component="Motor"),
        Identity(Scope.COMPONENT, State.CRITICAL, robot="r", group="Motor"),
        Identity(Scope.SITE, State.SILENT, site="hall"),
    ]
    unnamed, north, south = (
        [fault_id(Fleet("f", exporter=name), identity) for identity in identities]
        for name in ("", "north", "south")
    )

    assert unnamed[:3] == north[:3]
    assert len({*unnamed, *north, *south}) == 6
    assert all(re.fullmatch("[0-9a-f]{12}", each) for each in unnamed)


@pytest.mark.parametrize("exporter", ["", "berlin"])
def test_the_labels_of_a_robot_do_not_replace_those_of_its_fault(exporter):
    own = {"site": "hall", "team": "blue", "evidence": "mine", "severity": "mine"}
    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW, labels=own)
    driver = StateDriver(fleet=Fleet("f", (robot,), exporter=exporter))
    driver.raw_every(1, 20, MOTOR)
    driver.raw_every(1, 40, HOT)

    [start] = map(dict, driver.samples()[START])
    assert (start["evidence"], start["severity"]) == ('Hot "92"', "critical")
    assert set(start) - {"team"} <= set(metrics.FAULT_START.labels)
    assert (start.get("exporter", ""), start["team"]) == (exporter, "blue")


@pytest.mark.parametrize(
    ("identity", "expected"),
    [
        (Identity(Scope.COMPONENT, State.CRITICAL), "critical"),
        (Identity(Scope.COMPONENT, State.WARNING), "warning"),
        (Identity(Scope.COMPONENT, State.STALE), "warning"),
        (Identity(Scope.VALUE, State.FALLING), "warning"),
        (Identity(Scope.ROBOT, State.SILENT), "critical"),
        (Identity(Scope.ROBOT, State.PENDING), "warning"),
        (Identity(Scope.ROBOT, State.MANY, severity="critical"), "critical"),
        (Identity(Scope.ROBOT, State.MANY, severity="warning"), "warning"),
        (Identity(Scope.FLAPPING, State.INTERMITTENT), "warning"),
        (Identity(Scope.ROBOT, State.CLOCK), "warning"),
        (Identity(Scope.SITE, State.SILENT), "critical"),
    ],
)
def test_every_fault_has_its_severity(identity, expected):
    texts = FaultText().render(Fleet("f"), [Fault(identity, 1.0, 2.0, {})])
    assert f'severity="{expected}"' in texts[metrics.FAULT_START.name].decode()


def test_a_fault_keeps_the_robots_labels_of_when_it_began_and_its_identity():
    driver = in_fault(site="hall", team="blue", check="mine")
    (labels,) = driver.samples()[START]
    assert {"site": "hall", "team": "blue"}.items() <= dict(labels).items()
    assert "check" not in dict(labels)

    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW, labels={"team": "red"})
    driver.configure(Fleet("f", (robot,)))
    assert driver.sample(START, team="blue") == WALL + 20
    driver.raw(MOTOR)
    driver.stand(12, HOT)
    assert driver.sample(START, team="red") is not None


def test_a_fault_that_lasts_is_rendered_once(monkeypatch):
    driver = in_fault()
    first = driver.exposition.render()
    monkeypatch.setattr(exposition, "_render", None)
    assert driver.exposition.render() == first


@pytest.mark.parametrize(("level", "shown"), [(OK, None), (WARN, 1), (ERROR, 6), (3, 2)])
def test_the_state_of_a_component_is_there_while_it_is_not_ok(level, shown):
    driver = driver_of()
    driver.raw(MOTOR._replace(level=level))
    assert driver.sample("component_state", component="Motor") == shown
    assert driver.sample("component_level", component="Motor") == level


@pytest.mark.parametrize(
    ("notified", "expected"),
    [
        (None, {}),  # Alertmanager posts nothing: it is not known
        ({}, {"": 0.0}),
        ({"sms": 5.0, "email": 7.5}, {"sms": 5.0, "email": 7.5}),
    ],
)
def test_a_fault_says_who_was_notified_or_that_nobody_was(notified, expected):
    identity = Identity(Scope.COMPONENT, State.CRITICAL, robot="r", component="Motor")
    fault = Fault(identity, since=1.0, confirmed=2.0, evidence="", labels={})
    of = None if notified is None else {key_of(as_texts(identity, {})): notified}
    rendered = FaultText().render(Fleet("f"), [fault], notified=of)[metrics.FAULT_NOTIFIED.name]

    found = {}
    for line in rendered.decode().splitlines():
        series, value = line.rsplit(" ", 1)
        receiver = re.search('receiver="([^"]*)"', series)
        found[receiver[1] if receiver else ""] = float(value)
    assert found == expected


def test_a_fault_is_acknowledged_by_the_newest_acknowledgement():
    identity = Identity(Scope.COMPONENT, State.CRITICAL, robot="r", component="Motor")
    fault = Fault(identity, since=1.0, confirmed=2.0, evidence="", labels={})
    named = identity_of({"fleet": "f", **as_texts(identity, {})})
    made = [
        Acknowledgement(named, since, author, f"by {author}", at, 100.0)
        for author, since, at in (
            ("ann", 1.0, 5.0),
            ("eve", 1.0, 6.0),
            ("bob", 1.0, 7.0),
            ("dan", 99.0, 8.0),  # of an earlier fault
        )
    ]
    rendered = FaultText().render(Fleet("f"), [fault], acknowledgements=made)[
        metrics.FAULT_ACKNOWLEDGED.name
    ]

    [line] = rendered.decode().splitlines()
    assert 'author="bob",comment="by bob"' in line
    assert line.endswith(" 7.0")


def test_every_family_of_faults_has_the_robots_labels_and_its_own():
    identity = Identity(Scope.COMPONENT, State.CRITICAL, robot="r", component="Motor")
    fault = Fault(identity, 1.0, 2.0, {"team": "blue"}, "hot", "driving")
    named = identity_of({"fleet": "f", **as_texts(identity, {})})
    texts = FaultText().render(
        Fleet("f", exporter="e"),
        [fault],
        [End(fault, "r", "recovered", 9.0, "well")],
        [Acknowledgement(named, 1.0, "ann", "mine", 5.0, 100.0)],
        notified={key_of(as_texts(identity, {})): {"sms": 5.0}},
    )
    shared = {"fleet", "exporter", "fault", "scope", "state", "severity"}
    shared |= {"robot", "component", "team"}
    for family, own in (
        (metrics.FAULT_START, {"evidence"}),
        (metrics.FAULT_END, {"reason", "evidence"}),
        (metrics.FAULT_ACKNOWLEDGED, {"author", "comment"}),
        (metrics.FAULT_NOTIFIED, {"receiver"}),
    ):
        [sample] = texts[family.name].decode().splitlines()
        assert set(re.findall('([a-z]+)="', sample)) == shared | own
        assert shared | own <= {*family.labels, "team"}
        assert family.open


def test_a_fault_of_many_robots_names_its_members_by_its_id():
    robots = [
        Robot(f"r{n}", topic_raw=f"/r{n}/diagnostics", source=Source.RAW, labels={"site": "hall"})
        for n in range(6)
    ]
    driver = StateDriver(fleet=Fleet("f", tuple(robots), exporter="e"))
    for second in range(20):
        driver.at(second)
        for robot in robots:
            broken = robot.name != "r5" and second > 2
            driver.receive(robot.topic_raw, HOT if broken else MOTOR)
    members = driver.samples()["fault_member"]
    [fault] = {dict(each)["fault"] for each in members}
    assert {dict(each)["robot"] for each in members} == {"r0", "r1", "r2", "r3", "r4"}
    assert {dict(each)["component"] for each in members} == {"Motor"}
    assert driver.sample(START, fault=fault, scope="common") is not None
