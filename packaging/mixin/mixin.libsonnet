// The rules and dashboards as a monitoring mixin (https://monitoring.mixins.dev). This folder needs nothing outside of it.
// rules.json and dashboards/ are written by ./run generate.
local rules = import 'rules.json';

{
  _config+:: {
    // Where the exporter serves the runbooks; %s is the name of the alert.
    runbookURLPattern: 'http://localhost:9877/runbooks/%s.html',
    // Also the rules about Prometheus and Alertmanager themselves, for a site that has none.
    servers: false,
  },

  local hasAlerts(group) = std.length([rule for rule in group.rules if 'alert' in rule]) > 0,
  local withRunbook(rule) = if !('alert' in rule) then rule else rule {
    annotations+: { runbook_url: std.format($._config.runbookURLPattern, rule.alert) },
  },
  local groups = [
    group { rules: std.map(withRunbook, group.rules) }
    for file in std.objectFields(rules)
    if file != 'servers' || $._config.servers
    for group in rules[file]
  ],

  // A group is evaluated in its order, so one with alerts keeps its records.
  prometheusAlerts+:: { groups+: std.filter(hasAlerts, groups) },
  prometheusRules+:: { groups+: std.filter(function(group) !hasAlerts(group), groups) },

  grafanaDashboards+:: {
    'ros-diagnostics-alerts.json': import 'dashboards/ros-diagnostics-alerts.json',
    'ros-diagnostics-component.json': import 'dashboards/ros-diagnostics-component.json',
    'ros-diagnostics-fleet.json': import 'dashboards/ros-diagnostics-fleet.json',
    'ros-diagnostics-monitoring.json': import 'dashboards/ros-diagnostics-monitoring.json',
    'ros-diagnostics-robot.json': import 'dashboards/ros-diagnostics-robot.json',
    'ros-diagnostics-missions.json': import 'dashboards/ros-diagnostics-missions.json',
    'ros-diagnostics-week.json': import 'dashboards/ros-diagnostics-week.json',
  },
}
