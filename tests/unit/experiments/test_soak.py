"""The scenario of a soak test is one that the virtual robots accept; its report counts."""

import csv
import json

from experiments import soak_report, soak_scenario
from virtual_robots.simulation.fleet import Fleet
from virtual_robots.simulation.scenario import load_scenario, schedule_events


def test_the_virtual_robots_accept_the_scenario(tmp_path):
    path = soak_scenario.write(tmp_path, robots=30, seconds=7200, seed=1)

    scenario = load_scenario(path)
    schedule_events(scenario, Fleet(scenario.specs, scenario.model.seed))

    assert len(scenario.specs) == 30
    assert len(scenario.model.events) > 400


def test_the_report_has_the_slope_of_what_grows(tmp_path):
    programs = ("exporter", "prometheus", "alertmanager", "robots")
    names = ("memory", "files", "threads", "cpu")
    rows = [
        {
            **{f"{program}_{name}": 50 for program in programs for name in names},
            **dict.fromkeys(("exporter_database", "exporter_wal", "lost", "rejected"), 0),
            **dict.fromkeys(("scrapes_failed", "prometheus_failed", "faults", "reloads"), 0),
            **dict.fromkeys(("scrape_longest", "mails_problem", "mails_recovery"), 3),
            "messages": 60 * n,
            "scrapes": 6 * n,
            "prometheus_scrapes": 17 * n,
            "seconds": 360 * n,
        }
        for n in range(21)
    ]
    for n, row in enumerate(rows):
        row["exporter_memory"] = 80 + 0.5 * n  # 5 MB an hour
    with (tmp_path / "soak.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]))
        writer.writeheader()
        writer.writerows(rows)
    (tmp_path / "soak.json").write_text(json.dumps({"seed": 1}))

    text = soak_report.write(tmp_path)

    memory = "| exporter, resident memory | 82.5 MB | 90.0 MB | 90.0 MB | +5.00 ± 0.00 MB |"
    assert memory in text
    assert "| exporter, threads | 50 | 50 | 50 | +0.00 ± 0.00 |" in text
    assert "1,200 messages received, 0 rejected; 0 lost" in text
    assert (tmp_path / "soak.md").read_text() == text
