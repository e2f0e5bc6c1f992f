"""Topics of diagnostics that no entry of fleet.yml matches: nobody monitors their robots. Pure."""

from __future__ import annotations

import logging
from collections.abc import Iterable, Iterator, Mapping
from itertools import islice
from math import inf
from typing import Any

import yaml

from ros_diagnostics_exporter.config.fleet import Fleet, Source, topics_of
from ros_diagnostics_exporter.config.robots import AGGREGATED, RAW_NAME
from ros_diagnostics_exporter.config.scalars import MAX_NAME
from ros_diagnostics_exporter.fleet.discovery import leaves_out, takes
from ros_diagnostics_exporter.model import ZENOH, Domain, Topic, Unclaimed

log = logging.getLogger(__name__)

# Entries that are listed, and topics of a domain that are looked at: anybody can make topics.
MOST, MOST_TOPICS = 100, 5_000


class Claims:
    """The topics that the entries of a config take, or leave out by name."""

    def __init__(self, fleet: Fleet) -> None:
        self._discoveries = [each for each in fleet.discoveries if each.source is not Source.NONE]
        named = [(each.domain_id, each.topic_agg or each.topic_raw) for each in fleet.robots]
        named += [(each.domain_id, each.topic) for each in fleet.shared]
        self._topics = {Topic(domain, name) for domain, topic in named for name in _both(topic)}
        if fleet.shard is not None:
            self._topics |= fleet.shard.elsewhere

    def takes(self, topic: Topic) -> bool:
        """Whether an entry takes a topic, or leaves the robot out that has it."""
        return topic in self._topics or any(
            takes(discovery, topic.name, topic.domain_id)
            or any(leaves_out(discovery, name, topic.domain_id) for name in _both(topic.name))
            for discovery in self._discoveries
        )


def beside(topic: Topic) -> list[Topic]:
    """The aggregated and the raw topic of a robot by one of them."""
    return [Topic(topic.domain_id, name) for name in _both(topic.name)]


def _both(topic: str | None) -> Iterator[str]:
    """The names of both."""
    if topic is not None:
        yield from filter(None, topics_of(topic, Source.AUTO))


def find_unclaimed(claims: Claims, topics: Iterable[Topic]) -> list[Unclaimed]:
    """What of these topics no entry takes, one for each robot, sorted."""
    by_entry: dict[tuple[str, str], list[str]] = {}
    for topic in topics:
        if not claims.takes(topic):
            by_entry.setdefault((str(topic.domain_id), _entry(topic)), []).append(topic.name)
    return sorted(
        Unclaimed(ZENOH if domain == ZENOH else int(domain), tuple(sorted(names)), entry)
        for (domain, entry), names in by_entry.items()
    )[:MOST]


def _entry(topic: Topic) -> str:
    namespace, _slash, last = topic.name.rpartition("/")
    is_zenoh = topic.domain_id == ZENOH
    root = "robot" if topic.domain_id in (0, ZENOH) else f"robot_{topic.domain_id}"
    entry: dict[str, object] = {"name": namespace.strip("/").replace("/", "_")[:MAX_NAME] or root}
    if is_zenoh:
        entry["zenoh"] = namespace.strip("/") or "/"
    else:
        entry["domain_id"] = topic.domain_id
    if last.removesuffix(AGGREGATED) != RAW_NAME:
        entry["topic"] = f"/{last}" if is_zenoh else topic.name
    elif namespace and not is_zenoh:
        entry["namespace"] = namespace
    text: str = yaml.safe_dump(entry, default_flow_style=True, sort_keys=False, width=inf)
    return text.strip()


def unclaimed_from_json(fleet: Fleet, live: Mapping[str, Any]) -> list[Unclaimed]:
    """What a file leaves of the unclaimed topics of /api/v1/fleet."""
    topics = (
        Topic(each["domain_id"], name)
        for each in live.get("unclaimed", ())
        for name in each["topics"]
    )
    return find_unclaimed(Claims(fleet), topics)


class UnclaimedWatch:
    """Keeps what is unclaimed in each domain, and logs each entry once."""

    def __init__(self, fleet: Fleet) -> None:
        self._claims = Claims(fleet)
        self._topics: dict[Domain, frozenset[Topic]] = {}  # that are no robot's
        self._found: dict[Domain, list[Unclaimed]] = {}
        self._logged: set[Unclaimed] = set()

    def configure(self, fleet: Fleet) -> None:
        """Go on by another config, at once for what is known."""
        self._claims = Claims(fleet)
        topics, self._topics, self._found = self._topics, {}, {}
        for domain in topics.keys() & set(fleet.domain_ids):
            self.update(domain, topics[domain])

    def update(self, domain: Domain, topics: Iterable[Topic]) -> None:
        """Take the topics of a domain that are no robot's; mostly they are the same as before."""
        known = frozenset(islice(topics, MOST_TOPICS))
        if known == self._topics.get(domain):
            return
        self._topics[domain] = known
        self._found[domain] = find_unclaimed(self._claims, known)
        for each in self._found[domain]:
            if each not in self._logged and len(self._logged) < MOST:
                self._logged.add(each)
                log.warning("no entry of fleet.yml matches %s", each)

    @property
    def entries(self) -> list[Unclaimed]:
        """What no entry takes, in all domains."""
        return [each for found in self._found.values() for each in found][:MOST]
