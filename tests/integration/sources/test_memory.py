"""Memory of a subscribed topic before anything arrives, of the sockets, and what is freed."""

import sys
from contextlib import closing
from pathlib import Path

from ros_diagnostics_exporter.config.fleet import Fleet, Robot
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.model import Stream, Topic
from ros_diagnostics_exporter.service import Service
from ros_diagnostics_exporter.sources.ros_environment import use_profiles
from ros_diagnostics_exporter.storage.storage import Storage
from support.called import called
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


RECEIVE = """
import ctypes, re
from pathlib import Path
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus

def kilobytes():
    ctypes.CDLL(None).malloc_trim(0)
    return int(re.search(r"RssAnon:\\s+(\\d+)", Path("/proc/self/status").read_text())[1])

rclpy.init()
node = rclpy.create_node("both")
large = DiagnosticArray(status=[DiagnosticStatus(message="m" * (3 << 20))])
names = [f"/r{n}/diagnostics" for n in range(20)]
received = set()
kept = [
    node.create_subscription(DiagnosticArray, n, lambda _, n=n: received.add(n), 10, raw=True)
    for n in names
]
before = kilobytes()
for name in names:
    publisher = node.create_publisher(DiagnosticArray, name, 1)
    while name not in received:
        publisher.publish(large)
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_publisher(publisher)
print(kilobytes() - before)
"""


JOIN = """
import os, socket
import rclpy

rclpy.init()
node = rclpy.create_node("subscriber")
sizes = [0]
for fd in os.listdir("/proc/self/fd"):
    try:
        copy = socket.socket(fileno=os.dup(int(fd)))
    except OSError:  # no socket
        continue
    sizes.append(copy.getsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF))
print(max(sizes))
"""


def kilobytes_of_topics(environment: dict[str, str]) -> int:
    return printed(environment, SUBSCRIBE, str(TOPICS))


def printed(environment: dict[str, str], *program: str) -> int:
    argv = [sys.executable, "-c", *program]
    run = called(argv, env=environment)
    assert not run.stderr
    return int(run.stdout)


def test_fast_dds_allocates_less_with_our_profiles(tmp_path):
    with domains.lease() as domain_id:
        theirs = domains.environment(domain_id)
        ours = dict(theirs)
        use_profiles(ours, tmp_path)

        assert kilobytes_of_topics(ours) < kilobytes_of_topics(theirs) / 2


def test_a_topic_keeps_nothing_of_large_messages_that_were_taken(tmp_path):
    """Of 20 topics with messages of 3 MiB; else anybody could fill the memory with topics."""
    with domains.lease() as domain_id:
        theirs = domains.environment(domain_id)
        ours = dict(theirs)
        use_profiles(ours, tmp_path)

        assert printed(theirs, RECEIVE) > 40 << 10
        assert printed(ours, RECEIVE) < 10 << 10


def test_the_socket_has_room_for_the_bursts_of_a_large_fleet(tmp_path):
    most = int(Path("/proc/sys/net/core/rmem_max").read_text())
    with domains.lease() as domain_id:
        ours = domains.environment(domain_id) | domains.BETWEEN_MACHINES
        use_profiles(ours, tmp_path)

        assert printed(ours, JOIN) == 2 * min(8 << 20, most)  # the kernel doubles what is asked for


def test_what_was_received_of_a_robot_that_is_gone_is_freed(tmp_path, ros_domain):
    fleet = Fleet("f", (Robot("r", ros_domain, topic_raw="/r/diagnostics"),))
    with closing(Storage(tmp_path / "exporter.db")) as storage:
        service = Service(fleet, tmp_path / "fleet.yml", storage)
        rings, stream = service._recordings.rings, Stream(Topic(ros_domain, "/r/diagnostics"))
        rings.receive(stream, b"\0\1\0\0", read_clocks())
        service._keep_recordings()
        assert rings.get(stream) is not None
        service.state.configure(Fleet("f", ()), read_clocks())
        service._forget_at = 0.0
        service._keep_recordings()
        assert rings.get(stream) is None
