"""What is wrong with the exporter itself: a fault for each part, ended by that part alone."""

from typing import Any

import pytest

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.model import OwnReport
from ros_diagnostics_exporter.model import Level
from support.fault_histories import Event, play, player, restart

DATABASE = "exporter/warning database"
DOMAIN = "exporter/critical domain 7"


def own(**parts: Level) -> Event:
    """All parts of the exporter, by a word of their names."""
    names = {"database": "database", "domain": "domain 7", "alertmanager": "Alertmanager"}
    found = [
        OwnReport(names[word], level, "why", 300.0 if word == "alertmanager" else 60.0)
        for word, level in parts.items()
    ]
    return lambda faults, now: faults.own(found, now)


def test_a_part_that_is_wrong_for_its_time_is_a_fault_until_it_is_right():
    play(
        (0, own(database=Level.WARN, domain=Level.OK)),
        (59, own(database=Level.WARN, domain=Level.ERROR)),
        (60, None, f"began {DATABASE}"),
        (119, None, f"began {DOMAIN}"),
        (200, own(database=Level.OK, domain=Level.ERROR), f"recovered {DATABASE}"),
        (201, own(database=Level.OK, domain=Level.OK), f"recovered {DOMAIN}"),
    )


def test_after_a_restart_a_part_that_was_wrong_waits_for_its_own_time_and_to_be_reported():
    play(
        (0, own(alertmanager=Level.WARN)),
        (100, restart()),
        (290, None),
        (310, own(alertmanager=Level.WARN), "began exporter/warning Alertmanager"),
        (320, own(alertmanager=Level.OK), "recovered exporter/warning Alertmanager"),
        robots=(),
    )


def test_what_is_not_known_begins_and_ends_nothing():
    play(
        (0, own(database=Level.STALE)),
        (100, own(database=Level.WARN)),
        (160, None, f"began {DATABASE}"),
        (170, own(database=Level.STALE)),
        (900, own(database=Level.OK), f"recovered {DATABASE}"),
    )


def test_a_part_that_there_is_no_more_is_removed_also_after_a_restart():
    play(
        (0, own(domain=Level.ERROR)),
        (60, None, f"began {DOMAIN}"),
        (70, own(database=Level.OK), f"removed {DOMAIN}"),
    )


def adopt(fault: Any) -> Event:
    return lambda faults, now: faults.adopt(fault, now)


@pytest.mark.parametrize("starts", [True, False])
def test_an_exporter_goes_on_with_its_own_fault_and_not_with_that_of_the_other_of_a_pair(starts):
    known = player([], FaultSettings())
    known.go(0, own(database=Level.WARN))
    [began] = known.go(60)
    lost = player([], FaultSettings())
    if starts:
        lost.go(90, restart())
    found = lost.go(91, adopt(began.fault))
    assert [each.fault for each in found] == ([began.fault] if starts else [])
    ended = lost.go(92, own(database=Level.OK))
    assert [each.what for each in ended] == (["recovered"] if starts else [])
