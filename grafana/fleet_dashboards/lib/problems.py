"""The table of problems: confirmed faults, and what is in trouble and not confirmed yet.

A row's value is the rank of its state, 10 more if it concerns many robots, and 10 less if another
problem or a downtime explains it. By that number the rows are sorted.
"""

from __future__ import annotations

from typing import NamedTuple

from grafana_foundation_sdk.builders import table
from grafana_foundation_sdk.models import dashboard

from fleet_dashboards.lib import links, palette, tables
from fleet_dashboards.lib.palette import State
from fleet_dashboards.lib.promql import HELD, HELD_OF_ROBOT, UPLINK, label, named, silent_reason
from fleet_dashboards.lib.tables import Column

# A fault's identity; a row has the labels of it that apply.
IDENTITY = "fleet, scope, state, site, robot, group, component, check, key, bound"
# A warning goes on under a critical fault of the same component or value: only the worst is shown.
_NESTED = "fleet, scope, robot, group, component, check, key, bound"
_COMPONENT = "fleet, robot, group, component"


MANY = 10  # added to the rank of what concerns many robots, and subtracted from what is explained


class _Kind(NamedTuple):
    """Faults that are shown alike: which, in which state, and what is put before their evidence."""

    matchers: str
    state: State
    text: str = ""  # $1 is the label `named_by`
    named_by: str = ""
    under: str = "critical|stale|lost"  # worse states: a warning goes on under them
    board: str = links.ROBOT_UID  # which shows more of it


_CRITICAL = _Kind('scope="component", state="critical"', palette.CRITICAL)
_KINDS = (
    _CRITICAL,
    _Kind('scope="component", state="stale"', palette.STALE),
    _Kind('scope="component", state="warning"', palette.WARNING),
    _Kind('scope="value", state="critical"', palette.CRITICAL, text="$1", named_by="key"),
    _Kind('scope="value", severity="warning"', palette.WARNING, text="$1", named_by="key"),
    _Kind('scope="check"', palette.CRITICAL, text="$1", named_by="check"),
    _Kind('scope="capability", state="lost"', palette.CRITICAL, "$1 is lost", "check"),
    _Kind('scope="capability", state="degraded"', palette.WARNING, "$1 is degraded", "check"),
    _Kind(
        'scope="capability", state="no_reserve"',
        palette.WARNING,
        "$1 has no reserve",
        "check",
        under="lost|degraded",
    ),
    _Kind('scope="robot", state="silent"', palette.SILENT),
    _Kind('scope="robot", state="pending"', palette.PENDING),
    _Kind('scope="robot", state="flapping"', palette.FLAPPING, "comes and goes"),
    _Kind(
        'scope="robot", state="many", severity="critical"',
        palette.CRITICAL,
        "many components failed at once",
    ),
    _Kind(
        'scope="robot", state="many", severity!="critical"',
        palette.WARNING,
        "many components failed at once",
    ),
    _Kind('scope="flapping", state="flapping"', palette.FLAPPING),
    _Kind('scope="flapping", state="intermittent"', palette.WARNING, "intermittent"),
)
_OF_MANY = (
    _Kind('scope="site", site=""', palette.SILENT, board=links.FLEET_UID),
    _Kind('scope="site", site!=""', palette.SILENT, "site $1", "site", board=links.FLEET_UID),
    _Kind('scope="common"', palette.CRITICAL, board=links.COMPONENT_UID),
)


def _confirmed(matchers: str) -> str:
    """Return the confirmed faults of single robots with the rank of their states, and a message."""
    listed = "\nor\n".join(_ranked(kind, matchers) for kind in _KINDS)
    return named(f"(\n{listed}\n)")


def _of_many(matchers: str, members: str) -> str:
    """Return the faults of many robots, with their number in the label ``who``.

    That of an uplink is one, too: its robots are out of reach.
    """
    down = f"({_ranked(_CRITICAL, matchers)} and on (fleet, robot) {UPLINK})"
    listed = "\nor\n".join(_ranked(kind, matchers, members) for kind in _OF_MANY)
    robots = f'group by (fault, fleet, robot) ({HELD_OF_ROBOT}{{scope=~"site|common"}})'
    number = f'count_values by (fault) ("who", count by (fault) ({robots}))'
    return f"""
      (
{listed}
      )
    * on (fault) group_left (who)
      {label(number, "who", "$1 robots", "who", "(.*)")}
    or
      {named(down)}
"""


