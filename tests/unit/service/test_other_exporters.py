"""What exporters that share a fleet learn of one another, by way of Prometheus."""

from typing import Any
from urllib.parse import parse_qs, urlsplit

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.config.shard import Shard
from ros_diagnostics_exporter.faults.model import Count, Counts, Scope
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.http_client import UnreachableError
from ros_diagnostics_exporter.model import Instant
from ros_diagnostics_exporter.other_exporters import OtherExporters

NOW = Instant(0.0, 1_700_000_000.0)
HALL = (Scope.SITE, "hall")


class Answers:
    """A Prometheus that answers with these rows, or not at all."""

    url = "http://p:9090"

    def __init__(self) -> None:
        self.rows: list[tuple[dict[str, str], int]] | None = []
        self.asked = ""

    def get(self, path: str, **_limit: Any) -> Any:
        self.asked = parse_qs(urlsplit(path).query)["query"][0]
        if self.rows is None:
            raise UnreachableError("refused")
        result = [{"metric": labels, "value": [0, str(number)]} for labels, number in self.rows]
        return {"data": {"resultType": "vector", "result": result}}

    def say(self, exporter: str, **numbers: int) -> None:
        """Let an exporter have said how many robots of the hall there are in which state."""
        labels = {"exporter": exporter, "scope": "site", "site": "hall"}
        self.rows = [(labels | {"state": state}, number) for state, number in numbers.items()]


class Taken:
    """What the state of the second of three exporters was given."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, name: str = "f") -> None:
        state = FleetState(Fleet(name).part(Shard(2, 3)), NOW)
        self.prometheus = Answers()
        client: Any = self.prometheus
        self.others = OtherExporters(state, Shard(2, 3), client, lambda: NOW)
        self.counts: Counts = {}
        self.known = 0.0
        monkeypatch.setattr(state._faults, "take_others", self._take)

    def _take(self, counts: Counts, known: float, _now: Instant) -> None:
        self.counts, self.known = counts, known


@pytest.fixture
def taken(monkeypatch: pytest.MonkeyPatch) -> Taken:
    return Taken(monkeypatch)


def test_what_the_others_count_is_added(taken):
    taken.prometheus.say("shard-1", present=5, counted=3, fresh=2)
    taken.others.turn()
    assert taken.counts == {HALL: Count(5, 3, 2)}
    assert taken.known == pytest.approx(2 / 3)
    taken.prometheus.say("shard-3", present=4)
    taken.others.turn()
    assert taken.counts == {HALL: Count(9, 3, 2)}  # the first has said nothing else since
    assert taken.known == 1.0
    assert (taken.others.missing, taken.others.error) == ([], "")


def test_an_exporter_of_another_name_does_not_count(taken):
    taken.prometheus.say("shard-4", present=5)
    taken.others.turn()
    assert (taken.counts, taken.known) == ({}, pytest.approx(1 / 3))
    assert [str(each) for each in taken.others.missing] == ["1/3", "3/3"]


def test_without_an_answer_what_was_known_goes_on(taken):
    taken.prometheus.say("shard-1", present=5)
    taken.others.turn()
    taken.prometheus.rows = None
    taken.others.turn()
    assert taken.others.error == "no answer of http://p:9090: refused"
    assert taken.counts == {HALL: Count(5)}
    taken.prometheus.rows = []
    taken.others.turn()
    assert (taken.others.error, taken.counts) == ("", {HALL: Count(5)})


def test_the_first_of_those_that_are_heard_says_which_are_missing(taken):
    assert taken.others.is_first
    taken.prometheus.say("shard-3", present=5)
    taken.others.turn()
    assert taken.others.is_first
    taken.prometheus.say("shard-1", present=5)
    taken.others.turn()
    assert not taken.others.is_first


def test_the_name_of_a_fleet_is_quoted_in_the_question(monkeypatch):
    taken = Taken(monkeypatch, 'a"b')
    taken.others.turn()
    assert r'{fleet="a\"b", shards="3", exporter!="shard-2"}' in taken.prometheus.asked
