"""Which action servers of robots are subscribed, and which came, went or were restarted. Pure.

Each publishes the list of its goals on a topic of its own, which tools hide.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import Literal, NamedTuple

from ros_diagnostics_exporter.model import Domain
from ros_diagnostics_exporter.sources.graph_topics import TopicView

GOALS_TYPE = "action_msgs/msg/GoalStatusArray"
STATUS = "/_action/status"  # after the name of an action
MOST = 20  # actions of one robot; those that an entry of fleet.yml names come first
# ... of a domain that no entry names, by the names of their robots: with Fast DDS each subscription
# takes some 34 KiB, which a large fleet has not asked for.
MOST_UNNAMED = 200


class ActionServer(NamedTuple):
    """An action server: the robot, the action's name in its namespace, whether an entry has it."""

    robot: str
    action: str
    is_named: bool


class ServerChange(NamedTuple):
    """What happened to a server; of a restart ``since`` is when the one before was seen last."""

    server: ActionServer
    what: Literal["came", "went", "restarted"]
    since: float = 0.0  # monotonic


class ActionServers:
    """The servers of all robots, by domain and topic."""

    def __init__(self) -> None:
        self._there: dict[Domain, dict[str, ActionServer]] = {}
        self._processes: dict[tuple[Domain, str], tuple[str, float]] = {}  # and when it was seen
        self._changes: list[ServerChange] = []

    def choose(self, domain: Domain, servers: dict[str, ActionServer]) -> set[str]:
        """Take the servers of a domain, by topic; those that are subscribed."""
        chosen: dict[str, ActionServer] = {}
        counts: dict[str, int] = {}
        unnamed = 0
        for topic, each in sorted(servers.items(), key=lambda each: (not each[1].is_named, each)):
            counts[each.robot] = counts.get(each.robot, 0) + 1
            if counts[each.robot] <= MOST and (each.is_named or unnamed < MOST_UNNAMED):
                chosen[topic] = each
                unnamed += not each.is_named
        before, self._there[domain] = self._there.get(domain, {}), chosen
        if chosen != before:
            self._note(domain, before, chosen)
        return set(chosen)

    def _note(
        self, domain: Domain, before: dict[str, ActionServer], now: dict[str, ActionServer]
    ) -> None:
        for topic in before.keys() - now.keys():
            self._processes.pop((domain, topic), None)
            self._changes.append(ServerChange(before[topic], "went"))
        for topic in now.keys() - before.keys():
            self._changes.append(ServerChange(now[topic], "came"))

    def find(self, domain: Domain, topic: str) -> ActionServer | None:
        """The server of a subscribed topic."""
        return self._there.get(domain, {}).get(topic)

    def see_topics(
        self, domain: Domain, views: Iterable[tuple[str, TopicView]], mono: float
    ) -> None:
        """Take who publishes some topics: another process than before is a restart."""
        for topic, view in views:
            server = self.find(domain, topic)
            processes = {each.process for each in view.publishers}
            if server is None or len(processes) != 1:
                continue
            [process] = processes
            known, at = self._processes.get((domain, topic), (process, mono))
            self._processes[domain, topic] = process, mono
            if known != process:
                self._changes.append(ServerChange(server, "restarted", at))

    def take_changes(self) -> list[ServerChange]:
        """What happened since the last call."""
        changes, self._changes = self._changes, []
        return changes
