"""Panels of the monitoring dashboard about hosts: pings, and the robots' computers.

They are empty unless the jobs at the end of prometheus.yml for them are in use; hence their rows
are collapsed, and queried only when opened.
"""

from __future__ import annotations

from collections.abc import Callable

from grafana_foundation_sdk.builders import table, timeseries

from fleet_dashboards.lib import palette, panels, tables
from fleet_dashboards.lib.tables import Column

LINES = 20  # of a graph
SHOWN = f"The {LINES} highest at the end of the range"
UP = palette.up_mappings()
CLOCK = palette.words(
    {"1": ("synchronized", palette.OK.colour), "0": ("free-running", palette.WARNING.colour)}
)
CHECK = palette.rewritten("/^ros-diagnostics-(.*)$/", "$1")  # of the job


def pings() -> table.Panel:
    """List what blackbox_exporter probes: robots and uplinks, and services of the robots."""
    by = "job, instance, fleet, robot"
    probed = 'job=~"ros-diagnostics-.*", fleet=~"$fleet"'
    return tables.joined(
        "Hosts",
        "Which robots and uplinks answer a ping, and which services of the robots' computers (SSH, "
        "HTTP, TCP ports) answer? Needs blackbox_exporter. If a silent robot answers a ping, its "
        "software has failed, not its power.",
        {
            "A": f"max by ({by}) (probe_success{{{probed}}})",
            "B": f"max by ({by}) (probe_duration_seconds{{{probed}}})",
        },
        [
            Column("A", "State", mappings=UP, width=80, background=True),
            tables.ROBOT,
            Column("job", "Check", mappings=CHECK, width=80),
            Column("instance", "Address"),
            Column("B", "Duration", unit="s", width=100),
            tables.FLEET,
        ],
        ascending=("State",),
        by=by,
    ).span(12)


# --- Computers: node_exporter on the robots. `at` is a modifier, such as "@ end()". ---

_NODE = 'job="ros-diagnostics-node", fleet=~"$fleet"'
_BY = "by (fleet, robot, instance)"


def _cpu(at: str = "") -> str:
    return f"""
clamp_min(
  1 - avg {_BY} (rate(node_cpu_seconds_total{{{_NODE}, mode="idle"}}[$__rate_interval]{at})),
  0
)
"""


def _memory(at: str = "") -> str:
    return f"""
1 - max {_BY} (
    node_memory_MemAvailable_bytes{{{_NODE}}}{at}
  /
    node_memory_MemTotal_bytes{{{_NODE}}}{at}
)
"""


def _disk(at: str = "") -> str:
    no_disk = "tmpfs|ramfs|devtmpfs|squashfs|iso9660|overlay"  # or never fuller than it was made
    of = f'{{{_NODE}, fstype!~"{no_disk}"}}{at}'
    return f"""
1 - min {_BY} (node_filesystem_avail_bytes{of} / (node_filesystem_size_bytes{of} > 0))
"""


def _temperature(at: str = "") -> str:
    return f"""
max {_BY} (
    node_hwmon_temp_celsius{{{_NODE}}}{at}
  or
    node_thermal_zone_temp{{{_NODE}}}{at}
)
"""


def _network(at: str = "") -> str:
    of = f'{{{_NODE}, device!="lo"}}[$__rate_interval]{at}'
    return f"""
sum {_BY} (
    rate(node_network_receive_bytes_total{of})
  +
    rate(node_network_transmit_bytes_total{of})
)
"""


def computers() -> table.Panel:
    """List the robots' computers."""
    return tables.joined(
        "Computers",
        "How busy, full and hot are the robots' computers? Needs node_exporter on them. Disk is "
        "the fullest file system, temperature the hottest sensor.",
        {
            "A": f"max {_BY} (up{{{_NODE}}})",
            "B": _cpu(),
            "C": _memory(),
            "D": _disk(),
            "E": _temperature(),
            "F": f"floor(time() - max {_BY} (node_boot_time_seconds{{{_NODE}}}))",
            "G": f"max {_BY} (node_timex_sync_status{{{_NODE}}})",
        },
        [
            Column("A", "State", mappings=UP, width=80, background=True),
            tables.ROBOT,
            Column("instance", "Address", min_width=120),
            Column("B", "CPU", unit="percentunit", width=90),
            Column("C", "Memory", unit="percentunit", width=90),
            Column("D", "Disk", unit="percentunit", width=90),
            Column("E", "Temperature", unit="celsius", width=120),
            Column("F", "Uptime", unit=tables.DURATION, width=115),
            Column("G", "Clock", mappings=CLOCK, width=130, background=True),
            tables.FLEET,
        ],
        ascending=("State",),
        by="fleet, robot, instance",
    )


# --- Over time: the highest at the end of the range, so that the lines stay the same over all of it


def _graph(
    title: str, question: str, measured: Callable[[str], str], unit: str = "percentunit"
) -> timeseries.Panel:
    at_end = measured(" @ end()")
    expr = f"{measured('')}\nand on (fleet, robot, instance)\n  topk({LINES}, {at_end})"
    # The scrape interval of the job is 15 s: rates need two scrapes.
    query = panels.over_time(expr, "{{robot}} {{instance}}").interval("15s")
    return panels.graph(title, f"{question} {SHOWN}.", query, unit=unit).min(0)


def computers_over_time() -> list[timeseries.Panel]:
    """Show how busy, full and hot the computers are, and how much they send and receive."""
    return [
        _graph("CPU", "Which computers are busy?", _cpu).max(1),
        _graph("Memory", "Which computers run out of memory?", _memory).max(1),
        _graph("Disk", "Which disks fill up?", _disk).max(1),
        _graph("Temperature", "Which computers get hot?", _temperature, "celsius"),
        _graph("Network", "How much do the computers send and receive?", _network, "Bps"),
    ]


def ping_time() -> timeseries.Panel:
    """Show how long pings take."""
    probed = 'job=~"ros-diagnostics-(ping|uplink)", fleet=~"$fleet"'
    by = "by (fleet, robot)"
    expr = f"""
      max {by} (probe_duration_seconds{{{probed}}})
    and on (fleet, robot)
      topk({LINES}, max {by} (probe_duration_seconds{{{probed}}} @ end()))
    """
    return panels.graph(
        "Ping duration",
        f"Which connections get slow? {SHOWN}; a failed probe lasts until its timeout.",
        panels.over_time(expr, "{{robot}}"),
        unit="s",
    )
