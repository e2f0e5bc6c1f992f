"""Settings are proposed only where the recording gives a reason."""

from contextlib import closing
from random import Random

import pytest

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.model import Status
from ros_diagnostics_tools.backtest.recordings import Recordings, RecordingSource
from ros_diagnostics_tools.backtest.replay import Replay, play
from ros_diagnostics_tools.backtest.suggest import Statistics, as_yaml, nice, split, suggest
from support.bags import TOPIC, every_second, fleet, write_bag


def suggestions(tmp_path, rows, **profile):
    statistics = Statistics()
    bag = write_bag(tmp_path / "bag", rows)
    with closing(Recordings([RecordingSource(bag)])) as recordings:
        replay = Replay(fleet(**profile), recordings, observe=statistics.observe)
        for _message in play(recordings, [replay]):
            pass
    return suggest(replay.result(), statistics, replay.state)


def outages(*lengths, every=400):
    """The seconds of outages of these lengths, each ``every`` seconds."""
    return [
        at for n, length in enumerate(lengths, 1) for at in range(n * every, n * every + length)
    ]


@pytest.mark.parametrize(
    ("durations", "found"),
    [
        ([], None),
        ([3, 4, 5, 6], None),  # too few
        ([3, 4, 5, 6, 7], None),  # and nothing longer
        ([3, 4, 5, 6, 7, 300], (5, 7)),
        ([1, 2, 4, 8, 16, 32, 64, 128, 256, 512], None),  # no clear step
        ([3, 4, 5, 6, 7, 3, 4, 5, 6, 7], (10, 7)),
        ([3, 4, 5, 6, 7, 3, 4, 5, 6, 7, 1000, 1200], (10, 7)),
        ([400] * 20, None),  # nothing that recovers by itself soon
    ],
)
def test_what_recovers_by_itself_is_split_from_what_does_not(durations, found):
    assert split(durations) == found


@pytest.mark.parametrize(("seconds", "round_one"), [(0.4, 1), (14.4, 15), (16, 20), (5000, 300)])
def test_a_proposal_is_a_round_duration(seconds, round_one):
    assert nice(seconds) == round_one


def test_outages_that_end_by_themselves_make_confirm_after_longer(tmp_path):
    lengths = (12, 14, 16, 18, 15, 17, 350, 360)
    rows = every_second(range(4000), {"motor": outages(*lengths), "laser": []})

    (found,) = suggestions(tmp_path, rows)

    assert (found.about, found.setting) == ("motor", "confirm_after")
    assert (found.current, found.proposed) == ("10s", "30s")
    assert found.reason == (
        "6 of 8 outages were over by themselves within 18s, the next lasted 5m50s: 6 fewer, the "
        "others 20s later"
    )


def test_what_is_proposed_can_be_put_into_fleet_yml(tmp_path):
    rows = every_second(range(4000), {"motor (left): x": outages(12, 14, 16, 18, 15, 17, 350)})
    found = suggestions(tmp_path, rows)
    path = tmp_path / "fleet.yml"
    path.write_text(f"fleet: f\nrobots: [{{name: r}}]\n{as_yaml(found)}")

    (rule,) = load(path).robots[0].profile.components

    assert rule.confirm_after == 30.0
    assert rule.pattern.search("motor (left): x")
    assert not rule.pattern.search("motor left: x")


def test_holes_in_the_radio_make_stale_after_longer(tmp_path):
    holes = {
        second for n, length in enumerate((15, 16, 14, 17, 15, 400), 1)
        for second in range(n * 500, n * 500 + length)
    }  # fmt: skip
    rows = every_second(sorted(set(range(3500)) - holes), {"motor": []})

    (found,) = [each for each in suggestions(tmp_path, rows) if each.about == "(all)"]

    assert (found.setting, found.current, found.proposed) == ("stale_after", "10s", "30s")
    assert found.reason.startswith("5 of 6 silences were over by themselves within 18s")


def test_a_stale_after_that_is_needlessly_long_becomes_shorter(tmp_path):
    rows = every_second(range(200), {"motor": []})

    (found,) = suggestions(tmp_path, rows, stale_after=60.0)

    assert (found.current, found.proposed) == ("1m", "5s")
    assert "no gap between two messages of 1 robot was longer than 1s" in found.reason


def test_a_driver_that_reports_trouble_once_is_one_that_reports_on_change(tmp_path):
    rows = every_second(range(400), {"motor": []})
    serial = Status(2, "rosserial (arm)", "lost sync", "", ())
    at, topic, statuses = rows[50]
    rows[50] = (at, topic, (*statuses, serial))

    found = suggestions(tmp_path, rows)
    (found,) = [each for each in found if each.setting == "reports"]
    assert (found.about, found.proposed) == ("rosserial (arm)", "on_change, ends_after 10m")
    assert found.reason == (
        "reported once, never OK, and nothing for the 5m49s in which its robot was received after "
        "that"
    )
    path = tmp_path / "fleet.yml"
    path.write_text(f"fleet: f\nrobots: [{{name: r}}]\n{as_yaml([found])}")
    (rule,) = load(path).robots[0].profile.components
    assert (rule.reports, rule.ends_after) == ("on_change", 600.0)
    assert rule.pattern.search("rosserial (arm)")

    rows[40] = (40.0, topic, (*statuses, serial._replace(level=0)))
    (tmp_path / "ok").mkdir()
    others = suggestions(tmp_path / "ok", rows)
    assert not [each for each in others if each.setting == "reports"]


def test_values_that_are_apart_in_trouble_make_a_threshold(tmp_path):
    random = Random(1)
    hot = set(outages(20, 20, 20, 20, 20, 20, every=100))

    def status(second):
        number = random.uniform(80, 90) if second in hot else random.uniform(30, 50)
        values = (("Temperature (C)", f"{number:.1f}"), ("Noise", f"{random.random():.3f}"))
        return Status(1 if second in hot else 0, "motor", "m", "", values)

    rows = [(float(second), TOPIC, (status(second),)) for second in range(1000)]

    (found,) = [each for each in suggestions(tmp_path, rows) if each.entry.get("thresholds")]

    assert found.about.startswith("motor: Temperature")
    assert found.setting == "thresholds high warning"
    assert 50 < float(found.proposed) < 80
    assert "6 times" in found.reason


def test_values_that_are_lower_in_trouble_make_a_low_threshold(tmp_path):
    empty = set(outages(20, 20, 20, 20, 20, 20, every=100))
    rows = [
        (
            float(second),
            TOPIC,
            (
                Status(
                    int(second in empty), "m", "", "", (("V", "20" if second in empty else "24"),)
                ),
            ),
        )
        for second in range(1000)
    ]

    (found,) = [each for each in suggestions(tmp_path, rows) if each.entry.get("thresholds")]

    assert (found.setting, found.proposed) == ("thresholds low warning", "22")


def test_nothing_is_proposed_without_a_reason(tmp_path):
    rows = every_second(range(600), {"motor": outages(5, every=100)})

    assert suggestions(tmp_path, rows) == []
