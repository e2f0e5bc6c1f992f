"""How arrays of drivers, and answers of queries, update the components of one robot.

What a query of Prometheus measures has an identity with the query's name where others have a
group's path, which begins with a slash, or nothing: so neither a robot nor a restart can take one
for the other.
"""

from __future__ import annotations

import sys
from collections.abc import Container, Mapping, Sequence
from functools import partial

from ros_diagnostics_exporter.model import Feed, Instant, Status
from ros_diagnostics_exporter.robots.component import (
    FIELDS,
    QUERY,
    Component,
    Identity,
    Said,
)
from ros_diagnostics_exporter.robots.components import Components
from ros_diagnostics_exporter.robots.rejections import Reject
from ros_diagnostics_exporter.robots.twins import (
    Suspects,
    Writers,
    are_by_id,
    has_returned,
    note,
    severity,
    worst,
)
from ros_diagnostics_exporter.sources.robot_graph import GROUP

TOPICS = "Topics"  # the group of components that are made of fields


def query_of(identity: Identity) -> str | None:
    """The name of the query that measures a component; None where the robot publishes it."""
    _name, group, _hardware_id = identity
    return group.removeprefix(QUERY) if group.startswith(QUERY) else None


def is_of_graph(identity: Identity) -> bool:
    """Whether it is the ROS graph that shows a component."""
    return query_of(identity) == GROUP


class MeasuredUpdates:
    """Applies the answers of queries: partial, so only a late component is STALE.

    ``answered`` is when each query that measures something of the robot was last answered,
    monotonic, whether or not the answer had anything of it.
    """

    def __init__(self, components: Components) -> None:
        self._components = components
        self.answered: dict[str, float] = {}

    def apply(self, feed: Feed, statuses: Sequence[Status], now: Instant) -> None:
        """Update the components from one answer; their names are unique in it."""
        self.answered[feed.name] = now.mono
        group = sys.intern(QUERY + feed.name)
        for status in statuses:
            identity = (status.name, group, "")
            component = self._components.get_or_add(identity, feed.group, now)
            if component is not None:
                self._components.regroup(component, feed.group)
                self._components.update_measured(component, feed, status, now)

    def restored(self, identity: Identity) -> None:
        """Note that an earlier process had a component of this identity."""
        query = query_of(identity)
        if query is not None:
            self.answered.setdefault(query, float("-inf"))

    def follow(self, feeds: Mapping[str, Feed]) -> list[Component]:
        """Have each component follow its feed, as the config has it; returns those of no feed."""
        for name in self.answered.keys() - feeds.keys():
            del self.answered[name]
        lost = []
        for component in self._components:
            query = query_of(component.identity)
            if query is None:
                continue
            if query == GROUP and component.feed is not None:
                continue  # it says of each report by which feed it is
            if query in feeds:
                self._components.set_feed(component, feeds[query])
            else:
                lost.append(component)
        return lost

    def last_answer(self, component: Component) -> float | None:
        """When the query that measures a component was last answered; None where none does."""
        query = query_of(component.identity)
        return None if query is None else self.answered.get(query, float("-inf"))


class FieldUpdates:
    """Applies what fleet.yml makes of fields of small topics: each renewed by its own topic."""

    def __init__(self, components: Components) -> None:
        self._components = components

    def apply(self, statuses: Sequence[Status], now: Instant) -> None:
        """Update the components of some entries."""
        for status in statuses:
            identity = (status.name, FIELDS, "")
            component = self._components.get_or_add(identity, TOPICS, now)
            if component is not None:
                self._components.update_raw(component, status, now)

    def lost(self, names: Container[str]) -> list[Component]:
        """The components of entries that the config no longer has."""
        found = [each for each in self._components if each.is_of_fields]
        return [each for each in found if each.identity[0] not in names]


