"""The command that plans downtimes: what it makes in Alertmanager, and what it takes back."""

import time
from datetime import datetime

import pytest

from ros_diagnostics_tools import commands
from support.as_listed import read, read_downtimes
from support.silences import listed
from support.web_server import component, fleet, robot

FLEET = fleet(
    robot("robot_1", component("Motor 1", "OK"), labels={"site": "hall", "team": "arms"}),
    robot("robot_2", component("Motor 1", "OK"), labels={"site": "hall", "team": "carts"}),
    robot("robot_3", labels={"site": "yard", "team": "carts"}),
)

pytestmark = pytest.mark.usefixtures("in_utc")


@pytest.fixture
def servers(played):
    """An exporter of this fleet, and an Alertmanager."""
    played.fleet = FLEET
    return played


@pytest.fixture
def downtime(run):
    """A function (words, code=0): what the command prints."""
    return lambda *words, code=0: run("downtime", *words, "--author", "ann", code=code)


@pytest.fixture
def plan(downtime):
    """A function (words, code=0): what the command prints of a downtime for new gears."""
    return lambda *words, code=0: downtime(*words, "--comment", "new gears", code=code)


def planned_robots(servers) -> list[str]:
    return sorted(each.robot for each in read_downtimes(servers.silences, "hall"))


@pytest.mark.parametrize("name", ["", "Motor 1"])
def test_what_the_command_plans_is_what_the_exporter_reads(servers, plan, name):
    before = time.time()
    said = plan(*filter(None, ("robot_1", name, "1h30m"))).out
    (found,) = read_downtimes(servers.silences, "hall")
    assert found[:2] == ("robot_1", name)
    assert found[4:] == ("ann", "new gears")
    assert before <= found.start <= time.time()
    assert found.end - found.start == pytest.approx(5400)
    assert said.startswith(f"planned: hall/{f'robot_1 {name}'.strip()} from ")
    assert read_downtimes(servers.silences, "other") == []
    assert read(servers.silences, "hall") == []  # no acknowledgement


def test_it_lasts_as_long_as_is_said_from_its_begin_on(servers, plan):
    plan("robot_1", "1h30m", "--from", "2099-01-01T10:00")
    (made,) = servers.silences
    begin, end = (datetime.fromisoformat(made[of]) for of in ("startsAt", "endsAt"))
    assert begin.astimezone().strftime("%Y-%m-%d %H:%M") == "2099-01-01 10:00"
    assert (end - begin).total_seconds() == 5_400.0
    assert (made["createdBy"], servers.matched()[0]["robot"]) == ("ann", "robot_1")


def test_one_that_begins_later_is_listed_and_can_be_cancelled(servers, downtime, plan):
    plan("robot_1", "Motor 1", "2h", "--from", "3h")
    (found,) = read_downtimes(servers.silences, "hall")
    assert found.start == pytest.approx(time.time() + 3 * 3600, abs=60)
    servers.silences += [listed(), {"nonsense": 1}]  # an acknowledgement is no downtime
    (line,) = downtime("--list").out.splitlines()[1:]
    assert line.split()[:4] == ["hall", "robot_1", "Motor", "1"]
    assert "planned: hall/robot_1 Motor 1" in downtime("--cancel", "robot_1", code=1).err
    downtime("--cancel", "robot_1", "Motor 1")
    assert read_downtimes(servers.silences, "hall") == []


def test_cancelling_a_component_leaves_its_robots_downtime(servers, downtime, plan):
    plan("robot_1", "1h")
    plan("robot_1", "Motor 1", "1h")
    downtime("robot_1", "Motor 1", "--cancel")
    (left,) = read_downtimes(servers.silences, "hall")
    assert left[:2] == ("robot_1", "")
    downtime("robot_2", "--cancel", code=1)


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (("robot_9", "1h"), "no robot 'robot_9'; the nearest is 'robot_"),
        (("robot_1", "Mottor 1", "1h"), "robot_1 has no component 'Mottor 1'; the nearest is 'Mot"),
        (("robot_1", "1h", "--fleet", "yard"), "is of fleet"),
        (("--site", "roof", "1h"), "no robot has the labels 'site=roof'"),
    ],
)
def test_what_the_exporter_does_not_know_is_not_planned(servers, plan, arguments, error):
    assert error in plan(*arguments, code=1).err
    assert servers.silences == []


def test_a_downtime_of_a_site_is_one_of_each_of_its_robots(servers, downtime, plan):
    plan("--site", "hall", "1h")
    assert planned_robots(servers) == ["robot_1", "robot_2"]
    plan("--site", "yard", "1h")
    said = downtime("--cancel", "--site", "hall").out
    assert said.startswith("cancelled: hall/robot_1 from ")
    assert planned_robots(servers) == ["robot_3"]


def test_of_several_labels_a_robot_has_all(servers, plan):
    plan("--site", "hall", "--selector", "team=carts", "2h")
    assert planned_robots(servers) == ["robot_2"]
    plan("--selector", "site=yard", "--selector", "team=carts", "2h")
    assert planned_robots(servers) == ["robot_2", "robot_3"]


def test_an_exporter_that_does_not_follow_is_an_error(servers, plan, monkeypatch):
    monkeypatch.setattr(commands.downtime, "FOLLOWED", 0.0)
    servers.follows = False
    said = plan("robot_1", "1h", code=1).err
    assert "does not read it: start it with --alertmanager.url=" in said


def test_without_an_exporter_the_fleet_has_to_be_named(servers, plan):
    servers.exporter_answers = False
    assert "or the fleet with --fleet" in plan("robot_1", "1h", code=3).err
    plan("--site", "yard", "1h", "--fleet", "hall", code=3)  # nobody says which robots
    assert servers.silences == []
    assert "not checked" in plan("robot_1", "1h", "--fleet", "hall").err
    assert planned_robots(servers) == ["robot_1"]


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
def test_wrong_arguments_are_usage_errors(arguments, problem, downtime):
    assert problem in downtime(*arguments, code=2).err


@pytest.mark.parametrize(
    "name", [("x" * 1_025,), ("robot_1", "x" * 1_025)], ids=["robot", "component"]
)
def test_a_name_that_no_robot_can_have_is_wrong_usage(servers, plan, name):
    plan(*name, "1h", code=2)


def test_a_duration_with_a_minus_is_named_with_the_way_out(servers, plan):
    error = plan("robot_1", "-5m", code=2).err
    assert "'-5m' begins with a minus" in error
    assert "write 5m" in error
    assert "No such option" not in error


def test_flags_may_stand_between_the_names(servers, downtime):
    downtime("robot_1", "--comment", "new gears", "Motor 1", "--from", "1h", "2h")
    (found,) = read_downtimes(servers.silences, "hall")
    assert found.component == "Motor 1"
