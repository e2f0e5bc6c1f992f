"""What it costs to count the goals of a fleet's actions, beside the same fleet without them.

First what the middleware takes, as later the process has had more memory: topics of goals of real
DDS that are subscribed and looked at once a second, as the exporter does, with messages and
without. Then in memory: robots whose diagnostics do not change, scraped every 15 s, with action
servers and without, in turns of the same run.
"""

from __future__ import annotations

import argparse
import gc
import os
import resource
import time
import tracemalloc
from collections.abc import Iterator
from pathlib import Path

import rclpy
from action_msgs.msg import GoalInfo, GoalStatus, GoalStatusArray
from rclpy.context import Context
from rclpy.qos import DurabilityPolicy, QoSProfile
from unique_identifier_msgs.msg import UUID

from bench.dds import BEGIN, parser_for
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.missions import ActionRule, TooMany
from ros_diagnostics_exporter.config.patterns import wildcard
from ros_diagnostics_exporter.decode.goals import (
    ACCEPTED,
    EXECUTING,
    SUCCEEDED,
    Goal,
)
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.metrics.exposition import Exposition
from ros_diagnostics_exporter.model import ALL_PARTS, Array, Instant, Status, Topic
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, STATUS
from ros_diagnostics_exporter.sources.dds_subscription import Subscriber
from ros_diagnostics_exporter.sources.dds_watch import GOALS_DEPTH, Watcher
from ros_diagnostics_exporter.sources.ros_environment import use_profiles
from support.goal_lists import encode_goals
from testbed import domains
from testbed.polling import until

WALL = 1_700_000_000.0
MINUTES = 3  # of virtual time that are measured, after one that is not
SCRAPED = 15  # seconds between two scrapes
STATUSES = tuple(Status(0, f"Component {number}", "OK") for number in range(16))


class InMemory:
    """A fleet, of which each robot has so many actions with two goals a minute."""

    def __init__(self, robots: int, actions: int) -> None:
        rule = ActionRule((wildcard("*"),), aborted=TooMany(2, 4), longer_than=900.0)
        profile = Profile(actions=(rule,))
        self.names = [f"robot_{number}" for number in range(robots)]
        self.actions = [f"action_{number}" for number in range(actions)]
        self._mono = 0.0
        found = tuple(
            Robot(each, namespace=f"/{each}", profile=profile).reading(Source.RAW)
            for each in self.names
        )
        self.state = FleetState(Fleet("bench", found), self._now())
        self.exposition = Exposition(self.state)
        self._topics = [
            f"/{robot}/{action}{STATUS}" for robot in self.names for action in self.actions
        ]
        self.state.update_nodes(0, [("nav", f"/{each}") for each in self.names], self._now())

    def _now(self) -> Instant:
        return Instant(self._mono, WALL + self._mono)

    def run(self, seconds: int) -> float:
        """CPU seconds of each second of virtual time, without making the messages."""
        begin = time.thread_time()
        making = 0.0
        for second in range(seconds):
            self._mono += 1.0
            now = self._now()
            for name in self.names:
                topic = Topic(0, f"/{name}/diagnostics")
                self.state.receive(topic, Array(now.wall, STATUSES, 900), now)
            types = dict.fromkeys(self._topics, (GOALS_TYPE,))
            self.state.watched_topics(0, types, now)
            made = time.thread_time()
            lists = [*self._lists(second)]
            making += time.thread_time() - made
            for topic_name, data in lists:
                self.state.receive_goals(0, topic_name, data, now)
            for _ in range(4):
                self.state.tick(now)
            self.state.take_fault_rows(now)
            self.state.take_events()
            if second % SCRAPED == 0:
                self.exposition.pieces(openmetrics=False, parts=ALL_PARTS)
        return (time.thread_time() - begin - making) / seconds

    def _lists(self, second: int) -> Iterator[tuple[str, bytes]]:
        """What is published in a second: of each server two goals a minute, of three lists each.

        A server keeps a goal that ended for 10 s, so each list has one goal.
        """
        for number, topic in enumerate(self._topics):
            phase = (second + number) % 30
            status = {0: ACCEPTED, 1: EXECUTING, 20: SUCCEEDED}.get(phase)
            if status is not None:
                begin = self._mono - phase
                key = round(begin * len(self._topics) + number).to_bytes(16, "big", signed=True)
                yield topic, encode_goals([Goal(key, begin, status)])


def megabytes(robots: int, actions: int) -> float:
    """What a fleet takes in memory after two minutes."""
    gc.collect()
    tracemalloc.start()
    fleet = InMemory(robots, actions)
    fleet.run(120)
    gc.collect()
    taken = tracemalloc.get_traced_memory()[0] / 1e6
    tracemalloc.stop()
    return taken


