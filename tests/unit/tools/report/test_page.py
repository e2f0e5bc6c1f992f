import time

import pytest

from ros_diagnostics_tools.report.availability import Availability, availability
from ros_diagnostics_tools.report.page import page, percent, subject_line, summary, text

WEEK = {
    "availability": 0.98765,
    "budget_minutes": -12.6,
    "faults": 4,
    "to_acknowledge": {"number": 2, "median": 60.0, "longest": 120.0},
    "to_recover": {"number": 0, "median": None, "longest": None},
    "notifications": 9,
    "lost_seconds": 7_300.0,
    "missions": None,
}
WORK = {
    "results": {"succeeded": 15.9, "aborted": 4.1, "unknown": 2.0, "preempted": 3.0},
    "interventions": 2.0,
    "autonomous_seconds": 36_000.0,
}
EVIL = "<script>alert(1)</script>"
REPORT = {
    "fleet": "hall",
    "begin": 0.0,
    "end": 604_800.0,
    "time_zone": "UTC (UTC+0000)",
    "events_since": 3_600.0,
    "day_begins": "00:00",
    "target": 0.99,
    "week": WEEK,
    "week_before": WEEK | {"availability": None, "budget_minutes": None, "faults": 5},
    "days": [f"day {n}" for n in range(7)],
    "robots": [{"robot": EVIL, "availability": 0.5, "days": [None, 1.0, 0.99999, 0.0, 1, 1, 1]}],
    "capabilities": [
        {"robot": EVIL, "capability": "lifting", "lost_seconds": 5_400.0, "could": 0.75},
        {"robot": "", "capability": EVIL, "lost_seconds": 60.0, "could": 1.0},
    ],
    "worst_parts": [{"robot": "r", "part": EVIL, "times": 3, "seconds": 7_200.0}],
    "nights": {"1970-01-01": 2},
    "missions": [],
    "because": [],
}


def test_the_summary_has_both_weeks_and_each_time_its_count():
    assert summary(REPORT) == [
        ("Availability", "98.77 %", "-"),
        ("Budget left for 99 % (robot minutes)", "-13", "-"),
        ("Critical faults", "4", "5"),
        *[("Time to acknowledge", *["1 min, at most 2 min (of 2)"] * 2)],
        ("Time to recover", "- (of 0)", "- (of 0)"),
        ("Notifications", "9", "9"),
        ("Capabilities lost, of all robots", "2 h", "2 h"),
    ]
    assert "Critical faults: 4 (week before: 5)" in text(REPORT)


WITH_MISSIONS = REPORT | {
    "week": WEEK | {"missions": WORK},
    "missions": [{"robot": EVIL, **WORK}, {"robot": "idle", **WORK, "results": {}}],
    "because": [f"3 goals of {EVIL} were aborted this week."],
}


def test_the_numbers_of_missions_are_in_the_summary_beside_the_week_before():
    assert summary(WITH_MISSIONS)[7:] == [
        ("Missions: Success", "80 % of 20 goals; 2 of 22 goals unknown", "-"),
        ("Missions: Interventions per hour", "0.2 (2 in 10 h of autonomy)", "-"),
        ("Missions: Hours between interventions", "5", "-"),
    ]
    assert text(WITH_MISSIONS).endswith(f"\n3 goals of {EVIL} were aborted this week.\n")


def test_the_page_has_the_missions_of_each_robot_that_has_any():
    nothing = {"results": {"preempted": 1.0}, "interventions": None, "autonomous_seconds": None}
    found = WITH_MISSIONS["missions"] + [{"robot": "parked", **nothing}]
    html = page(WITH_MISSIONS | {"missions": found})

    assert "<td>80 % of 20 goals; 2 of 22 goals unknown</td>" in html
    assert "<th scope=row>idle</th><td>-</td><td>0.2 (2 in 10 h of autonomy)</td>" in html
    assert "parked" not in html
    assert html.count("&lt;script&gt;") == 6
    assert "<p>3 goals of &lt;script&gt;" in html
    assert "Missions" not in page(REPORT)


def test_a_budget_that_is_missed_by_seconds_is_0():
    missed = REPORT | {"week": WEEK | {"budget_minutes": -0.3}}
    assert ("Budget left for 99 % (robot minutes)", "0", "-") in summary(missed)


def test_the_page_has_the_summary_and_escapes_what_robots_are_named():
    html = page(REPORT)
    for _name, now, before in summary(REPORT):
        assert f"<td>{now}</td><td>{before}</td>" in html
    assert html.count("&lt;script&gt;") == 4
    assert "<script" not in html
    assert html.count("<td>2 h</td>") == 3
    assert "<td>the fleet</td>" in html
    assert "<td>1 h</td>\n<td>75.00 %</td>" in html
    assert "1970-01-08 00:00 UTC" in html
    assert "http" not in html  # it loads nothing
    assert page(REPORT | {"robots": [], "worst_parts": []}).count("<h2>") == 4


def test_a_fleet_whose_name_has_a_line_break_adds_no_header_to_the_mail():
    subject = subject_line(REPORT | {"fleet": "hall\nBcc: x@example.org"})
    assert "\n" not in subject


def test_what_is_in_utc_is_so_on_every_machine(monkeypatch):
    monkeypatch.setenv("TZ", "Asia/Tokyo")
    time.tzset()
    try:
        assert subject_line(REPORT) == "hall: robots, week until 1970-01-08 00:00 UTC"
    finally:
        monkeypatch.undo()
        time.tzset()


@pytest.mark.parametrize(
    ("share", "colour"),
    [(None, "#FFFFFF"), (1.0, "#1F7F63"), (0.9995, "#1F7F63"), (0.99, "#8FD3BD"),
     (0.95, "#FFD92F"), (0.9499, "#C1121F"), (0.0, "#C1121F")],
)  # fmt: skip
def test_an_availability_has_the_colour_of_the_best_that_it_reaches(share, colour):
    robot = {"robot": "r", "availability": share, "days": []}
    assert f'<td style="background:{colour};' in page(REPORT | {"robots": [robot]})


@pytest.mark.parametrize(
    ("share", "shown"),
    [(None, "-"), (1.0, "100 %"), (0.999999, "99.99 %"), (0.99, "99.00 %"), (0.0, "0.00 %")],
)
def test_what_is_not_100_percent_is_not_rounded_to_it(share, shown):
    assert percent(share) == shown


def test_planned_and_unknown_time_does_not_count():
    seconds = {"ok": 600.0, "warning": 200.0, "critical": 100.0, "silent": 100.0}
    uncounted = {"maintenance": 1e6, "pending": 1e6, "undetermined": 1e6}
    found = availability(seconds | uncounted)
    assert found == Availability(1_000.0, 800.0)
    assert found.share == 0.8
    assert found.budget(0.75) == pytest.approx(50.0)
    assert found.budget(0.99) == pytest.approx(-190.0)
    assert availability(uncounted).share is None
