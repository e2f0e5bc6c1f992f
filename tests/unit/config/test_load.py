"""The Fleet of a valid fleet.yml."""

import os
import socket
from pathlib import Path

import pytest
import yaml

from ros_diagnostics_exporter.config import yaml_file
from ros_diagnostics_exporter.config.capabilities import in_order
from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.config.queries import component_name

MIXED = Path(__file__).parents[3] / "docs" / "examples" / "mixed-fleet" / "fleet.yml"
DEMO = """
    fleet: demo
    profiles:
      default: {stale_after: 5s, confirm_after: 10s}
    robots:
      - {name: robot_1, namespace: /robot_1, domain_id: 7, labels: {site: hall}}
    discovery:
      - {topic: "/{robot}/diagnostics_agg", domain_ids: [7]}
"""


def test_minimal_file_is_a_fleet_with_the_default_profile(fleet_of):
    fleet = fleet_of("fleet: demo")
    assert fleet.name == "demo"
    assert (fleet.robots, fleet.discoveries, fleet.shared, fleet.maintenance) == ((),) * 4
    assert [*fleet.profiles] == ["default"]
    assert fleet.exporter == ""
    assert (fleet.profiles["default"].stale_after, fleet.domain_ids) == (10.0, ())


@pytest.mark.parametrize(
    ("written", "name"), [("berlin", "berlin"), ('"Hall 2/B"', "Hall 2/B"), ("7", "7")]
)
def test_an_exporter_has_a_name_as_a_label_has_a_value(fleet_of, written, name):
    assert fleet_of(f"fleet: demo\nexporter: {written}").exporter == name


def test_robot_has_its_topics_profile_and_labels(fleet_of):
    robot = fleet_of(DEMO).robots[0]
    assert (robot.name, robot.domain_id, robot.namespace) == ("robot_1", 7, "/robot_1")
    assert robot.topic_agg == "/robot_1/diagnostics_agg"
    assert robot.topic_raw == "/robot_1/diagnostics"
    assert (robot.profile.stale_after, robot.profile.confirm_after) == (5.0, 10.0)
    assert dict(robot.labels) == {"site": "hall"}


@pytest.mark.parametrize(
    ("keys", "agg", "raw", "namespace"),
    [
        ("", "/diagnostics_agg", "/diagnostics", ""),
        ("namespace: /", "/diagnostics_agg", "/diagnostics", ""),
        ("namespace: /a/b", "/a/b/diagnostics_agg", "/a/b/diagnostics", "/a/b"),
        ("source: agg", "/diagnostics_agg", None, ""),
        ("source: raw", None, "/diagnostics", ""),
        ("topic: /a/diagnostics_agg", "/a/diagnostics_agg", "/a/diagnostics", "/a"),
        ("topic: /a/health, source: both", "/a/health_agg", "/a/health", "/a"),
        ("topic: /a/health, source: agg", "/a/health", None, "/a"),
        ("topic: /a/health_agg, source: raw", None, "/a/health_agg", "/a"),
    ],
)
def test_topics_follow_from_namespace_topic_and_source(fleet_of, keys, agg, raw, namespace):
    robot = fleet_of(f"fleet: demo\nrobots: [{{name: r, {keys}}}]").robots[0]
    assert (robot.topic_agg, robot.topic_raw, robot.namespace) == (agg, raw, namespace)


def test_domains_of_all_entries_are_collected(fleet_of):
    fleet = fleet_of("""
        fleet: demo
        robots: [{name: a, domain_id: 9}]
        discovery: [{topic: "/{robot}/diagnostics", domain_ids: [3, "10-12"]}]
        shared: [{topic: /diagnostics}]
    """)
    assert fleet.domain_ids == (0, 3, 9, 10, 11, 12)


def test_a_query_may_be_one_character(fleet_of):
    (query,) = fleet_of('fleet: demo\nqueries: [{expr: "1", component: site}]').queries
    assert query.expr == "1"


def test_the_label_of_a_robot_is_robot_unless_a_query_names_another_or_an_address(fleet_of):
    text = "fleet: demo\nqueries: [{expr: up, component: site, %s}]"
    for written, expected in (
        ("group: a", ("robot", None)),
        ("robot: host", ("host", None)),
        ("address: instance", (None, "instance")),
    ):
        (query,) = fleet_of(text % written).queries
        assert (query.robot, query.address) == expected


def test_the_value_of_a_label_has_at_most_256_characters(fleet_of, errors_of):
    text = "fleet: demo\nrobots: [{name: r, labels: {site: %s}}]"
    (robot,) = fleet_of(text % ("a" * 256)).robots
    assert robot.labels == {"site": "a" * 256}
    (error,) = errors_of(text % ("a" * 257))
    assert "has 257 characters; use at most 256" in error


def test_capabilities_are_ordered_after_those_that_they_need(fleet_of):
    fleet = fleet_of("""
        fleet: demo
        profiles:
          default:
            capabilities:
              tour: [{capability: drive}, {capability: view}]
              drive: {any: [{capability: view}, Motor]}
              view: Laser
    """)
    assert in_order(fleet.profiles["default"].capabilities) == ["view", "drive", "tour"]


def test_a_profile_has_conditions_where_a_component_or_a_value_has(fleet_of):
    when = "when: [{component: Dock, level: OK}]"
    for rules, expected in (
        ("components: [{match: Motor}], values: [{key: Level, unit: V}]", False),
        (f"components: [{{match: Motor, {when}}}]", True),
        (f"values: [{{key: Level, thresholds: {{low: {{warning: 1}}}}, {when}}}]", True),
    ):
        fleet = fleet_of(f"fleet: demo\nprofiles: {{default: {{{rules}}}}}")
        assert fleet.profiles["default"].has_conditions is expected


