"""Which alerts ros-diagnostics ack acknowledges, and by which silences."""

import json
from datetime import datetime
from typing import Any

import pytest

from support.as_listed import read

SINCE = "2026-01-01 10:00:00.123 +0000 UTC"
SHOWN = "2026-01-01 10:00:00 UTC"
BY = ("--comment", "on it", "--author", "ann")
ESCALATION = "RosDiagnosticsUnacknowledged"
# As the rules make them: own labels of the robot and the exporter's name are not the identity's.
CRITICAL = {"fleet": "f", "exporter": "berlin", "team": "blue", "severity": "critical"}
MOTOR = {**CRITICAL, "robot": "r1", "group": "/Motor", "component": "Motor 1", "site": "hall"}


def alert(name: str, since: str | None = SINCE, **labels: str) -> dict[str, Any]:
    return {
        "labels": {"alertname": f"RosDiagnostics{name}", **labels},
        "annotations": {} if since is None else {"evidence": f"since {since}"},
    }


COMPONENT = alert("ComponentCritical", scope="component", state="critical", **MOTOR)
VALUE = alert("ValueCritical", scope="value", state="critical", key="U", bound="low", **MOTOR)
ROBOT = {**CRITICAL, "robot": "r1", "site": "hall"}
SILENT = alert("RobotSilent", scope="robot", state="silent", **ROBOT)
CHECK = alert("CheckShort", scope="check", state="critical", check="motors", **ROBOT)
SITE = alert("FleetPartDown", scope="site", state="silent", site="hall", **CRITICAL)
FLEET = alert("FleetPartDown", scope="site", state="silent", **CRITICAL)  # a fleet without sites
OF_FLEET = alert("CapabilityLost", scope="capability", state="lost", check="lifting", **CRITICAL)
COMMON = alert("CommonCause", scope="common", state="critical", component="Motor 1", **CRITICAL)
EXPORTER = alert("ExporterDown", None, **CRITICAL)
OFFSET = alert("ClockOffset", None, fleet="f", robot="r1", severity="warning")
OWN = {"scope": "exporter", "state": "warning", "component": "database", "severity": "warning"}
DATABASE = alert("ExporterFault", fleet="f", **OWN)
STALLED = alert("ExporterStalled", "2026", fleet="f", instance="e:1", severity="critical")
INFO = alert("Watchdog", None, severity="info")
FOREIGN = {
    "labels": {"alertname": "DiskFull", "robot": "r1"},
    "annotations": {"evidence": f"since {SINCE}"},
}
FAULTS = (OF_FLEET, COMPONENT, VALUE, SILENT, CHECK, SITE, FLEET, COMMON, DATABASE)


@pytest.fixture
def server(played):
    """An Alertmanager in which all of them fire."""
    played.alerts = [*FAULTS, EXPORTER, OFFSET, STALLED, INFO, FOREIGN]
    return played


@pytest.fixture
def ack(run):
    """A function (words, code=0): what the command prints."""
    return lambda *words, code=0: run("ack", *words, *BY, code=code)


def escalation(problem: dict[str, Any], **more: str) -> dict[str, str]:
    """The matchers of a fault's acknowledgement."""
    labels = problem["labels"]
    left_out = {"exporter", "team", "alertname"}
    named = {name: text for name, text in labels.items() if name not in left_out}
    return {"alertname": ESCALATION, "since": SINCE, **named, **more}


def of(problem: dict[str, Any]) -> dict[str, str]:
    """The matchers of the acknowledgement of an alert that is no fault."""
    labels = problem["labels"]
    return {**labels, "alertname": ESCALATION, "of": labels["alertname"]}


@pytest.mark.parametrize(
    ("arguments", "expected"),
    [
        (["r1"], [of(OFFSET), *map(escalation, (SILENT, COMPONENT, VALUE, CHECK))]),
        (["r1", "Motor 1"], [escalation(COMPONENT), escalation(VALUE)]),
        (["r1", "motors"], [escalation(CHECK)]),
        (["--site", "hall"], [escalation(SITE)]),
        (["--site", ""], [escalation(FLEET)]),
        (["--common", "Motor 1"], [escalation(COMMON)]),
        (["--capability", "lifting"], [escalation(OF_FLEET)]),
        (["--alert", "ExporterDown"], [of(EXPORTER)]),
        (["--part", "database"], [escalation(DATABASE)]),
        (["--alert", "RosDiagnosticsExporterStalled"], [of(STALLED)]),
    ],
)
def test_what_the_arguments_name_is_acknowledged(server, ack, arguments, expected):
    ack(*arguments)

    def in_order(matchers):
        return sorted(tuple(sorted(each.items())) for each in matchers)

    assert in_order(server.matched()) == in_order(expected)


