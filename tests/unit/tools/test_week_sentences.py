"""`history --week`: sentences that follow from the events, with the numbers of a recount."""

import re
from collections import Counter
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from ros_diagnostics_exporter.api.occurrences import WEEK
from ros_diagnostics_exporter.fleet_texts import span
from ros_diagnostics_tools import week_sentences
from support.web_server import downtime, fleet, problem, robot

NOW = 30 * 86_400.0
BEGIN = NOW - WEEK
HOUR = 3_600.0
Event = dict[str, Any]


def fault(
    since: float, until: float | None, component: str = "Motor 2", **more: Any
) -> list[Event]:
    """The events of a fault, which is confirmed ten seconds after ``since``."""
    labels = {"scope": "component", "state": "critical", "severity": "critical", "robot": "r"}
    of = {**labels, "group": "/Motor", "component": component, "since": since, **more}
    found = [{"id": 0, "time": since + 10, "kind": "fault_began", **of}]
    if until is not None:
        found.append({"id": 0, "time": until, "kind": "fault_ended", "reason": "recovered", **of})
    return found


def lasting(since: float, component: str = "Motor 2", **more: Any) -> dict[str, Any]:
    of = {"robot": "r", "group": "/Motor", "component": component, "since": since}
    return problem("component", "critical", **(of | {"confirmed": since + 10} | more))


def level(time: float, component: str, after: str = "WARN") -> Event:
    of = {"group": "/Power", "component": component, "before": "OK", "after": after}
    return {"id": 0, "time": time, "kind": "level", "robot": "r", **of}


def sentences(events: list[Event], since: float = BEGIN, **of_robot: Any) -> list[str]:
    numbered = [{**each, "id": number} for number, each in enumerate(events, 1)]
    return [
        each["text"]
        for each in week_sentences.sentences(numbered, robot("r", **of_robot), NOW, since)
    ]


def three(*, charger: bool = True) -> list[Event]:
    """Motor 2 fails three times, four minutes after the charger turns WARNING."""
    begins = [NOW - days * 86_400.0 for days in (5, 4, 2)]
    faults = [each for at in begins for each in fault(at, at + 600)]
    return faults + [level(at - 240, "Charger") for at in begins if charger]


def test_a_part_that_failed_three_times_after_a_charge_and_who_has_it():
    last = NOW - HOUR
    events = three() + fault(last, None) + [level(last - 270, "Charger")]
    taken = {"author": "ann", "comment": "new gears", "at": NOW - 60, "until": NOW + 4 * HOUR}

    assert sentences(events, problems=[lasting(last, acknowledged=taken)]) == [
        (
            "/Motor/Motor 2 was faulty 4 times in the last 7 days, for 10 min to 1 h each, "
            "1 h in all, and it goes on."
        ),
        (
            "Each of the 4 times it began 4 min after /Power/Charger turned WARNING, which "
            "happened 4 times."
        ),
        "The recovery before the last fault held 1 d.",
        "ann has it until 04:00 UTC: new gears.",
    ]


def test_what_also_happens_without_a_fault_or_not_each_time_is_not_mentioned():
    events = three()
    assert any("Charger" in text for text in sentences(events))
    often = [level(NOW - HOUR * number, "Charger") for number in range(1, 6)]
    assert not any("Charger" in text for text in sentences(events + often))
    assert not any("Charger" in text for text in sentences(events[:-1]))
    own = [{**each, "group": "/Motor", "component": "Motor 2"} for each in events[-3:]]
    assert not any("turned" in text for text in sentences(three(charger=False) + own))
    assert not any("Charger" in text for text in sentences(events[:4] + events[-3:]))


def test_of_two_that_precede_it_as_often_the_one_with_the_steadier_delay_is_named():
    begins = [each["since"] for each in three(charger=False) if each["kind"] == "fault_began"]
    brake = [level(at - delay, "Brake") for at, delay in zip(begins, (1, 31, 61), strict=True)]
    named = [text for text in sentences(three() + brake) if text.startswith("Each of")]
    assert [re.search("after (.*) turned", text)[1] for text in named] == ["/Power/Charger"]


@pytest.mark.parametrize(
    ("after", "words"),
    [("silent", "the robot was silent"), ("received", "the robot was back"), ("known", "")],
)
def test_that_the_robot_was_away_may_come_before_a_fault(after, words):
    faults = three(charger=False)
    begins = [each["since"] for each in faults if each["kind"] == "fault_began"]
    of = {"id": 0, "kind": "robot", "robot": "r", "after": after}
    found = sentences(faults + [{**of, "time": at - 60} for at in begins])
    named = [text for text in found if text.startswith("Each of the 3 times")]
    assert named == (
        [f"Each of the 3 times it began 1 min after {words}, which happened 3 times."]
        if words
        else []
    )


