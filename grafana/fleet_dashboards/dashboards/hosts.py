"""Host checks: who answers a ping, and how the robots' computers are.

Empty where the jobs of prometheus.yml for it are not in use.
"""

from __future__ import annotations

from grafana_foundation_sdk.builders import table, timeseries

from fleet_dashboards.lib import links, palette, panels, tables
from fleet_dashboards.lib.tables import Column
from fleet_dashboards.queries import hosts as queries
from fleet_dashboards.queries import monitoring

UP = palette.up_mappings()
FLEET = Column("fleet", "Fleet", width=110)
ROBOT = Column("robot", "Robot", link=links.TO_ROBOT)
STEP = "15s"  # of the job: rates need two scrapes
SHOWN = "The 20 highest at the end of the range"


def hosts() -> table.Panel:
    """Host checks, as Nagios' check_ping made them."""
    return tables.listing(
        "Hosts",
        "Which robots and uplinks answer a ping? Only where blackbox_exporter is scraped: a robot "
        "that answers and is silent has lost its software, not its power.",
        "Nothing is pinged: see the end of prometheus.yml",
        {"A": monitoring.HOSTS, "B": monitoring.HOST_LATENCY},
        [
            Column("A", "State", mappings=UP, width=90),
            FLEET,
            ROBOT,
            Column("uplink", "Uplink"),
            Column("instance", "Address"),
            Column("B", "Took", unit="s", width=100),
        ],
        descending=False,
        by="job, instance, fleet, robot, uplink",
    ).span(12)


def computers() -> table.Panel:
    """The robots' computers."""
    return tables.listing(
        "Computers",
        "How busy, full and hot are the robots' computers? Only where node_exporter runs on them. "
        "Disk is the fullest file system, temperature the hottest sensor.",
        "No computer is asked: see the end of prometheus.yml",
        {
            "A": queries.ANSWERS,
            "B": queries.BUSY,
            "C": queries.MEMORY,
            "D": queries.DISK,
            "E": queries.TEMPERATURE,
            "F": queries.RUNS_FOR,
            "G": queries.CLOCK,
        },
        [
            Column("A", "State", mappings=UP, width=90),
            FLEET,
            ROBOT,
            Column("instance", "Address"),
            Column("B", "CPU", unit="percentunit", width=90),
            Column("C", "Memory", unit="percentunit", width=90),
            Column("D", "Disk", unit="percentunit", width=90),
            Column("E", "Temperature", unit="celsius", width=120),
            Column("F", "Runs for", unit="dtdurations", width=150),
            Column("G", "Clock", mappings=palette.clock_mappings(), width=130),
        ],
        descending=False,
        by="fleet, robot, instance",
    )


def over_time() -> list[timeseries.Panel]:
    """The past of the computers."""
    return [
        _graph("CPU", "Whose computer is busy?", queries.BUSY_OVER_TIME).max(1),
        _graph("Memory", "Whose memory runs out?", queries.MEMORY_OVER_TIME).max(1),
        _graph("Disk", "Whose disk fills up?", queries.DISK_OVER_TIME).max(1),
        _graph("Temperature", "Whose computer gets hot?", queries.TEMPERATURE_OVER_TIME, "celsius"),
        _graph("Network", "Who sends and receives how much?", queries.NETWORK_OVER_TIME, "Bps"),
        ping_over_time(),
    ]


def _graph(title: str, question: str, expr: str, unit: str = "percentunit") -> timeseries.Panel:
    query = panels.over_time(expr, "{{robot}} {{instance}}").interval(STEP)
    return panels.graph(title, f"{question} {SHOWN}.", query, unit=unit).min(0)


def ping_over_time() -> timeseries.Panel:
    """How long a ping takes."""
    return panels.graph(
        "Time of a ping",
        f"Whose connection gets slow? {SHOWN}; a probe that fails takes its whole time.",
        panels.over_time(queries.PING_OVER_TIME, "{{robot}}{{uplink}}"),
        unit="s",
    )
