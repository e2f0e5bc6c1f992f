"""The diagnostic_aggregator of ROS 2 in Python, configured by the same diagnostics.yaml.

No ROS and no clock: ``now`` (seconds, any origin) is an argument. Classes have upstream's names. It
behaves as the C++ program, release 4.2.7 or 4.2.6, as recordings in tests/data/golden show, except
that parameters cannot be set at run time.
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