def _ranked(kind: _Kind, matchers: str, members: str = "") -> str:
    found = f"{HELD}{{{matchers}, {kind.matchers}}}"
    if members:
        found = f"({found} and on (fault) {HELD_OF_ROBOT}{{{members}}})"
    found = f"{found} * 0 + {kind.state.rank}"
    if kind.state in (palette.WARNING, palette.FLAPPING):
        worse = f'{HELD}{{{matchers}, state=~"{kind.under}"}}'
        found = f"({found} unless on ({_NESTED}) {worse})"
    if kind.state is palette.STALE:
        found = f'({found} unless on ({_NESTED}) {HELD}{{{matchers}, state="critical"}})'
    found = label(found, "board", kind.board)
    if not kind.text:
        return label(found, "message", "$1", "evidence", "(?s:(.*))")
    found = label(found, "message", kind.text, kind.named_by, "(.*)")
    return f'label_join({found}, "message", ": ", "message", "evidence")'


_SUPPRESSED = "ros_diagnostics_component_suppressed"
_REASONS = 'reason=~"uplink_down|domain_unreachable"'


def _soft(matchers: str, faults: str, covered: str, chosen: str) -> str:
    """Return what is in trouble and not confirmed, as ranks with a message.

    Nothing is known of the components of a silent robot, nor of those of an exporter that does not
    answer. ``covered`` is shown as one fault, and so are the robots of an uplink that is one of the
    ``faults``. ``chosen`` compares ranks.
    """
    components = f"component:ros_diagnostics_state:rank{{{matchers}}}"
    robots = f"robot:ros_diagnostics_state:rank{{{matchers}}}"
    up = f"max by (fleet, robot) (ros_diagnostics_robot_up{{{matchers}}})"
    received, silent = f"{up} == 1", f"{up} == 0"
    behind = f"(ros_diagnostics_robot_silent_reason{{{matchers}, {_REASONS}}} == 1)"
    planned = f"(ros_diagnostics_robot_maintenance{{{matchers}}} == 1)"
    component_planned = f"(ros_diagnostics_component_maintenance{{{matchers}}} == 1)"
    suppressed = f"""
      {_SUPPRESSED}{{{matchers}}}
      or {component_planned}
      or ({components} and on (fleet, robot) {planned})
"""
    component = f"""
    ({components} {chosen})
    unless on ({_COMPONENT}) ({components} == 2 and on ({_COMPONENT})
      ros_diagnostics_component_planned_stale == 1)
    unless on ({_COMPONENT}) {HELD_OF_ROBOT}{{scope=~"component|flapping|common|capability"}}
    unless on ({_COMPONENT}) {HELD}{{{faults}, scope=~"component|flapping"}}
    and on (fleet, robot) ({received})
{covered}
"""
    robot = f"""
    ({robots} {chosen})
    and on (fleet, robot) ({silent})
    unless on (fleet, robot) {HELD}{{scope="robot", state=~"silent|pending|flapping"}}
    unless on (fleet, robot) {HELD_OF_ROBOT}{{scope="site"}}
    unless on (fleet, robot) ({behind} and on (fleet)
      ({HELD}{{{faults}, {_CRITICAL.matchers}}} and on (fleet, robot) {UPLINK}))
"""
    # Of few components, before they are grouped: there are messages of all.
    message = f"""
    group by ({_COMPONENT}, message) (
      ros_diagnostics_component_message_info{{{matchers}}} and on ({_COMPONENT}) {components}
    )
"""
    reason = label(silent_reason(matchers), "message", "$1", "reason", "(.*)")
    found = f"""(
{_described(component, components, _COMPONENT, message, suppressed)}
    or
{_described(robot, robots, "fleet, robot", reason, f"{behind} or {planned}")}
    )"""
    return named(label(found, "board", links.ROBOT_UID))


def _described(rows: str, ranks: str, by: str, messages: str, suppressed: str) -> str:
    """Return the rows with their messages, and lower those of which ``suppressed`` has a series.

    ``ranks`` are of all that there may be: what has no message, or is not suppressed, is among
    them. So ``rows``, which cost most, are computed once.
    """
    return f"""
  (
{rows}
  )
+ on ({by}) group_left (message)
  (
    0 * topk by ({by}) (1,
{messages}
    )
    or on ({by}) 0 * {ranks}
  )
- on ({by}) group_left ()
  (
    {MANY} * group by ({by}) ({suppressed})
    or on ({by}) 0 * {ranks}
  )
"""


_BEGAN = "ros_diagnostics_component_problem_since_timestamp_seconds"
_RECEIVED = "ros_diagnostics_robot_last_message_timestamp_seconds"


