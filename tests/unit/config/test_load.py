"""The Fleet of a valid fleet.yml."""

import os
import socket
import tempfile
from pathlib import Path

import pytest

from ros_diagnostics_exporter.config.errors import ConfigError
from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.config.load import load, sources

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


def test_discovery_matches_topics_and_names_the_robot(fleet_of):
    discovery = fleet_of(DEMO).discoveries[0]
    assert discovery.pattern.fullmatch("/robot_9/diagnostics_agg")["robot"] == "robot_9"
    assert not discovery.pattern.fullmatch("/hall/robot_9/diagnostics_agg")
    assert not discovery.pattern.fullmatch("/diagnostics_agg")
    assert (discovery.domain_ids, discovery.source) == ((7,), Source.AUTO)


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


def test_key_without_a_value_counts_as_not_given(fleet_of):
    fleet = fleet_of("""
        fleet: demo
        robots:
        profiles: {default: }
        limits:
    """)
    assert (fleet.robots, fleet.limits.components) == ((), 500)


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


def test_missing_file_is_an_error(tmp_path):
    with pytest.raises(ConfigError) as caught:
        load(tmp_path / "fleet.yml")
    assert str(caught.value) == (
        f"{tmp_path}/fleet.yml: cannot be read (No such file or directory); "
        "name a file that exists and that this user may read"
    )


def test_folder_in_place_of_the_file_is_an_error(tmp_path):
    with pytest.raises(ConfigError, match=r"cannot be read \(Is a directory\)"):
        load(tmp_path)


@pytest.fixture
def unreadable(tmp_path):
    """For a while, a user who may not read fleet.yml."""
    path = tmp_path / "fleet.yml"
    path.write_text("fleet: demo")
    path.chmod(0)
    user = os.geteuid()
    if user == 0:
        os.seteuid(65_534)
    yield path
    os.seteuid(user)


def test_unreadable_file_is_an_error(unreadable):
    with pytest.raises(ConfigError, match=r"cannot be read \(Permission denied\)"):
        load(unreadable)


def test_huge_file_is_rejected_before_it_is_parsed(tmp_path):
    path = tmp_path / "fleet.yml"
    path.write_bytes(b"#" * 9_000_000)
    with pytest.raises(ConfigError, match="is larger than 8388608 bytes"):
        load(path)


@pytest.mark.parametrize("kind", ["fifo", "socket", "device"])
def test_what_is_not_a_regular_file_is_an_error_and_does_not_block(fleet_of, tmp_path, kind):
    """A FIFO that nobody writes to would be opened, and a terminal read, for ever."""
    (tmp_path / "robots.d").mkdir()
    odd = tmp_path / "robots.d" / "odd.yml"
    if kind == "fifo":
        os.mkfifo(odd)
    elif kind == "device":
        odd.symlink_to("/dev/zero")
    else:
        with socket.socket(socket.AF_UNIX) as listening:
            listening.bind(str(odd))
    with pytest.raises(ConfigError, match=rf"{odd}: cannot be read \(") as caught:
        fleet_of("fleet: demo", **{"robots.d/good.yml": "{name: r, domain_id: 1}"})
    assert len(caught.value.problems) == 1


MANY = 60_000


def test_a_list_of_many_problems_is_cut():
    keys = "".join(f"key_{number}: 1\n" for number in range(MANY))
    assert_bounded("fleet: demo\n" + keys, "and at least 980 more problems")


def test_a_list_of_many_wrong_entries_is_cut():
    entries = "".join(f"  - {{nam: r{number}}}\n" for number in range(2_000))
    assert_bounded("fleet: demo\nrobots:\n" + entries, "and at least 9")


def test_a_long_key_is_shortened(fleet_of):
    with pytest.raises(ConfigError) as caught:
        fleet_of(f"fleet: demo\n? {'k' * 1_000_000}\n: 1\n")
    (line,) = str(caught.value).splitlines()
    assert "kkk...: is not a key; use one of" in line
    assert len(line) < 1000


def assert_bounded(text, more):
    with tempfile.NamedTemporaryFile("w", suffix=".yml") as file:
        file.write(text)
        file.flush()
        with pytest.raises(ConfigError) as caught:
            load(Path(file.name))
    lines = str(caught.value).splitlines()
    assert len(lines) == 21
    assert lines[-1].startswith(more)
    assert lines[-1].endswith("more problems, listed once these are fixed")
    assert len(str(caught.value)) < 20_000
    assert len(caught.value.text(3).splitlines()) == 4


def test_a_list_of_many_warnings_is_cut(fleet_of):
    robots = "".join(f"- {{name: r{number}, domain_id: {100 + number}}}\n" for number in range(60))
    fleet = fleet_of("fleet: demo\nrobots:\n" + robots)
    assert len(fleet.warnings) == 21
    assert fleet.warnings[-1] == "and 38 more warnings"


def test_sources_are_the_same_for_a_fleet_a_path_and_a_broken_file(fleet_of, tmp_path):
    path = tmp_path / "fleet.yml"
    expected = (path, *(tmp_path / f"{each}.d" for each in ("robots", "maintenance", "queries")))
    assert sources(fleet_of(DEMO)) == sources(path) == expected
    path.write_text("fleet: [")
    assert sources(path) == (path,)
    path.write_text("fleet: 3")
    assert sources(path) == expected
