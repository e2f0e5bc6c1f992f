"""Expressions about the robots' computers: node_exporter on them, as prometheus.yml scrapes it."""

from __future__ import annotations

_NODE = 'job="ros-diagnostics-node", fleet=~"$fleet"'
_HOST = "by (fleet, robot, instance)"
_SHOWN = 20  # lines of a graph
# Not a disk, or never fuller than it was made.
_NO_DISK = "tmpfs|ramfs|devtmpfs|squashfs|iso9660|overlay"


def _busy(at: str = "") -> str:
    return f"""
clamp_min(
  1 - avg {_HOST} (rate(node_cpu_seconds_total{{{_NODE}, mode="idle"}}[$__rate_interval]{at})),
  0
)
"""


def _memory(at: str = "") -> str:
    return f"""
1 - max {_HOST} (
    node_memory_MemAvailable_bytes{{{_NODE}}}{at}
  /
    node_memory_MemTotal_bytes{{{_NODE}}}{at}
)
"""


def _disk(at: str = "") -> str:
    of = f'{{{_NODE}, fstype!~"{_NO_DISK}"}}{at}'
    return f"""
1 - min {_HOST} (node_filesystem_avail_bytes{of} / (node_filesystem_size_bytes{of} > 0))
"""


def _temperature(at: str = "") -> str:
    return f"""
max {_HOST} (
    node_hwmon_temp_celsius{{{_NODE}}}{at}
  or
    node_thermal_zone_temp{{{_NODE}}}{at}
)
"""


def _network(at: str = "") -> str:
    of = f'{{{_NODE}, device!="lo"}}[$__rate_interval]{at}'
    return f"""
sum {_HOST} (
    rate(node_network_receive_bytes_total{of})
  +
    rate(node_network_transmit_bytes_total{of})
)
"""


def _worst(over_time: str, at_end: str) -> str:
    """The highest at the end of the range, so that the lines stay the same over all of it."""
    return f"{over_time}\nand on (fleet, robot, instance)\n  topk({_SHOWN}, {at_end})"


ANSWERS = f"max {_HOST} (up{{{_NODE}}})"
BUSY = _busy()
MEMORY = _memory()
DISK = _disk()
TEMPERATURE = _temperature()
RUNS_FOR = f"time() - max {_HOST} (node_boot_time_seconds{{{_NODE}}})"
CLOCK = f"max {_HOST} (node_timex_sync_status{{{_NODE}}})"

_END = " @ end()"
BUSY_OVER_TIME = _worst(_busy(), _busy(_END))
MEMORY_OVER_TIME = _worst(_memory(), _memory(_END))
DISK_OVER_TIME = _worst(_disk(), _disk(_END))
TEMPERATURE_OVER_TIME = _worst(_temperature(), _temperature(_END))
NETWORK_OVER_TIME = _worst(_network(), _network(_END))

_PING = 'job=~"ros-diagnostics-(ping|uplink)", fleet=~"$fleet"'
_PINGED = "by (fleet, robot, uplink)"
PING_OVER_TIME = f"""
  max {_PINGED} (probe_duration_seconds{{{_PING}}})
and on (fleet, robot, uplink)
  topk({_SHOWN}, max {_PINGED} (probe_duration_seconds{{{_PING}}} @ end()))
"""
