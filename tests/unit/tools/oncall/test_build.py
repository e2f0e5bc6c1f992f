"""Alertmanager's configuration with the people on call in it."""

from collections.abc import Callable, Iterator
from datetime import datetime, timedelta, timezone
from pathlib import Path
from typing import Any

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_tools.oncall.build import _Configuration, built_until, hours
from support.shipped_rules import run_tool
from support.time_intervals import contains

UTC = timezone.utc
NOW = datetime(2027, 3, 22, 12, tzinfo=UTC)  # a Monday; clocks of Berlin change on Sunday
FILE = """
time_zone: Europe/Berlin
people:
  anna: {email: anna@example.org, phone: "+4915112345601"}
  ben: {email: ben@example.org}
  carla: {email: carla@example.org, phone: "+4915112345603"}
  maria: {email: maria@example.org, phone: "+4915112345604"}
teams:
  - name: arms
    matchers: [team = arms]
    levels:
      first:
        receiver: on-call
        like: [email, sms]
        shifts:
          - {people: [carla], since: 2027-01-04T08:00, hours: [daily 08:00-20:00]}
          - {people: [anna, maria], since: 2027-01-04T08:00, hours: [daily 20:00-08:00]}
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
          - {people: [ben, carla], since: 2027-01-04T09:00, every: day}
      manager:
        receiver: escalation-2
        shifts:
          - {people: [maria], since: 2027-01-04T09:00}
overrides:
  - {person: carla, instead_of: ben, start: 2027-03-24T09:00, end: 2027-03-25T09:00}
"""


BUILT: list[dict[str, Any]] = []


@pytest.fixture
def built(run: Callable[..., Any], folder: Path) -> dict[str, Any]:
    """What the file above becomes: built by the first test that asks, and not changed by any."""
    if not BUILT:
        assert run(FILE, "build", "--ahead", "2w", now=NOW).err == ""
        BUILT.append(yaml.safe_load((folder / "alertmanager-oncall.yml").read_text()))
    return BUILT[0]


def notified(config: dict[str, Any], at: datetime, labels: dict[str, str]) -> list[str]:
    """The receivers that are notified of an alert with these labels at a time."""
    times = {each["name"]: each["time_intervals"] for each in config["time_intervals"]}

    def active(route: dict[str, Any]) -> bool:
        within = [contains(times[name], at) for name in route.get("active_time_intervals", [])]
        muted = [contains(times[name], at) for name in route.get("mute_time_intervals", [])]
        return (not within or any(within)) and not any(muted)

    def receivers(route: dict[str, Any]) -> Iterator[str] | list[str]:
        found = [r for r in route.get("routes", []) if matches(r.get("matchers", []), labels)]
        taken: list[str] = []
        for each in found:
            taken += receivers(each)
            if not each.get("continue"):
                return taken
        return taken or ([route["receiver"]] if active(route) and not found else [])

    return list(receivers(config["route"]))


def matches(matchers: list[str], labels: dict[str, str]) -> bool:
    """Only the matchers of these tests: equality, and the last of alertmanager.yml."""
    pairs = [each.split(" = ") for each in matchers if " = " in each]
    return all(labels.get(name) == value.strip('"') for name, value in pairs)


CRITICAL = {"alertname": "RosDiagnosticsComponentCritical", "severity": "critical"}
UNACKNOWLEDGED = {"alertname": "RosDiagnosticsUnacknowledged", "severity": "critical"}


def people(receivers: list[str]) -> list[str]:
    return [each.rpartition("/")[2] for each in receivers if each.startswith("on-call/")]


