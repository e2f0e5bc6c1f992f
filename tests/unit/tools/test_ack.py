"""Which alerts ros-diagnostics-ack acknowledges, and by which silences."""

from __future__ import annotations

from typing import Any

import pytest

from ros_diagnostics_exporter.alertmanager import read
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_tools.commands import ack

SINCE = "2026-01-01 10:00:00.123 +0000 UTC"
ESCALATION = "RosDiagnosticsUnacknowledged"
# As the rules make them: own labels of the robot and the exporter's name are not the identity's.
CRITICAL = {"fleet": "f", "exporter": "berlin", "team": "blue", "severity": "critical"}
MOTOR = {**CRITICAL, "robot": "r1", "group": "/Motor", "component": "Motor 1", "site": "hall"}


def alert(name: str, since: str | None = SINCE, **labels: str) -> dict[str, Any]:
    return {
        "labels": {"alertname": f"RosDiagnostics{name}", **labels},
        "annotations": {} if since is None else {"since": since},
    }


COMPONENT = alert("ComponentCritical", scope="component", state="critical", **MOTOR)
VALUE = alert("ValueCritical", scope="value", state="critical", key="U", bound="low", **MOTOR)
ROBOT = {**CRITICAL, "robot": "r1", "site": "hall"}
SILENT = alert("RobotSilent", scope="robot", state="silent", **ROBOT)
CHECK = alert("CheckShort", scope="check", state="critical", check="motors", **ROBOT)
SITE = alert("FleetPartDown", scope="site", state="silent", site="hall", **CRITICAL)
FLEET = alert("FleetPartDown", scope="site", state="silent", **CRITICAL)  # a fleet without sites
COMMON = alert("CommonCause", scope="common", state="critical", component="Motor 1", **CRITICAL)
EXPORTER = alert("ExporterDown", None, **CRITICAL)
OFFSET = alert("ClockOffset", None, fleet="f", robot="r1", severity="warning")
UPLINK = alert("UplinkDown", "2026", fleet="f", uplink="ap_9", severity="critical")
INFO = alert("Watchdog", None, severity="info")
FOREIGN = {"labels": {"alertname": "DiskFull", "robot": "r1"}, "annotations": {"since": SINCE}}
ALL = (
    COMPONENT,
    VALUE,
    SILENT,
    CHECK,
    SITE,
    FLEET,
    COMMON,
    EXPORTER,
    OFFSET,
    UPLINK,
    INFO,
    FOREIGN,
)


@pytest.fixture
def server(monkeypatch):
    """An Alertmanager in place of the client: ``alerts`` and ``silences``, those posted too."""

    class Server:
        def __init__(self) -> None:
            self.alerts: list[dict[str, Any]] = [*ALL]
            self.silences: list[dict[str, Any]] = []

        def posted(self) -> list[dict[str, str]]:
            return [
                {each["name"]: each["value"] for each in made["matchers"]} for made in self.silences
            ]

    found = Server()

    def get(_client, path):
        return found.alerts if path.startswith("/api/v2/alerts") else found.silences

    def post(_client, _path, body):
        found.silences.append({"status": {"state": "active"}, **body})

    monkeypatch.setattr(Client, "get", get)
    monkeypatch.setattr(Client, "post", post)
    return found


def run(*arguments: str) -> int:
    return ack.main([*arguments, "--comment", "on it", "--author", "ann"])


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
        (
            ["r1"],
            [
                of(OFFSET),
                *map(escalation, (SILENT, COMPONENT, VALUE, CHECK)),
            ],
        ),
        (["r1", "Motor 1"], [escalation(COMPONENT), escalation(VALUE)]),
        (["r1", "motors"], [escalation(CHECK)]),
        (["--site", "hall"], [escalation(SITE)]),
        (["--site", ""], [escalation(FLEET)]),
        (["--common", "Motor 1"], [escalation(COMMON)]),
        (["--alert", "ExporterDown"], [of(EXPORTER)]),
        (["--alert", "RosDiagnosticsUplinkDown"], [of(UPLINK)]),
    ],
)
def test_what_the_arguments_name_is_acknowledged(server, arguments, expected):
    assert run(*arguments) == 0

    def in_order(matchers):
        return sorted(tuple(sorted(each.items())) for each in matchers)

    assert in_order(server.posted()) == in_order(expected)


def test_the_silence_is_what_the_exporter_reads(server):
    assert run("r1", "Motor 1") == 0
    found = read(server.silences, "f")
    assert {each.fault[1] for each in found} == {"component", "value"}
    assert {(each.author, each.comment, each.since) for each in found} == {
        ("ann", "on it", 1767261600.123)
    }


