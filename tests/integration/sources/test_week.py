"""The families of the week are of the exporter's own event log."""

import time

from ros_diagnostics_exporter.api import week
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.events import Event

MOTOR = {
    "scope": "component",
    "state": "critical",
    "severity": "critical",
    "robot": "r",
    "group": "/Motor",
    "component": "Motor 1",
}


def test_a_fault_of_the_event_log_is_in_the_families_of_the_week(run_exporter, monkeypatch):
    running = run_exporter(Fleet("f"))
    service = running.service
    running.wait_for("week_faults", 0)
    now = time.time()
    since = now - 86_400.0
    for kind, after, more in (
        ("fault_began", 10.0, {}),
        ("notified", 15.0, {"after": "firing", "receiver": "email"}),
        ("acknowledged", 70.0, {"author": "ann"}),
        ("fault_ended", 600.0, {"reason": "recovered"}),
    ):
        service.events.record(Event(since + after, kind, since=since, **MOTOR, **more))

    service._count_week()
    assert running.sample("week_faults") == 1
    assert running.sample("week_acknowledge_seconds", quantile="0.5") == 60
    assert running.sample("week_recover_seconds", quantile="1") == 600
    assert running.sample("week_notifications") == 1
    of = {"robot": "r", "part": "/Motor/Motor 1"}
    assert running.sample("week_faulty_seconds", **of) == 600
    assert running.sample("week_faulty_times", **of) == 1
    assert sum(running.samples("week_night_notifications").values()) in {0, 1}

    monkeypatch.setattr(week, "MOST", 1)
    service._count_week()
    assert running.samples("week_faults") == {}  # not counted, rather than counted in part