@pytest.mark.parametrize(
    ("labels", "at", "expected"),
    [
        (CRITICAL, "2027-03-22T12:00", "ben"),
        (CRITICAL, "2027-03-24T07:59", "ben"),
        (CRITICAL, "2027-03-24T08:01", "carla"),  # instead of ben, from 09:00 CET
        (CRITICAL, "2027-03-25T08:01", "ben"),
        (CRITICAL, "2027-03-29T06:59", "ben"),
        (CRITICAL, "2027-03-29T07:01", "anna"),  # 09:00 CEST
        (CRITICAL | {"team": "arms"}, "2027-03-27T18:59", "carla"),
        (CRITICAL | {"team": "arms"}, "2027-03-27T19:01", "maria"),  # 20:00 CET
        (CRITICAL | {"team": "arms"}, "2027-03-28T05:59", "maria"),
        (CRITICAL | {"team": "arms"}, "2027-03-28T06:01", "carla"),  # 08:00 CEST
        (UNACKNOWLEDGED | {"step": "1"}, "2027-03-22T12:00", "carla"),
        (UNACKNOWLEDGED | {"step": "1", "team": "arms"}, "2027-03-23T08:01", "ben"),
        (UNACKNOWLEDGED | {"step": "2"}, "2027-03-28T01:00", "maria"),
    ],
)
def test_one_person_is_notified(built, labels, at, expected):
    when = datetime.fromisoformat(at).replace(tzinfo=UTC)
    assert people(notified(built, when, labels)) == [expected]


def test_mails_of_the_base_configuration_are_sent_as_before(built):
    assert notified(built, NOW, CRITICAL)[-1] == "email"
    assert notified(built, NOW, {"alertname": "RosDiagnosticsWatchdog"}) == ["none"]
    assert notified(built, NOW, UNACKNOWLEDGED | {"step": "0"}) == ["reminder"]


def test_for_a_minute_after_a_handover_both_are_notified(built):
    handover, minute = datetime(2027, 3, 29, 7, tzinfo=UTC), timedelta(minutes=1)
    found = [people(notified(built, handover + n * minute, CRITICAL)) for n in (-1, 0, 1)]
    assert found == [["ben"], ["ben", "anna"], ["anna"]]


def test_after_the_end_everybody_of_the_level_is_notified(built):
    after = NOW + timedelta(weeks=2, minutes=1)
    assert people(notified(built, after, CRITICAL)) == ["everybody"]
    receivers = {each["name"]: each for each in built["receivers"]}
    everybody = receivers["on-call/robots/first/everybody"]
    assert everybody["email_configs"][0]["to"] == "anna@example.org, ben@example.org"
    assert [each["phone_number"] for each in everybody["sns_configs"]] == ["+4915112345601"]


def test_receivers_are_copies_with_the_address_of_the_person(built):
    receivers = {each["name"]: each for each in built["receivers"]}
    anna = receivers["on-call/robots/first/2027-03-29T07:00Z/anna"]
    ben = receivers["on-call/robots/first/2027-03-22T08:00Z/ben"]
    email, sms = receivers["email"]["email_configs"][0], receivers["sms"]["sns_configs"][0]

    assert anna["email_configs"] == [email | {"to": "anna@example.org"}]
    assert anna["sns_configs"] == [sms | {"phone_number": "+4915112345601"}]
    assert ben["email_configs"] == [email | {"to": "ben@example.org"}]
    assert "sns_configs" not in ben  # no telephone number
    assert anna["webhook_configs"] == receivers["email"]["webhook_configs"]  # once, of two
    second = receivers["on-call/robots/second/2027-03-23T08:00Z/ben"]
    like = receivers["escalation-1"]["email_configs"][0]
    assert second["email_configs"] == [like | {"to": "ben@example.org"}]


def test_everything_else_stays_as_it_is(built, folder):
    base = yaml.safe_load((folder / "alertmanager.yml").read_text())

    for key in ("global", "templates", "inhibit_rules"):
        assert built[key] == base[key]
    for key in ("receivers", "time_intervals"):
        assert built[key][: len(base[key])] == base[key]
    for route, before in zip(built["route"]["routes"], base["route"]["routes"], strict=True):
        assert {key: route[key] for key in before} == before
        assert ("routes" in route) is (
            route["receiver"] in ("on-call", "escalation-1", "escalation-2")
        )


