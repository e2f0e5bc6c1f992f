from __future__ import annotations

import json
from pathlib import Path

import pytest

from ros_diagnostics_exporter import events
from ros_diagnostics_exporter.events import Event, EventLog, EventLogError, Wanted


def level(time: float, message: str = "") -> Event:
    return Event(time, "level", "r", "/Motor", "Motor 1", "OK", "ERROR", message)


def lines(path):
    return [json.loads(line) for line in path.read_text("utf-8").splitlines()]


def test_each_event_is_one_line_of_json_on_disk(tmp_path):
    log = EventLog(tmp_path / "events.jsonl")
    log.record(level(1.5, "two\nlines, Übermotor \ud800\x9b"))
    log.record(Event(2.0, "robot", "r", after="silent"))
    log.close()
    written = (tmp_path / "events.jsonl").read_text("utf-8")
    assert "Übermotor" in written
    assert "\x9b" not in written  # a terminal would take it for the begin of a command
    first, second = lines(tmp_path / "events.jsonl")
    assert first == {
        "time": 1.5,
        "kind": "level",
        "robot": "r",
        "group": "/Motor",
        "component": "Motor 1",
        "before": "OK",
        "after": "ERROR",
        "message": "two\nlines, Übermotor ?\x9b",
    }
    assert second == {"time": 2.0, "kind": "robot", "robot": "r", "after": "silent"}


def test_a_restart_appends(tmp_path):
    for time in (1.0, 2.0):
        log = EventLog(tmp_path / "events.jsonl")
        log.record(level(time))
        log.close()
    assert [line["time"] for line in lines(tmp_path / "events.jsonl")] == [1.0, 2.0]


def test_the_log_is_rotated_by_size_and_old_files_go(tmp_path):
    log = EventLog(tmp_path / "events.jsonl", max_bytes=1_000, backups=2)
    for number in range(100):
        log.record(level(float(number)))
    log.close()
    files = sorted(tmp_path.iterdir())
    assert [each.name for each in files] == ["events.jsonl", "events.jsonl.1", "events.jsonl.2"]
    assert all(each.stat().st_size <= 1_000 for each in files)
    assert lines(tmp_path / "events.jsonl")[-1]["time"] == 99.0


def test_off_by_default_nothing_is_written_and_the_last_events_are_remembered(monkeypatch):
    monkeypatch.setattr(events, "MAX_EVENTS", 3)
    log = EventLog()
    for number in range(5):
        log.record(level(float(number)))
    assert [event["time"] for event in log.find(Wanted())] == [4.0, 3.0, 2.0]
    log.close()


def test_each_event_has_an_id_from_which_older_ones_are_found(monkeypatch):
    monkeypatch.setattr(events, "MAX_EVENTS", 4)
    log = EventLog()
    for number in range(6):
        log.record(level(float(number)))
    assert [event["id"] for event in log.find(Wanted(limit=2))] == [6, 5]
    assert [event["id"] for event in log.find(Wanted(before=5))] == [4, 3]
    assert list(log.find(Wanted(before=3))) == []


def test_long_messages_take_a_bounded_part_of_the_memory(monkeypatch):
    monkeypatch.setattr(events, "BYTES", 100_000)
    log = EventLog()
    for number in range(100):
        log.record(level(float(number), "x" * 1_000_000))
    found = list(log.find(Wanted()))
    assert found[0]["time"] == 99.0
    assert 10 < len(found) < 25
    assert {len(event["message"]) for event in found} == {events.MESSAGE + 1}


def test_a_file_that_cannot_be_opened_is_an_error_at_the_start(tmp_path):
    with pytest.raises(EventLogError, match="no-such-folder"):
        EventLog(tmp_path / "no-such-folder" / "events.jsonl")


def test_a_full_disk_is_told_once_and_events_go_on(caplog):
    log = EventLog(Path("/dev/full"))
    for number in range(3):
        log.record(level(float(number)))
    log.close()
    assert caplog.text.count("cannot be written") == 1
    assert len(list(log.find(Wanted()))) == 3
