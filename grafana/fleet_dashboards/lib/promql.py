"""Expressions that several dashboards share.

`$fleet`, `$site`, `$robot_group` may be several or all, so they match as regular expressions;
`$robot` alone on its dashboard, `$component` and `$key` on theirs are one, and match exactly.
Recorded states (prometheus/rules) are preferred to computing them again: they are cheap to query.
"""

from __future__ import annotations

HELD = "fleet:ros_diagnostics_fault_start:held"
# The same of each robot, with those of sites and of many robots that it is part of.
HELD_OF_ROBOT = "robot:ros_diagnostics_fault_start:held"
# What has no place in ROS, and is no robot, such as an access point.
DEVICE = 'robot:ros_diagnostics:info{domain_id="none"}'
# What of it robots name as their uplink.
_UPLINKS = 'group by (fleet, uplink) (robot:ros_diagnostics:info{uplink!=""})'
UPLINK = f"""(
  {DEVICE}
and on (fleet, robot)
  label_replace({_UPLINKS}, "robot", "$1", "uplink", "(.*)")
)"""
# Series that belong to no value: the exporter's own families, recorded series, alerts.
_OTHERS = "ros_diagnostics_.*|ALERTS.*|.*:.*"


def component_rank(matchers: str, at: str = "") -> str:
    """Return the rank of each component, OK ones included: only others have a recorded rank.

    ``at`` is a modifier, such as "@ end()".

    That ends when the exporter dies, and levels, which are scraped less often, some seconds later.
    """
    return (
        "max by (fleet, robot, group, component) ("
        f"component:ros_diagnostics_state:rank{{{matchers}}}{at}"
        f" or ros_diagnostics_component_level{{{matchers}}}{at} == 0)"
    )


def problem_began(matchers: str, at: str = "") -> str:
    """Return when each component that is not OK left OK; Unix time."""
    began = f"ros_diagnostics_component_problem_since_timestamp_seconds{{{matchers}}}{at}"
    return f"max by (fleet, robot, group, component) ({began})"


def message_age(matchers: str) -> str:
    """Return the age of each robot's last message when it was scraped, in whole seconds."""
    received = f"ros_diagnostics_robot_last_message_timestamp_seconds{{{matchers}}}"
    # A message that is received during the scrape may have a later timestamp: hence clamp_min.
    return f"""
floor(clamp_min(
  max by (fleet, robot) (timestamp({received}) - ({received} > 0)),
  0
))
"""


def silent_reason(matchers: str) -> str:
    """Return why each silent robot is; right after a start of the exporter nobody knows that."""
    reason = f"ros_diagnostics_robot_silent_reason{{{matchers}}} == 1"
    unsure = f'{matchers}, reason=~"mute|publisher_gone|never_seen"'
    early = (
        f"(ros_diagnostics_robot_silent_reason{{{unsure}}} == 1"
        " and on (instance) ros_diagnostics_exporter_settled == 0)"
    )
    return f"""
  (({reason}) unless {early})
or
  {label(early, "reason", "just_started")}
"""


def promoted(matchers: str, at: str = "") -> str:
    """Select the values that fleet.yml gives a metric of their own, by any name."""
    return f'{{{matchers}, component!="", key!="", __name__!~"{_OTHERS}"}}{at}'


def values(matchers: str, at: str = "") -> str:
    """Return key-values that are numbers; those with a metric of their own have no unit.

    ``at`` is a modifier, such as "@ end()".
    """
    return f"""
    ros_diagnostics_component_value{{{matchers}}}{at}
  or on (fleet, robot, group, component, key)
    {promoted(matchers, at)}
"""


def with_unit(expr: str) -> str:
    """Add a label ``in_unit`` for the end of a legend, which is absent where there is no unit."""
    found = label(f"({expr})", "in_unit", " in $1", "unit", "(.+)")
    return label(found, "in_unit", " in °$1", "unit", "deg(C|F)")


