"""Warnings about what a config may contain but probably should not."""

import pytest


@pytest.mark.parametrize(
    ("text", "warnings"),
    [
        pytest.param(
            "robots: [{name: a, domain_id: 102}, {name: b, domain_id: 101}]",
            ["2: robots[a].domain_id: DDS domain 102 shares its ports with Linux' outgoing"],
            id="a domain above those of clients",
        ),
        pytest.param(
            'discovery: [{topic: "/{robot}/diagnostics", domain_ids: [0, 214-215, 150]}]',
            ["2: discovery[0].domain_ids: DDS domain 150, 214 shares its ports with Linux'"],
            id="domains of a discovery",
        ),
        pytest.param(
            "shared: [{topic: /diagnostics, domain_id: 200}]",
            ["2: shared[0].domain_id: DDS domain 200 shares its ports with Linux' outgoing"],
            id="the domain of a shared topic",
        ),
        pytest.param(
            """robots: [{name: a}]
profiles: {default: {graph: {mode: "off"}, actions: [{match: dock, aborted: {critical: 1}}]}}""",
            ["3: profiles.default.actions: are never judged, because graph.mode is off; remove"],
            id="actions without the graph",
        ),
        pytest.param(
            "{}",
            ["1: no robots, discovery or shared topics, so there is nothing to watch; add"],
            id="nothing to watch",
        ),
        pytest.param(
            """robots: [{name: a, labels: {site: x}}]
profiles: {default: {values: [{key: Level, metric: ros_battery_percent}]}}
maintenance: [{name: m, comment: c, start: 2026-01-01, selector: {sitte: x, robot: a}}]""",
            [
                (
                    "3: profiles.default.values[0].metric: ros_battery_percent is not in a base "
                    "unit of Prometheus; call it ..._ratio and convert with scale"
                ),
                (
                    "4: maintenance[m].selector.sitte: no robot has the label sitte, so this "
                    "downtime is never active; select by one of fleet, robot, site"
                ),
            ],
            id="a metric and a selector",
        ),
        pytest.param(
            """robots:
  - {name: a, labels: {uplink: ap-1}}
  - {name: b, namespace: /b, labels: {uplink: ap-2}}
  - {name: c, namespace: /c, labels: {uplink: ap-2}}
  - {name: ap-1, source: queries}""",
            [
                (
                    "4: robots[b].labels.uplink: is ap-2, which is no robot of this file, so its "
                    "failure explains no silence; add {name: ap-2, source: queries, address: ...}"
                )
            ],
            id="an uplink that is no robot",
        ),
        pytest.param(
            """robots: [{name: a, profile: host, source: queries}, {name: b}]
shared: [{topic: /diagnostics_agg, domain_id: 3, profile: host}]
profiles:
  host: {topics: [{topic: load, component: Load, field: data}]}
  default: {topics: [{topic: e_stop, component: E-stop, field: data}]}""",
            [
                (
                    "5: profiles.host.topics: no robot of this profile has a namespace in ROS, so "
                    "no topic is read; give a robot with source queries its domain_id, or remove"
                )
            ],
            id="topics of robots without ROS",
        ),
        pytest.param(
            """robots: [{name: a}]
profiles:
  default:
    values:
      - {key: a, scale: 2}
      - {key: b, offset: 2, metric: ros_b_volts, thresholds: {low: {warning: 1}}}
      - {key: c, scale: 2, metric: ros_c_volts}
      - {key: d, scale: 2, unit: V}""",
            [
                "6: profiles.default.values[0]: is converted, but its label still has the unit",
                "7: profiles.default.values[1]: is converted, but its label still has the unit",
            ],
            id="a conversion that keeps its unit",
        ),
        pytest.param(
            """robots: [{name: a}]
profiles:
  default:
    stale_after: 5000
    components: [{match: Laser, stale_after: 1h}, {match: Door, stale_after: 2h}]""",
            [
                (
                    "5: profiles.default.stale_after: is 1h23m20s: silence is noticed only after "
                    "that; write the unit, as in 5s or 500ms"
                ),
                "6: profiles.default.components[1].stale_after: is 2h: silence is noticed only",
            ],
            id="hours without a unit",
        ),
        pytest.param(
            "robots: [{name: a, domain_id: 0}, {name: b, domain_id: 232}]",
            [],
            id="domains of clients",
        ),
    ],
)
def test_warnings_name_the_place(fleet_of, tmp_path, text, warnings):
    found = fleet_of("fleet: demo\n" + text.removeprefix("{}")).warnings
    assert len(found) == len(warnings)
    for warning, begin in zip(found, warnings, strict=True):
        assert warning.startswith(f"{tmp_path}/fleet.yml:{begin}")
