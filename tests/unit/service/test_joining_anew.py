"""Which domains are joined anew: other addresses, all robots silent, or deaf to one of them."""

import errno
from itertools import pairwise
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import pytest

from ros_diagnostics_exporter import comparing
from ros_diagnostics_exporter.comparing import CONFIRM, LONGEST, REST
from ros_diagnostics_exporter.config.fleet import Fleet, Profile, Robot, Source
from ros_diagnostics_exporter.config.graph import Graph
from ros_diagnostics_exporter.joining import LEAST, Joining
from ros_diagnostics_exporter.model import Array, Status, Topic
from ros_diagnostics_exporter.sources.listener import Listener
from support.state_driver import StateDriver
from testbed.polling import until

OK = Status(0, "Motor", "OK")


def driver_of(*names: str) -> StateDriver:
    robots = (Robot(each, 7, topic_raw=f"/{each}/diagnostics", source=Source.RAW) for each in names)
    return StateDriver(fleet=Fleet("f", tuple(robots)))


class Playing:
    """A joining whose listener has joined domain 7 at 1.

    A second participant receives ``heard`` within a second. ``seconds`` has when one began.
    """

    def __init__(self, driver: StateDriver, monkeypatch: pytest.MonkeyPatch) -> None:
        self.left: list[Any] = []
        self.heard: set[str] = set()
        self.received: set[str] = set()  # by this process, but nothing that makes a robot up
        self.seconds: list[float] = []
        self.outdated: list[int] = []
        self.joins = 0
        self.driver = driver
        listener: Any = SimpleNamespace(
            joined_at=(joined_at := {7: 1.0}),
            received_since=lambda _domain, _topics, _mono: self.received,
            ros_arguments=(),
            domain_ids=(7,),
            joining=(),
            find_outdated=lambda: self.outdated,
            leave=self.left.extend,
            join=self.join,
        )
        monkeypatch.setattr("ros_diagnostics_exporter.joining.read_clocks", lambda: driver.now)
        monkeypatch.setattr(comparing, "Second", self.listen)
        self.joined_at = joined_at
        self.joining = Joining(driver.state, listener)

    def listen(self, domain: int, topics: set[str], _arguments: object) -> Any:
        assert domain == 7
        self.seconds.append(self.driver.now.mono)
        heard = set(topics) & self.heard
        return SimpleNamespace(began=self.driver.now.mono, listens=False, stop=lambda: heard)

    def join(self) -> None:
        self.joins += 1

    def until(self, seconds: float, *received: str):
        while self.driver.now.mono < seconds:
            for each in received:
                topic = Topic(7, f"/{each}/diagnostics")
                self.driver.state.receive(topic, Array(0.0, (OK,), 100), self.driver.now)
            self.driver.wait(1)
            self.joining.turn()
        return self


def test_a_domain_whose_robots_all_fall_silent_is_joined_anew(monkeypatch):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    assert (playing.until(LEAST + 10, "a", "b").left, playing.joins) == ([], 0)
    assert set(playing.until(LEAST + 20).left) == {7}
    assert playing.joins == len(playing.left)
    assert playing.driver.state.robots["a"].silent_reason != "domain_unreachable"


@pytest.mark.parametrize(("names", "later"), [(("a", "b"), ("a",)), (("a",), ())])
def test_one_silent_robot_is_no_reason(monkeypatch, names, later):
    playing = Playing(driver_of(*names), monkeypatch).until(LEAST + 10, *names)
    assert playing.until(LEAST + 60, *later).left == []


A, B = "/a/diagnostics", "/b/diagnostics"


def test_a_domain_that_is_deaf_to_one_robot_is_joined_anew_without_a_fault_of_it(monkeypatch):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    playing.until(REST + 10, "a", "b")
    playing.heard = {A}
    assert playing.until(REST + 20 + 3 + CONFIRM, "b").left == [7]
    assert playing.joins == 1
    first, again = playing.seconds
    assert again - first == CONFIRM
    events = [each.message for each in playing.driver.events if each.kind == "config"]
    why = f"a second process on this machine finds {A}, and the exporter does not"
    assert events == [f"domain 7: {why}", f"domain 7: it is joined anew: {why}"]
    playing.joined_at[7] = playing.driver.now.mono
    playing.until(REST + 60, "a", "b")
    assert not [each for each in playing.driver.events if each.kind == "fault_began"]
    assert playing.left == [7]


NODES = [("driver", "/a"), ("camera", "/a")]


