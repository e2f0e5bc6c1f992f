"""Entries of fleet.yml that match nothing that was received."""

import json
from pathlib import Path

import pytest

from ros_diagnostics_exporter.api.snapshot import fleet_snapshot
from ros_diagnostics_exporter.fleet.unmatched import GRACE, KINDS, Unmatched, UnmatchedWatch
from ros_diagnostics_exporter.model import Array, Endpoint, Instant, Status, Topic
from ros_diagnostics_tools.main import main
from support.configs import load_text
from support.state_driver import OK, StateDriver
from support.web_server import serve as serve  # noqa: PLC0414 - a fixture

MOTOR = Status(OK, "Motor 1", "OK", "", (("Level", "3"), ("Temperature (°C)", "41")))
MATCHING = """
fleet: f
profiles:
  default:
    checks: {motors: {match: [Motor], expect: 1}}
    components:
      - {match: Motor, stale_after: 9s, unless: {component: motor, key: Temp*, above: 90}}
      - {match: Nothing, ignore: true}
    capabilities: {driving: [Motor, {component: Motor, key: Level}]}
    values:
      - component: Motor
        key: Level
        unit: V
        thresholds: {low: {warning: 1}}
        when: [{key: Level, above: 0}, {component: Motor 1, level: OK}]
robots: [{name: r, topic: /r/diagnostics, source: raw, labels: {site: hall}}]
discovery: [{topic: "/{robot}/diagnostics", include: ["r*"]}]
maintenance:
  - {name: one, comment: c, selector: {robot: r}, start: 2026-01-01}
  - {name: past, comment: c, selector: {robot: gone}, start: 2020-01-01, end: 2020-01-02}
"""
EMPTY = dict.fromkeys(KINDS, 0)


def driver_of(tmp_path: Path, text: str) -> StateDriver:
    return StateDriver(fleet=load_text(tmp_path, text))


def received(driver: StateDriver, seconds: float) -> list[dict[str, str]]:
    """Receive the motor until then, every half minute; what is reported."""
    for at in range(int(driver.now.mono) + 30, int(seconds) + 1, 30):
        driver.at(at)
        driver.raw(MOTOR)
        driver.state.find_unmatched(driver.now)  # while the motor is OK: before, it was STALE
        driver.state.tick(driver.now)
    found = fleet_snapshot(driver.state, driver.now)["unmatched"]
    assert {each.pop("why") for each in found} <= {"matches nothing"}
    return list(found)


def test_what_matches_is_not_reported(tmp_path):
    driver = driver_of(tmp_path, MATCHING)

    assert received(driver, 2 * GRACE) == []
    assert driver.state.unmatched.counts == EMPTY


@pytest.mark.parametrize(
    ("right", "wrong", "line"),
    [
        ("match: [Motor]", "match: [Mottor]", "check motors: Mottor|Motor 1"),
        ("{match: Motor,", "{match: Motr 1,", "component Motr 1|Motor 1"),
        ("[Motor, {", "[Moter 1, {", "capability driving: Moter 1|Motor 1"),
        ("r, key: Level}]", "r, key: Levels}]", "capability driving: Motor Levels|Level"),
        ("t: Motor\n", "t: Mtor 1\n", "value component Mtor 1, key Level|Motor 1"),
        ("key: Level\n", "key: Leval\n", "value component Motor, key Leval|Level"),
        ("t: motor, key", "t: Mtor 1, key", "condition Mtor 1 Temp* is above 90|Motor 1"),
        (
            "key: Temp*",
            "key: Temperatur",
            "condition motor Temperatur is above 90|Temperature (°C)",
        ),
        ("{key: Level,", "{key: Levels,", "condition Levels is above 0|Level"),
        ("t: Motor 1, l", "t: Motor 2, l", "condition Motor 2 is OK|Motor 1"),
        ("selector: {robot: r}", "selector: {site: hal}", "maintenance one: site=hal|hall"),
        ('["r*"]', '["x*"]', "discovery /{robot}/diagnostics include x*|"),
    ],
)
def test_what_matches_nothing_is_reported_after_five_minutes(tmp_path, caplog, right, wrong, line):
    assert right in MATCHING
    driver = driver_of(tmp_path, MATCHING.replace(right, wrong))

    assert received(driver, GRACE) == []
    reported, nearest = line.split("|")
    what, _, entry = reported.partition(" ")
    expected = {"what": what, "entry": entry, "nearest": nearest}
    assert received(driver, 2 * GRACE) == [expected]
    assert driver.state.unmatched.counts == EMPTY | {what: 1}
    near = f"; the nearest is {nearest!r}" if nearest else ""
    lines = [each.getMessage() for each in caplog.records]
    assert lines == [f"fleet.yml: {reported} matches nothing{near}"]