def in_order(expr: str) -> str:
    """Add a label ``order``, in which robot_2 is before robot_10.

    It is the robot's name with "!" before a number at its end, up to four characters, because
    series and texts are sorted by character.
    """
    ordered = label(expr, "order", "$1", "robot", "(.*)")
    for digits in (1, 2, 3):
        regexp = f"(|.*[^0-9])([0-9]{{{digits}}})"
        ordered = label(ordered, "order", f"${{1}}{'!' * (4 - digits)}$2", "robot", regexp)
    return ordered


def worst_first(expr: str, rank: str, began: str, by: str, *, most: int = 0) -> str:
    """Add a label ``_place`` to range vectors: worst first, then the oldest, then by ``order``.

    Prometheus sorts the series of a range by their labels, in the order of the labels' names.

    Args:
        expr: The states over time.
        rank: Their ranks at the end of the range, so that a row has one place in all of it.
        began: When each trouble began, at the end, too; what has none is the last of its rank.
        by: The labels that the three have in common.
        most: So many of them, the worst; 0 for all, also those that are not there at the end.
    """
    place = f"""
      count_values by ({by}) ("_place", 8 - {worst(rank, began, by, most)})
    """
    placed = f"({expr}) * on ({by}) group_left (_place) {place}"
    return placed if most else f"{placed} or on ({by}) {expr}"


def worst(rank: str, began: str, by: str, most: int) -> str:
    """Return the ``most`` of the highest rank, and of those the oldest, as `worst_first` does."""
    # Unix time is less than 0.3 of it.
    found = f"({rank}) - on ({by}) (({began}) / 1e10 or on ({by}) ({rank}) * 0 + 0.5)"
    return f"topk({most}, {found})" if most else f"({found})"


def label(expr: str, name: str, value: str, source: str = "", regexp: str = "") -> str:
    """Give series a label: a text, or what ``regexp`` finds in the label ``source``."""
    return f'label_replace({expr}, "{name}", "{value}", "{source}", "{regexp}")'


def named(expr: str) -> str:
    """Add the robot as the label ``who``; of a long name begin and end, which tell it apart."""
    full = label(expr, "who", "$1", "robot", "(.*)")
    return label(full, "who", "$1\u2026$2", "robot", "(.{6}).{4,}(.{6})")


def or_nothing(expr: str, text: str, proof: str, column: str = "message") -> str:
    """Return one row with a text in a column if ``expr`` has none and ``proof`` has a value.

    So an empty table says that all is well only where that is known. The value is NaN, which a
    table shows as an empty cell.
    """
    proven = label(f"(0 * group({proof}) / 0)", column, text)
    return f"""
  (
{expr}
  )
or on ()
  {proven}
"""


def settled(matchers: str, *, of: str = "") -> str:
    """Return a value if every exporter answers and has settled; else what is empty proves nothing.

    With ``of="fleet"`` a value for each fleet of which that is true. An exporter that was ever
    scraped is held as long as its target exists. At a centre of many sites, which scrapes none, it
    takes `reached` as well.
    """
    held = f"exporter:ros_diagnostics_exporter:held{{{matchers}}}"
    return f"""
    ros_diagnostics_exporter_settled{{{matchers}}} == 1
  unless on ({of})
    ({held} unless on (instance, job) up == 1)
  unless on ({of})
    ros_diagnostics_exporter_settled{{{matchers}}} == 0
"""


def answering(matchers: str) -> str:
    """Return a value if every exporter answers, also one that has just started."""
    held = f"exporter:ros_diagnostics_exporter:held{{{matchers}}}"
    return f"""
    ros_diagnostics_exporter_settled{{{matchers}}}
  unless on ()
    ({held} unless on (instance, job) up == 1)
"""


def reached(proof: str, sites: str = ".*") -> str:
    """Return ``proof`` without a value while the centre of many sites does not reach one of them.

    Args:
        proof: As of `settled`, without ``of``.
        sites: A regular expression for which sites; by default all.
    """
    return f"""{proof}  unless on ()
    ALERTS{{alertname="RosDiagnosticsSiteUnreachable", alertstate="firing", site=~"{sites}"}}
"""
