"""What another configuration would change, in words."""

from ros_diagnostics_exporter.config.fleet import ComponentRule
from ros_diagnostics_exporter.regex import Pattern
from ros_diagnostics_tools.backtest.compare import compare, in_words
from support.bags import every_second, fleet, judged, write_bag

OUTAGES = {"motor": [*range(40, 55), *range(100, 115), *range(200, 400)]}


def words_of(tmp_path, first, second, *, confirm_after=30.0, outages=OUTAGES, seconds=500):
    bag = write_bag(tmp_path / "bag", every_second(range(seconds), outages))
    results = judged(first, bag), judged(second, bag)
    return in_words(compare(*results, lambda _identity: confirm_after))


def test_a_longer_confirm_after_has_fewer_notifications_and_misses_none(tmp_path):
    words = words_of(tmp_path, fleet(), fleet(confirm_after=30.0))

    assert words[:3] == [
        "profile default: confirm_after 30s instead of 10s",
        "notifications: 1 instead of 3, 2 fewer",
        "1 fault later by 20s",
    ]
    assert words[3] == "2 faults no longer notified, recovered by themselves:"
    assert words[4].endswith("  r motor: critical")
    assert words[-1] == "none missed"


def test_the_other_way_round_it_has_more_and_earlier_ones(tmp_path):
    words = words_of(tmp_path, fleet(confirm_after=30.0), fleet(), confirm_after=10.0)

    assert words[1:4] == [
        "notifications: 3 instead of 1, 2 more",
        "1 fault earlier by 20s",
        "2 faults only with the other configuration:",
    ]


def test_a_fault_that_lasts_and_is_ignored_is_missed(tmp_path):
    ignoring = fleet(components=(ComponentRule(Pattern("motor"), ignore=True),))

    words = words_of(tmp_path, fleet(), ignoring, outages={"motor": range(100, 500), "laser": []})

    assert "profile default: other rules of components" in words
    assert "1 fault MISSED: lasted longer than their confirm_after:" in words
    assert "none missed" not in words


def test_of_a_fault_at_the_end_it_is_not_known_whether_it_is_missed(tmp_path):
    patient = fleet(confirm_after=60.0)

    words = words_of(
        tmp_path, fleet(), patient, confirm_after=60.0, outages={"motor": range(470, 500)}
    )

    assert "1 fault not known: the recording ends before their confirm_after:" in words
    assert not any("MISSED" in line or line == "none missed" for line in words)


def test_the_same_configuration_changes_nothing(tmp_path):
    assert words_of(tmp_path, fleet(), fleet()) == [
        "the configurations differ in nothing that judges faults",
        "notifications: 3 instead of 3, the same number",
        "none missed",
    ]


def test_a_fault_that_flapping_covers_is_not_missed(tmp_path):
    flaps = [at for begin in range(40, 400, 30) for at in range(begin, begin + 15)]
    outages = {"motor": [*flaps, *range(400, 500)]}

    words = words_of(tmp_path, fleet(), fleet(confirm_after=30.0), outages=outages, seconds=600)

    assert any("covered by another notification" in line for line in words)
    assert words[-1] == "none missed"
