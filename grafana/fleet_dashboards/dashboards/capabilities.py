"""What robots and the fleet can do: panels for the fleet, for a robot, and for reports."""

from __future__ import annotations

from grafana_foundation_sdk.builders import table

from fleet_dashboards.lib import palette, panels, tables, variables
from fleet_dashboards.lib.promql import HELD, in_order, label
from fleet_dashboards.lib.tables import Column

_STATE = "capability:ros_diagnostics_capability_state:max"
_CAPABILITY = "fleet, exporter, robot, capability"
STATE = tables.STATE._replace(mappings=palette.able_mappings(), width=115)


def of_robots(robots: str, proof: str) -> table.Panel:
    """Show a matrix: what each robot can do, the worst first.

    Args:
        robots: Has a series for each of the robots that are chosen.
        proof: Has a value if having no row means that no robot has capabilities.
    """
    worst = f"max by (fleet, robot) ({_STATE} and on (fleet, robot) ({robots}))"
    each = f"max by (fleet, robot, capability) ({_STATE} and on (fleet, robot) ({robots}))"
    rows = panels.tidy(in_order(f"({each} or {worst})"))
    none = label(f"(0 * group({proof}) / 0)", "order", "No robot has capabilities")
    # The worst is a column, too, and so is what says that there is none.
    expr = label(f"({rows}\nor on ()\n{none})", "capability", "Worst", "capability", "")
    return (
        tables.pivot(
            "What robots can do",
            "What can each robot do, by the capabilities of its profile in fleet.yml? The worst "
            "first. NO RESERVE: it is lost with the next part that fails. DEGRADED: it rests on a "
            "part in WARNING. LOST: too few parts work. UNKNOWN: it rests on what is not received.",
            expr,
            [
                tables.ROBOT_IN_ORDER,
                tables.FLEET,
                Column(
                    "Worst", "Worst", mappings=[*palette.able_mappings(), tables.NAN], width=115
                ),
                tables.NAME,
            ],
            label="capability",
            sort="Worst",
            others=palette.able_mappings(),
        )
        .height(8)
        .span(14)
    )


def of_fleet(matchers: str, proof: str) -> table.Panel:
    """List what the fleet can do, with how many robots can and cannot."""

    def robots(states: str) -> str:
        family = f'ros_diagnostics_fleet_capability_robots{{{matchers}, state=~"{states}"}}'
        counted = f"max by (fleet, exporter, capability, state) ({family} {_SPEAKS})"
        return f"sum by (fleet, exporter, capability) ({counted})"

    return (
        tables.joined(
            "What the fleet can do",
            "What can each fleet do, by the capabilities at the top of fleet.yml, and how many of "
            "the robots for it can, cannot, or are not received? The worst first.",
            {
                "A": f'max by (fleet, exporter, capability) ({_STATE}{{{matchers}, robot=""}})',
                "B": robots("ok|degraded"),
                "C": robots("lost"),
                "D": robots("unknown"),
            },
            [
                STATE,
                Column("capability", "Capability", min_width=150),
                Column("B", "Can", width=60),
                Column("C", "Cannot", width=75),
                Column("D", "Unknown", width=90),
                tables.FLEET,
            ],
            by="fleet, exporter, capability",
            empty=tables.Empty("It has no capabilities", proof, "capability"),
            sort=("State", "Capability"),
            ascending=("Capability",),
        )
        .height(8)
        .span(10)
    )


_SPEAKS = (
    "unless on (fleet, exporter, instance) "
    'exporter_site:ros_diagnostics_site:follows{scope="capability"}'
)


def of_robot() -> table.Panel:
    """List what one robot can do, and why not."""
    fault = f'{HELD}{{{variables.ONE_ROBOT}, scope="capability", state="%s"}}'
    # The better goes on under the worse: one of each is shown.
    worst = "\nor on (fleet, robot, check)\n".join(
        fault % state for state in ("lost", "degraded", "no_reserve")
    )
    why = label(f"({worst})", "capability", "$1", "check", "(.*)")
    return (
        tables.joined(
            "What it can do",
            "What can the robot do, and what not, by the capabilities of its profile in fleet.yml? "
            "Because: the parts, as they were when the fault was confirmed; of capabilities that "
            "are in trouble because of the same parts, one has the fault.",
            {
                "A": f"max by (fleet, robot, capability) ({_STATE}{{{variables.ONE_ROBOT}}})",
                "B": f"group by (fleet, robot, capability, evidence) ({why})",
            },
            [
                STATE,
                Column("capability", "Capability", min_width=110),
                Column("evidence", "Because", min_width=200, wrapped=True),
            ],
            by="fleet, robot, capability",
            empty=tables.Empty(
                "None in its profile",
                f"ros_diagnostics_robot_up{{{variables.ONE_ROBOT}}}",
                "capability",
            ),
            sort=("State", "Capability"),
            ascending=("Capability",),
        )
        .height(7)
        .span(24)
    )


def availability(matchers: str) -> table.Panel:
    """Show for which share of the time range what could be done."""
    series = f"capability:ros_diagnostics_part_seconds:sum5m{{{matchers}}}"
    seconds = f"sum by ({_CAPABILITY}, part) (sum_over_time({series}[$__range]))"
    known = f"sum by ({_CAPABILITY}) (sum_over_time({series}[$__range]))"
    parts = " or ".join(label(f"{known} * 0", "part", part) for part in ("able", "lost", "unknown"))
    return tables.pivot(
        "Availability of capabilities",
        "For which share of the time could each robot, and without a robot the fleet, do what it "
        "is for? Could is the share in which it was not lost, with or without reserve; lost and "
        "unknown are the rest. Planned time, and time in which the exporter was down, is left out.",
        f"""
          ({seconds} or {parts})
        / on ({_CAPABILITY}) group_left ()
          {known}
        """,
        [
            tables.FLEET,
            tables.ROBOT,
            Column("capability", "Capability", min_width=150),
            Column("able", "Could", unit="percentunit", width=108),
            Column("lost", "Lost", unit="percentunit", width=108),
            Column("unknown", "Unknown", unit="percentunit", width=108),
        ],
        label="part",
        sort="Could",
    ).height(8)