def test_a_fault_from_before_the_week_that_lasts_or_ended_in_it_counts_and_an_older_one_does_not():
    old = fault(BEGIN - 9 * HOUR, BEGIN - HOUR)
    assert sentences(old) == ["No fault in the last 7 days."]
    ended = sentences(fault(BEGIN - HOUR, BEGIN + HOUR))
    assert ended[0] == "/Motor/Motor 2 was faulty once in the last 7 days, for 2 h."
    goes_on = sentences([], problems=[lasting(BEGIN - 17 * HOUR)])
    assert goes_on == [
        "/Motor/Motor 2 was faulty once in the last 7 days, for 7 d, and it goes on."
    ]


def test_an_event_log_that_knows_less_than_a_week_says_so():
    begin = "1970-01-30 23:00:00 UTC, where the event log begins"
    assert sentences([], NOW - HOUR) == [f"No fault since {begin}."]
    texts = sentences(fault(NOW - 600, NOW - 300), NOW - HOUR)
    assert texts[0] == f"/Motor/Motor 2 was faulty once since {begin}, for 5 min."


def test_a_warning_that_turns_critical_is_one_time_and_a_recovery_is_no_notification():
    worse = fault(NOW - 600, NOW - 300, state="warning") + fault(NOW - 300, NOW - 60)
    sent = {**worse[2], "kind": "notified", "receiver": "email"}
    texts = sentences([*worse, {**sent, "after": "firing"}, {**sent, "after": "resolved"}])
    assert texts[0] == "/Motor/Motor 2 was faulty once in the last 7 days, for 9 min."
    assert texts[-1] == "1 notification was sent: email 1."


def test_a_fault_whose_end_is_not_in_the_log_and_that_does_not_last_is_left_out():
    assert sentences(fault(NOW - HOUR, None)) == ["No fault in the last 7 days."]


def test_an_acknowledgement_without_an_end_and_a_downtime_have_their_author():
    since = NOW - HOUR
    forever = {"author": "ann", "comment": "on it", "at": NOW, "until": NOW + 365 * 86_400.0}
    texts = sentences(
        fault(since, None),
        problems=[lasting(since, acknowledged=forever)],
        downtimes=[downtime("Motor 2", until=NOW + HOUR), downtime("Lidar")],
    )
    assert texts[1:] == [
        "ann has it: on it.",
        "ann planned a downtime of it until 01:00 UTC: new gears.",
    ]


def test_of_parts_that_are_well_the_one_that_failed_most_often_is_first():
    once = fault(NOW - HOUR, NOW - 60, "Motor 1")
    twice = fault(NOW - 9 * HOUR, NOW - 8 * HOUR) + fault(NOW - 7 * HOUR, NOW - 6 * HOUR)
    first = [text for text in sentences([*once, *twice]) if "was faulty" in text]
    assert [text.split(" was")[0] for text in first] == ["/Motor/Motor 2", "/Motor/Motor 1"]


def test_of_parts_that_failed_as_often_the_one_that_was_well_last_is_first():
    early, late = (fault(NOW - at, NOW - at + 60, f"Part {at}") for at in (900, 800))
    for events in ([*early, *late], [*late, *early]):
        texts = [text for text in sentences(events) if "was faulty" in text]
        assert [text.split(" was")[0] for text in texts] == ["/Motor/Part 800", "/Motor/Part 900"]


def test_what_lasts_is_first_and_the_number_of_parts_is_limited():
    many = [each for n in range(12) for each in fault(NOW - 9 * HOUR, NOW - HOUR, f"Part {n}")]
    since = NOW - 60
    texts = sentences(many + fault(since, None), problems=[lasting(since)])
    assert texts[0].startswith("/Motor/Motor 2 was faulty once")
    assert texts[-1] == "3 more parts were faulty in the last 7 days."


STEP = 10  # seconds: times are its multiples
times = st.integers(0, 300).map(lambda each: each * STEP)
faults = st.lists(
    st.tuples(st.sampled_from("abc"), times, times, st.sampled_from(("critical", "warning"))),
    max_size=8,
    unique_by=lambda each: (each[0], each[1], each[3]),
)
levels = st.lists(st.tuples(times, st.sampled_from("xy")), max_size=9, unique=True)
sent = st.lists(st.tuples(st.integers(0, 7), st.sampled_from(("email", "sms"))), max_size=6)


def runs(covered: set[int]) -> list[tuple[int, int]]:
    """The runs of consecutive seconds, counted one by one."""
    found: list[tuple[int, int]] = []
    for second in sorted(covered):
        if found and found[-1][1] == second - 1:
            found[-1] = found[-1][0], second
        else:
            found.append((second, second))
    return found


