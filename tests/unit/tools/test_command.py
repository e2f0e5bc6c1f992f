"""The one command: its help, exit codes, named exporters, what each subcommand prints."""

import json
import shlex
import sys
from collections.abc import Iterator

import click
import pytest

from ros_diagnostics_exporter.http_client import Client, UnreachableError
from ros_diagnostics_tools.commands import test_page
from ros_diagnostics_tools.main import COMMANDS, command, main
from support.called import called
from support.web_server import component, fleet, robot

FLEET = fleet(robot("robot_1", component("Motor 1", "OK"), labels={"site": "hall", "team": "arms"}))
FAULT = {
    "scope": "component",
    "state": "critical",
    "severity": "critical",
    "robot": "robot_1",
    "group": "/Motor",
    "component": "Motor 1",
    "site": "",
    "check": "",
    "key": "",
    "bound": "",
    "since": 1_000.0,
    "evidence": "\x1b[31mhot",
}


def commands(group: click.Group, path: tuple[str, ...] = ()) -> Iterator[tuple[str, ...]]:
    """The path of each subcommand that does something."""
    context = click.Context(group)
    for name in group.list_commands(context):
        each = group.get_command(context, name)
        if isinstance(each, click.Group):
            yield from commands(each, (*path, name))
        else:
            yield (*path, name)


PATHS = list(commands(command))


@pytest.mark.parametrize("path", PATHS, ids=" ".join)
def test_help_has_an_example_that_the_parser_takes(path, run):
    shown = run(*path, "--help").out.replace("\\\n", " ")
    assert "Example" in shown or "  ros-diagnostics " in shown
    example = shown[shown.rindex("ros-diagnostics " + " ".join(path)) :].split("\n\n")[0]
    words = shlex.split(" ".join(example.split("\n  ros-diagnostics")[0].split()))[1:]
    parsed: click.Command = command
    while isinstance(parsed, click.Group):
        name = words.pop(0)
        parsed = parsed.get_command(click.Context(parsed), name) or parsed
    parsed.make_context(path[-1], words)  # or it raises UsageError


def test_the_help_says_of_each_subcommand_what_its_own_does(run):
    shown = run("--help").out
    assert all(name in shown and text in shown for name, text in COMMANDS.items())


def test_completion_names_the_subcommands_without_importing_them():
    code = (
        "import sys\n"
        "from click.shell_completion import ShellComplete\n"
        "from ros_diagnostics_tools.main import command\n"
        "found = ShellComplete(command, {}, 'ros-diagnostics', 'X').get_completions([], 'd')\n"
        "print([each.value for each in found])\n"
        "print([each for each in sys.modules if each.startswith('ros_diagnostics_tools.commands')])"
    )
    done = called([sys.executable, "-c", code], timeout=60)
    assert done.stdout.splitlines() == ["['downtime']", "[]"]


# -- exit codes ------------------------------------------------------------------------------


ASKING = (
    ["status"],
    ["why", "r"],
    ["capabilities", "r"],
    ["history", "r"],
    ["faults"],
    ["forget", "r"],
    ["watch", "accept", "r"],
    ["ack", "--list"],
    ["downtime", "--list"],
    ["test-page", "r"],
)


@pytest.mark.parametrize("arguments", ASKING, ids=" ".join)
def test_a_server_that_does_not_answer_is_3_for_all(arguments, run):
    closed = "http://127.0.0.1:1"
    said = run(*arguments, "--url", closed, "--alertmanager", closed, code=3).err
    assert said.startswith(f"ros-diagnostics: cannot reach {closed}/")
    assert ": Connection refused. Does it run? For another address: --url (exporter)" in said


@pytest.mark.parametrize(
    "arguments", [["nothing"], ["status", "--nothing"], ["faults", "--output", "xml"]], ids=" ".join
)
def test_wrong_arguments_are_2(arguments, run):
    assert "Usage: ros-diagnostics" in run(*arguments, code=2).err


def test_a_configuration_that_is_not_right_is_2(tmp_path, run):
    (tmp_path / "fleet.yml").write_text("fleet: f\nrobos: []\n")
    assert "robots" in run("check-config", str(tmp_path / "fleet.yml"), code=2).err


@pytest.mark.parametrize(
    "arguments", [["downtime", "--list"], ["ack", "--list"], ["why", "r"]], ids=" ".join
)
def test_ctrl_c_ends_a_command_without_a_traceback(arguments, monkeypatch, run):
    def interrupted(_client, _path):
        raise KeyboardInterrupt

    monkeypatch.setattr(Client, "get", interrupted)
    run(*arguments, code=130)


