"""On call with the routes of docs/existing-servers.md: nobody is notified less than before."""

import re
from datetime import datetime, timezone

import pytest

from support.existing_site import ALERTMANAGER, added
from support.shipped_rules import ROOT, run_tool

NOW = datetime(2027, 3, 22, 12, tzinfo=timezone.utc)
PAGE = (ROOT / "docs" / "on-call.md").read_text().partition("## With existing servers")[2]
(ROUTE,) = re.findall(r"```yaml\n(- .*\n)```", PAGE.partition("\n## ")[0])
FILE = """
time_zone: Europe/Berlin
people:
  anna: {email: anna@example.org}
  ben: {email: ben@example.org}
teams:
  - name: robots
    levels:
      first:
        receiver: on-call
        like: [robots]
        shifts:
          - {people: [anna, ben], since: 2027-01-04T09:00}
"""
LAST = "    - receiver: robots\n"


@pytest.fixture
def site(folder):
    """A function (edit): the site's alertmanager.yml with the page's pieces and its route."""
    text = added(ALERTMANAGER.format(smtp="localhost:25"), "alertmanager.yml")
    nested = "repeat_interval: 96h\n    routes:\n"
    assert text.count(nested) == 1
    text = text.replace(nested, f"{nested}      {ROUTE}")

    def write(edit=str):
        (folder / "alertmanager.yml").write_text(edit(text))

    return write


def receivers(folder, **labels):
    """Who is sent a critical fault by what was built."""
    given = {"alertname": "RosDiagnosticsComponentCritical", "severity": "critical", **labels}
    built = f"--config.file={folder / 'alertmanager-oncall.yml'}"
    wanted = [f"{name}={value}" for name, value in given.items()]
    return run_tool("amtool", "config", "routes", "test", built, *wanted).strip().split(",")


def test_the_route_of_the_page_adds_the_person_on_call(run, folder, site):
    site()
    for command in ("check", "build"):
        assert run(FILE, command, now=NOW).err == ""
    critical = receivers(folder)
    assert critical[-1] == "robots"
    assert all(each.startswith("on-call/robots/first/") for each in critical[:-1])
    assert receivers(folder, severity="warning") == ["robots"]


def test_a_receiver_that_would_get_nothing_any_more_is_named(run, site):
    site(lambda text: re.sub(rf"^ *{LAST.strip()}\n", "", text, flags=re.MULTILINE))
    errors = run(FILE, "check", now=NOW, code=1).err
    assert re.fullmatch(
        r'alertmanager.yml:\d+: route: alerts for "on-call" no longer go to "robots", above it; '
        r"add - receiver: robots as the last of the routes below that\n",
        errors,
    )
    assert run(FILE, "build", now=NOW).err == errors


def test_check_finds_what_build_rejects_and_says_where_the_route_belongs(run, site):
    site()
    text = FILE.replace("receiver: on-call", "receiver: robots").replace("like: [robots]", "")
    text = text.replace("        \n", "")
    check, build = (run(text, command, now=NOW, code=2) for command in ("check", "build"))
    assert check == build
    assert "add {matchers: [severity = critical], receiver: on-call, continue: true}" in check.err
