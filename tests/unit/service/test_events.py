from ros_diagnostics_exporter import events
from ros_diagnostics_exporter.events import Event, EventLog, Wanted


def level(time: float, message: str = "") -> Event:
    return Event(time, "level", "r", "/Motor", "Motor 1", "OK", "ERROR", message)


def test_the_last_events_are_in_memory(monkeypatch):
    monkeypatch.setattr(events, "MAX_EVENTS", 3)
    log = EventLog()
    for number in range(5):
        log.record(level(float(number)))
    assert [event["time"] for event in log.find(Wanted())] == [4.0, 3.0, 2.0]


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


def test_older_events_are_asked_for_where_those_in_memory_do_not_suffice():
    asked: list[Wanted] = []

    def older(wanted: Wanted) -> list[tuple[int, Event]]:
        asked.append(wanted)
        return [(number, level(float(number))) for number in (7, 6, 5)]

    log = EventLog(7, older)
    log.record(Event(8.0, "config"))
    log.record(level(9.0))
    assert [event["id"] for event in log.find(Wanted(limit=1))] == [9]
    assert asked == []
    assert [event["id"] for event in log.find(Wanted(kind="level", limit=3))] == [9, 7, 6]
    assert [event["id"] for event in log.find(Wanted(before=8))] == [7, 6, 5]
    assert [event["id"] for event in log.find(Wanted(before=3, limit=2))] == [7, 6]
    assert asked == [
        Wanted(kind="level", before=8, limit=2),
        Wanted(before=8),
        Wanted(before=3, limit=2),
    ]


def test_the_events_after_one_are_those_that_are_to_be_written(monkeypatch):
    monkeypatch.setattr(events, "MAX_EVENTS", 4)
    log = EventLog(10)
    for number in range(6):
        log.record(level(float(number)))
    assert [(number, event.time) for number, event in log.after(14)] == [(15, 4.0), (16, 5.0)]
    assert [number for number, _event in log.after(0)] == [13, 14, 15, 16]
    assert log.after(16) == []


def test_without_a_database_no_event_of_a_fault_makes_room_for_others():
    log = EventLog()
    for number in range(100):
        log.record(Event(float(number), "fault_began", "r"))
    for number in range(3 * events.MAX_EVENTS):
        log.record(Event(100.0 + number, "level", "loud"))

    found = list(log.find(Wanted(robot="r", limit=60)))
    assert [each["id"] for each in found] == list(range(100, 40, -1))
    more = log.find(Wanted(robot="r", before=41, limit=60))
    assert [each["id"] for each in more] == list(range(40, 0, -1))
    assert len(list(log.find(Wanted(limit=10**9)))) == events.MAX_EVENTS + 100
