"""The command: what it prints and writes, its exit codes."""

import json
import re
import stat
import sys
from datetime import datetime, timedelta, timezone
from typing import Any

import icalendar
import pytest
import yaml

from ros_diagnostics_exporter.extras import install_command
from support.called import called
from support.shipped_rules import run_tool

NOW = datetime(2027, 3, 22, 12, 34, 56, tzinfo=timezone.utc)  # 13:34 in Berlin
FILE = """
time_zone: Europe/Berlin
people:
  anna: {email: anna@example.org, phone: "+4915112345601"}
  ben: {email: ben@example.org}
teams:
  - name: robots
    levels:
      first:
        receiver: on-call
        like: [email, sms]
        shifts:
          - {people: [anna, ben], since: 2027-01-04T09:00}
      second:
        receiver: escalation-1
        shifts:
          - {people: [ben, anna], since: 2027-01-04T09:00}
"""


def test_who_is_on_call_now(run):
    title, _, *rows = (line.split() for line in run(FILE, "who", now=NOW).out.splitlines())
    assert " ".join(title) == "on call at 2027-03-22 Mon 13:34 CET"
    until = ["2027-03-29", "Mon", "09:00", "CEST"]
    assert rows == [
        ["robots", "first", "ben", "ben@example.org", *until, "anna"],
        ["robots", "second", "anna", "anna@example.org", "+4915112345601", *until, "ben"],
    ]


@pytest.mark.parametrize(
    ("at", "expected"),
    [
        ("2027-03-29T08:59", "ben"),
        ("2027-03-29T09:00", "anna"),  # after the clock change, at nine
        ("2027-03-29T06:59Z", "ben"),
        ("2027-03-29T07:00:00+00:00", "anna"),
    ],
)
def test_who_is_on_call_at_a_time(run, at, expected):
    found = run(FILE, "who", "--at", at, now=NOW).out.splitlines()
    assert found[2].split()[2] == expected


@pytest.mark.parametrize(
    ("at", "expected"), [("07:59Z", "ben"), ("08:00Z", "anna"), ("08:59Z", "anna")]
)
def test_an_override_begins_at_the_time_of_its_offset(run, at, expected):
    override = "{person: anna, instead_of: ben, start: 2027-03-24T08:00Z, end: 2027-03-25T08:00Z}"
    who = ("who", "--at", f"2027-03-24T{at}")
    found = run(f"{FILE}overrides: [{override}]", *who, now=NOW).out.splitlines()
    assert found[2].split()[2] == expected


def test_two_teams_have_events_of_their_own_in_a_calendar(run):
    levels = FILE.partition("- name: robots\n")[2]
    arms = f"  - name: arms\n    matchers: [team = arms]\n{levels}"
    output = run(FILE.replace("teams:\n", f"teams:\n{arms}"), "icalendar", now=NOW).out
    found = [str(each["uid"]) for each in events(output)]
    assert any("-arms-" in each for each in found)
    assert len(set(found)) == len(found)


def test_a_time_that_is_none(run):
    errors = run(FILE, "who", "--at", "noon", now=NOW, code=2).err
    assert "--at: 'noon' is no time; write it as 10m, 14:30, 2027-01-31" in errors


def test_what_was_built_is_as_readable_as_alertmanager_yml(run, folder):
    """It may have a password in it, too."""
    (folder / "alertmanager.yml").chmod(0o640)
    found = "alertmanager-oncall.yml: on call until 2027-06-21 Mon 14:00 CEST\n"
    assert run(FILE, "build", now=NOW) == (found, "")
    built = folder / "alertmanager-oncall.yml"
    assert stat.S_IMODE(built.stat().st_mode) == 0o640
    assert sorted(each.name for each in folder.iterdir()) == [
        *("alertmanager-oncall.yml", "alertmanager.yml", "examples", "oncall.yml", "templates")
    ]


@pytest.mark.parametrize("output", ["alertmanager.yml", "../built.yml"])
def test_an_output_that_would_not_work(run, folder, output):
    before = (folder / "alertmanager.yml").read_text()
    assert run(FILE, "build", "--to", output, now=NOW, code=2).err == (
        f"alertmanager.yml: {output} cannot be the output; name another file in the folder of "
        "alertmanager.yml, as its templates are there\n"
    )
    assert (folder / "alertmanager.yml").read_text() == before
    assert not (folder.parent / "built.yml").exists()