# -- subcommands -----------------------------------------------------------------------------


def test_a_configuration_is_checked_also_against_the_running_exporter(serve, tmp_path, run):
    path = tmp_path / "fleet.yml"
    path.write_text(
        "fleet: hall\nrobots: [{name: robot_1, namespace: /a}, {name: x, namespace: /x}]\n"
    )
    assert "unmatched" not in run("check-config", str(path)).out

    query = {"name": "Host/wrong", "expr": "no(", "rows": 0, "skipped": 0, "error": "parse error"}
    server = serve(fleet_snapshot=lambda: {**FLEET, "queries": [query]})
    live = ["check-config", str(path), "--live"]
    shown = run(*live, at=server).out
    assert "unmatched (" in shown
    assert "queries (1):\n  Host/wrong: parse error" in shown
    assert json.loads(run(*live, "--output", "json", at=server).out)["fleet"] == "hall"
    of_each = [run("check-config", str(path), f"--shard={each}/2").out for each in (1, 2)]
    assert [text.count("domain 0, /") for text in of_each] == [1, 1]
    assert "is not a shard such as 2/4" in run("check-config", "--shard=3/2", code=2).err


@pytest.mark.usefixtures("wide")
def test_faults_are_listed(serve, run):
    faults = {"fleet": "hall", "time": 1_060.0, "faults": [FAULT]}
    server = serve(faults=lambda: faults)
    text = run("faults", at=server).out
    assert "CRITICAL  robot_1  /Motor/Motor 1" in text
    assert "\x1b" not in text
    assert json.loads(run("faults", "--output", "json", at=server).out) == faults
    assert run("faults", "--robot", "other*", at=server).out == "no fault of fleet hall\n"


def test_forget_names_the_robot_and_the_component(serve, run):
    asked = []
    server = serve(
        forget=lambda *given: asked.append(given) or (2, given[1] is None),
        fleet_snapshot=lambda: FLEET,
        lifecycle=True,
    )
    assert run("forget", "robot_1", "Motor 1", at=server).out == (
        "robot_1 Motor 1 is forgotten\n"
        "Only this exporter has forgotten it, as it reaches no Alertmanager: repeat it at each"
        " other exporter of the fleet, with --url.\n"
    )
    found = json.loads(run("forget", "robot_1", "--output", "json", at=server).out)
    assert found == {"forgotten": 2, "passed_on": True}
    assert asked == [("robot_1", "Motor 1"), ("robot_1", None)]


def test_forget_says_that_a_robot_is_not_known_and_names_the_nearest(serve, run):
    server = serve(forget=lambda *_: (0, True), fleet_snapshot=lambda: FLEET, lifecycle=True)
    said = "no robot is called 'robot1'; the nearest is 'robot_1'; if alerts still fire for a robot"
    assert run("forget", "robot1", at=server, code=1).out == f"{said} of this name, they end\n"


def unknown(*_given, **_more):
    raise LookupError("there is no robot 'robot1'")


def test_why_names_the_nearest_robot(serve, run):
    said = run("why", "robot1", at=serve(why=unknown, fleet_snapshot=lambda: FLEET), code=1).err
    assert "no robot 'robot1'; the nearest is 'robot_1'" in said


def test_accept_names_the_robot(serve, run):
    asked = []
    server = serve(accept_graph=lambda *given: asked.append(given) or 16, lifecycle=True)
    accept = ("watch", "accept", "robot_1")
    assert run(*accept, at=server).out == "accepted: robot_1, 16 nodes are expected\n"
    assert json.loads(run(*accept, "--output", "json", at=server).out) == {"expected": 16}
    assert asked == [("robot_1",)] * 2


def test_what_the_exporter_does_not_know_cannot_be_forgotten(serve, run):
    server = serve(forget=unknown, fleet_snapshot=lambda: FLEET, lifecycle=True)
    said = run("forget", "robot1", at=server, code=1).err
    assert said.startswith("ros-diagnostics: there is no robot 'robot1' (http://")
    assert "404" in said


def routed(**suppressing):
    """What Alertmanager says of an alert that has two receivers."""
    state = "suppressed" if suppressing else "active"
    status = {"state": state, "silencedBy": [], "inhibitedBy": [], **suppressing}
    return {"receivers": [{"name": "on-call"}, {"name": "email"}], "status": status}


