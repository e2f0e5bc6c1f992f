// For jsonnet users: the dashboards and rules as a monitoring mixin (https://monitoring.mixins.dev).
// Rules and alerts of a group are evaluated in its order, so both are in prometheusRules.

// A text with "---" in a comment is parsed as a list of documents.
local groups(text) = local parsed = std.parseYaml(text); (if std.isArray(parsed) then parsed[0] else parsed).groups;

{
  grafanaDashboards+:: {
    'ros-diagnostics-alerts.json': import '../../grafana/dashboards/ros-diagnostics-alerts.json',
    'ros-diagnostics-component.json': import '../../grafana/dashboards/ros-diagnostics-component.json',
    'ros-diagnostics-fleet.json': import '../../grafana/dashboards/ros-diagnostics-fleet.json',
    'ros-diagnostics-monitoring.json': import '../../grafana/dashboards/ros-diagnostics-monitoring.json',
    'ros-diagnostics-robot.json': import '../../grafana/dashboards/ros-diagnostics-robot.json',
    'ros-diagnostics-week.json': import '../../grafana/dashboards/ros-diagnostics-week.json',
  },
  prometheusRules+:: {
    groups+: std.flatMap(groups, [
      importstr '../../prometheus/rules/availability.yml',
      importstr '../../prometheus/rules/escalation.yml',
      importstr '../../prometheus/rules/faults.yml',
      importstr '../../prometheus/rules/monitoring.yml',
      importstr '../../prometheus/rules/pairs.yml',
      importstr '../../prometheus/rules/servers.yml',
      importstr '../../prometheus/rules/states.yml',
    ]),
  },
}