def test_a_folder_that_cannot_be_written(run, folder):
    errors = run(FILE, "build", "--rules", "missing/oncall.yml", now=NOW, code=1).err
    assert errors.startswith("ros-diagnostics: [Errno 2] No such file or directory: ")


CHECK = ("check", "--built", "alertmanager-oncall.yml")


def test_check_of_what_was_just_built(run):
    run(FILE, "build", now=NOW)
    found = run(FILE, *CHECK, now=NOW)
    assert found.err == ""
    assert found.out.splitlines() == [
        "oncall.yml: valid until 2027-06-21 Mon 14:34 CEST",
        "alertmanager-oncall.yml: on call until 2027-06-21 Mon 14:00 CEST",
    ]


def test_check_warns_two_weeks_before_the_end(run):
    run(FILE, "build", "--ahead", "5w", now=NOW)
    run(FILE, *CHECK, now=NOW + timedelta(weeks=2, days=6))
    errors = run(FILE, *CHECK, now=NOW + timedelta(weeks=3), code=1).err
    assert errors == "alertmanager-oncall.yml: ends in less than 2w; build it again\n"


@pytest.mark.parametrize("changed", ["oncall.yml", "alertmanager.yml"])
def test_check_warns_where_a_file_was_changed_after_the_build(run, folder, changed):
    run(FILE, "build", now=NOW)
    text = FILE + "\n" if changed == "oncall.yml" else FILE
    if changed == "alertmanager.yml":
        (folder / changed).write_text((folder / changed).read_text() + "\n")
    changed = "oncall.yml or alertmanager.yml has changed since; build it again"
    assert run(text, *CHECK, now=NOW, code=1).err == f"alertmanager-oncall.yml: {changed}\n"


def test_check_of_a_file_that_was_not_built(run):
    errors = run(FILE, "check", "--built", "alertmanager.yml", now=NOW, code=1).err
    assert "alertmanager.yml: was not built by ros-diagnostics oncall" in errors


def test_check_of_a_rota_with_a_gap(run):
    errors = run(FILE.replace("2027-01-04", "2027-05-03"), "check", now=NOW, code=2).err
    when = "from 2027-03-22 Mon 13:34 CET until 2027-05-03 Mon 09:00 CEST"
    assert f"{when} nobody is on call; " in errors


def test_check_says_who_gets_which_days(run):
    first = "          - {people: [anna, ben], since: 2027-01-04T09:00}\n"
    hours = """\
          - {people: [anna, ben], since: 2027-01-04T09:00, every: day, hours: [Mon-Fri 09:00-19:00]}
          - {people: [ben], since: 2027-01-04T19:00, hours: [Mon-Thu 19:00-09:00, Fri 19:00-24:00,
             Sat 00:00-24:00, Sun 00:00-24:00, Mon 00:00-09:00]}
"""
    assert first in FILE
    found = run(FILE.replace(first, hours), "check", "--ahead", "2w", now=NOW)
    assert found.err == ""
    assert found.out.splitlines()[1:] == [
        "days of robots/first until then:",
        "  anna: Mon 1, Tue 1, Wed 1, Thu 1, Fri 1",
        "  ben: Mon 3, Tue 2, Wed 2, Thu 2, Fri 2, Sat 2, Sun 2",
    ]


@pytest.mark.parametrize(
    ("since", "hours", "divided"),
    [
        ("09:00", "Mon-Fri 08:00-19:00", "08:00-19:00"),
        ("08:00", "Mon-Fri 08:00-19:00", ""),
        ("19:00", "Mon-Fri 08:00-19:00", ""),
        ("06:30", "Mon-Fri 22:00-07:00", "22:00-07:00"),
        ("22:00", "Mon-Fri 22:00-07:00", ""),
        ("09:00", "Sat-Sun 00:00-24:00", ""),
    ],
)
def test_a_handover_within_the_hours_of_a_day_is_named(run, since, hours, divided):
    first = "          - {people: [anna, ben], since: 2027-01-04T09:00}\n"
    daily = f"""\
          - people: [anna, ben]
            since: 2027-01-04T{since}
            every: day
            hours: ["{hours}"]
"""
    assert first in FILE
    always = {"person": "ben", "start": "2027-01-01T00:00", "end": "2030-01-01T00:00"}
    where = {"team": "robots", "level": "first"}
    text = FILE.replace(first, daily) + yaml.safe_dump({"overrides": [always | where]})
    errors = run(text, "check", "--ahead", "2w", now=NOW, code=int(bool(divided))).err
    expected = (
        rf"oncall.yml:(\d+): teams\[robots\].levels.first.shifts\[0\].since: the handover at "
        rf"{since} divides the hours {divided}, so each part is a turn of its own; write the "
        rf"beginning of the hours, T{divided[:5]}\n"
    )
    assert re.fullmatch(expected if divided else "", errors)


