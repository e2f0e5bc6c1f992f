"""Any text of a robot can be displayed everywhere, without unprintable characters."""

import json
import logging
import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from rich.console import Console

from ros_diagnostics_exporter.events import Event, EventLog, Wanted
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.logs import set_up
from ros_diagnostics_exporter.texts import natural, one_line, printable, to_json
from ros_diagnostics_exporter.web.pages import landing, missing_robot, robot_page
from ros_diagnostics_tools.check_nagios import check
from ros_diagnostics_tools.commands.status import view
from ros_diagnostics_tools.main import main
from support.called import called
from support.web_server import broken, component, problem, robot
from support.web_server import fleet as fleet_of

CHECKOUT = Path(__file__).parents[3]
# Every category, surrogates and what is not assigned too; the awkward ones more often.
AWKWARD = (
    "\x00\t\n\r\x1b\x7f\x9b\xa0\xad\u00b2\u0663"
    "\u200b\u200e\u200f\u2028\u2029\u202e\u2066\u2069\ufeff"
)
TEXTS = st.text(st.characters(exclude_categories=()) | st.sampled_from(AWKWARD + "01|<[%='"))


def fleet(name: str, text: str) -> dict:
    """A fleet as /api/v1/fleet shows it, ``text`` wherever a robot may have put it."""
    motor = component(text, "ERROR", group=f"/{text}", message=text)
    motor["values"] = [{"key": text, "value": text, "number": 1.0, "unit": text}]
    about = {"group": f"/{text}", "component": text, "evidence": text}
    problems = [
        broken(**about),
        problem("value", "warning", key=text, **about),
        problem("check", "critical", check=text),
        problem("check", "critical", check="other", evidence=text),
    ]
    given = robot(
        name,
        motor,
        labels={"site": text},
        capabilities=[
            {
                "capability": text,
                "state": "lost",
                "parts": [
                    _part(group=text, component=text, key=text),
                    _part(check=text),
                    _part(robot=text, check=text),
                ],
            }
        ],
        short_checks=[{"check": text, "patterns": [text], "found": 1, "expected": 2}],
        groups=[{"group": f"/{text}", "level": "ERROR"}],
        problems=problems,
    )
    others = [{**given, "robot": other} for other in (f"{name}1", f"1{name}", "robot_2")]
    common = problem("common", "critical", component=text, evidence=text)
    return {**fleet_of(given, *others, problems=[common]), "fleet": text}


def _part(**named: str) -> dict[str, str]:
    unnamed = dict.fromkeys(("robot", "group", "component", "key", "check"), "")
    return {**unnamed, **named, "state": "lost"}


@given(TEXTS, TEXTS)
@example("", "\ud800")  # in the link of a runbook
def test_the_pages_have_only_printable_text(name, text):
    event = Event(1_000.0, "level", name, text, text, "OK", "ERROR", text)
    log = EventLog()
    log.record(event)
    fault = {"scope": "value", "state": "warning", "severity": "warning", "key": text}
    log.record(replace(event, kind="fault_began", **fault))
    given = fleet(name, text)
    robots = robot_page(given, name, log.find(Wanted()))
    assert robots is not None
    for page in (landing(given, "/metrics"), robots, missing_robot(given, text)):
        assert page.replace("\n", "").isprintable()


def test_the_page_lists_robots_by_the_numbers_in_their_names():
    robots = [robot(name, problems=[broken()]) for name in ("robot_10", "robot_2")]
    page = landing(fleet_of(*robots), "/metrics")
    assert page.index("robot_2") < page.index("robot_10")
    assert page.rindex("robot_2") < page.rindex("robot_10")


@given(TEXTS, TEXTS, st.booleans())
def test_the_status_command_prints_only_printable_text(name, text, components):
    console = Console(width=10_000, force_terminal=False)
    with console.capture() as captured:
        console.print(view(fleet(name, text), components=components))
    assert captured.get().replace("\n", "").isprintable()


@given(TEXTS, TEXTS)
def test_the_nagios_plug_in_prints_one_printable_line(name, text):
    _, line = check(fleet(name, text), name, "")
    assert line.isprintable()
    assert line.count("|") == 1


@given(TEXTS)
@pytest.mark.parametrize("form", ["logfmt", "json"])
def test_a_log_line_is_printable(form, text):
    root = logging.getLogger()
    before, level = list(root.handlers), root.level
    set_up("info", form)
    record = logging.LogRecord("a", logging.INFO, "", 0, "robot %s", (text,), None)
    try:
        assert root.handlers[0].format(record).isprintable()
    finally:
        root.handlers[:] = before
        root.setLevel(level)


@given(TEXTS)
def test_to_json_is_one_printable_line_that_decodes_to_the_text(text):
    line = to_json(text)
    assert line.isprintable()
    assert json.loads(line) == text.encode(errors="replace").decode()


def test_invisible_characters_become_escapes():
    assert one_line("a\u202eb\u2066c\u200fd\u200be\u2028f\x1bg") == (
        r"a\u202eb\u2066c\u200fd\u200be\u2028f\x1bg"
    )
    assert one_line("12\u202f°C\n\ttwo") == "12 °C  two"
    assert printable("12\u202f°C\n") == r"12\u202f°C\n"
    assert one_line("Größe 電池 🤖") == "Größe 電池 🤖"


@given(st.lists(TEXTS))
def test_natural_sorts_any_names_in_one_order(names):
    other_way = names[::-1]
    assert sorted(names, key=natural) == sorted(other_way, key=natural)


def test_natural_sorts_numbers_by_value():
    names = ["robot", "robot_1", "robot_2", "robot_010", "robot_10", "robot_10a", "robot_10b2"]
    other_way = names[::-1]
    assert sorted(other_way, key=natural) == names
    assert min("r" + "9" * 5_000, "r1", "robot\u00b2", "\u0663robot", key=natural) == "r1"
    found = sorted((f"r{number}" for number in range(200)), key=natural)
    assert found == [f"r{number}" for number in range(200)]


ALERT = {
    "labels": {
        "alertname": "RosDiagnosticsComponentCritical",
        "fleet": "f",
        "scope": "component",
        "state": "critical\x1b[2J",
        "robot": "r\u202e\x1b[2J",
        "component": "[/bold]\x9b",
    },
    "annotations": {"evidence": "since 2026-01-01 00:00:00 +0000 UTC"},
}


@pytest.mark.parametrize("arguments", [["--list"], ["r\u202e\x1b[2J", "--comment", "x"]])
def test_the_ack_command_prints_only_printable_text(monkeypatch, capsys, arguments):
    def get(_client, path):
        return [ALERT] if path.startswith("/api/v2/alerts") else []

    monkeypatch.setattr(Client, "get", get)
    monkeypatch.setattr(Client, "post", lambda *_: None)
    assert main(["ack", *arguments, "--author", "me"]) == 0
    out = capsys.readouterr().out
    assert out.replace("\n", "").isprintable()
    assert "[/bold]" in out


def test_the_documented_jq_line_prints_only_printable_text():
    """The line is run as docs/deployment.md has it."""
    if shutil.which("jq") is None:
        pytest.skip("needs jq")
    (line,) = [
        each.strip()
        for each in (CHECKOUT / "docs" / "deployment.md").read_text().splitlines()
        if each.startswith("    jq ")
    ]
    event = {"after": "ERROR", "time": 1, "robot": "r", "component": "c", "message": AWKWARD}
    answer = json.dumps({"events": [event]})
    done = called(["sh", "-c", line], input=answer)
    assert done.stdout.rstrip("\n").isprintable()
    assert json.loads(done.stdout) == [1, "r", "c", AWKWARD]
