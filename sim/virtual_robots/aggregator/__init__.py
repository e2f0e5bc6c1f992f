"""The diagnostic_aggregator of ROS 2, in Python, from the very diagnostics.yaml that it takes.

Free of ROS and of clocks: ``now`` (seconds, any origin) is an argument everywhere. What it does is
what the C++ program does, release 4.2.7 or 4.2.6, its surprises included; the recordings in
tests/data/golden hold it to that. Left out: parameters set at run time.
"""

from virtual_robots.aggregator.aggregator import VERSIONS, Aggregator, Report
from virtual_robots.aggregator.parameters import AnalyzerConfigError, Parameters, load_parameters

__all__ = [
    "VERSIONS",
    "Aggregator",
    "AnalyzerConfigError",
    "Parameters",
    "Report",
    "load_parameters",
]
