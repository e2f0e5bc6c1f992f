"""Downtimes: what ros-diagnostics downtime asks of Alertmanager, and what the exporter reads."""

from __future__ import annotations

import time
from datetime import datetime, timedelta, timezone
from typing import Any
from urllib.parse import parse_qs

import pytest

from ros_diagnostics_exporter import silences
from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_tools.commands import downtime
from ros_diagnostics_tools.main import main
from support.as_listed import read, read_downtimes
from support.silences import listed
from support.web_server import component, fleet, robot

FLEET = fleet(
    robot("robot_1", component("Motor 1", "OK")),
    robot("robot_2", labels={"site": "hall", "kind": "arm"}),
    robot("robot_3", labels={"site": "yard", "kind": "arm"}),
)


class Servers:
    """An Alertmanager and an exporter in place of the client."""

    def __init__(self) -> None:
        self.silences: list[dict[str, Any]] = []
        self.follows = True
        self.exporter_answers = True

    def get(self, client: Client, path: str) -> Any:
        if path.startswith("/api/v2/silences"):
            return self.silences
        if not self.exporter_answers:
            raise UnreachableError(f"{client.url} refused")
        wanted = parse_qs(path.partition("?")[2]).get("robot", [])
        planned = read_downtimes(self.silences, "hall") if self.follows else []
        robots = [
            {
                **each,
                "downtimes": [
                    {"component": one.component, "until": one.end}
                    for one in planned
                    if one.robot == each["robot"]
                ],
            }
            for each in FLEET["robots"]
            if not wanted or each["robot"] in wanted
        ]
        return {**FLEET, "robots": robots}

    def post(self, _client: Client, _path: str, body: dict[str, Any]) -> None:
        number = str(len(self.silences))
        self.silences.append({"id": number, "status": {"state": "active"}, **body})

    def delete(self, _client: Client, path: str) -> None:
        number = path.rpartition("/")[2]
        self.silences = [each for each in self.silences if each.get("id") != number]


@pytest.fixture
def servers(monkeypatch) -> Servers:
    found = Servers()
    for name in ("get", "post", "delete"):
        method = getattr(found, name)
        monkeypatch.setattr(Client, name, lambda client, *given, m=method: m(client, *given))
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    return found


def run(*arguments: str) -> int:
    return main(["downtime", *arguments, "--author", "ann"])


def plan(*arguments: str) -> int:
    return run(*arguments, "--comment", "new gears")


@pytest.mark.parametrize("name", ["", "Motor 1"])
def test_what_the_command_plans_is_what_the_exporter_reads(servers, capsys, name):
    before = time.time()
    assert plan(*filter(None, ("robot_1", name, "1h30m"))) == 0
    (found,) = read_downtimes(servers.silences, "hall")
    assert found[:2] == ("robot_1", name)
    assert found[4:] == ("ann", "new gears")
    assert before <= found.start <= time.time()
    assert found.end - found.start == pytest.approx(5400)
    assert capsys.readouterr().out.startswith(f"planned: hall/{f'robot_1 {name}'.strip()} from ")
    assert read_downtimes(servers.silences, "other") == []
    assert read(servers.silences, "hall") == []  # no acknowledgement


def test_one_that_begins_later_is_listed_and_can_be_cancelled(servers, capsys):
    assert plan("robot_1", "Motor 1", "2h", "--from", "3h") == 0
    (found,) = read_downtimes(servers.silences, "hall")
    assert found.start == pytest.approx(time.time() + 3 * 3600, abs=60)
    servers.silences += [listed(), {"nonsense": 1}]  # an acknowledgement is no downtime
    capsys.readouterr()
    assert run("--list") == 0
    (line,) = capsys.readouterr().out.splitlines()[1:]
    assert line.split()[:4] == ["hall", "robot_1", "Motor", "1"]

    assert run("--cancel", "robot_1") == 1
    assert "planned: hall/robot_1 Motor 1" in capsys.readouterr().err
    assert run("--cancel", "robot_1", "Motor 1") == 0
    assert read_downtimes(servers.silences, "hall") == []


def test_names_that_the_exporter_does_not_know_are_rejected_with_the_nearest(servers, capsys):
    assert plan("robot_9", "1h") == 1
    assert "no robot 'robot_9'; the nearest is 'robot_" in capsys.readouterr().err
    assert plan("robot_1", "Mottor 1", "1h") == 1
    assert "no component 'Mottor 1'; the nearest is 'Motor 1'" in capsys.readouterr().err
    assert plan("robot_1", "1h", "--fleet", "yard") == 1
    assert servers.silences == []


def test_a_downtime_of_a_site_is_one_of_each_of_its_robots(servers, capsys):
    assert plan("--site", "yard", "1h") == 0
    assert robots_planned(servers) == ["robot_3"]
    assert plan("--selector", "site=hall", "--selector", "kind=arm", "1h") == 0
    assert robots_planned(servers) == ["robot_2", "robot_3"]
    capsys.readouterr()
    assert run("--cancel", "--site", "hall") == 0
    assert capsys.readouterr().out.startswith("cancelled: hall/robot_2 from ")
    assert robots_planned(servers) == ["robot_3"]