def test_the_rule_fires_two_weeks_before_the_end(run, folder):
    run(FILE, "build", "--ahead", "3w", "--rules", "rules.yml", now=NOW)
    run_tool("promtool", "check", "rules", folder / "rules.yml")
    # promtool's clock begins at 1970; a rule with the end there is the same rule.
    end = int((NOW + timedelta(weeks=1)).replace(minute=0, second=0).timestamp())
    rules = (folder / "rules.yml").read_text()
    assert f"vector(time()) > {end}" in rules
    (folder / "rules.yml").write_text(rules.replace(str(end), "600"))
    name = "RosDiagnosticsOnCallEnds"
    firing = {"exp_labels": {"severity": "warning"}}
    tests = {
        "rule_files": ["rules.yml"],
        "evaluation_interval": "1m",
        "tests": [
            {
                "alert_rule_test": [
                    {"eval_time": "10m", "alertname": name, "exp_alerts": []},
                    {"eval_time": "11m", "alertname": name, "exp_alerts": [firing]},
                ]
            }
        ],
    }
    firing["exp_annotations"] = yaml.safe_load(rules)["groups"][0]["rules"][0]["annotations"]
    (folder / "tests.yml").write_text(json.dumps(tests))
    run_tool("promtool", "test", "rules", folder / "tests.yml")


def events(output: str) -> list[Any]:
    return icalendar.Calendar.from_ical(output).walk("VEVENT")


def test_a_calendar_has_an_event_for_each_duty(run):
    output = run(FILE, "icalendar", "--ahead", "3w", now=NOW).out
    found = [(str(e["summary"]), e["dtstart"].dt, e["dtend"].dt) for e in events(output)]
    start, change, end = (
        datetime(2027, month, day, hour, tzinfo=timezone.utc)
        for month, day, hour in ((3, 22, 8), (3, 29, 7), (4, 5, 7))
    )
    assert found[:2] == [
        ("ben is on call: robots, first", start, change),
        ("anna is on call: robots, first", change, end),
    ]
    assert len({str(each["uid"]) for each in events(output)}) == len(found) == 8


def test_a_calendar_of_one_person_has_the_same_events_a_week_later(run):
    def by_uid(now: datetime) -> dict[str, datetime]:
        output = run(FILE, "icalendar", "--person", "anna", now=now).out
        assert "ben is" not in output
        return {str(each["uid"]): each["dtstart"].dt for each in events(output)}

    first, later = by_uid(NOW), by_uid(NOW + timedelta(weeks=1))

    assert len(first.keys() & later.keys()) == 13
    assert all(later[uid] == first[uid] for uid in first.keys() & later.keys())


def test_a_calendar_of_a_person_who_is_not_there(run):
    said = '--person: "zoe" is never on call; use one of anna, ben\n'
    assert run(FILE, "icalendar", "--person", "zoe", now=NOW, code=2) == ("", said)


WITHOUT = """
import sys
sys.modules["icalendar"] = None
from ros_diagnostics_tools.main import main
sys.exit(main(["oncall", *sys.argv[1:]]))
"""


def test_without_the_library_all_but_the_calendar_works(run, folder):
    run(FILE.replace("2027", "2026"), "build")  # the clock is the real one

    def without(*arguments: str) -> tuple[int, str]:
        argv = [sys.executable, "-c", WITHOUT, *arguments]
        done = called(argv, code=None, cwd=folder, timeout=60)
        return done.returncode, done.stderr

    assert without(*CHECK) == (0, "")
    said = f"the library icalendar is not installed: {install_command('icalendar')}"
    assert without("icalendar") == (2, f"ros-diagnostics: {said}\n")
