"""A subscription that is replaced loses no message, of whatever quality its publisher is."""

import pytest

from ros_diagnostics_exporter.config.fleet import Fleet, Robot, Source
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_exporter.sources import handover, reception
from support.ros_publisher import repeating
from testbed.polling import until

TOPIC = "/r/diagnostics"
REPLACED = 4  # times
PERIOD = 0.03  # seconds between two messages
GROW = 50  # messages after which they are twice as large, and their queue half as deep


@pytest.mark.parametrize("reliable", [True, False])
def test_each_message_is_received_once(ros_domain, robots, run_exporter, monkeypatch, reliable):
    monkeypatch.setattr(reception, "OVERLAP", 1.0)
    monkeypatch.setattr(handover, "LATE", 0.2)
    monkeypatch.setattr(reception, "MAX_HISTORY", 100_000)
    robot = Robot("r", ros_domain, topic_raw=TOPIC, source=Source.RAW)
    running = run_exporter(Fleet("f", (robot,)))
    domain = running.service.listener._domains[ros_domain]
    opened, sent = [], []
    open_one = domain.open
    monkeypatch.setattr(domain, "open", lambda *wanted: opened.append(1) or open_one(*wanted))
    robots.offer(TOPIC, reliable=reliable)
    robots.wait_for_listeners()

    def send(turn: int) -> None:
        sent.append(turn)
        robots.send(TOPIC, Status(0, "Motor", "x" * 100 * 2 ** (turn // GROW)))

    with repeating(send, PERIOD):
        until(lambda: len(opened) > REPLACED, "it is replaced some times", 60)
    until(
        lambda: running.sample("robot_messages_total", robot="r") >= len(sent),
        lambda: f"{running.sample('robot_messages_total', robot='r')} of {len(sent)}",
    )
    assert running.sample("robot_messages_total", robot="r") == len(sent)
