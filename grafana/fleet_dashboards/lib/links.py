"""Where a click leads. Links carry what was clicked on, the data source and the time range."""

from __future__ import annotations

FLEET_UID = "ros-diagnostics-fleet"
ROBOT_UID = "ros-diagnostics-robot"
COMPONENT_UID = "ros-diagnostics-component"
ALERTS_UID = "ros-diagnostics-alerts"
MONITORING_UID = "ros-diagnostics-monitoring"
TAG = "ros-diagnostics"

_COMMON = "${datasource:queryparam}&${__url_time_range}"

# From a table's row; the names are the columns' titles.
TO_ROBOT = (
    f"/d/{ROBOT_UID}?{_COMMON}&var-fleet=${{__data.fields.Fleet}}"
    "&var-robot=${__data.fields.Robot}"
)
TO_COMPONENT = (
    f"/d/{COMPONENT_UID}?{_COMMON}&var-fleet=${{__data.fields.Fleet}}"
    "&var-component=${__data.fields.Component}"
)
# From a robot's own dashboard.
TO_COMPONENT_OF_FLEET = (
    f"/d/{COMPONENT_UID}?{_COMMON}&${{fleet:queryparam}}&var-component=${{__data.fields.Component}}"
)
# From a line or bar of a graph.
TO_ROBOT_OF_SERIES = (
    f"/d/{ROBOT_UID}?{_COMMON}&var-fleet=${{__field.labels.fleet}}"
    "&var-robot=${__field.labels.robot}"
)


def to_fleet(state: str) -> str:
    """The fleet dashboard, filtered by the variable ``state`` (as it stands in an address)."""
    kept = "${fleet:queryparam}&${site:queryparam}&${robot_group:queryparam}"
    return f"/d/{FLEET_UID}?{_COMMON}&{kept}&var-state={state}"