@given(faults, levels, sent)
def test_every_number_of_a_sentence_is_that_of_a_recount(made, changes, notified):
    base = int(NOW) - 4_000
    events: list[Event] = [level(base + at, name) for at, name in changes]
    covered: dict[str, set[int]] = {}
    counted: dict[str, Counter[str]] = {}
    for number, (name, begin, lasted, state) in enumerate(made):
        since, until = base + begin, base + begin + lasted
        of = fault(since, until, name, state=state)
        covered.setdefault(name, set()).update(range(since, until + 1))
        for which, receiver in notified:
            if which == number:
                begun = {**of[0], "kind": "notified", "receiver": receiver, "after": "firing"}
                events.append(begun)
                counted.setdefault(name, Counter())[receiver] += 1
        events += of
    numbered = [{**each, "id": number} for number, each in enumerate(events, 1)]

    by_part: dict[str, list[str]] = {}
    for each in week_sentences.sentences(numbered, robot("r"), NOW, BEGIN):
        by_part.setdefault(each["about"].removeprefix("/Motor/"), []).append(each["text"])

    assert by_part.keys() == (covered.keys() or {""})
    for name, seconds in covered.items():
        text = " ".join(by_part[name])
        spells = runs(seconds)
        lengths = [last - first for first, last in spells]
        number = "once" if len(spells) == 1 else f"{len(spells)} times"
        assert f"was faulty {number} in" in text
        if len(spells) > 1:
            assert f"{span(sum(lengths))} in all" in text
            held = spells[-1][0] - spells[-2][1]
            assert f"The recovery before the last fault held {span(held)}" in text or (
                f"the recovery before the last fault held {span(held)}" in text
            )
        assert f"for {span(NOW - spells[-1][1])}" in text
        assert ("sent:" in text) == (name in counted)
        for receiver, count in counted.get(name, {}).items():
            assert f"{receiver} {count}" in text
        check_preceding(text, spells, [(base + at, each) for at, each in changes])


def check_preceding(text: str, spells: list[tuple[int, int]], changes: list[tuple[int, str]]):
    found = re.search(r"Each of the (\d+) times it began (.+) after /Power/(.) .* (\w+)", text)
    expected = {
        name: (
            [max((at for at, each in changes if each == name and 1 <= first - at <= 900), default=0)
             for first, _last in spells],
            sum(each == name for _at, each in changes),
        )
        for name in "xy"
    }  # fmt: skip
    able = {
        name
        for name, (before, number) in expected.items()
        if len(spells) >= 3 and all(before) and number <= 2 * len(spells)
    }
    assert bool(found) == bool(able)
    if found:
        name = found[3]
        assert name in able
        before, number = expected[name]
        delays = [first - at for (first, _last), at in zip(spells, before, strict=True)]
        low, high = span(min(delays)), span(max(delays))
        assert found[1] == str(len(spells))
        assert found[2] == (low if low == high else f"{low} to {high}")
        assert f"which happened {'once' if number == 1 else f'{number} times'}." in text


def goal(time: float, component: str = "dock_robot", **wrong: str) -> Event:
    kind = "goal" if component else "intervention"
    problems = [{"about": about, "state": state} for about, state in wrong.items()]
    details = {"details": {"problems": problems}} if problems else {}
    of = {"robot": "r", "component": component, "after": "aborted"}
    return {"id": 0, "time": time, "kind": kind, **of, **details}


def test_aborted_goals_and_interventions_are_counted_with_what_was_wrong():
    events = [goal(NOW - 100, Laser="STALE"), goal(NOW - 90, Laser="STALE"), goal(NOW - 80)]
    events += [goal(NOW - 70, "spin", Laser="STALE"), goal(NOW - 60, ""), goal(NOW - 50, "")]
    events += [goal(BEGIN - 10, "spin")]

    assert sentences(events) == [
        "No fault in the last 7 days.",
        "3 goals of dock_robot were aborted in the last 7 days: 2 of them while Laser was STALE.",
        "There were 2 interventions in the last 7 days.",
        "One goal of spin was aborted in the last 7 days: while Laser was STALE.",
    ]


def test_the_sentences_of_one_part_are_one_line_and_all_comes_from_the_api(serve, run):
    events = [{**each, "id": number} for number, each in enumerate(three(), 1)]
    asked = []

    def find(wanted):
        asked.append((wanted.robot, wanted.kind))
        return [each for each in events[::-1] if wanted.kind in (None, each["kind"])]

    server = serve(
        fleet_snapshot=lambda: {**fleet(robot("r")), "time": NOW},
        find_events=find,
        faults=lambda: {"faults": [], "events_since": 0.0},
    )

    [line] = run("history", "r", "--week", at=server).out.splitlines()
    assert line.startswith("/Motor/Motor 2 was faulty 3 times in the last 7 days")
    assert "Each of the 3 times it began 4 min after /Power/Charger turned WARNING" in line
    assert {robot for robot, _kind in asked} == {"r"}
    assert "no robot 'q'" in run("history", "q", "--week", at=server, code=1).err
