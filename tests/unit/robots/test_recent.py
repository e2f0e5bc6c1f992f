from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.robots.recent import MOST, Recent

moments = st.lists(st.tuples(st.floats(0, 100), st.integers(0, 255)), max_size=60)


@given(moments, st.floats(1, 50), st.floats(0, 60))
def test_what_is_kept_is_what_happened_within_the_time(happened, within, before):
    recent = Recent(within)
    happened = sorted(happened, key=lambda each: each[0])
    for at, what in happened:
        recent.add([what], at)
    last = happened[-1][0] if happened else 0.0
    moment = last - min(before, within)

    assert recent.since(moment) == bytes(what for at, what in happened if at > moment)
    after = [at for at, _what in happened if at > moment]
    assert recent.next_after(moment) == (after[0] if after else None)
    assert [*recent] == [(at, what) for at, what in happened if at > last - within]


def test_so_many_are_kept_at_most():
    recent = Recent(1e9)
    for number in range(MOST + 3):
        recent.add([number % 256], float(number))

    assert len([*recent]) == MOST
    assert next(iter(recent)) == (3.0, 3)