def test_a_value_with_thresholds_that_is_no_number_is_reported(tmp_path, caplog, serve, capsys):
    driver = driver_of(tmp_path, MATCHING)
    odd = MOTOR._replace(values=(("Level", "abc"), ("Temperature (°C)", "41")))
    for at in range(30, 2 * int(GRACE), 30):
        driver.at(at)
        driver.raw(odd)
        driver.state.find_unmatched(driver.now)
    said = (
        "value component Motor 1, key Level = 'abc' of r is no number, its thresholds cannot be "
        "judged"
    )
    assert [str(each) for each in driver.state.unmatched.entries] == [said]
    assert [each.getMessage() for each in caplog.records] == [f"fleet.yml: {said}"]
    snapshot = json.loads(json.dumps(fleet_snapshot(driver.state, driver.now)))
    (value, _other) = snapshot["robots"][0]["components"][0]["values"]
    assert (value["number"], bool(value["thresholds"])) == (None, True)
    server = serve(fleet_snapshot=lambda: snapshot)
    check = ["check-config", str(tmp_path / "fleet.yml"), "--live"]
    assert main([*check, f"--url=http://{server.addresses[0]}"]) == 0
    assert f"unmatched (1):\n  {said}" in capsys.readouterr().out


def test_a_topic_of_which_no_robot_has_a_component_is_reported(tmp_path):
    topics = "topics: [{topic: e_stop, component: E-Stop, field: data, error_when: 1}]"
    driver = driver_of(tmp_path, MATCHING.replace("    checks:", f"    {topics}\n    checks:"))
    for at in range(30, 2 * int(GRACE), 30):
        driver.at(at)
        driver.raw(MOTOR)
    said = [(each.what, each.entry, each.why) for each in driver.state.unmatched.entries]
    assert said == [("topic", "e_stop: E-Stop", "is received of no robot")]


def test_without_profiles_there_is_no_entry_that_could_match_nothing():
    assert received(StateDriver(), 2 * GRACE) == []


def test_the_five_minutes_are_over_at_their_end():
    watch, entry = UnmatchedWatch(), Unmatched("check", "motors: Mottor")
    reported = []
    for seconds in (0.0, 299.0, 300.0):
        watch.update([entry], Instant(seconds, seconds))
        reported.append(watch.entries)

    assert reported == [(), (), (entry,)]


def test_a_shared_topic_on_which_no_robot_was_found_is_reported(tmp_path):
    driver = driver_of(tmp_path, f"{MATCHING}shared: [{{topic: /a/d}}, {{topic: /b/d}}]")
    status = MOTOR._replace(hardware_id="r2")
    driver.receive("/a/d", status)
    assert received(driver, 2 * GRACE) == [{"what": "shared", "entry": "/b/d", "nearest": ""}]


def test_nothing_is_reported_until_something_was_received(tmp_path):
    driver = driver_of(tmp_path, MATCHING.replace("match: [Motor]", "match: [Mottor]"))
    driver.at(3 * GRACE)
    driver.state.tick(driver.now)

    assert driver.state.unmatched.entries == ()


