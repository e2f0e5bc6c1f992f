"""Robots found by their topics, and robots that share one."""

import pytest

from ros_diagnostics_exporter.config.fleet import Source
from ros_diagnostics_exporter.config.scalars import topic as checked_topic
from ros_diagnostics_exporter.fleet.discovery import found_robot, shared_identity


def discovery(fleet_of, keys):
    return fleet_of(f"fleet: demo\ndiscovery: [{{{keys}}}]").discoveries[0]


@pytest.mark.parametrize(
    ("keys", "topic", "robot"),
    [
        ('topic: "/{robot}/diagnostics"', "/r1/diagnostics", "r1"),
        ('topic: "/{robot}/diagnostics"', "/r1/diagnostics_agg", None),
        ('topic: "/fleet/amr_{robot}/diagnostics"', "/fleet/amr_7/diagnostics", "7"),
        ('topic: "/*/{robot}/*"', "/hall/r1/health", "r1"),
        ('topic: "/*/{robot}/*"', "/r1/health", None),
        ("type: diagnostic_msgs/msg/DiagnosticArray", "/hall/r1/health", "r1"),
        ("type: diagnostic_msgs/msg/DiagnosticArray", "/r1/diagnostics_agg", "r1"),
        ("type: diagnostic_msgs/msg/DiagnosticArray", "/diagnostics", None),
        ("source: agg, type: diagnostic_msgs/msg/DiagnosticArray", "/r1/diagnostics_agg", "r1"),
        ("source: agg, type: diagnostic_msgs/msg/DiagnosticArray", "/r1/diagnostics", None),
        ("source: raw, type: diagnostic_msgs/msg/DiagnosticArray", "/r1/diagnostics_agg", None),
        ("source: raw, type: diagnostic_msgs/msg/DiagnosticArray", "/r1/diagnostics", "r1"),
        ('source: raw, topic: "/{robot}/*"', "/r1/diagnostics_agg", None),
        ('source: agg, topic: "/{robot}/health"', "/r1/health", "r1"),
    ],
)
def test_topic_contains_the_name_of_the_robot(fleet_of, keys, topic, robot):
    match = discovery(fleet_of, keys).pattern.fullmatch(topic)
    assert (match and match["robot"]) == robot


@pytest.mark.parametrize(
    ("source", "topics"),
    [
        (Source.AGG, ("/r1/health", None)),
        (Source.RAW, (None, "/r1/health")),
        (Source.AUTO, ("/r1/health_agg", "/r1/health")),
    ],
)
def test_discovered_topic_of_another_name_is_of_the_kind_of_its_source(fleet_of, source, topics):
    found = discovery(fleet_of, f'topic: "/{{robot}}/health", source: {source.value}')
    robot = found_robot(found, "r1", "/r1/health", 0)
    assert (robot.topic_agg, robot.topic_raw) == topics


def test_robots_in_the_root_namespace_are_named_by_their_domain(fleet_of):
    found = discovery(
        fleet_of, 'topic: /diagnostics_agg, domain_ids: [1-60], name: "robot_{domain_id}"'
    )
    assert found.pattern.fullmatch("/diagnostics_agg")
    assert (found.name, len(found.domain_ids)) == ("robot_{domain_id}", 60)


def test_include_and_exclude_match_whole_names(fleet_of):
    found = discovery(
        fleet_of,
        'topic: "/{robot}/diagnostics", include: ["amr_*", {regex: "arm_[12]"}], exclude: amr_9',
    )
    assert [bool(each.fullmatch("amr_10")) for each in found.include] == [True, False]
    assert [bool(each.fullmatch("arm_12")) for each in found.include] == [False, False]
    assert [bool(each.fullmatch("amr_9")) for each in found.exclude] == [True]


def test_discovered_robots_have_profile_address_and_labels(fleet_of):
    found = fleet_of("""
        fleet: demo
        profiles: {amr: {stale_after: 3s}}
        discovery:
          - topic: "/{robot}/diagnostics_agg"
            profile: amr
            source: both
            address: "{robot}.lan"
            labels: {site: hall, floor: 3}
    """).discoveries[0]
    assert (found.profile.stale_after, found.source.value) == (3.0, "both")
    assert (found.address, dict(found.labels)) == ("{robot}.lan", {"site": "hall", "floor": "3"})


STATUS = ("husky-0849", "r1/arm: left")  # hardware_id and name of a status