def print_in_memory(options: argparse.Namespace) -> None:
    """The fleet with actions, and without."""
    components = f"{options.robots} robots of {len(STATUSES)} components"
    print(f"\n{components}, 2 goals a minute of each action")
    print(f"{'actions':<10}{'CPU':>8}{'MB':>8}")
    for actions in (0, options.actions) * options.turns:
        fleet = InMemory(options.robots, actions)
        fleet.run(60)
        cpu = fleet.run(60 * MINUTES)
        taken = megabytes(options.robots, actions) if options.memory else 0.0
        print(f"{actions:<10}{cpu:>8.1%}{taken:>8.1f}", flush=True)


# -- the middleware ----------------------------------------------------------------------------


class Subscribed:
    """Real topics of goals, as an exporter's watcher has them."""

    def __init__(self, domain_id: int, topics: int) -> None:
        os.environ.update(domains.environment(domain_id))
        use_profiles(os.environ, Path())  # as the exporter does, which needs a third of it so
        self._contexts = [Context(), Context()]
        nodes = []
        for number, context in enumerate(self._contexts):
            rclpy.init(context=context, domain_id=domain_id)
            name = ("servers", "exporter")[number]
            nodes.append(rclpy.create_node(name, context=context, enable_rosout=False))
        self._server, self._node = nodes
        self._subscriber = Subscriber(self._node)
        profile = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.names = [f"/robot_{number}/go{STATUS}" for number in range(topics)]
        self._publishers = [
            self._server.create_publisher(GoalStatusArray, each, profile) for each in self.names
        ]
        self._received = 0
        self._watcher = Watcher(domain_id, self)  # type: ignore[arg-type]

    # What the watcher asks of its receiver.

    def watched_topics(self, *_arguments: object) -> dict[str, str]:
        """All of them."""
        return dict.fromkeys(self.names, GOALS_TYPE)

    def record_watched(self, *_arguments: object) -> None:
        """Nothing is recorded."""

    def note_watched(self, *_arguments: object) -> None:
        """Nothing is given up."""

    def receive_goals(self, *_arguments: object) -> None:
        """Count."""
        self._received += 1

    def look(self) -> float:
        """CPU seconds of one look."""
        now, begin = Instant(time.monotonic(), time.time()), time.thread_time()
        for _ in self._watcher.look(self._subscriber, {}, now):
            pass
        return time.thread_time() - begin

    def publish(self) -> None:
        """Have every server send a list of three goals."""
        info = [GoalInfo(goal_id=UUID(uuid=[number] * 16)) for number in range(3)]
        message = GoalStatusArray(status_list=[GoalStatus(goal_info=each) for each in info])
        for publisher in self._publishers:
            publisher.publish(message)

    def receive_all(self) -> float:
        """CPU seconds of the looks that receive a message of each server."""
        self._received, spent = 0, 0.0
        self.publish()

        def look() -> bool:
            nonlocal spent
            spent += self.look()
            return self._received >= len(self.names)

        until(look, lambda: f"{self._received} messages", BEGIN, 1.0)
        return spent

    def close(self) -> None:
        """Leave the domain."""
        for node, context in zip((self._server, self._node), self._contexts, strict=True):
            node.destroy_node()
            context.try_shutdown()


def print_middleware(options: argparse.Namespace, domain_id: int) -> None:
    """What a subscribed topic of goals takes, and a message on it."""
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    subscribed = Subscribed(domain_id, options.topics)
    published = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    subscribed.look()
    subscribed.receive_all()
    after = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    idle = min(subscribed.look() for _ in range(5)) / options.topics
    busy = subscribed.receive_all() / options.topics
    print(f"{options.topics} topics of real DDS, subscribed with a depth of {GOALS_DEPTH}")
    print(f"{'a look at one without a message':<44}{1e6 * idle:>7.1f} us")
    print(f"{'a message, taken and decoded':<44}{1e6 * busy:>7.1f} us")
    of_publisher = (published - before) / options.topics
    of_ours = (after - published) / options.topics
    print(f"{'memory of one':<44}{of_ours:>7.1f} KiB")
    print(f"{'(of its publisher in this process)':<44}{of_publisher:>7.1f} KiB")
    subscribed.close()


def main() -> None:
    """Print what the middleware takes, then what it costs in memory."""
    parser = parser_for("missions", __doc__)
    parser.set_defaults(robots=1000)
    parser.add_argument("--actions", type=int, default=5, help="of each robot")
    parser.add_argument("--topics", type=int, default=1000, help="of real DDS")
    parser.add_argument("--turns", type=int, default=2)
    parser.add_argument("--no-memory", dest="memory", action="store_false")
    options = parser.parse_args()
    with domains.lease() as domain_id:
        print_middleware(options, domain_id)
    print_in_memory(options)


if __name__ == "__main__":
    main()
