"""Links between the dashboards; they keep the data source and the time range."""

from __future__ import annotations

FLEET_UID = "ros-diagnostics-fleet"
ROBOT_UID = "ros-diagnostics-robot"
COMPONENT_UID = "ros-diagnostics-component"
ALERTS_UID = "ros-diagnostics-alerts"
MONITORING_UID = "ros-diagnostics-monitoring"
TAG = "ros-diagnostics"

_COMMON = "${datasource:queryparam}&${__url_time_range}"

# From a row of a table; __data.fields are the columns, by title.
TO_ROBOT = (
    f"/d/{ROBOT_UID}?{_COMMON}&var-fleet=${{__data.fields.Fleet}}"
    "&var-robot=${__data.fields.Robot}"
)
TO_COMPONENT = (
    f"/d/{COMPONENT_UID}?{_COMMON}&var-fleet=${{__data.fields.Fleet}}"
    "&var-component=${__data.fields.Component}"
)
# From the dashboard of a robot.
TO_COMPONENT_OF_FLEET = (
    f"/d/{COMPONENT_UID}?{_COMMON}&${{fleet:queryparam}}&var-component=${{__data.fields.Component}}"
)
# From a line or bar of a graph.
TO_ROBOT_OF_SERIES = (
    f"/d/{ROBOT_UID}?{_COMMON}&var-fleet=${{__field.labels.fleet}}"
    "&var-robot=${__field.labels.robot}"
)


def to_fleet(state: str) -> str:
    """Return the fleet dashboard filtered by ``state``, a URL-encoded value of the variable."""
    kept = "${fleet:queryparam}&${site:queryparam}&${robot_group:queryparam}"
    return f"/d/{FLEET_UID}?{_COMMON}&{kept}&var-state={state}"
