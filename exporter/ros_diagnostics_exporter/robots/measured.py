"""Components that a query of Prometheus measures, beside those that the robot publishes.

Their identity has the query's name where others have a group's path, which begins with a slash, or
nothing: so neither a robot nor a restart can take one for the other.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ros_diagnostics_exporter.model import Feed, Instant, Status
from ros_diagnostics_exporter.robots.component import Component, Identity
from ros_diagnostics_exporter.robots.components import Components
from ros_diagnostics_exporter.sources.graph import GROUP

_MARK = "query:"


def query_of(identity: Identity) -> str | None:
    """The name of the query that measures a component; None where the robot publishes it."""
    _name, group, _hardware_id = identity
    return group.removeprefix(_MARK) if group.startswith(_MARK) else None


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
        for status in statuses:
            identity = (status.name, _MARK + feed.name, "")
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
