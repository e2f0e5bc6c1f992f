"""A robot's connection: what arrives from it, how late, and what is refused."""

from __future__ import annotations

from grafana_foundation_sdk.builders import stat, table, timeseries

from fleet_dashboards.lib import palette, panels, tables
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import robot as queries


def age_over_time() -> timeseries.Panel:
    """Gaps in the connection."""
    return panels.graph(
        "Age of the last message",
        "Did the connection have gaps, and how long? Above the dashed line the robot is silent.",
        panels.over_time(queries.MESSAGE_AGE, "age"),
        panels.over_time(queries.STALE_AFTER, "silent from here", "B"),
        unit="s",
    ).override_by_name("silent from here", panels.dashed(palette.UNKNOWN.colour))


def offset_over_time() -> timeseries.Panel:
    """The robot's clock over time."""
    return panels.graph(
        "Clock offset over time",
        "Does the robot's clock drift or step?",
        panels.over_time(queries.CLOCK_OFFSET, "offset"),
        unit="s",
    )


def receipt() -> timeseries.Panel:
    """Messages."""
    return panels.graph(
        "Messages received",
        "How many arrays arrive in a second?",
        panels.over_time(queries.MESSAGE_RATE, "messages"),
        unit="cps",
    )


def bytes_received() -> timeseries.Panel:
    """Bytes."""
    return panels.graph(
        "Data received",
        "How much of the network do this robot's diagnostics take?",
        panels.over_time(queries.BYTE_RATE, "bytes"),
        unit="Bps",
    )


def publishers() -> stat.Panel:
    """Publishers that DDS has matched."""
    return panels.number(
        "Publishers",
        "How many publishers on this robot's topics does DDS see now? None and silent: the program "
        "has ended or the network is cut. Some and silent: the program hangs.",
        queries.PUBLISHERS,
    ).height(8)


def rejected() -> table.Panel:
    """What was not taken in."""
    return (
        tables.listing(
            "Rejected",
            "What of this robot's messages was not taken in during the time range, and why?",
            "Nothing was rejected",
            {"A": queries.REJECTED},
            [Column("reason", "Reason"), Column("A", "Count")],
            sort="Count",
        )
        .height(8)
        .span(8)
    )


def inventory() -> table.Panel:
    """Where the robot lives."""
    return (
        tables.listing(
            "Inventory",
            "Where does this robot live, and what does fleet.yml say of it?",
            "No such robot",
            {"A": queries.INVENTORY},
            [
                Column(
                    label,
                    label.removeprefix("ros_").replace("_id", "").replace("_", " ").capitalize(),
                )
                for label in (
                    *("fleet", "robot", "site", "robot_group", "kind", "team", "uplink", "address"),
                    *("domain_id", "ros_namespace", "topic", "profile"),
                )
            ],
            sort="Robot",
        )
        .height(8)
        .span(12)
    )
