"""What all sources of messages share: an error in a piece of a turn is counted, and it goes on."""

from unittest.mock import Mock

from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.sources.reception import Reception
from testbed.polling import until


class Broken(Reception):
    """Has one topic, with one message, and can neither read that nor look at the graph."""

    def __init__(self) -> None:
        super().__init__(7, Mock(), Mock(), 0.0)
        self.arrived = ["a message"]
        self.want("/diagnostics", None, shared=False)

    join = leave = lambda _self: None

    def look(self):
        raise RuntimeError("a bug")

    def open(self, *_wanted):
        return (lambda: self.arrived.pop() if self.arrived else None), lambda: None

    def data(self, taken):
        raise RuntimeError(f"another bug, with {taken}")


def test_errors_inside_a_turn_are_counted_and_the_turns_go_on(caplog):
    domain = Broken()
    domain.loop.start()
    try:
        until(lambda: not domain.arrived and domain.last_turn, "a message was taken")
        counted = domain.loop.errors
        assert counted >= 2
        until(lambda: domain.loop.errors > counted, "the next look fails too")
        assert domain.joined
    finally:
        domain.wait(30)
    assert "domain 7: internal error: a bug" in caplog.text


def test_a_domain_whose_graph_cannot_be_looked_at_says_why(monkeypatch):
    monkeypatch.setattr("ros_diagnostics_exporter.sources.reception.NOT_LOOKED", 0.1)
    domain = Broken()
    assert domain.trouble == "it is not joined: it is still being joined"
    domain.arrived.clear()
    domain.loop.start()
    try:
        until(lambda: domain.trouble.endswith("more than 0 s: a bug"), "the look is late")
        domain.look = lambda: iter([domain.complete_look(read_clocks())])
        until(lambda: domain.trouble == "", "it was looked at")
    finally:
        domain.wait(30)


def test_a_domain_whose_messages_cannot_be_taken_says_why():
    domain = Broken()
    domain.look = lambda: iter([domain.complete_look(read_clocks())])
    domain.arrived = ["a message"] * 1000
    domain.loop.start()
    try:
        wanted = "its messages are not taken: another bug, with a message"
        until(lambda: domain.trouble == wanted, "messages are not taken")
    finally:
        domain.wait(30)
