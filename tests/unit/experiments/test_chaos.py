"""Which mails of a chaos test are wrong, by what the robots know; its scenario is a valid one."""

from pathlib import Path

import pytest
import yaml

from experiments.chaos_truth import Incident, Mail, Outage, count, incidents, read, report, scenario
from virtual_robots.simulation.scenario import load_scenario

MOTOR = "demo/robot_4 Motor 1"
BROKEN = Incident(MOTOR, "CRITICAL", 100.0, 200.0)
PROBLEM, RECOVERY = Mail(120.0, "PROBLEM", *BROKEN[:2]), Mail(205.0, "RECOVERY", *BROKEN[:2])
KILLED = Outage("Alertmanager", "kill", 125.0, 130.0)
WRONG = {
    "nothing": ([PROBLEM, RECOVERY], {}),
    "no mail at all": ([], {"missed": 1}),
    "a mail that comes too late": (
        [PROBLEM._replace(received=400.0)],
        {"false PROBLEM": 1, "endless": 1, "missed": 1},
    ),
    "no recovery": ([PROBLEM], {"endless": 1}),
    "a recovery while it is broken": (
        [PROBLEM, RECOVERY._replace(received=150.0)],
        {"false RECOVERY": 1},
    ),
    "a mail about another one": (
        [PROBLEM, PROBLEM._replace(about="demo/robot_5 Motor 1"), RECOVERY],
        {"false PROBLEM": 1, "endless": 1},
    ),
    "another state": (
        [PROBLEM, PROBLEM._replace(state="WARNING"), RECOVERY],
        {"false PROBLEM": 1, "endless": 1},
    ),
    "twice": ([PROBLEM, PROBLEM._replace(received=140.0), RECOVERY], {"false PROBLEM": 1}),
}


@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_without_an_outage(what: str):
    mails, wrong = WRONG[what]
    counts = count([BROKEN], [], mails, [])
    assert dict(counts.wrong) == wrong
    assert not counts.possible


POSSIBLE = {
    "it ends before it can be seen": ([], Outage("exporter", "kill", 110.0, 190.0), 1, 0),
    "there is time to see it": ([], Outage("exporter", "kill", 110.0, 150.0), 0, 1),
    "what was sent is forgotten": ([PROBLEM], KILLED, 1, 0),
    "... and sent again": ([PROBLEM, PROBLEM._replace(received=140.0), RECOVERY], KILLED, 1, 0),
    "a pause forgets nothing": ([PROBLEM], KILLED._replace(how="pause"), 0, 1),
    "what was sent long ago is written": (
        [PROBLEM],
        KILLED._replace(begin=160.0, end=165.0),
        0,
        1,
    ),
    "Prometheus is away for long": (
        [PROBLEM, RECOVERY._replace(received=190.0)],
        Outage("Prometheus", "stop", 122.0, 188.0),
        1,
        0,
    ),
    "Prometheus is away for a moment": (
        [PROBLEM, RECOVERY._replace(received=190.0)],
        Outage("Prometheus", "stop", 180.0, 188.0),
        0,
        1,
    ),
}


@pytest.mark.parametrize("what", POSSIBLE)
def test_what_the_pages_name_is_no_mistake(what: str):
    mails, outage, possible, wrong = POSSIBLE[what]
    counts = count([BROKEN], [outage], mails, [])
    assert (counts.possible.total(), counts.wrong.total()) == (possible, wrong)
    assert ("see docs/" in "\n".join(report(counts))) is bool(possible)


def test_what_lasts_when_all_is_repaired_is_endless():
    counts = count([], [], [], ["fault of robot_1 Motor 1 critical"])
    assert counts.wrong == {"endless": 1}
    assert [*report(counts)][-1] == "0 false PROBLEM, 0 false RECOVERY, 0 missed, 1 endless"


def test_a_silence_that_may_be_mailed_need_not_be():
    silence = Incident("demo site hall", "SILENT", 100.0, 130.0, must=False)
    mail = Mail(125.0, "PROBLEM", *silence[:2])
    assert not count([silence], [], [], []).wrong
    assert not count(
        [silence], [], [mail, mail._replace(kind="RECOVERY", received=128.0)], []
    ).wrong


@pytest.mark.parametrize(
    ("subject", "found"),
    [
        (f"** PROBLEM ** {MOTOR} is CRITICAL", ("PROBLEM", MOTOR, "CRITICAL")),
        (f"** RECOVERY ** {MOTOR} is no longer CRITICAL", ("RECOVERY", MOTOR, "CRITICAL")),
        ("** PROBLEM ** demo site hall is SILENT", ("PROBLEM", "demo site hall", "SILENT")),
        (f"** FLAPPING ** {MOTOR} started flapping", ("PROBLEM", MOTOR, "FLAPPING")),
        (f"** FLAPPING ** {MOTOR} stopped flapping", ("RECOVERY", MOTOR, "FLAPPING")),
        ("** MAINTENANCE ** demo downtime new floor of robot_1 began", None),
    ],
)
def test_a_subject_is_read(subject: str, found: tuple[str, ...] | None):
    mail = read(1.0, subject)
    assert (None if mail is None else mail[1:]) == found


def test_what_happens_while_the_robots_are_paused_is_seen_when_they_go_on():
    content = {"events": [{"at": 20.0, "for": 60.0, "robot": "robot_1", "what": "hang"}]}
    pauses = [Outage("robots", "pause", 1015.0, 1030.0), Outage("robots", "pause", 1079.0, 1090.0)]
    (found,) = incidents(content, "demo", 1000.0, pauses)
    assert found == Incident("demo/robot_1", "SILENT", 1030.0, 1090.0)


def test_the_robots_accept_the_scenario_of_an_hour(tmp_path: Path):
    path = tmp_path / "scenario.yaml"
    content = scenario(12, 3600, 1)
    path.write_text(yaml.safe_dump(content))
    events = load_scenario(path).model.events
    assert len(events) > 200
    assert content != scenario(12, 3600, 2)
    for one in events:  # none begins while its component, or its robot, was just in trouble
        for other in events:
            same = (one.robot, one.component) == (other.robot, other.component)
            assert one is other or not same or abs(one.at - other.at) > one.length + 240