def robots_planned(servers) -> list[str]:
    return sorted(each.robot for each in read_downtimes(servers.silences, "hall"))


def test_labels_that_no_robot_has_plan_nothing(servers, capsys):
    assert plan("--site", "roof", "1h") == 1
    assert "no robot has the labels 'site=roof'" in capsys.readouterr().err
    servers.exporter_answers = False
    assert plan("--site", "yard", "1h", "--fleet", "hall") == 3  # nobody says which robots
    assert servers.silences == []


def test_an_exporter_that_does_not_follow_is_an_error(servers, capsys, monkeypatch):
    monkeypatch.setattr(downtime, "FOLLOWED", 0.0)
    servers.follows = False
    assert plan("robot_1", "1h") == 1
    assert "does not read it: start it with --alertmanager.url=" in capsys.readouterr().err


def test_without_an_exporter_the_fleet_has_to_be_named(servers, capsys):
    servers.exporter_answers = False
    assert plan("robot_1", "1h") == 3
    assert "or the fleet with --fleet" in capsys.readouterr().err
    assert plan("robot_1", "1h", "--fleet", "hall") == 0
    assert "not checked" in capsys.readouterr().err
    assert len(read_downtimes(servers.silences, "hall")) == 1


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (["robot_1", "--comment", "x"], "'robot_1' is not a duration"),
        (["robot_1", "Motor 1", "--comment", "x"], "'Motor 1' is not a duration such as 90s"),
        (["robot_1", "99999d", "--comment", "x"], "'99999d' is not a duration"),
        (["robot_1", "1h"], "say with --comment"),
        (["robot_1", "1h", "--comment", " "], "say with --comment"),
        (["", "1h", "--comment", "x"], "a name has 1 to 1024 characters"),
        (["robot_1", "1h", "--comment", "x", "--from", "soon"], "'soon' is no time"),
        (["robot_1", "1h", "--comment", "x", "--from", "2020-01-01"], "has passed"),
        (["--cancel"], "missing ROBOT"),
        (["--site", "hall", "robot_1", "1h", "--comment", "x"], "stand for ROBOT"),
        (["--selector", "hall", "1h", "--comment", "x"], "'hall' is not LABEL=VALUE"),
        (["--list", "robot_1"], "--list takes no ROBOT"),
        (["--list", "--cancel", "robot_1"], "and no --cancel"),
    ],
)
def test_wrong_arguments_are_usage_errors(arguments, problem, capsys):
    assert run(*arguments) == 2
    assert problem in capsys.readouterr().err


def test_flags_may_stand_between_the_names(servers):
    assert run("robot_1", "--comment", "new gears", "Motor 1", "--from", "1h", "2h") == 0
    (found,) = read_downtimes(servers.silences, "hall")
    assert found.component == "Motor 1"


@pytest.mark.parametrize(
    "arguments", [["downtime", "--list"], ["ack", "--list"], ["why", "r"]], ids=" ".join
)
def test_ctrl_c_ends_a_command_without_a_traceback(arguments, monkeypatch):
    def interrupted(_client, _path):
        raise KeyboardInterrupt

    monkeypatch.setattr(Client, "get", interrupted)
    assert main(arguments) == 130


@pytest.mark.parametrize(
    "changed",
    [
        {"status": {"state": "expired"}},
        {"endsAt": "soon"},
        {"matchers": []},
        {"matchers": None},
        {"createdBy": None},
    ],
)
def test_other_silences_are_no_downtimes(servers, changed):
    plan("robot_1", "1h")
    (made,) = servers.silences
    assert len(read_downtimes([made], "hall")) == 1
    assert read_downtimes([{**made, **changed}], "hall") == []


@pytest.mark.parametrize(
    "matcher",
    [
        {"name": "robot", "value": "r.*", "isRegex": True},
        {"name": "robot", "value": "robot_1", "isRegex": False, "isEqual": False},
        {"name": "severity", "value": "warning", "isRegex": False},
        {"name": "robot", "value": "", "isRegex": False},
    ],
)
def test_a_silence_that_matches_something_else_is_none(servers, matcher):
    plan("robot_1", "1h")
    (made,) = servers.silences
    others = [each for each in made["matchers"] if each["name"] != matcher["name"]]
    assert read_downtimes([{**made, "matchers": [*others, matcher]}], "hall") == []


def test_of_too_many_those_in_force_and_the_next_ones_are_kept(monkeypatch):
    monkeypatch.setattr(silences, "MOST", 3)
    now = datetime.now(timezone.utc)
    hours = [48, -1, 24, 1, -2]  # until they begin
    made = [
        {
            "status": {"state": "active" if each < 0 else "pending"},
            **silences.silence(
                silences.downtime_matchers("hall", f"robot_{each}", ""),
                now + timedelta(hours=each),
                now + timedelta(hours=100),
                "ann",
                "new gears",
            ),
        }
        for each in hours
    ]

    found = read_downtimes(made, "hall")
    assert [each.robot for each in found] == ["robot_-2", "robot_-1", "robot_1"]