@pytest.mark.parametrize("name", ["lidar: Front  left", "lidar: Front left", "front LEFT"])
def test_a_name_may_lose_blanks_when_it_is_copied_and_its_only_match_is_taken(server, ack, name):
    labels = {**MOTOR, "component": "lidar: Front  left"}
    server.alerts = [alert("ComponentCritical", scope="component", state="critical", **labels)]
    server.alerts.append(COMPONENT)
    ack("r1", name)
    assert [each["component"] for each in server.matched()] == ["lidar: Front  left"]


def test_a_part_of_several_names_is_no_name(server, ack):
    labels = {**MOTOR, "component": "Motor 2"}
    other = alert("ComponentStale", scope="component", state="stale", **labels)
    server.alerts = [COMPONENT, other]
    assert "no alert is firing for 'r1 Motor'" in ack("r1", "Motor", code=1).err


def test_a_robot_of_two_fleets_is_acknowledged_in_the_one_that_is_named(server, ack):
    other = {**COMPONENT, "labels": {**COMPONENT["labels"], "fleet": "g"}}
    server.alerts = [COMPONENT, other]
    said = ack("r1", code=1).err
    assert "'r1' is of several fleets: say with --fleet which: f, g" in said
    assert server.silences == []
    # Alertmanager filters by fleet; this one shows what it has.
    server.alerts = [other]
    ack("r1", "--fleet", "g")
    assert server.matched() == [{**escalation(COMPONENT), "fleet": "g"}]


def test_an_acknowledgement_can_be_taken_back(server, ack, run):
    ack("r1", "Motor 1")
    ack("--site", "hall")
    cancel = ("ack", "--cancel", "r1", "Motor 1")
    assert run(*cancel).out.splitlines() == [
        "no longer acknowledged: f/r1 Motor 1 CRITICAL",
        "no longer acknowledged: f/r1 Motor 1 U low CRITICAL",
    ]
    assert server.matched() == [escalation(SITE)]
    assert "nobody has acknowledged 'r1 Motor 1'; see --list" in run(*cancel, code=1).err
    assert server.matched() == [escalation(SITE)]


def test_json_has_what_was_done_and_what_is_listed(server, ack, run):
    (done,) = json.loads(ack("--site", "hall", "--output", "json").out)
    assert (done["part"], done["silence"], done["author"]) == ("site hall", "id-0", "ann")
    listed = json.loads(run("ack", "--list", "--output", "json").out)
    assert [each["part"] for each in listed if each["author"] == "ann"] == ["site hall"]


def test_the_silence_is_what_the_exporter_reads(server, ack):
    ack("r1", "Motor 1")
    found = read(server.silences, "f")
    assert {each.fault[1] for each in found} == {"component", "value"}
    assert {(each.author, each.comment, each.since) for each in found} == {
        ("ann", "on it", 1767261600.123)
    }


def test_an_alert_and_its_escalation_are_one(server, ack):
    labels = {**COMPONENT["labels"], "alertname": ESCALATION, "since": "earlier", "step": "1"}
    other = {**of(EXPORTER), "team": "blue", "exporter": "berlin", "step": "1"}
    alone = {"alertname": ESCALATION, "of": "RosDiagnosticsRulesFailing", "step": "2"}
    server.alerts = [
        COMPONENT,
        EXPORTER,
        *({**sent(each, state="suppressed"), "annotations": {}} for each in (labels, other, alone)),
    ]
    for words in (["r1"], ["--alert", "ExporterDown"], ["--alert", "RulesFailing"]):
        ack(*words)
    assert server.matched() == [
        escalation(COMPONENT),
        of(EXPORTER),
        {"alertname": ESCALATION, "of": "RosDiagnosticsRulesFailing"},
    ]


def sent(labels: dict[str, str], *, state: str = "active") -> dict[str, Any]:
    """An alert of an escalation as Alertmanager has it."""
    return {
        "labels": labels,
        "annotations": {"evidence": f"since {SINCE}"},
        "status": {"state": state},
    }