def test_an_alert_and_its_escalation_are_one(server):
    labels = {**COMPONENT["labels"], "alertname": ESCALATION, "since": "earlier", "step": "1"}
    other = {**of(EXPORTER), "team": "blue", "exporter": "berlin", "step": "1"}
    alone = {"alertname": ESCALATION, "of": "RosDiagnosticsRulesFailing", "step": "2"}
    server.alerts = [
        COMPONENT,
        EXPORTER,
        *({"labels": each, "annotations": {}} for each in (labels, other, alone)),
    ]
    assert run("r1") == run("--alert", "ExporterDown") == run("--alert", "RulesFailing") == 0
    assert server.posted() == [
        escalation(COMPONENT),
        of(EXPORTER),
        {"alertname": ESCALATION, "of": "RosDiagnosticsRulesFailing"},
    ]


def test_what_is_acknowledged_is_so_once(server, capsys):
    assert run("--site", "hall") == run("--site", "hall") == 0
    assert len(server.silences) == 1
    assert "f/site hall is already acknowledged by ann" in capsys.readouterr().out


@pytest.mark.parametrize(
    "change",
    [{"isRegex": True}, {"isEqual": False}, {"value": "2026-01-02 10:00:00 +0000 UTC"}],
    ids=str,
)
def test_a_silence_of_anything_else_is_no_acknowledgement(server, change):
    assert run("--site", "hall") == 0
    (since,) = (each for each in server.silences[0]["matchers"] if each["name"] == "since")
    since.update(change)
    assert run("--site", "hall") == 0
    assert len(server.silences) == 2


def test_only_a_fault_ends_its_acknowledgement_so_others_are_short(server, capsys):
    assert run("--alert", "ExporterDown") == run("--site", "hall") == 0
    assert run("--common", "Motor 1", "--days", "2") == 0
    lasting = [
        (each["startsAt"][:10] < each["endsAt"][:10], _days(each)) for each in server.silences
    ]
    assert lasting == [(True, 1), (True, 365), (True, 2)]
    first, second, _third = capsys.readouterr().out.splitlines()
    assert first.startswith("acknowledged: f/berlin ExporterDown until 20")
    assert second == f"acknowledged: f/site hall SILENT since {SINCE}"


def _days(silence: dict[str, Any]) -> float:
    start, end = (ack.datetime.fromisoformat(silence[name]) for name in ("startsAt", "endsAt"))
    return (end - start).total_seconds() / 86_400


def test_the_list_shows_everything_that_can_be_acknowledged(server, capsys):
    assert run("r1", "Motor 1") == 0
    capsys.readouterr()
    assert ack.main(["--list"]) == 0
    _head, *rows = capsys.readouterr().out.splitlines()
    shown = {" ".join(row.split()) for row in rows}
    assert shown == {
        f"f r1 Motor 1 CRITICAL {SINCE} ann on it",
        f"f r1 Motor 1 U low CRITICAL {SINCE} ann on it",
        f"f r1 SILENT {SINCE} nobody",
        f"f r1 motors CRITICAL {SINCE} nobody",
        f"f site hall SILENT {SINCE} nobody",
        f"f site SILENT {SINCE} nobody",
        f"f Motor 1 on many robots CRITICAL {SINCE} nobody",
        "f berlin ExporterDown nobody",
        "f r1 ClockOffset nobody",
        "f ap_9 UplinkDown nobody",
    }


@pytest.mark.parametrize(
    "arguments", [["r2"], ["r1", "Arm"], ["--site", "yard"], ["--common", "Arm"], ["--alert", "X"]]
)
def test_what_is_not_firing_cannot_be_acknowledged(server, capsys, arguments):
    assert run(*arguments) == 1
    error = capsys.readouterr().err
    given = " ".join(each for each in arguments if not each.startswith("--"))
    assert f"no alert is firing for '{given}'; there are alerts for " in error
    assert "f/site hall SILENT" in error
    server.alerts = [INFO, FOREIGN]
    assert run(*arguments) == 1
    assert "no alert is firing for" in capsys.readouterr().err
    assert server.silences == []


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        ([], "give a ROBOT, --site, --common or --alert"),
        (["r1", "--site", "hall"], "not allowed with argument"),
        (["--common", "Motor 1", "--alert", "ExporterDown"], "not allowed with argument"),
    ],
)
def test_one_thing_is_acknowledged_at_a_time(arguments, error, capsys):
    with pytest.raises(SystemExit) as ended:
        run(*arguments)
    assert ended.value.code == 2
    assert error in capsys.readouterr().err