@pytest.fixture
def alertmanager(played):
    played.fleet, played.routed = FLEET, routed()
    return played


def test_a_test_page_has_the_labels_of_a_fault_and_says_that_it_is_a_test(alertmanager, run):
    said = run("test-page", "robot_1", "--receiver", "on-call").out
    (alert,) = alertmanager.alerts
    assert alert["labels"] == {
        "alertname": "RosDiagnosticsTest",
        "fleet": "hall",
        "robot": "robot_1",
        "site": "hall",
        "team": "arms",
        "component": "TEST, nothing is wrong",
        "scope": "component",
        "state": "critical",
        "severity": "critical",
    }
    assert "TEST" in alert["annotations"]["summary"]
    assert alert["startsAt"] < alert["endsAt"]
    assert "to on-call, email" in said


def test_a_test_page_that_goes_elsewhere_or_nowhere_fails(alertmanager, run):
    said = run("test-page", "robot_1", "--receiver", "boss", code=1).err
    assert "do not lead to 'boss' but to on-call, email" in said
    for by in ("silencedBy", "inhibitedBy"):
        alertmanager.routed = routed(**{by: ["x"]})
        assert "nobody is notified" in run("test-page", "robot_1", code=1).err
    assert "no robot 'robot_2'" in run("test-page", "robot_2", code=1).err


def test_a_test_page_that_alertmanager_does_not_show_fails(alertmanager, monkeypatch, run):
    monkeypatch.setattr(test_page, "SHOWN", 0.0)
    assert "does not show it" in run("test-page", "robot_1", code=1).err


# -- named exporters -------------------------------------------------------------------------


@pytest.fixture
def asked(monkeypatch, tmp_path):
    """The URLs that were asked, with $XDG_CONFIG_HOME at ``tmp_path``."""
    monkeypatch.setenv("XDG_CONFIG_HOME", str(tmp_path))
    urls = []

    def get(client, _path):
        urls.append(client.url)
        raise UnreachableError("enough")

    monkeypatch.setattr(Client, "get", get)
    return urls


NAMED = """
exporters:
  north: {url: "http://north:1", alertmanager: "http://north:2"}
  south: {url: "http://south:1", user: ann, password_file: south.pw}
"""


def test_exporters_have_names_and_the_first_is_the_default(asked, tmp_path):
    assert main(["faults"]) == 3
    (tmp_path / "ros-diagnostics.yml").write_text(NAMED)
    (tmp_path / "south.pw").write_text("secret")
    for arguments in ([], ["--url", "south"], ["--url", "http://east:1"]):
        assert main(["faults", *arguments]) == 3
    assert main(["ack", "--list", "-u", "north"]) == 3
    assert main(["ack", "--list", "-u", "north", "--alertmanager", "http://other:2"]) == 3
    assert asked == [
        *("http://127.0.0.1:9877", "http://north:1", "http://south:1", "http://east:1"),
        *("http://north:2", "http://other:2"),
    ]


@pytest.mark.parametrize("flag", ["password-file", "ca-file", "cert-file", "key-file"])
def test_a_file_that_cannot_be_read_is_a_wrong_argument(asked, tmp_path, run, flag):
    missing = tmp_path / "missing"
    said = run("faults", "--url", "https://north:1", f"--{flag}", str(missing), code=2).err
    assert f"{flag.replace('-', '_')}: {missing}: no such file, or it cannot be read" in said
    assert asked == []


@pytest.mark.parametrize(
    ("content", "error"),
    [
        (NAMED, "--url west: neither a URL such as http://127.0.0.1:9877 nor one of the exporters"),
        ("exporters: {west: {uri: x}}", "exporters: west: uri: no such key; there are url"),
        ("exporters: {west: {user: x}}", "exporters: west: needs url"),
        ("exporters: {}", "exporters: names no exporter"),
        ("[", "is no list of exporters; write exporters:"),
        (None, "No such file"),
    ],
)
def test_a_name_that_is_not_there_and_a_wrong_file_are_said(asked, tmp_path, run, content, error):
    if content is not None:
        (tmp_path / "ros-diagnostics.yml").write_text(content)
    shown = run("faults", "--url", "west", code=2).err
    assert error in shown
    assert str(tmp_path / "ros-diagnostics.yml") in shown
    assert asked == []