def test_a_step_that_was_sent_is_left_out_so_that_its_end_is_sent(server, ack, run):
    steps = [{**COMPONENT["labels"], **escalation(COMPONENT), "step": each} for each in "120"]
    server.alerts = [COMPONENT, sent(steps[0]), sent(steps[1], state="suppressed"), sent(steps[2])]
    ack("r1", "Motor 1")
    (made,) = server.silences
    assert made["matchers"][-1] == {"name": "step", "value": "1", "isRegex": True, "isEqual": False}
    assert len(read(server.silences, "f")) == 1  # the exporter finds it nevertheless
    assert "is already acknowledged by ann" in ack("r1", "Motor 1").out
    run("ack", "--cancel", "r1", "Motor 1")
    assert server.silences == []


def test_what_is_acknowledged_is_so_once(server, ack):
    ack("--site", "hall")
    assert "f/site hall is already acknowledged by ann" in ack("--site", "hall").out
    assert len(server.silences) == 1


@pytest.mark.parametrize(
    "change",
    [{"isRegex": True}, {"isEqual": False}, {"value": "2026-01-02 10:00:00 +0000 UTC"}],
    ids=str,
)
def test_a_silence_of_anything_else_is_no_acknowledgement(server, ack, change):
    ack("--site", "hall")
    (since,) = (each for each in server.silences[0]["matchers"] if each["name"] == "since")
    since.update(change)
    ack("--site", "hall")
    assert len(server.silences) == 2


def test_only_a_fault_ends_its_acknowledgement_so_others_are_short(server, ack):
    first, second = (ack(*words).out for words in (["--alert", "ExporterDown"], ["--site", "hall"]))
    ack("--common", "Motor 1", "--for", "2d")
    lasting = [
        (each["startsAt"][:10] < each["endsAt"][:10], _days(each)) for each in server.silences
    ]
    assert lasting == [(True, 1), (True, 365), (True, 2)]
    assert first.startswith("acknowledged: f/berlin ExporterDown until 20")
    assert second.startswith(f"acknowledged: f/site hall SILENT since {SHOWN}, until 20")
    assert second.endswith(" UTC at the latest\n")


def test_an_alert_of_a_whole_fleet_is_named_by_the_fleet(server, ack):
    server.alerts = [alert("NoExporter", None, fleet="f", severity="critical")]
    assert ack("--alert", "NoExporter").out.startswith("acknowledged: f NoExporter until 20")


def _days(silence: dict[str, Any]) -> float:
    start, end = (datetime.fromisoformat(silence[name]) for name in ("startsAt", "endsAt"))
    return (end - start).total_seconds() / 86_400


def test_the_list_shows_everything_that_can_be_acknowledged(server, ack, run):
    ack("r1", "Motor 1")
    _head, *rows = run("ack", "--list").out.splitlines()
    shown = {" ".join(row.split()) for row in rows}
    assert shown == {
        f"f r1 Motor 1 CRITICAL {SHOWN} ann on it",
        f"f r1 Motor 1 U low CRITICAL {SHOWN} ann on it",
        f"f r1 SILENT {SHOWN} nobody",
        f"f r1 motors CRITICAL {SHOWN} nobody",
        f"f site hall SILENT {SHOWN} nobody",
        f"f site SILENT {SHOWN} nobody",
        f"f lifting of the fleet LOST {SHOWN} nobody",
        f"f Motor 1 on many robots CRITICAL {SHOWN} nobody",
        "f berlin ExporterDown nobody",
        "f r1 ClockOffset nobody",
        f"f database of the exporter WARNING {SHOWN} nobody",
        "f e:1 ExporterStalled nobody",
    }


@pytest.mark.parametrize(
    "arguments", [["r2"], ["r1", "Arm"], ["--site", "yard"], ["--common", "Arm"], ["--alert", "X"]]
)
def test_what_is_not_firing_cannot_be_acknowledged(server, ack, arguments):
    error = ack(*arguments, code=1).err
    given = " ".join(each for each in arguments if not each.startswith("--"))
    assert f"no alert is firing for '{given}'; there are alerts for " in error
    assert "f/site hall SILENT" in error
    server.alerts = [INFO, FOREIGN]
    assert "no alert is firing for" in ack(*arguments, code=1).err
    assert server.silences == []


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ([], "give a ROBOT, --site, --common, --capability, --part or --alert"),
        (["r1", "--site", "hall"], "give only one of ROBOT"),
        (["--common", "Motor 1", "--alert", "ExporterDown"], "give only one of ROBOT"),
    ],
)
def test_one_thing_is_acknowledged_at_a_time(arguments, error, ack):
    assert error in ack(*arguments, code=2).err
