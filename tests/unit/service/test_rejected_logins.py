"""Wrong passwords leave a trace: a number, a line a minute, a fault; and they are a pause."""

import logging

from ros_diagnostics_exporter.rejected_logins import ALLOWED, MANY, MINUTE, RECENT, RejectedLogins


def test_a_line_a_minute_names_the_address_with_most(caplog):
    caplog.set_level(logging.WARNING)
    rejected = RejectedLogins()
    for number in range(300):  # a second between two
        rejected.note("10.0.0.9" if number % 10 else "10.0.0.8", float(number))

    assert rejected.total == 300
    assert len(caplog.messages) == 5
    assert caplog.messages[1] == "60 logins were rejected, 54 of them of 10.0.0.9"


def test_many_in_a_minute_are_a_fault_for_ten_minutes():
    rejected = RejectedLogins()
    rejected.note("a", 0.0)
    for _ in range(MANY):
        rejected.note("a", 1.0)
    assert rejected.reason(2.0) == ""
    rejected.note("a", 2.0)
    assert rejected.reason(2.0) == f"{MANY + 1} logins were rejected, {MANY + 1} of them of a"
    assert rejected.reason(RECENT) != "" == rejected.reason(2.0 + RECENT)


def test_an_address_with_too_many_has_a_pause_and_others_have_none():
    rejected, begin = RejectedLogins(), 1_000.0
    for _ in range(ALLOWED):
        rejected.note("a", begin)
    assert not rejected.has_pause("a", begin)
    rejected.note("a", begin)
    assert rejected.has_pause("a", begin + 2 * MINUTE - 1)
    assert not rejected.has_pause("b", begin)
    assert not rejected.has_pause("a", begin + 2 * MINUTE)


def test_a_few_wrong_ones_an_hour_are_no_pause():
    rejected = RejectedLogins()
    for number in range(100):
        rejected.note("a", number * 30.0)
    assert not rejected.has_pause("a", 3_000.0)