def test_a_duty_has_the_same_receiver_and_hours_when_it_is_built_later(run, folder, built):
    """Alertmanager remembers by the receiver's name what it has sent."""
    run(FILE, "build", "--ahead", "2w", now=NOW + timedelta(days=5))
    later = yaml.safe_load((folder / "alertmanager-oncall.yml").read_text())
    first = {each["name"]: each for each in built["time_intervals"]}
    lasting = "on-call/robots/first/2027-03-25T08:00Z/ben"  # the one that is on call both times
    complete = [each for each in later["time_intervals"] if "/2027-03-" in each["name"]]

    assert lasting in [each["name"] for each in complete]
    for each in complete:
        assert each == first[each["name"]]


def test_words_that_yaml_reads_in_several_ways_stay_as_they_are_written(run, folder):
    config = folder / "alertmanager.yml"
    text = config.read_text().replace('"07:00"', "17:00").replace('"19:00"', "24:00")
    config.write_text(text.replace("smtp_require_tls: false", "smtp_require_tls: no"))

    run(FILE, "build", now=NOW)
    output = (folder / "alertmanager-oncall.yml").read_text()
    assert "smtp_require_tls: no\n" in output
    assert "{start_time: '17:00', end_time: '24:00'}" in output  # bare, it is a number for some
    run_tool("amtool", "check-config", folder / "alertmanager-oncall.yml")


@pytest.mark.parametrize("weeks", ["1", "13"])
def test_amtool_accepts_what_is_built(run, folder, weeks):
    run(FILE, "build", "--ahead", f"{weeks}w", now=NOW)
    output = folder / "alertmanager-oncall.yml"

    assert "SUCCESS" in run_tool("amtool", "check-config", output)
    for labels, receivers in (
        (["severity=critical", "team=legs"], "/robots/first/"),
        (["severity=critical", "team=arms"], "/arms/first/"),
        (["alertname=RosDiagnosticsUnacknowledged", "step=1", "team=arms"], "/robots/second/"),
        (["alertname=RosDiagnosticsUnacknowledged", "step=2"], "/robots/manager/"),
    ):
        flag = f"--config.file={output}"
        found = run_tool("amtool", "config", "routes", "test", flag, *labels).strip().split(",")
        ours = [each for each in found if each != "email"]
        assert ours
        assert all(receivers in each for each in ours)


@pytest.mark.parametrize(
    ("intervals", "minutes"),
    [("", 11), ("group_interval: 1m, ", 3), ("group_interval: 25s, ", 1)],
    ids=["default", "of the route", "of seconds"],
)
def test_both_are_notified_for_twice_the_group_interval(tmp_path, intervals, minutes):
    path = tmp_path / "alertmanager.yml"
    path.write_text(f"route: {{receiver: a, routes: [{{{intervals}receiver: on-call}}]}}")

    assert _Configuration(path).overlap({"on-call"}) == timedelta(minutes=minutes)


def test_the_last_minute_of_a_day_is_in_the_hours_up_to_midnight():
    midnight = datetime(2027, 3, 23, tzinfo=UTC)
    found = hours(midnight - timedelta(hours=2), midnight)
    assert contains(found, midnight - timedelta(minutes=1))
    assert found[0]["times"] == [{"start_time": "22:00", "end_time": "24:00"}]


@given(
    first=st.integers(0, 1_500_000),
    minutes=st.integers(1, 120_000),
    probes=st.lists(st.integers(-1500, 121_500), max_size=40),
)
def test_hours_are_the_time_from_start_until_end(first, minutes, probes):
    minute = timedelta(minutes=1)
    start = datetime(2026, 1, 1, tzinfo=UTC) + first * minute
    end = start + minutes * minute

    found = hours(start, end)

    for when in (start - minute, start, end - minute, end, *(start + n * minute for n in probes)):
        assert contains(found, when) is (start <= when < end), when


def test_the_end_is_read_from_what_was_built(run, folder):
    run(FILE, "build", "--ahead", "2w", now=NOW)
    built = (folder / "alertmanager-oncall.yml").read_text()
    assert built_until(built) == NOW + timedelta(weeks=2)
    for other in ((folder / "alertmanager.yml").read_text(), "", "a: b: c", "time_intervals: 1"):
        assert built_until(other) is None
