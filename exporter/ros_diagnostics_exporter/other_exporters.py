"""What the exporters that share a fleet count of its robots: each judges larger faults by the sum.

Each serves what its own robots count, and asks Prometheus for what the others serve.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.faults.model import Count, Counts, Scope
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.http_client import Client
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.sources.prometheus import QueryError, ask
from ros_diagnostics_exporter.texts import escape

FAMILY = "ros_diagnostics_shard_robots"
# Of a pair of exporters of one shard, the one counts whose word does (pairs.yml).
EXPR = """\
max by (exporter, scope, site, component, state) (
    {family}{{fleet="{fleet}", shards="{shards}", exporter!="{own}"}}
  unless on (fleet, scope, site, instance)
    exporter_site:ros_diagnostics_site:follows{{scope="site"}}
  unless on (fleet, scope, instance)
    exporter_site:ros_diagnostics_site:follows{{scope="common"}}
)"""

Labels = tuple[str, str, str, str, str]  # shards, scope, site, component, state


class OtherExporters:
    """The other shards of the fleet of a state, and what they count, by their names.

    What one has said counts until it says something else: that it is away is no end of anything.
    ``error`` is why Prometheus did not answer last, "" if it did.
    """

    INTERVAL = 2.0  # seconds, as Prometheus scrapes faults

    def __init__(
        self, state: FleetState, shard: Shard, client: Client | None, clocks: Callable[[], Instant]
    ) -> None:
        self._state = state
        self._shard = shard
        self._client = client
        self._clocks = clocks
        self._said: dict[str, Counts] = {}
        self.error = ""

    def turn(self) -> None:
        """Ask once, and pass on what is known."""
        fleet = self._state.fleet
        names = {"fleet": escape(fleet.name), "own": escape(fleet.exporter)}
        expr = EXPR.format(family=FAMILY, shards=self._shard.count, **names)
        try:
            rows = ask(self._client, expr)
        except QueryError as error:
            self.error = str(error)
            return
        self.error = ""
        found: dict[str, dict[tuple[Scope, str], Count]] = {}
        for labels, number in rows:
            of_one = found.setdefault(labels.get("exporter", ""), {})
            scope = Scope(labels["scope"])
            key = scope, labels.get("site" if scope is Scope.SITE else "component", "")
            of_one[key] = of_one.get(key, Count())._replace(**{labels["state"]: int(number)})
        self._said |= found
        known = [self._said[name] for name in self._names() if name in self._said]
        share = (len(known) + 1) / self._shard.count
        self._state.judge(lambda of: of.take_others(_sum(known), share, self._clocks()))

    def _names(self) -> dict[str, Shard]:
        """The others by the names that they have now."""
        fleet, own = self._state.fleet, self._shard
        shards = (Shard(number, own.count, fleet.together) for number in range(1, own.count + 1))
        return {each.name: each for each in shards if each.number != own.number}

    @property
    def missing(self) -> list[Shard]:
        """Those that have said nothing yet."""
        return [shard for name, shard in self._names().items() if name not in self._said]

    @property
    def is_first(self) -> bool:
        """Whether this one is to say which are missing: the first of those that are not."""
        others = self._names()
        there = others.keys() & self._said.keys()
        return all(self._shard.number < others[name].number for name in there)

    def samples(self, now: Instant) -> Iterator[tuple[Labels, float]]:
        """What this exporter serves for the others: nothing while it does not know yet."""
        if not self._state.settled(now):
            return
        for (scope, name), count in self._state.judge(lambda of: of.engine.counts()).items():
            of = (name, "") if scope is Scope.SITE else ("", name)
            for state, number in count._asdict().items():
                yield (str(self._shard.count), scope.value, *of, state), float(number)


def _sum(known: list[Counts]) -> dict[tuple[Scope, str], Count]:
    """What all of them count together."""
    found: dict[tuple[Scope, str], Count] = {}
    for counts in known:
        for key, count in counts.items():
            found[key] = Count(*map(sum, zip(found.get(key, Count()), count, strict=True)))
    return found
