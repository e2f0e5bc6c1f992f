"""The command that plans downtimes: what it makes in Alertmanager, and what it takes back."""

from __future__ import annotations

import pytest

from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_tools.commands import downtime
from ros_diagnostics_tools.main import main
from support.web_server import component, fleet, robot

FLEET = fleet(
    robot("robot_1", component("Motor 1", "OK"), labels={"site": "hall", "team": "arms"}),
    robot("robot_2", component("Motor 1", "OK"), labels={"site": "hall", "team": "carts"}),
)


class Played:
    """An exporter and an Alertmanager; an exporter follows no downtime that lies ahead."""

    def __init__(self) -> None:
        self.silences = []
        self.deleted = []

    def get(self, _client, path):
        if path.startswith("/api/v1/fleet"):
            names = [each["robot"] for each in FLEET["robots"] if path.endswith(each["robot"])]
            every = "?" not in path
            robots = [each for each in FLEET["robots"] if every or each["robot"] in names]
            return {**FLEET, "robots": robots}
        return [
            {**each, "id": f"{number}", "status": {"state": "pending"}}
            for number, each in enumerate(self.silences)
        ]

    def post(self, _client, _path, body):
        self.silences.append(body)
        return {"silenceID": str(len(self.silences) - 1)}

    def delete(self, _client, path):
        self.deleted.append(path.rpartition("/")[2])


@pytest.fixture
def played(monkeypatch) -> Played:
    found = Played()
    for name in ("get", "post", "delete"):
        method = getattr(found, name)
        monkeypatch.setattr(Client, name, lambda client, *given, m=method: m(client, *given))
    return found


def plan(*arguments: str) -> int:
    begins = ["--from", "2099-01-01T10:00", "--comment", "new gears", "--author", "ann"]
    return main(["downtime", *arguments, *begins])


def about(silence):
    return {each["name"]: each["value"] for each in silence["matchers"]}


def test_it_lasts_as_long_as_is_said_from_its_begin_on(played):
    assert plan("robot_1", "1h30m") == 0
    (made,) = played.silences
    begin, end = (downtime.datetime.fromisoformat(made[of]) for of in ("startsAt", "endsAt"))
    assert begin.astimezone().strftime("%Y-%m-%d %H:%M") == "2099-01-01 10:00"
    assert (end - begin).total_seconds() == 5_400.0
    assert (made["createdBy"], about(made)["robot"]) == ("ann", "robot_1")


def test_of_several_labels_a_robot_has_all(played):
    assert plan("--site", "hall", "--selector", "team=carts", "2h") == 0
    assert [about(each)["robot"] for each in played.silences] == ["robot_2"]


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("robot_3", "1h"), "no robot 'robot_3'; the nearest is 'robot_"),
        (("robot_1", "Motor 2", "1h"), "robot_1 has no component 'Motor 2'; the nearest is 'Motor"),
        (("robot_1", "1h", "--fleet", "other"), "is of fleet"),
    ],
)
def test_what_the_exporter_does_not_know_is_not_planned(played, capsys, arguments, error):
    assert plan(*arguments) == 1
    assert error in capsys.readouterr().err
    assert played.silences == []


def test_cancelling_a_component_leaves_its_robots_downtime(played):
    assert plan("robot_1", "1h") == 0
    assert plan("robot_1", "Motor 1", "1h") == 0
    assert main(["downtime", "robot_1", "Motor 1", "--cancel"]) == 0
    assert played.deleted == ["1"]
    assert main(["downtime", "robot_2", "--cancel"]) == 1


@pytest.mark.parametrize(
    "name", [("x" * 1_025,), ("robot_1", "x" * 1_025)], ids=["robot", "component"]
)
def test_a_name_that_no_robot_can_have_is_wrong_usage(played, name):
    assert plan(*name, "1h") == 2


def test_a_duration_with_a_minus_is_named_with_the_way_out(played, capsys):
    assert plan("robot_1", "-5m") == 2
    error = capsys.readouterr().err
    assert "'-5m' begins with a minus" in error
    assert "write 5m" in error
    assert "No such option" not in error