def test_the_name_of_a_component_is_made_of_the_labels_of_its_element():
    labels = {"device": "sda", "mountpoint": "/"}
    names = {"disk {mountpoint}": "disk /", "disk {no} {device}": "disk sda", "{no}": "{no}"}
    assert {template: component_name(template, labels) for template in names} == names


def test_two_loads_of_one_file_are_equal():
    """So that a reload sees which robots did not change."""
    assert load(MIXED) == load(MIXED)


def test_robots_of_another_profile_stay_equal_when_one_changes(fleet_of):
    text = """
        fleet: demo
        profiles: {{a: {{checks: {{m: [Motor]}}, stale_after: {}}}, b: {{checks: {{m: Motor}}}}}}
        robots: [{{name: a, domain_id: 1, profile: a}}, {{name: b, domain_id: 2, profile: b}}]
    """
    before, after = fleet_of(text.format("5s")), fleet_of(text.format("6s"))
    assert before.robots[0] != after.robots[0]
    assert before.robots[1] == after.robots[1]


def test_unreadable_file_is_an_error(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: demo")
    path.chmod(0)
    user = os.geteuid()
    try:
        if user == 0:
            os.seteuid(65_534)
        with pytest.raises(ConfigError, match=r"cannot be read \(Permission denied\)"):
            load(path)
    finally:
        os.seteuid(user)


def test_huge_file_is_rejected_before_it_is_parsed(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_bytes(b"#" * 9_000_000)
    with pytest.raises(ConfigError, match="is larger than 8388608 bytes"):
        load(path)


@pytest.mark.parametrize("kind", ["fifo", "socket", "device", "folder"])
def test_what_is_not_a_regular_file_is_an_error_and_does_not_block(fleet_of, tmp_path, kind):
    """A FIFO that nobody writes to would be opened, and a terminal read, for ever."""
    (tmp_path / "robots.d").mkdir()
    odd = tmp_path / "robots.d" / "odd.yml"
    if kind == "fifo":
        os.mkfifo(odd)
    elif kind == "device":
        odd.symlink_to("/dev/zero")
    elif kind == "folder":
        odd.mkdir()
    else:
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(odd))
    with pytest.raises(ConfigError, match=rf"{odd}: cannot be read \(") as caught:
        fleet_of("fleet: demo", **{"robots.d/good.yml": "{name: r, domain_id: 1}"})
    assert len(caught.value.problems) == 1


def nested(depth: int) -> str:
    return f"profiles: {{default: {{capabilities: {{a: {'{all: [' * depth}x{']}' * depth}}}}}}}"


def test_ten_levels_of_lists_may_be_within_the_list_of_a_capability(fleet_of):
    assert fleet_of(f"fleet: demo\n{nested(11)}").profiles["default"].capabilities
    with pytest.raises(ConfigError, match="lists are nested deeper than 10 levels"):
        fleet_of(f"fleet: demo\n{nested(12)}")


@pytest.mark.parametrize(
    ("problem", "number", "more"),
    [("key_{}: 1\n", 60_000, "and at least 980 more"), ("- nam: {}\n", 2_000, "and at least 9")],
)
def test_a_list_of_many_problems_is_cut(fleet_of, problem, number, more):
    problems = "".join(map(problem.format, range(number)))
    with pytest.raises(ConfigError) as caught:
        fleet_of("fleet: demo\n" + ("robots:\n" if problem[0] == "-" else "") + problems)
    *lines, last = str(caught.value).splitlines()
    assert len(lines) == 20
    assert last.startswith(more)
    assert last.endswith("more problems, listed once these are fixed")
    assert len(str(caught.value)) < 20_000
    assert len(caught.value.text(3).splitlines()) == 4
    known = len(caught.value.problems)
    assert caught.value.text(known - 1).splitlines()[-1].startswith("and at least 1 more")
    assert "more problems" not in caught.value.text(known)


def test_too_many_values_are_rejected_before_they_take_memory(fleet_of, monkeypatch):
    monkeypatch.setattr(yaml_file, "MAX_VALUES", 10)
    monkeypatch.setattr(yaml_file, "MAX_DEPTH", 3)  # as deep as it is
    monkeypatch.setattr(yaml, "compose", lambda *_arguments, **_more: pytest.fail("is composed"))
    with pytest.raises(ConfigError, match=r"fleet.yml:3: has more than 10 keys and values"):
        fleet_of("fleet: demo\nrobots: [{name: a},\n{name: b}, {name: c}, {name: d}]\n")


def test_a_long_key_is_shortened(fleet_of):
    with pytest.raises(ConfigError) as caught:
        fleet_of(f"fleet: demo\n? {'k' * 1_000_000}\n: 1\n")
    (line,) = str(caught.value).splitlines()
    assert "kkk...: is not a key; use one of" in line
    assert len(line) < 1000


def test_a_list_of_many_warnings_is_cut(fleet_of):
    robots = "".join(f"- {{name: r{number}, domain_id: {100 + number}}}\n" for number in range(60))
    fleet = fleet_of("fleet: demo\nrobots:\n" + robots)
    assert len(fleet.warnings) == 21
    assert fleet.warnings[-1] == "and 38 more warnings"


def test_sources_are_the_same_for_a_fleet_a_path_and_a_broken_file(fleet_of, tmp_path):
    path = tmp_path / "fleet.yml"
    expected = (path, *(tmp_path / f"{each}.d" for each in ("robots", "maintenance", "queries")))
    assert fleet_of(DEMO).sources == load(path).sources == expected
    for broken, read in (("fleet: [", (path,)), ("fleet: 3", expected)):
        path.write_text(broken)
        with pytest.raises(ConfigError) as caught:
            load(path)
        assert caught.value.sources == read