def _since(matchers: str, states: str) -> str:
    """Return when the trouble began, of faults and of what is not confirmed; Unix time."""
    return f"""
    max by ({IDENTITY}) ({HELD}{{{matchers}}})
  or
    max by ({_COMPONENT}) ({_BEGAN}{{{states}}})
  or
    max by (fleet, robot) ({_RECEIVED}{{{states}}} > 0)
"""


ACKNOWLEDGED = "ros_diagnostics_fault_acknowledged_timestamp_seconds"
_NOTIFIED = "ros_diagnostics_fault_notified_timestamp_seconds"
# Of each robot in a downtime one, also of a pair of exporters.
_UNTIL = "topk by (fleet, robot) (1, ros_diagnostics_robot_downtime_end_timestamp_seconds)"


def _care(matchers: str, states: str) -> str:
    """Return every problem with a label ``care``: who has it or was notified, or why nobody was.

    What an exporter that does not answer would know is not known.
    """
    sent = f"max by ({IDENTITY}, receiver) ({_NOTIFIED}{{{matchers}}} > 0)"
    last = f"topk by ({IDENTITY}) (1, {sent})"
    several = f"count by ({IDENTITY}) ({sent}) > 1"
    faults, soft, soft_robots = _each(matchers, states)
    planned = f"on (fleet, robot) (ros_diagnostics_robot_maintenance{{{states}}} == 1)"
    until = f"on (fleet, robot) group_left (downtime, author) ({_UNTIL} < +Inf)"
    until = label(f"({faults} or {soft}) * {until}", "care", "maintenance until")
    until = label(until, "care", "maintenance by $1 until", "author", "(.+)")
    parts = f"ros_diagnostics_component_maintenance{{{states}}} == 1"
    behind = f"max by (fleet, robot) (ros_diagnostics_robot_silent_reason{{{_REASONS}}} == 1)"
    suppressed = f"{_SUPPRESSED}{{{states}"
    found = _first_of(
        f"""
    label_join(
      {label(f"{ACKNOWLEDGED}{{{matchers}}}", "by", "acknowledged by $1", "author", "(.*)")},
      "care", ": ", "by", "comment"
    )
""",
        f'label_join({until}, "care", ": ", "care", "downtime")',
        label(f"(({faults} or {soft}) and {planned})", "care", "maintenance"),
        label(f"(({faults} or {soft}) and on ({_COMPONENT}) {parts})", "care", "maintenance"),
        label(
            f"({last} and on ({IDENTITY}) {several})",
            *("care", "notified: $1 …", "receiver", "(.*)"),
        ),
        label(last, "care", "notified: $1", "receiver", "(.*)"),
        label(f"max by ({IDENTITY}) ({_NOTIFIED}{{{matchers}}} == 0)", "care", "not notified yet"),
        label(faults, "care", "not known"),
        label(
            f"({soft_robots} and on (fleet, robot) {behind})",
            *("care", "suppressed by network"),
        ),
        label(
            f'max by ({_COMPONENT}) ({suppressed}, reason="depends_on"}})',
            "care",
            "suppressed by dependency",
        ),
        label(
            f"max by ({_COMPONENT}) ({suppressed}}})",
            *("care", "suppressed by capability"),
        ),
        label(f"({soft})", "care", "nobody yet: not confirmed"),
    )
    return f"group by ({IDENTITY}, care) (\n{found}\n)"


def _care_at(matchers: str, states: str) -> str:
    """Return when a fault was acknowledged, or its downtime ends, or it was notified; Unix time."""
    faults, soft, _robots = _each(matchers, states)
    return f"""
    max by ({IDENTITY}) ({ACKNOWLEDGED}{{{matchers}}})
  or
    0 * ({faults} or {soft}) + on (fleet, robot) group_left () ({_UNTIL} < +Inf)
  or
    max by ({IDENTITY}) ({_NOTIFIED}{{{matchers}}} > 0)
"""


def _each(matchers: str, states: str) -> tuple[str, str, str]:
    """Return the faults, all problems that are none yet, and those of these that are robots."""
    robots = f"max by (fleet, robot) ({_RECEIVED}{{{states}}})"
    soft = f"max by ({_COMPONENT}) ({_BEGAN}{{{states}}}) or {robots}"
    return f"max by ({IDENTITY}) ({HELD}{{{matchers}}})", soft, robots


def _first_of(*exprs: str) -> str:
    """Return of each problem the series of the first expression that has one."""
    return f"\nor on ({IDENTITY})\n".join(exprs)


