"""Which domains are joined anew: other addresses, or all robots silent at once."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.joining import LEAST, Joining
from ros_diagnostics_exporter.model import Array, Status, Topic
from ros_diagnostics_exporter.sources.listener import Listener
from support.state_driver import StateDriver

OK = Status(0, "Motor", "OK")


def driver_of(*names: str) -> StateDriver:
    robots = (Robot(each, 7, topic_raw=f"/{each}/diagnostics", source=Source.RAW) for each in names)
    return StateDriver(fleet=Fleet("f", tuple(robots)))


class Playing:
    """A joining whose listener has joined domain 7 at 1."""

    def __init__(self, driver: StateDriver, monkeypatch: pytest.MonkeyPatch) -> None:
        self.left: list[Any] = []
        self.outdated: list[int] = []
        self.followed = 0
        self.driver = driver
        listener: Any = SimpleNamespace(
            joined_at={7: 1.0},
            domain_ids=(7,),
            joining=(),
            find_outdated=lambda: self.outdated,
            leave=self.left.extend,
            follow=self.follow,
        )
        monkeypatch.setattr("ros_diagnostics_exporter.joining.read_clocks", lambda: driver.now)
        self.joining = Joining(driver.state, listener, [listener])

    def follow(self, _fleet: Fleet) -> None:
        self.followed += 1

    def until(self, seconds: float, *received: str) -> None:
        while self.driver.now.mono < seconds:
            for each in received:
                topic = Topic(7, f"/{each}/diagnostics")
                self.driver.state.receive(topic, Array(0.0, (OK,), 100), self.driver.now)
            self.driver.at(self.driver.now.mono + 1)
            self.joining.turn()


def test_a_domain_whose_robots_all_fall_silent_is_joined_anew(monkeypatch):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    playing.until(LEAST + 10, "a", "b")
    assert (playing.left, playing.followed) == ([], 0)
    playing.until(LEAST + 20)
    assert set(playing.left) == {7}
    assert playing.followed == len(playing.left)
    assert playing.driver.state.robots["a"].silent_reason != "domain_unreachable"


@pytest.mark.parametrize(("names", "later"), [(("a", "b"), ("a",)), (("a",), ())])
def test_one_silent_robot_is_no_reason(monkeypatch, names, later):
    playing = Playing(driver_of(*names), monkeypatch)
    playing.until(LEAST + 10, *names)
    playing.until(LEAST + 60, *later)
    assert playing.left == []


def test_other_addresses_are_and_the_robots_silence_is_none_of_theirs(monkeypatch):
    playing = Playing(driver_of("a"), monkeypatch)
    playing.until(10, "a")
    playing.driver.at(20)
    playing.outdated = [7]
    playing.joining.turn()
    assert (playing.left, playing.followed) == ([7], 1)
    events = [each.message for each in playing.driver.events if each.kind == "config"]
    assert events == ["domain 7: it is joined anew: this machine has other addresses"]


def test_a_domain_is_outdated_once_the_addresses_have_settled(monkeypatch):
    now = frozenset({"10.0.0.2"})
    monkeypatch.setattr("ros_diagnostics_exporter.sources.listener.local_addresses", lambda: now)
    listener = Listener(driver_of().state)
    made: Any = SimpleNamespace(addresses=now, joined=True)
    listener._domains = {7: made}
    assert (listener.find_outdated(), listener.find_outdated()) == ([], [])
    now = frozenset({"10.0.0.3"})
    assert listener.find_outdated() == []
    assert listener.find_outdated() == [7]
    made.joined = False
    assert listener.find_outdated() == []
