"""Texts of robots where people see them: nothing raises, nothing invisible is left."""

from __future__ import annotations

import json
import logging
import shutil
import subprocess
from argparse import Namespace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from ros_diagnostics_exporter.cli import ack
from ros_diagnostics_exporter.cli.check_nagios import check
from ros_diagnostics_exporter.cli.status import view
from ros_diagnostics_exporter.logs import set_up
from ros_diagnostics_exporter.texts import natural, printable, shown, to_json
from ros_diagnostics_exporter.web.pages import landing

CHECKOUT = Path(__file__).parents[3]
# Every category, surrogates and what is not assigned too; the awkward ones more often.
AWKWARD = (
    "\x00\t\n\r\x1b\x7f\x9b\xa0\xad\u00b2\u0663"
    "\u200b\u200e\u200f\u2028\u2029\u202e\u2066\u2069\ufeff"
)
TEXTS = st.text(st.characters(exclude_categories=()) | st.sampled_from(AWKWARD + "01|<[%='"))
OPTIONS = Namespace(component=None)


def fleet(name: str, text: str) -> dict:
    """A fleet as /api/v1/fleet shows it, ``text`` wherever a robot may have put it."""
    component = {
        "component": text,
        "group": f"/{text}",
        "level": "ERROR",
        "level_before_stale": None,
        "state": "CRITICAL",
        "planned_stale": False,
        "message": text,
        "since": 1_000.0,
        "values": [{"key": text, "value": text, "number": 1.0, "unit": text}],
    }
    robot = {
        "robot": name,
        "up": True,
        "silent_reason": None,
        "last_message": 1_000.0,
        "maintenance": False,
        "short_checks": [{"check": text, "found": 1, "expected": 2}],
        "groups": [{"group": f"/{text}", "level": "ERROR"}],
        "components": [component],
    }
    others = [{**robot, "robot": other} for other in (f"{name}1", f"1{name}", "robot_2")]
    return {"fleet": text, "time": 1_060.0, "robots": [robot, *others]}


@given(TEXTS, TEXTS)
def test_the_page_shows_any_text_and_no_text_turns_it_round(name, text):
    page = landing(fleet(name, text), "/metrics")
    assert page.replace("\n", "").isprintable()


@given(TEXTS, TEXTS, st.sampled_from([None, ""]))
def test_the_status_command_prints_any_text_and_no_terminal_obeys_it(name, text, component):
    console = Console(width=10_000, force_terminal=False)
    with console.capture() as captured:
        console.print(view(fleet(name, text), Namespace(component=component)))
    assert captured.get().replace("\n", "").isprintable()


@given(TEXTS, TEXTS)
def test_the_nagios_plug_in_prints_one_line_of_any_text(name, text):
    _, line = check(fleet(name, text), name, "")
    assert line.isprintable()
    assert line.count("|") == 1


@given(TEXTS)
@pytest.mark.parametrize("form", ["logfmt", "json"])
def test_a_log_line_shows_any_text(form, text):
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
def test_json_for_a_file_is_the_same_text(text):
    line = to_json(text)
    assert line.isprintable()
    assert json.loads(line) == text.encode(errors="replace").decode()


def test_what_is_invisible_is_shown_as_an_escape():
    assert shown("a\u202eb\u2066c\u200fd\u200be\u2028f\x1bg") == (
        r"a\u202eb\u2066c\u200fd\u200be\u2028f\x1bg"
    )
    assert shown("12\u202f°C\n\ttwo") == "12 °C  two"
    assert printable("12\u202f°C\n") == r"12\u202f°C\n"
    assert shown("Größe 電池 🤖") == "Größe 電池 🤖"


@given(st.lists(TEXTS))
def test_any_names_sort_and_always_in_the_same_way(names):
    other_way = names[::-1]
    assert sorted(names, key=natural) == sorted(other_way, key=natural)


def test_numbers_sort_as_numbers():
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
        "robot": "r\u202e\x1b[2J",
        "component": "[/bold]\x9b",
    },
    "annotations": {"since": "2026-01-01 00:00:00 +0000 UTC"},
}


@pytest.mark.parametrize("arguments", [["--list"], ["r\u202e\x1b[2J", "--comment", "x"]])
def test_an_acknowledgement_prints_no_text_that_a_terminal_obeys(monkeypatch, capsys, arguments):
    def answer(_options, path, _body=None):
        return [ALERT] if path.startswith("/api/v2/alerts") else []

    monkeypatch.setattr(ack, "ask", answer)
    assert ack.main([*arguments, "--author", "me"]) == 0
    out = capsys.readouterr().out
    assert out.replace("\n", "").isprintable()
    assert "[/bold]" in out


def test_the_documented_line_for_the_event_log_shows_escapes(tmp_path):
    """Of docs/deployment.md, run as it stands there."""
    if shutil.which("jq") is None:
        pytest.skip("needs jq")
    (line,) = [
        each
        for each in (CHECKOUT / "docs" / "deployment.md").read_text().splitlines()
        if each.startswith("jq ")
    ]
    event = {"after": "ERROR", "time": 1, "robot": "r", "component": "c", "message": AWKWARD}
    (tmp_path / "events.jsonl").write_text(json.dumps(event) + "\n")
    done = subprocess.run(
        ["sh", "-c", line], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert done.stdout.rstrip("\n").isprintable()
    assert json.loads(done.stdout) == [1, "r", "c", AWKWARD]