_START = "ros_diagnostics_fault_start_timestamp_seconds"


def _pages(matchers: str, states: str) -> str:
    """Return every problem with the ``instance`` of an exporter that has a page of it, and its id.

    An exporter that does not answer has no page.
    """
    faults = f"max by ({IDENTITY}, fault, instance) ({_START}{{{matchers}}})"
    of_soft = f"max by (fleet, robot, instance) (ros_diagnostics_robot_up{{{states}}})"
    soft = f"max by ({_COMPONENT}, instance) ({_BEGAN}{{{states}}}) or {of_soft}"
    found = _first_of(f"topk by ({IDENTITY}) (1, {faults})", f"topk by ({IDENTITY}) (1, {soft})")
    return f"group by ({IDENTITY}, fault, instance) (\n{found}\n)"


def _state_mappings() -> list[dashboard.ValueMapping]:
    """Show the value of a row as the word of its state, in its colour."""
    shown = {
        str(state.rank + added): (state.word, state.colour)
        for added in (MANY, 0, -MANY)
        for state in reversed(palette.STATES)
    }
    return palette.words(shown)


# Why a robot is silent in words, and any other text as it is.
_REASON = palette.words({reason: (text, None) for reason, text in palette.SILENT_REASONS.items()})
ROBOT = Column("who", "Robot", link=links.OF_WHO, width=125, filtered=True)
# On a screen of 1366 pixels all of them, also beside Grafana's menu, which takes 300.
_COLUMNS = (
    tables.STATE._replace(mappings=_state_mappings()),
    ROBOT,
    Column("message", "Message", mappings=_REASON, min_width=250),
    Column("component", "Component", link=links.TO_COMPONENT, width=125, filtered=True),
    Column("B", "Since", unit=tables.MINUTE, width=105),
    Column("care", "Handled by", width=190, links=links.OF_PROBLEM),
    Column("E", "At", unit=tables.MINUTE, width=105),
    tables.FLEET._replace(hidden=True),
    Column("robot", "Name", hidden=True),
    Column("site", "Site", hidden=True),
    Column("board", "Board", hidden=True),
    Column("instance", "Exporter", hidden=True),
    Column("fault", "Fault", hidden=True),
    Column("scope", "Scope", hidden=True),
    Column("state", "Kind", hidden=True),
)


def problem_rows(
    matchers: str,
    *,
    of_states: str = "",
    selected: str = "",
    covered: str = "",
    chosen: str = "",
    filters: str = "",
    members: str = "",
) -> str:
    """Return a series for each problem: the rank of its state, and more or less than that.

    Args:
        matchers: Which faults, by labels that they have.
        of_states: Of the states and families of robots, which have fewer labels; `matchers` if "".
        selected: Restricts what is not confirmed; PromQL that follows its expression.
        covered: Leaves out of that what belongs to a larger fault; PromQL, too.
        chosen: Compares ranks: those of the states that are shown.
        filters: Of the variables, for all rows; PromQL, too.
        members: Of faults of many robots only those that these are part of, by labels of robots.
    """
    return f"""
  max by ({IDENTITY}, who, board, message) (
    (
      (
{_of_many(matchers, members)}
      ) {chosen}
    ) + {MANY}
or
    (
{_confirmed(matchers)}
    ) {chosen}
or
    {_soft(of_states or matchers, matchers, covered, chosen)}
    {selected}
  ) {filters}
"""


def problem_table(
    title: str,
    description: str,
    rows: str,
    matchers: str,
    *,
    proof: str,
    of_states: str = "",
    hidden: tuple[str, ...] = (),
) -> table.Panel:
    """Return the table of problems, worst first and of those the oldest first.

    Args:
        title: Of the panel.
        description: Of the panel.
        rows: As `problem_rows` returns them, with ``matchers`` and ``of_states``.
        matchers: Which faults, by labels that they have.
        proof: Has a value if having no row means that there is no problem.
        of_states: Of the states and families of robots; as of `problem_rows`.
        hidden: Titles of columns that are not shown.
    """
    states = of_states or matchers
    return tables.joined(
        title,
        description,
        {
            "A": rows,
            "B": f"(\n{_since(matchers, states)}\n) * 1000",
            "C": _care(matchers, states),
            "D": _pages(matchers, states),
            "E": f"(\n{_care_at(matchers, states)}\n) * 1000",
        },
        [each._replace(hidden=each.hidden or each.title in hidden) for each in _COLUMNS],
        by=IDENTITY,
        empty=tables.Empty("No problems", proof),
        sort=("State", "Since"),
    )
