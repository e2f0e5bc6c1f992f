"""Loss and delay by what the middleware says of each message."""

import pytest

from ros_diagnostics_exporter.sources.link import (
    MOST_MISSING,
    MOST_OVERTAKEN,
    Link,
    LinkReading,
    joined,
)

WALL = 1_700_000_000.0


class Sender:
    """A publisher whose clock is an hour behind."""

    def __init__(self) -> None:
        self.link = Link()
        self.wall = WALL
        self.number = 0

    def send(self, count: int, lost=(), period: float = 1.0, delays=(0.01,)) -> None:
        """Send messages; of these ``lost`` by their place do not arrive."""
        for place in range(count):
            self.number += 1
            self.wall += period
            if place not in lost:
                self.arrive(self.number, self.wall, delays[place % len(delays)])

    def arrive(self, number: int, sent: float, delay: float) -> None:
        self.link.note(number, round((sent - 3600) * 1e9), round((sent + delay) * 1e9))

    @property
    def reading(self) -> LinkReading | None:
        return self.link.reading(self.wall + 0.1)


@pytest.fixture
def sender() -> Sender:
    return Sender()


def test_what_is_missing_is_counted_over_a_minute(sender):
    assert sender.reading is None
    sender.send(40, lost=range(1, 40, 4))
    assert (sender.reading.expected, sender.reading.lost) == (40, 10)
    assert sender.reading.loss == pytest.approx(0.25)
    sender.send(70)
    assert (sender.reading.lost, sender.reading.loss) == (0, 0.0)
    sender.wall += 120
    assert sender.reading is None
    sender.send(36_000, period=0.1)
    assert len(sender.link._steps) <= 7  # what is kept does not grow


def test_messages_that_all_take_as_long_have_no_jitter_not_even_the_first(sender):
    sender.send(3)
    assert (sender.reading.jitter, sender.reading.delay) == pytest.approx((0.0, 0.0), abs=1e-5)


def test_the_delay_is_above_the_least_and_needs_no_common_clock(sender):
    sender.send(60, delays=(0.01, 0.21))
    assert sender.reading.delay == pytest.approx(0.2, abs=1e-5)
    assert sender.reading.jitter == pytest.approx(0.2, rel=0.1)
    sender.send(200, delays=(0.11,))
    assert sender.reading.delay == pytest.approx(0.1, abs=1e-5)
    assert sender.reading.jitter < 0.001
    sender.send(600, delays=(0.11,))  # it has been the least for ten minutes
    assert sender.reading.delay == pytest.approx(0.0, abs=1e-5)


def test_a_restart_a_pause_and_another_publishers_numbers_are_no_loss(sender):
    sender.send(30)
    sender.number = 0
    sender.send(5)
    sender.number += 20
    sender.wall += 11
    sender.send(5)
    sender.number += MOST_MISSING + 1
    sender.send(5)
    assert (sender.reading.expected, sender.reading.lost) == (45, 0)


def test_what_was_the_least_before_a_long_pause_counts_no_more(sender):
    sender.send(600, delays=(0.01,))
    sender.wall += 9 * 60
    sender.send(30, delays=(0.11,))
    assert sender.reading.delay == pytest.approx(0.1, abs=1e-5)
    sender.wall += 86_400
    sender.send(30, delays=(0.51,))  # the robot's clock has drifted
    assert sender.reading.delay == pytest.approx(0.0, abs=1e-5)


def test_a_message_that_was_overtaken_or_came_twice_is_not_lost(sender):
    sender.send(10)
    sender.arrive(12, sender.wall + 0.2, 0.01)
    sender.arrive(12, sender.wall + 0.2, 0.2)
    assert sender.reading.lost == 1
    sender.arrive(11, sender.wall + 0.1, 0.3)
    assert (sender.reading.expected, sender.reading.lost) == (12, 0)


def test_a_clock_of_the_exporter_that_is_set_back_begins_anew(sender):
    sender.send(30)
    sender.wall -= 7200
    sender.send(30)
    assert (sender.reading.expected, sender.reading.lost) == (30, 0)


def test_the_link_of_a_robot_is_that_of_all_its_publishers():
    one, other = LinkReading(10, 5, 0.1, 0.02), LinkReading(30, 0, 0.3, 0.01)
    assert joined([one, other]) == LinkReading(40, 5, 0.3, 0.02)


def test_a_clock_is_bounded_without_a_stamp(sender):
    sender.send(60, delays=(0.01, 0.21))
    assert sender.reading.behind == pytest.approx(3600.01, abs=1e-3)
    sender.send(61, delays=(0.11,))
    assert sender.reading.behind == pytest.approx(3600.11, abs=1e-3)


def test_a_clock_that_is_set_back_is_no_delay(sender):
    sender.send(60, delays=(0.01,))
    for _ in range(70):  # from now on two hours behind
        sender.number += 1
        sender.wall += 1
        sender.arrive(sender.number, sender.wall - 3600, 3600.01)
    assert sender.reading.delay == pytest.approx(0.0, abs=1e-3)
    assert sender.reading.behind == pytest.approx(7200.01, abs=1e-3)


def test_a_robot_that_reboots_with_its_clock_behind_is_measured_anew(sender):
    sender.send(100)
    for number in range(1, MOST_OVERTAKEN + 60):
        sender.wall += 1
        sender.link.note(number, round(number * 1e9), round(sender.wall * 1e9))
    assert (sender.reading.expected, sender.reading.lost) == (60, 0)
    assert sender.reading.behind == pytest.approx(sender.wall - number)
