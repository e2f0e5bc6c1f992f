"""The flap ratio is Nagios' formula, on slots that miss no change."""

from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.faults.records import SLOTS, FlapHistory, flap_ratio


def nagios(history: list[int]) -> float:
    """check_for_service_flapping of Nagios Core 4 (base/flapping.c), in percent."""
    curved_changes = 0.0
    last = history[0]
    for x in range(1, 21):
        if last != history[x]:
            curved_changes += ((x - 1) * (1.25 - 0.75)) / (21 - 2) + 0.75
        last = history[x]
    return curved_changes * 100.0 / (21 - 1)


@given(st.lists(st.integers(0, 3), min_size=SLOTS, max_size=SLOTS))
def test_the_ratio_is_nagios_percentage(history):
    assert abs(flap_ratio(bytes(history)) * 100 - nagios(history)) < 1e-9


@given(st.lists(st.tuples(st.integers(0, 3), st.integers(0, 60)), max_size=60))
def test_the_slots_are_every_change_and_the_rests_between(changes):
    """Against a plain replay: each change is a slot, each full interval of rest one more."""
    level, mono = 0, 100.0
    flaps = FlapHistory([level] * SLOTS, mono)
    slots, last = [0] * SLOTS, mono
    for new, pause in changes:
        mono += pause
        if new == level:
            continue
        flaps.change(new, mono, 15.0)
        while last + 15.0 <= mono:
            slots.append(level)
            last += 15.0
        slots.append(new)
        last, level = mono, new

    assert [*flaps.slots] == slots[-SLOTS:]
