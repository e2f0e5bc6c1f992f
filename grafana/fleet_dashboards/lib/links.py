"""Links between the dashboards; they keep the data source and the time range.

Names are percent-encoded: a component may be called "A & B", "50 %" or "#1".
"""

from __future__ import annotations

FLEET_UID = "ros-diagnostics-fleet"
ROBOT_UID = "ros-diagnostics-robot"
COMPONENT_UID = "ros-diagnostics-component"
ALERTS_UID = "ros-diagnostics-alerts"
WEEK_UID = "ros-diagnostics-week"
MISSIONS_UID = "ros-diagnostics-missions"
MONITORING_UID = "ros-diagnostics-monitoring"
TAG = "ros-diagnostics"

_COMMON = "${datasource:queryparam}&${__url_time_range}"


def _column(title: str) -> str:
    return f"${{__data.fields.{title}:percentencode}}"


def _label(name: str) -> str:
    return f"${{__field.labels.{name}:percentencode}}"


# From a row of a table; __data.fields are the columns, by title.
TO_ROBOT = f"/d/{ROBOT_UID}?{_COMMON}&var-fleet={_column('Fleet')}&var-robot={_column('Robot')}"
TO_ROBOT_IN_ORDER = (  # where the column Robot is the label "order"
    f"/d/{ROBOT_UID}?{_COMMON}&var-fleet={_column('Fleet')}&var-robot={_column('Name')}"
)
# The same from a problem, to what its row is about: a robot, a site, or a component of many robots.
OF_WHO = (
    f"/d/{_column('Board')}?{_COMMON}&var-fleet={_column('Fleet')}&var-robot={_column('Name')}"
    f"&var-site={_column('Site')}&var-component={_column('Component')}"
)
TO_COMPONENT = (
    f"/d/{COMPONENT_UID}?{_COMMON}&var-fleet={_column('Fleet')}"
    f"&var-component={_column('Component')}"
)
# From a problem to the pages of an exporter, by the address at which Prometheus scrapes it.
_PROBLEM = f"http://${{__data.fields.Exporter}}/problem?fault={_column('Fault')}"
OF_PROBLEM = (
    ("Why, acknowledge, plan a downtime", f"{_PROBLEM}&robot={_column('Name')}"),
    ("Runbook", f"{_PROBLEM}&scope={_column('Scope')}&state={_column('Kind')}"),
)
# From the dashboard of a robot.
TO_COMPONENT_OF_FLEET = (
    f"/d/{COMPONENT_UID}?{_COMMON}&${{fleet:queryparam}}&var-component={_column('Component')}"
)
# From a line or bar of a graph.
TO_ROBOT_OF_SERIES = (
    f"/d/{ROBOT_UID}?{_COMMON}&var-fleet={_label('fleet')}&var-robot={_label('robot')}"
)
# The same at the time of the mark under the pointer: tables show what was true then.
_THEN = "${datasource:queryparam}&from=${__from}&to=${__value.time}"
TO_ROBOT_THEN = f"/d/{ROBOT_UID}?{_THEN}&var-fleet={_label('fleet')}&var-robot={_label('robot')}"
TO_MISSIONS = f"/d/{MISSIONS_UID}?{_COMMON}&${{fleet:queryparam}}"
TO_MONITORING = f"/d/{MONITORING_UID}?{_COMMON}"


def to_fleet(state: str) -> str:
    """Return the fleet dashboard filtered by ``state``, a URL-encoded value of the variable."""
    kept = "${fleet:queryparam}&${site:queryparam}&${robot_group:queryparam}"
    return f"/d/{FLEET_UID}?{_COMMON}&{kept}&var-state={state}"
