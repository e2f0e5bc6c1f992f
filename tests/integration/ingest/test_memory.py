"""Memory that a subscribed topic takes before anything arrives."""

from __future__ import annotations

import subprocess
import sys

from ros_diagnostics_exporter.ingest.ros import use_profiles
from testbed import domains

TOPICS = 200
SUBSCRIBE = """
import re, sys
from pathlib import Path
import rclpy
from diagnostic_msgs.msg import DiagnosticArray

def kilobytes():
    return int(re.search(r"VmRSS:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

rclpy.init()
node = rclpy.create_node("subscriber")
before = kilobytes()
kept = [
    node.create_subscription(DiagnosticArray, f"/r{n}/diagnostics", lambda _: None, 1000)
    for n in range(int(sys.argv[1]))
]
print(kilobytes() - before)
"""


def kilobytes_of_topics(environment: dict[str, str]) -> int:
    argv = [sys.executable, "-c", SUBSCRIBE, str(TOPICS)]
    run = subprocess.run(argv, env=environment, capture_output=True, text=True, check=True)
    assert not run.stderr
    return int(run.stdout)


def test_fast_dds_allocates_less_with_our_profiles(tmp_path):
    with domains.lease() as domain_id:
        theirs = domains.environment(domain_id)
        ours = dict(theirs)
        use_profiles(ours, tmp_path)

        assert kilobytes_of_topics(ours) < kilobytes_of_topics(theirs) / 2