@pytest.mark.parametrize(
    ("keys", "status", "robot", "component"),
    [
        ("by: hardware_id", STATUS, "husky-0849", "r1/arm: left"),
        ("pattern: 'husky-{robot}'", STATUS, "0849", "r1/arm: left"),
        ("pattern: {regex: '[a-z]+-0*(?P<robot>\\d+)'}", STATUS, "849", "r1/arm: left"),
        ("by: name, pattern: '{robot}/{component}'", STATUS, "r1", "arm: left"),
        ("by: name, pattern: '{robot}/{component}'", ("", "r1/a/b"), "r1", "a/b"),
        ("by: name, pattern: '{component} of {robot}'", ("", "laser of r1"), "r1", "laser"),
        ("by: name, pattern: {regex: '(?P<robot>r\\d+).*'}", STATUS, "r1", "r1/arm: left"),
        ("by: name, pattern: {regex: '(?P<robot>r\\d)(?P<component>x)?'}", ("", "r1"), "r1", "r1"),
    ],
)
def test_status_on_a_shared_topic_names_its_robot(fleet_of, keys, status, robot, component):
    shared = fleet_of(f"fleet: demo\nshared: [{{topic: /diagnostics, {keys}}}]").shared[0]
    assert shared_identity(shared, *status) == (robot, component)


@pytest.mark.parametrize(
    ("keys", "status"),
    [
        *[("by: hardware_id", (bad, "x")) for bad in ("", " ", "a/b", "a\n", "x" * 129)],
        ("pattern: 'husky-{robot}'", ("jackal-1", "x")),
        ("pattern: 'husky-{robot}'", ("husky-/dev/ttyUSB0", "x")),
        ("by: name, pattern: '{robot}: {component}'", ("r1", "no colon")),
        ("by: name, pattern: '{robot}/{component}'", ("", "r1/" + "a" * 300)),
        ("by: name, pattern: {regex: '(?P<robot>r1)?.*'}", ("", "x")),
    ],
)
def test_status_without_a_robots_name_is_rejected(fleet_of, keys, status):
    shared = fleet_of(f"fleet: demo\nshared: [{{topic: /diagnostics, {keys}}}]").shared[0]
    assert shared_identity(shared, *status) is None


@pytest.mark.parametrize(
    ("keys", "raw"),
    [
        ("topic: /diagnostics", True),
        ("topic: /diagnostics_agg", False),
        ("topic: /diagnostics_agg, source: raw", True),
        ("topic: /lab/health, source: agg", False),
    ],
)
def test_shared_topic_is_raw_or_aggregated(fleet_of, keys, raw):
    assert fleet_of(f"fleet: demo\nshared: [{{{keys}}}]").shared[0].raw is raw


def test_declared_robot_on_a_shared_topic_has_the_source_of_the_topic(fleet_of):
    fleet = fleet_of("""
        fleet: demo
        shared: [{topic: /diagnostics}, {topic: /lab/all, source: agg, domain_id: 2}]
        robots:
          - {name: a, topic: /diagnostics, labels: {site: hall}}
          - {name: b, topic: /diagnostics, source: raw}
          - {name: c, topic: /lab/all, domain_id: 2}
          - {name: d, topic: /lab/all, domain_id: 3}
    """)
    assert [(each.topic_agg, each.topic_raw, each.source.value) for each in fleet.robots] == [
        (None, "/diagnostics", "raw"),
        (None, "/diagnostics", "raw"),
        ("/lab/all", None, "agg"),
        ("/lab/all_agg", "/lab/all", "auto"),
    ]


@pytest.mark.parametrize(
    "name",
    [
        *("/a", "/a/b", "/_a", "/a1/b_2", "/a__b", "/" + "a" * 246),
        *("", "/", "a", "/a/", "//a", "/a//b", "/1", "/a/1b", "/a-b", "/a b", "/{a}", "/~", "/ä"),
        "/" + "a" * 247,
    ],
)
def test_topic_names_are_those_that_ros_accepts(name):
    validate = pytest.importorskip("rclpy.validate_full_topic_name", reason="no ROS 2 here")
    exceptions = pytest.importorskip("rclpy.exceptions")
    try:
        validate.validate_full_topic_name(name)
    except (exceptions.InvalidTopicNameException, ValueError):
        with pytest.raises(ValueError, match="is not"):
            checked_topic(name)
    else:
        assert checked_topic(name) == name
