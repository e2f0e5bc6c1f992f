"""What all sources of messages share: an error in a piece of a turn is counted, and it goes on."""

from __future__ import annotations

from unittest.mock import Mock

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