def test_what_matches_later_is_reported_no_more(tmp_path):
    driver = driver_of(tmp_path, MATCHING.replace("key: Level\n", "key: Leval\n"))
    received(driver, 2 * GRACE)
    assert driver.state.unmatched.counts["value"] == 1

    driver.raw(MOTOR._replace(values=(("Leval", "3"),)))
    driver.at(2 * GRACE + 61)
    driver.state.tick(driver.now)

    assert driver.state.unmatched.counts == EMPTY


def test_a_rule_of_the_default_profile_may_match_in_another(tmp_path):
    """One that a profile inherits is listed once, and only where it matches in none."""
    text = MATCHING.replace("profiles:", "profiles:\n  other: {stale_after: 5s}")
    text = text.replace("name: r,", "name: r, profile: other,")
    driver = driver_of(tmp_path, text.replace("match: [Motor]", "match: [Mottor]"))

    assert [each["what"] for each in received(driver, 2 * GRACE)] == ["check"]


def test_a_file_is_checked_against_a_running_exporter(tmp_path, capsys, serve):
    driver = driver_of(tmp_path, MATCHING).raw(MOTOR)
    snapshot = json.loads(json.dumps(fleet_snapshot(driver.state, driver.now)))
    server = serve(fleet_snapshot=lambda: snapshot)
    (tmp_path / "fleet.yml").write_text(MATCHING.replace("key: Level\n", "key: Leval\n"))

    check = ["check-config", str(tmp_path / "fleet.yml"), "--live"]
    assert main([*check, f"--url=http://{server.addresses[0]}"]) == 0
    assert capsys.readouterr().out.endswith(
        "unmatched (1):\n"
        "  value component Motor, key Leval matches nothing; the nearest is 'Level'\n"
    )


def test_an_exporter_that_does_not_answer_is_an_error(tmp_path, capsys, free_port):
    (tmp_path / "fleet.yml").write_text(MATCHING)

    check = ["check-config", str(tmp_path / "fleet.yml"), "--live"]
    assert main([*check, f"--url=http://127.0.0.1:{free_port()}"]) == 3
    assert "Connection refused" in capsys.readouterr().err


TWO_ENTRIES = """
fleet: f
discovery:
  - {topic: "/{robot}/diagnostics_agg", include: [robot_*]}
  - {topic: "/{robot}/diagnostics_agg", exclude: [robot_*]}
"""


def of_two_entries(path: Path, *robots: str) -> StateDriver:
    """Robots that two entries of discovery share, for ten minutes."""
    driver = driver_of(path, TWO_ENTRIES)
    for _ in range(int(2 * GRACE) // 30):
        found = {f"/{each}/diagnostics_agg": Endpoint(1) for each in robots}
        driver.state.update_graph(0, found, driver.now)
        for each in robots:
            array = Array(0.0, (MOTOR._replace(name="/Drives/Motor"), MOTOR))
            driver.state.receive(Topic(0, f"/{each}/diagnostics_agg"), array, driver.now)
        driver.state.find_unmatched(driver.now)
        driver.wait(30)
    return driver


@pytest.mark.parametrize("robots", [["robot_1", "robot_2"], ["robot_1", "tb3"]])
def test_an_entry_whose_topics_others_take_or_that_excludes_them_is_no_mistake(tmp_path, robots):
    driver = of_two_entries(tmp_path, *robots)
    assert [each for each in driver.state.unmatched.entries if each.what == "discovery"] == []


def test_a_discovery_that_finds_nobody_is_reported_also_where_there_is_no_robot(tmp_path):
    driver = of_two_entries(tmp_path)
    entries = [str(each) for each in driver.state.unmatched.entries]
    assert entries == [
        "discovery /{robot}/diagnostics_agg matches nothing",
        "discovery /{robot}/diagnostics_agg include robot_* matches nothing",
    ]
