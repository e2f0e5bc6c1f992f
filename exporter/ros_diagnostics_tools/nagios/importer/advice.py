"""What to do about each directive that has no equivalent, or needs none."""

from __future__ import annotations

from ros_diagnostics_tools.nagios.importer.files import Directive
from ros_diagnostics_tools.nagios.importer.ledger import Effect

_PAGE = "a text for Nagios' pages: not shown here"
_LINK = "links are those of robots, and this is none"
_PICTURE = "a picture of Nagios' map: Grafana's dashboards have none"
_EVENT = "no command is run on a fault: a webhook of Alertmanager reads, and a person acts"
_RETAIN = "state is always kept over a restart (--storage.path)"
_ACTIVE = "robots are received, not checked: there is nothing to switch"
_FLAPPING = "flapping has one pair of thresholds for the fleet: faults.flapping in fleet.yml"
_MAIL = "mails are written by alertmanager/templates: edit email.tmpl where yours differs"
_EXECUTE = "checks are not run, so none is left out: only notifications depend"
_REMINDER = (
    "a fault that nobody acknowledges is repeated once a day (RosDiagnosticsUnacknowledged, step 0 "
    "in prometheus/rules/escalation.yml)"
)
_BY_GROUP = "services are not looked up by group: name hosts and descriptions, or write it by hand"
_RIGHTS = "rights on pages: Grafana's roles, and Alertmanager's --web.config.file"

# By directive.
ADVICE = {
    "alias": _PAGE,
    "display_name": _PAGE,
    "notes": _PAGE,
    "notes_url": _LINK,
    "action_url": _LINK,
    **dict.fromkeys(("icon_image", "icon_image_alt", "vrml_image", "statusmap_image"), _PICTURE),
    **dict.fromkeys(("2d_coords", "3d_coords"), _PICTURE),
    **dict.fromkeys(("event_handler", "event_handler_enabled", "event_handler_period"), _EVENT),
    **dict.fromkeys(("retain_status_information", "retain_nonstatus_information"), _RETAIN),
    **dict.fromkeys(
        ("active_checks_enabled", "passive_checks_enabled", "parallelize_check"), _ACTIVE
    ),
    "check_interval": "robots are received, not checked: every message counts at once",
    "check_freshness": "always looked at: stale_after of the profile",
    "freshness_threshold": "check_freshness is off: stale_after of the profile holds",
    **dict.fromkeys(("low_flap_threshold", "high_flap_threshold"), _FLAPPING),
    "flap_detection_enabled": "flapping is always detected; its alerts are routed by option f",
    "flap_detection_options": "every change of level counts",
    "process_perf_data": "key-values of ROS are always stored, in Prometheus",
    "obsess": "Prometheus' remote_write or a second Prometheus sends results to another site",
    "initial_state": "a robot is PENDING until its first message",
    "stalking_options": "every change of level is an event: /api/v1/events",
    "is_volatile": "what comes and goes between scrapes fires RosDiagnosticsComponentIntermittent",
    "notification_interval": _REMINDER,
    "importance": "no sum of importance: route by labels (team, kind) of fleet.yml",
    "minimum_importance": "route by labels (team, kind) of fleet.yml",
    **dict.fromkeys(
        ("failure_prediction_enabled", "failure_prediction_options"), "Nagios ignores it"
    ),
    "can_submit_commands": _RIGHTS,
    "servicegroups": "add a check to the profile whose words match the group's components",
    "parents": "services have no parents: what depends is a servicedependency, an inhibit rule",
    "check_command": "not a ROS check, and nobody is notified of it",
    "inherits_parent": "inhibition is one level: write a rule for each pair",
    "execution_failure_criteria": _EXECUTE,
    "dependency_period": "an inhibit rule always holds",
    "last_notification": "an escalation lasts until the fault is acknowledged or ends",
    "escalation_options": "only CRITICAL and silent robots escalate",
    "hostgroup_name": "no robot is in it",
    "host_name": "not a robot: none of its checks is a ROS plug-in (see --plugin)",
    "timeperiod_name": "no route and no downtime uses these hours",
    "command_name": "no ROS check uses this command",
    "command_line": "no ROS check uses this command",
    **dict.fromkeys(("host_notification_commands", "service_notification_commands"), _MAIL),
    "contact_name": "no robot's contact",
    "contactgroup_name": "no robot's contact group",
    "email": "no robot's contact",
    "pager": "add sns_configs or a webhook to its receiver: docs/notifications.md, Text messages",
    "service_description": "not a ROS check",
    **dict.fromkeys(("servicegroup_name", "dependent_servicegroup_name"), _BY_GROUP),
}
# Where the object says it all.
BY_KIND = {
    "servicegroup": ADVICE["servicegroups"],
    "hostgroup": "no robot is in it, or nobody refers to it",
    "contactgroup": "no robot's contact group",
    "hostextinfo": _PAGE,
    "serviceextinfo": _PAGE,
    "hostgroupescalation": "Nagios ignores it",
    "timeperiod": "no route and no downtime uses these hours",
    "main": "a setting of the Nagios process: nothing to do",
    "resource": "no ROS check uses this macro",
}
MAIN = {
    "enable_notifications": "to switch all notifications off, silence them in Alertmanager",
    "enable_flap_detection": ADVICE["flap_detection_enabled"],
    "low_host_flap_threshold": _FLAPPING,
    "high_host_flap_threshold": _FLAPPING,
    "enable_event_handlers": _EVENT,
    "global_host_event_handler": _EVENT,
    "global_service_event_handler": _EVENT,
    "soft_state_dependencies": "inhibit rules act on confirmed faults",
    "check_service_freshness": ADVICE["check_freshness"],
    "check_host_freshness": ADVICE["check_freshness"],
    "retain_state_information": _RETAIN,
    "process_performance_data": ADVICE["process_perf_data"],
}
NOT_OF_ROBOTS = (
    "only of objects that are no robot's (no ROS check, see --plugin): for other hosts there are "
    "blackbox_exporter and node_exporter (docs/queries.md, computers)"
)
# What is translated where it is a robot's.
TRANSLATED = frozenset(
    {
        *("address", "check_period", "contact_groups", "contacts", "first_notification"),
        *("first_notification_delay", "max_check_attempts", "retry_interval", "hostgroups"),
        *("notification_period", "notification_options", "notifications_enabled"),
        *("escalation_period", "notification_failure_criteria", "dependent_host_name"),
        *("dependent_hostgroup_name", "dependent_service_description"),
        *("host_notification_period", "service_notification_period", "host_notification_options"),
        *("service_notification_options", "host_notifications_enabled"),
        "service_notifications_enabled",
    }
)
SECRET = ("pass", "secret", "token", "key", "community", "user", "pw")