@pytest.mark.parametrize("is_found", [True, False])
def test_a_domain_in_which_another_process_finds_a_node_that_is_gone_is_joined_anew(
    monkeypatch, is_found
):
    graph = Graph(mode="on", expect=("camera",))
    watched = Robot("a", 7, "/a", topic_raw=A, source=Source.RAW, profile=Profile(graph=graph))
    playing = Playing(StateDriver(fleet=Fleet("f", (watched,))), monkeypatch)
    state = playing.driver.state
    state.update_nodes(7, NODES, playing.driver.now)
    for second in range(0, 4 * int(REST), 5):
        state.update_nodes(7, NODES[:1], playing.driver.now)
        playing.heard = {"node /a/camera"} if is_found else set()
        playing.until(second + 5, "a")
    assert playing.seconds
    assert (7 in playing.left) == is_found
    said = "a second process on this machine finds node /a/camera, and the exporter does not"
    assert any(said in each.message for each in playing.driver.events) == is_found


def test_a_topic_of_which_this_process_receives_bytes_is_no_reason(monkeypatch):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    playing.heard = playing.received = {A}  # and all of it is undecodable
    assert playing.until(REST + 60, "b").seconds
    assert playing.left == []


def test_nothing_is_compared_while_no_robot_is_silent(monkeypatch):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    assert playing.until(600, "a", "b").seconds == []


def test_a_robot_that_is_off_is_compared_ever_less_often_and_another_one_soon(monkeypatch):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    playing.until(4 * LONGEST, "b")
    rests = [later - before for before, later in pairwise(playing.seconds)]
    assert rests[:3] == [120, 240, 480]
    assert rests[-2:] == [LONGEST, LONGEST]
    before = len(playing.seconds)
    assert len(playing.until(4 * LONGEST + 20).seconds) == before + 1


def test_what_is_missed_once_is_a_silence_again(monkeypatch):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    playing.until(REST + 10, "a", "b")
    playing.heard = {A}
    playing.until(REST + 22, "b")
    assert playing.driver.state.robots["a"].silent_reason == "domain_unreachable"
    assert playing.driver.state.robots["b"].network.domain_up  # its faults go on
    playing.heard = set()
    assert playing.until(REST + 60, "b").left == []
    assert playing.driver.state.robots["a"].silent_reason != "domain_unreachable"
    assert [each.robot for each in playing.driver.events if each.kind == "fault_began"] == ["a"]


def test_a_second_process_that_cannot_be_started_keeps_no_domain_from_being_joined(
    monkeypatch, caplog
):
    playing = Playing(driver_of("a", "b"), monkeypatch)

    def fail(*_arguments: object) -> None:
        raise OSError("no memory")

    monkeypatch.setattr(comparing, "Second", fail)
    playing.outdated = [7]
    assert 7 in playing.until(REST + 2, "b").left
    failed = "domain 7: the process that listens to silent robots was not started: no memory"
    assert caplog.messages.count(failed) == 1


@pytest.mark.parametrize(
    ("program", "says"), [("nothing.that.is.there", "failed (exit code 1)"), ("timeit", "")]
)
def test_a_process_that_fails_or_hangs_is_ended_and_has_received_nothing(
    monkeypatch, caplog, program, says
):
    monkeypatch.setattr(comparing, "PROGRAM", program)
    monkeypatch.setattr(comparing, "ENDED", 1.0)
    second = comparing.Second(7, ["while True: pass"], ())  # what timeit measures
    until(lambda: not second.listens, "it is over")
    assert second.stop() == set()
    assert says in caplog.text


@pytest.mark.parametrize("joined", [{}, {7: 1000.0}])
def test_what_is_compared_while_the_domain_is_left_says_nothing(monkeypatch, joined):
    playing = Playing(driver_of("a", "b"), monkeypatch)
    playing.until(REST + 10, "b")
    playing.heard = {A}
    assert len(playing.seconds) == 1
    playing.joined_at.clear()
    playing.joined_at.update(joined)
    assert playing.until(REST + 60, "b").left == []
    assert not [each for each in playing.driver.events if each.kind == "config"]


def test_other_addresses_are_and_the_robots_silence_is_none_of_theirs(monkeypatch):
    playing = Playing(driver_of("a"), monkeypatch).until(10, "a")
    playing.driver.at(20)
    playing.outdated = [7]
    playing.joining.turn()
    assert (playing.left, playing.joins) == ([7], 1)
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


def test_no_domain_is_outdated_while_no_file_may_be_opened(monkeypatch):
    listener = Listener(driver_of().state)
    made: Any = SimpleNamespace(addresses=frozenset({"10.0.0.2"}), joined=True)
    listener._domains = {7: made}

    def fail(number: int) -> None:
        monkeypatch.setattr(
            "ros_diagnostics_exporter.sources.listener.local_addresses",
            Mock(side_effect=OSError(number, "it is not read")),
        )

    fail(errno.EMFILE)
    assert (listener.find_outdated(), listener.find_outdated()) == ([], [])
    fail(errno.EACCES)
    with pytest.raises(PermissionError):
        listener.find_outdated()
