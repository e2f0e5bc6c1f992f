"""The nodes of one robot: which are expected, gone, there twice. Pure."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from math import inf

from ros_diagnostics_exporter.model import Instant, Level

# Seconds without another node that goes, until those that are gone are judged, together.
SETTLE = 5.0
LATEST = 30.0  # ... after which they are judged in any case
# Seconds after a robot's first node is seen in which others may start. A restart of the exporter
# is one, too: of what was there before nothing is known.
START = 60.0
# Seconds for which two nodes have one name until that is no restart: the middleware takes 20 to
# notice that a process was killed.
DOUBLED = 30.0
AT_ONCE = 1.5  # seconds in which the processes of a namespace say goodbye
MANY = 3  # nodes that are gone together; more are one problem
MOST = 1000  # of one robot
NODES = "nodes"
GONE = " nodes are gone: "
NODE = "node "  # before the name of one: a component, or what a second participant looks for


@dataclass(slots=True)
class _Node:
    """One node; times are monotonic.

    ``seen`` are the seconds for which exactly one was there, until ``since``; ``count`` are there
    now. ``judged``: it is a problem that it is gone, ``together`` with others.
    """

    seen: float = 0.0
    since: float | None = None
    count: int = 0
    gone: float | None = None
    doubled: float | None = None
    process: str = ""
    stopped: bool = False
    judged: bool = False
    together: bool = False

    def seen_until(self, mono: float) -> float:
        """Seconds for which it was there alone."""
        return self.seen + (0.0 if self.since is None else mono - self.since)

    def set_count(self, count: int, mono: float) -> None:
        """Take how many of its name are there."""
        if count != 1:
            self.seen, self.since = self.seen_until(mono), None
        elif self.since is None:
            self.since = mono
        if count == 0 and self.count:
            self.gone = mono
        if count:
            self.gone, self.stopped, self.judged, self.together = None, False, False, False
        if count < 2:
            self.doubled = None
        elif self.doubled is None:
            self.doubled = mono
        self.count = count


class Nodes:
    """The nodes of one robot by their names in its namespace."""

    def __init__(self) -> None:
        self._nodes: dict[str, _Node] = {}
        self._events: list[str] = []
        self._returned = 0.0  # when the first was seen after none was there
        self.expected = 0  # how many are, there or not
        self.due = inf  # when time makes a problem of what is there or not, monotonic

    @property
    def there(self) -> bool:
        """Whether any is there."""
        return any(each.count for each in self._nodes.values())

    @property
    def gone(self) -> list[str]:
        """The names of those of which it is a problem that they are gone."""
        return [name for name, each in self._nodes.items() if each.judged]

    def there_since(self, name: str) -> float:
        """Since when exactly one node of this name is there, monotonic; never: infinity."""
        since = self._nodes[name].since if name in self._nodes else None
        return inf if since is None else since

    def update(self, found: Mapping[str, int], now: Instant) -> None:
        """Take how many nodes there are of each name."""
        if found and not self.there:
            self._returned = now.mono
        for name in self._nodes.keys() - found.keys():
            self._nodes[name].set_count(0, now.mono)
        for name, count in found.items():
            if name not in self._nodes and len(self._nodes) >= MOST:
                self._drop_one()
            self._nodes.setdefault(name, _Node()).set_count(count, now.mono)

    def _drop_one(self) -> None:
        """Forget the one that is not there and was for the shortest time, or any."""
        name = min(self._nodes, key=lambda each: (self._nodes[each].count, self._nodes[each].seen))
        del self._nodes[name]

    def note_processes(self, processes: Iterable[tuple[str, str]]) -> None:
        """Take by which process nodes are run."""
        for name, process in processes:
            if name in self._nodes:
                self._nodes[name].process = process

    # -- judged ------------------------------------------------------------------------------

    def judge(
        self, learn_after: float, expected: frozenset[str], now: Instant
    ) -> dict[str, tuple[int, str]]:
        """(level, text) of each problem, by component; to be asked while any node is there."""
        for name in expected - self._nodes.keys():
            self._nodes[name] = _Node(gone=now.mono)
        self.due = inf
        own = {
            name: each
            for name, each in self._nodes.items()
            if name in expected or each.seen_until(now.mono) >= learn_after
        }
        self.expected = len(own)
        self._judge_gone(own, now)
        problems = {}
        for name, each in own.items():
            if each.judged and not each.together:
                problems[f"{NODE}{name}"] = int(Level.ERROR), "the node is gone"
            elif each.doubled is not None and now.mono - each.doubled >= DOUBLED:
                text = f"{each.count} nodes have this name"
                problems[f"{NODE}{name}"] = int(Level.ERROR), text
            elif each.doubled is not None:
                self.due = min(self.due, each.doubled + DOUBLED)
        gone = sorted(name for name, each in own.items() if each.together)
        if gone:
            text = f"{len(gone)} of {len(own)}{GONE}{', '.join(gone)}"
            problems[NODES] = int(Level.ERROR), text
        return problems

    def _judge_gone(self, own: Mapping[str, _Node], now: Instant) -> None:
        """Judge those that are gone, once no more go."""
        gone = {
            name: each
            for name, each in own.items()
            if each.gone is not None and not (each.judged or each.stopped)
        }
        times = [each.gone for each in gone.values() if each.gone is not None]
        if not times:
            return
        settled = min(max(times) + SETTLE, min(times) + LATEST)
        due = max(self._returned + START, settled)
        if now.mono < due:
            self.due = due
            return
        self._find_planned(own, gone)
        gone = {name: each for name, each in gone.items() if not each.stopped}
        for each in gone.values():
            each.judged, each.together = True, len(gone) > MANY

    def _find_planned(self, own: Mapping[str, _Node], gone: Mapping[str, _Node]) -> None:
        """Find whole namespaces that left at once: processes that are killed go one by one."""
        for namespace in sorted({name.rpartition("/")[0] for name in gone} - {""}, key=len):
            within = {name: each for name, each in own.items() if name.startswith(f"{namespace}/")}
            if _left_at_once([each for each in within.values() if not each.stopped]):
                for each in within.values():
                    each.stopped = True
                self._events.append(f"all {len(within)} nodes in {namespace} were stopped")

    # -- by a person -----------------------------------------------------------------------------

    def drop(self, is_dropped: Callable[[str], bool], expected: Collection[str]) -> set[str]:
        """Know no more the nodes that do not count; the components that are about them."""
        dropped = {
            name
            for name, each in self._nodes.items()
            if is_dropped(name) or not (each.seen or each.count or name in expected)
        }
        were_together = any(self._nodes[name].together for name in dropped)
        for name in dropped:
            del self._nodes[name]
        is_left = any(each.together for each in self._nodes.values())
        names = {f"{kind} {name}" for kind in ("node", "log", "lifecycle") for name in dropped}
        return names | ({NODES} if were_together and not is_left else set())

    def accept(self, learn_after: float) -> None:
        """Expect those that are there, and no others."""
        self._nodes = {name: each for name, each in self._nodes.items() if each.count}
        for each in self._nodes.values():
            each.seen = max(each.seen, learn_after) if each.count == 1 else 0.0
        self.expected = sum(each.count == 1 for each in self._nodes.values())

    def forget(self, component: str) -> None:
        """Expect no more what a component is about."""
        for name, each in list(self._nodes.items()):
            if component == f"{NODE}{name}" or (component == NODES and each.together):
                del self._nodes[name]

    def adopt(self, component: str, text: str, learn_after: float, now: Instant) -> None:
        """Expect the nodes of a problem that another process knew."""
        kind, _blank, name = component.partition(" ")
        names = text.partition(GONE)[2].split(", ") if component == NODES else [name]
        for each in names if kind in (NODE.strip(), NODES) else ():
            if each and (each in self._nodes or len(self._nodes) < MOST):
                node = self._nodes.setdefault(each, _Node(gone=now.mono))
                node.seen = max(node.seen, learn_after)

    def take_events(self) -> list[str]:
        """What happened since the last call."""
        events, self._events = self._events, []
        return events

    # -- outliving the process ---------------------------------------------------------------

    def learned(self, now: Instant) -> dict[str, float]:
        """For how long each was there."""
        return {name: round(each.seen_until(now.mono)) for name, each in self._nodes.items()}

    def restore(self, learned: Mapping[str, float], now: Instant) -> None:
        """Go on from what an earlier process learned: none of them is there yet."""
        for name, seen in learned.items():
            self._nodes[name] = _Node(seen=seen, gone=now.mono)


def _left_at_once(nodes: Sequence[_Node]) -> bool:
    """Whether all of them did, and not because one process ended that ran them all."""
    gone = [each.gone for each in nodes if each.gone is not None]
    processes = {each.process for each in nodes} - {""}
    if len(gone) < len(nodes) or len(processes) < 2:
        return False
    return max(gone) - min(gone) < AT_ONCE