# Of these, notifications depend; of what else has no equivalent, none does.
OTHERWISE = frozenset(
    {
        *("low_flap_threshold", "high_flap_threshold", "flap_detection_enabled", "is_volatile"),
        *("low_host_flap_threshold", "high_host_flap_threshold", "enable_flap_detection"),
        *("notification_interval", "dependency_period", "last_notification", "inherits_parent"),
        *("escalation_options", "enable_notifications", "servicegroup_name", "event_handler"),
        "dependent_servicegroup_name",
    }
)


def effect(directive: Directive) -> Effect:
    """What a directive that nothing here translates means to those who are notified."""
    return Effect.OTHERWISE if directive.key in OTHERWISE else Effect.INFORMATION


def advice(directive: Directive) -> str:
    """What to do about a directive that nothing here translates."""
    if directive.kind in ("main", "resource"):
        return MAIN.get(directive.key, BY_KIND[directive.kind])
    if directive.key.startswith("_"):
        return "a custom variable: add it to labels of the robot in fleet.yml if queries need it"
    if directive.key == "command_line" and "$CONTACT" in directive.value:
        return _MAIL
    if directive.kind == "contact" and directive.key.startswith("address"):
        return "another address of the contact: add it to the contact's receiver"
    if directive.kind == "servicegroup" and directive.key == "servicegroup_name":
        return BY_KIND["servicegroup"]
    known = ADVICE.get(directive.key) or BY_KIND.get(directive.kind)
    known = known or (NOT_OF_ROBOTS if directive.key in TRANSLATED else None)
    return known or "not a directive that Nagios documents: look it up"


def shown(directive: Directive) -> str:
    """The value for the report; not where it may be a secret."""
    custom = directive.key.startswith("_")
    secret = custom and any(word in directive.key.lower() for word in SECRET)
    hidden = directive.kind == "resource" or secret
    return "(not shown)" if hidden else directive.value