class RawUpdates:
    """Applies the arrays of a robot's drivers: partial, so only a late component is STALE."""

    def __init__(self, components: Components, reject: Reject) -> None:
        self._components = components
        self._reject = reject
        self._suspects: Suspects = {}  # names that several nodes may publish
        self._writers = Writers()

    def apply(self, statuses: Sequence[Status], now: Instant, publisher: str = "") -> None:
        """Update the components from one array of a publisher; "" where that is not known."""
        if len({status.name for status in statuses}) != len(statuses):
            statuses = self._worst_of_each(statuses, now)
        components, split_names = self._components, self._components.split_names
        for status in statuses:
            name = status.name
            identity = name, "", status.hardware_id if name in split_names else ""
            component = components.by_identity.get(identity)
            if component is not None:
                last = component.last
                if last is not status and last is not None and last[3] != status[3]:
                    is_back = has_returned(component, publisher)
                    if is_back or are_by_id(self._suspects, last, status, now):
                        self._split(name, now)
                        component = components.by_identity.get(self._identity(status))
            if component is None:
                component = components.get_or_add(self._identity(status), _node_of(name), now)
            if component is not None:
                if publisher != component.publisher or component.said is not None:
                    counted = self._worst_said(component, status, publisher, now)
                    components.update_raw(component, counted, now)
                else:
                    components.update_raw(component, status, now)

    def _identity(self, status: Status) -> Identity:
        is_split = status.name in self._components.split_names
        return status.name, "", status.hardware_id if is_split else ""

    def _split(self, name: str, now: Instant) -> None:
        """Make a component of each hardware_id, of which counts what its publishers said last.

        Who publishes only on a change does not say it again.
        """
        components = self._components
        if name in components.split_names:
            return
        shared = components.by_identity.get((name, "", ""))
        said = {} if shared is None or not shared.reports else shared.said or {}
        components.split_by_hardware_id(name, now)
        of_each: dict[Identity, dict[str, Said]] = {}
        for publisher, each in said.items():
            of_each.setdefault(self._identity(each.status), {})[publisher] = each
        for identity, of_one in of_each.items():
            component = components.get_or_add(identity, _node_of(name), now)
            if component is not None:
                component.said = of_one
                components.update(component, worst(component, components, self._writers, now), now)

    def _worst_said(
        self, component: Component, status: Status, publisher: str, now: Instant
    ) -> Status:
        """What counts of what all publishers say of a component, of whom one says this now."""
        if not publisher:  # and no other is known any more
            component.publisher, component.said = "", None
            return status
        is_back = has_returned(component, publisher)
        note(component, publisher, status, now)
        counted = worst(component, self._components, self._writers, now)
        if is_back and counted is not status:  # else it may have been started again
            self._reject("duplicate_component", status.name)
        return counted

    def follow_writers(self, names: frozenset[str], now: Instant) -> None:
        """Take the publishers that the ROS graph has: what others said may count no more."""
        if names is self._writers.names:
            return  # not asked for again
        self._writers = Writers(names, now.mono)
        components = self._components
        for component in list(components) if components.receives_arrays(now) else ():
            if component.said is not None and component.reports:
                counted = worst(component, components, self._writers, now)
                components.update(component, counted, now)

    def _worst_of_each(self, statuses: Sequence[Status], now: Instant) -> list[Status]:
        """The worst status of each component, for an array that has a name more than once.

        One name with two hardware_ids are two components, from then on.
        """
        ids: dict[str, set[str]] = {}
        for status in statuses:
            if status.hardware_id:
                ids.setdefault(status.name, set()).add(status.hardware_id)
        for name, several in ids.items():
            if len(several) > 1:
                self._split(name, now)
        found: dict[Identity, Status] = {}
        for status in statuses:
            identity = self._identity(status)
            if identity in found:
                self._reject("duplicate_component", status.name)
                rank = partial(severity, component=self._components.by_identity.get(identity))
                found[identity] = max(found[identity], status, key=rank)
            else:
                found[identity] = status
        return list(found.values())


def _node_of(name: str) -> str:
    """The node that publishes a raw status: updaters write "node: task"."""
    node, colon, _task = name.partition(": ")
    return node if colon else ""
