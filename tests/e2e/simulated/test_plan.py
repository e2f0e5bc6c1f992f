"""What the played history is made of: programs read it, and mails have the template's subjects."""

from __future__ import annotations

import yaml

from e2e.simulated import plan
from ros_diagnostics_exporter.config.load import load
from simulation.hours import mails
from simulation.story import ERROR, OK, Event, Story
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.scenario import load_scenario, schedule_events

STORY = Story(
    1,
    4,
    120,
    (
        Event(10, "level", "r001", ("part 3", ERROR)),
        Event(12, "mute", "r002", ("part 1", True)),
        Event(15, "charge", "r000", (5.0,)),
        Event(20, "off", "r003", (True,)),
        Event(60, "level", "r001", ("part 3", OK)),
        Event(61, "maintenance", "site 2", (40,)),
        Event(62, "declared", "r002", (False,)),
    ),
    period=1,
)


def test_the_virtual_robots_and_the_exporter_read_it(tmp_path):
    (tmp_path / "simulated.yaml").write_text(yaml.safe_dump(plan.KIND))
    (tmp_path / "simulated.analyzers.yaml").write_text(yaml.safe_dump(plan.ANALYZERS))
    path = tmp_path / "hours.yaml"
    path.write_text(plan.scenario(STORY, "./simulated.yaml"))
    scenario = load_scenario(path)
    robots = Fleet(scenario.specs, seed=1)
    schedule_events(scenario, robots)
    fleet = tmp_path / "fleet.yml"
    done = [(event, 1_790_000_000.4) for event in STORY.events if event.what in plan.ACTS]
    fleet.write_text(plan.fleet_config(STORY, 7, done))

    config = load(fleet)

    assert list(robots.robots) == ["r000", "r001", "r002", "r003"]
    assert [each.name for each in config.robots] == ["r000", "r001", "r003"]
    assert [each.start for each in config.maintenance] == [1_790_000_000.0]


def test_the_ledger_has_the_subjects_of_mails():
    found = plan.subjects(mails(STORY))

    assert found["** PROBLEM ** f/r001 part 3 is CRITICAL"] == 1
    assert found["** RECOVERY ** f/r001 part 3 is no longer CRITICAL"] == 1
    assert found["** PROBLEM ** f/r000 part 0 charge is CRITICAL: too low"] == 1
    assert found["** PROBLEM ** f/r003 is SILENT"] == 1
    assert not [each for each in found if "WARNING" in each]  # inhibited
