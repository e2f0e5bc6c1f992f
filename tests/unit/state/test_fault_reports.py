"""What the state receives becomes faults: arrays, silence, time and config in, faults out."""

from __future__ import annotations

import json
import re
from dataclasses import replace

import pytest

from ros_diagnostics_exporter.config.fleet import (
    Check,
    ComponentRule,
    Discovery,
    Fleet,
    Maintenance,
    Profile,
    Robot,
    Source,
    Threshold,
    ValueRule,
)
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import Reason, Row
from ros_diagnostics_exporter.model import Array, Status
from ros_diagnostics_exporter.state.state import Endpoint, Topic
from support.state_driver import ERROR, OK, STALE, WALL, WARN, Story, tree

MOTOR, LASER = Status(OK, "Motor"), Status(OK, "Laser")
HOT, WARM = Status(ERROR, "Motor", "Hot"), Status(WARN, "Motor", "Warm")
SETTLED = 40.0  # restart_grace is over


def faults(story: Story) -> set[tuple[str, ...]]:
    """Scope, state and what it is about of each fault."""
    return {
        (each.identity.scope.value, each.identity.state.value, *filter(None, each.identity[2:]))
        for each in story.state.faults.all()
    }


def settled(*statuses: Status, **profile) -> Story:
    """A robot that is received once a second, with these statuses, until restart_grace is over."""
    story = Story(**profile)
    story.raw_every(1, SETTLED, *statuses)
    return story


def stand(story: Story, seconds: float, *statuses: Status) -> None:
    """Send these once a second for some seconds."""
    story.raw_every(1, story.now.mono + seconds, *statuses)


def reloaded(story: Story, **profile) -> None:
    (robot,) = story.state.fleet.robots
    robot = replace(robot, profile=replace(robot.profile, **profile))
    story.state.configure(replace(story.state.fleet, robots=(robot,)), story.now)


def restarted(story: Story, rows: list[Row]) -> Story:
    """Another process, from the rows and the robots that the one before wrote."""
    again = Story(fleet=story.state.fleet)
    again.now = story.now
    written = {name: robot.remember(story.now) for name, robot in story.state.robots.items()}
    again.state.restore(written, again.now)
    stored = json.loads(json.dumps(rows))
    again.state.faults.restore(
        [Row(kind, tuple(key), fields) for kind, key, fields in stored], again.now
    )
    return again


class Recorded(Story):
    """Keeps the rows of its faults as a database would."""

    def __init__(self, **profile) -> None:
        super().__init__(**profile)
        self.rows: dict[tuple, Row] = {}
        take = self.state.faults.take_rows

        def kept(now):
            taken = take(now)
            self.rows.update({(row.kind, row.key): row for row in taken})
            return taken

        self.state.faults.take_rows = kept

    def written(self) -> list[Row]:
        self.state.faults.take_rows(self.now)
        return [row for row in self.rows.values() if row.fields is not None]


# -- components ----------------------------------------------------------------------------------


def test_an_error_is_a_fault_after_confirm_after_and_ends_with_ok():
    story = settled(MOTOR)
    began = story.now.wall
    stand(story, 9, HOT)
    assert faults(story) == set()
    stand(story, 3, HOT)
    assert faults(story) == {("component", "critical", "r", "Motor")}
    (fault,) = story.state.faults.all()
    assert (fault.since, fault.confirmed) == (began, began + 10)

    story.raw(MOTOR)
    assert faults(story) == set()


def test_a_confirmed_warning_that_gets_worse_is_critical_at_once_and_goes_on():
    story = settled(MOTOR)
    stand(story, 12, WARM)
    assert faults(story) == {("component", "warning", "r", "Motor")}
    story.raw(HOT)
    assert faults(story) == {
        ("component", "warning", "r", "Motor"),
        ("component", "critical", "r", "Motor"),
    }
    story.raw(WARM)
    assert faults(story) == {("component", "warning", "r", "Motor")}


def test_a_component_that_the_aggregator_lost_is_stale():
    story = Story(Source.AGG)
    for second in range(60):
        story.at(second)
        story.agg(*tree(Parts=[MOTOR, LASER] if second < SETTLED else [LASER]))
    assert faults(story) == {("component", "stale", "r", "/Parts", "Motor")}


@pytest.mark.parametrize(("level", "critical"), [(STALE, True), (WARN, False)])
def test_config_says_when_stale_is_critical_and_what_a_level_counts_as(level, critical):
    rules = (ComponentRule(re.compile("Motor"), levels={WARN: OK}),)
    story = settled(MOTOR, stale_is_critical=True, components=rules)
    stand(story, 12, MOTOR._replace(level=level))
    states = {state for _scope, state, *_about in faults(story)}
    assert states == ({"stale", "critical"} if critical else set())


def test_a_component_has_its_own_confirm_after_and_follows_a_reload():
    rule = ComponentRule(re.compile("Motor"), confirm_after=3.0)
    story = settled(MOTOR, components=(rule,))
    stand(story, 5, HOT)
    assert faults(story) == {("component", "critical", "r", "Motor")}
    story.raw(MOTOR)
    reloaded(story, components=(replace(rule, confirm_after=60.0),))
    stand(story, 50, HOT)
    assert faults(story) == set()
    reloaded(story, components=(rule,))
    assert faults(story) == {("component", "critical", "r", "Motor")}


def test_a_component_that_the_config_ignores_has_no_fault():
    story = settled(MOTOR)
    stand(story, 12, HOT)
    reloaded(story, components=(ComponentRule(re.compile("Motor"), ignore=True),))
    assert faults(story) == set()


def test_a_component_in_another_group_takes_its_fault_along():
    story = Story(Source.AGG)
    for second in range(60):
        story.at(second)
        story.agg(*tree(Old=[HOT, LASER]))
    (before,) = story.state.faults.all()
    story.agg(*tree(New=[HOT, LASER]))
    assert faults(story) == {("component", "critical", "r", "/New", "Motor")}
    (after,) = story.state.faults.all()
    assert (after.since, after.confirmed) == (before.since, before.confirmed)


def test_two_components_that_look_alike_have_a_fault_each():
    story = settled(MOTOR)
    first, second = (HOT._replace(hardware_id=each) for each in "ab")
    for _ in range(13):
        story.raw(first, second)
        story.at(story.now.mono + 1)
    assert faults(story) == {
        ("component", "critical", "r", "Motor [a]"),
        ("component", "critical", "r", "Motor [b]"),
    }
    story.raw(first, second._replace(level=OK))
    assert faults(story) == {("component", "critical", "r", "Motor [a]")}


def test_a_component_that_changes_all_the_time_is_flapping_and_nothing_else():
    story = settled(MOTOR)
    for _ in range(12):
        stand(story, 1, HOT)
        stand(story, 1, MOTOR)
    assert faults(story) == {("flapping", "flapping", "r", "Motor")}
    stand(story, 400, MOTOR)
    assert faults(story) == set()


def test_many_components_that_fail_at_once_are_one_fault():
    parts = [Status(OK, f"Part {number}") for number in range(10)]
    story = settled(*parts)
    stand(story, 12, *(each._replace(level=ERROR) for each in parts))
    assert faults(story) == {("robot", "many", "r", "critical")}


def test_the_evidence_says_what_was_known_when_the_fault_began():
    hot = HOT._replace(message="Hot\n\u202eagain", values=(("Temperature", "91 C"),))
    story = settled(MOTOR, LASER)
    stand(story, 12, hot, LASER._replace(level=WARN))
    evidence = {each.identity.component: each.evidence for each in story.state.faults.all()}
    assert evidence == {
        "Motor": "Hot \\u202eagain; values: Temperature: 91 C; also: Laser WARN",
        "Laser": "also: Motor ERROR",
    }


def test_the_evidence_is_bounded_and_printable_whatever_a_robot_sends():
    values = tuple((f"key {number}" * 50, "\x1b" * 5_000) for number in range(100))
    loud = HOT._replace(message="\n" * 50_000, values=values)
    story = settled(MOTOR)
    stand(story, 12, loud)
    (fault,) = story.state.faults.all()
    assert len(fault.evidence) <= 512
    assert fault.evidence.isprintable()


# -- robots --------------------------------------------------------------------------------------


def test_a_silent_robot_is_one_fault_and_its_components_keep_theirs():
    story = Story(Source.AGG)
    for second in range(60):
        story.at(second)
        story.agg(*tree(Parts=[HOT if second >= SETTLED else MOTOR, LASER]))
    last = story.now.wall
    story.at(story.now.mono + 30)
    critical = ("component", "critical", "r", "/Parts", "Motor")
    assert faults(story) == {("robot", "silent", "r"), critical}
    (silent,) = (each for each in story.state.faults.all() if each.identity.state == "silent")
    assert silent.since == last
    assert silent.evidence == "publisher_gone"

    story.agg(*tree(Parts=[HOT, LASER]))
    assert faults(story) == {critical}
    story.agg(*tree(Parts=[MOTOR, LASER]))
    assert faults(story) == set()


def test_a_declared_robot_that_is_never_received_is_pending():
    story = Story()
    story.at(899)
    assert faults(story) == set()
    story.at(901)
    assert faults(story) == {("robot", "pending", "r")}
    story.raw(MOTOR)
    assert faults(story) == set()


def test_a_robot_that_publishes_and_is_never_received_is_silent_after_its_stale_after():
    story = Story(stale_after=20.0)
    story.at(SETTLED)
    story.state.graph(0, {"/r/diagnostics": Endpoint(1)}, story.now)
    story.at(SETTLED + 29)
    assert faults(story) == set()
    story.at(SETTLED + 32)
    assert faults(story) == {("robot", "silent", "r")}
    story.state.graph(0, {}, story.now)
    story.at(SETTLED + 40)
    (problem,) = (p for p in story.state.faults.problems(story.now) if p.fault is not None)
    assert problem.identity.state == "silent"  # a person, or a message, ends it


def test_a_slow_driver_is_no_stale_component_after_its_robots_return():
    story = Story()
    slow = Status(OK, "Slow")
    for second in range(120):
        story.at(second)
        story.raw(MOTOR, *([slow] if second % 30 == 0 else []))
    story.at(180)
    assert faults(story) == {("robot", "silent", "r")}
    stand(story, 60, MOTOR)
    assert faults(story) == set()
    stand(story, 60, MOTOR)
    assert faults(story) == {("component", "stale", "r", "Slow")}
    story.raw(slow)
    assert faults(story) == set()


def in_maintenance(begin: float, end: float) -> Fleet:
    robot = Robot("r", topic_raw="/r/diagnostics", source=Source.RAW)
    selector = {"robot": (re.compile("r"),)}
    window = Maintenance("night", selector, "", start=WALL + begin, end=WALL + end)
    return Fleet("f", (robot,), maintenance=(window,))


def test_nothing_begins_in_maintenance_and_what_is_still_wrong_after_it_does():
    story = Story(fleet=in_maintenance(50, 150))
    story.raw_every(1, 60, MOTOR)
    story.raw_every(1, 100, HOT)
    assert faults(story) == set()
    (problem,) = story.state.faults.problems(story.now, "r")
    assert problem.quiet is Reason.MAINTENANCE
    story.at(140)  # switched off
    assert faults(story) == set()
    story.raw_every(1, 155, HOT)
    assert faults(story) == {("component", "critical", "r", "Motor")}


def test_a_robot_that_is_found_in_maintenance_is_quiet_from_the_start():
    story = Story(fleet=in_maintenance(0, 1_000))
    story.at(950)
    assert faults(story) == set()
    story.at(1_002)
    assert faults(story) == {("robot", "pending", "r")}


def test_silence_of_a_whole_site_is_one_fault_and_names_its_robots():
    robots = tuple(
        Robot(
            f"r{number}",
            topic_raw=f"/r{number}/diagnostics",
            source=Source.RAW,
            labels={"site": "hall"},
        )
        for number in range(6)
    )
    story = Story(fleet=Fleet("f", robots))
    for second in range(int(SETTLED)):
        story.at(second)
        for robot in robots:
            topic = Topic(0, robot.topic_raw)
            story.state.receive(topic, Array(0.0, (MOTOR,), 100), story.now)
    story.at(SETTLED + 30)
    assert faults(story) == {("site", "silent", "hall")}
    (fault,) = story.state.faults.all()
    assert fault.evidence == "robots: r0, r1, r2, r3, r4 and 1 more"


# -- values and checks ---------------------------------------------------------------------------

LOW = ValueRule(key=re.compile("Volt"), thresholds=(Threshold("low", "critical", 10.0),))


def volt(number: str) -> Status:
    return MOTOR._replace(values=(("Volt", number),))


BELOW = ("value", "critical", "r", "Motor", "Volt", "low")


def test_a_value_beyond_its_threshold_is_a_fault_until_it_is_back_beyond_the_hysteresis():
    story = settled(volt("12"), values=(LOW,))
    stand(story, 9, volt("9.5"))
    assert faults(story) == set()
    stand(story, 3, volt("9.4"))
    assert faults(story) == {BELOW}
    (fault,) = story.state.faults.all()
    assert fault.evidence == "9.4, low threshold 10"
    stand(story, 3, volt("10.1"))
    assert faults(story) == {BELOW}
    stand(story, 1, volt("10.3"))
    assert faults(story) == set()


@pytest.mark.parametrize(
    "status",
    [MOTOR, volt("unknown"), volt("12")._replace(level=STALE)],
    ids=["missing", "no number", "stale"],
)
def test_a_value_that_is_no_longer_known_goes_on(status):
    story = settled(volt("12"), values=(LOW,))
    stand(story, 12, volt("9"))
    stand(story, 60, status)
    assert BELOW in faults(story)
    stand(story, 1, volt("12"))
    assert faults(story) == set()


def test_a_value_that_goes_missing_before_it_is_confirmed_does_not_begin():
    story = settled(volt("12"), values=(LOW,))
    stand(story, 5, volt("9"))
    stand(story, 60, MOTOR)
    assert faults(story) == set()


def test_a_stale_component_that_counts_as_ok_confirms_no_value():
    rule = ComponentRule(re.compile("Motor"), levels={STALE: OK})
    story = settled(volt("12"), values=(LOW,), components=(rule,))
    stand(story, 5, volt("9"))
    stand(story, 60, volt("9")._replace(level=STALE))
    assert faults(story) == set()


@pytest.mark.parametrize("last", [volt("9"), MOTOR], ids=["published", "missing"])
def test_a_fault_goes_with_its_threshold(last):
    story = settled(volt("12"), values=(LOW,))
    stand(story, 12, volt("9"))
    stand(story, 1, last)
    reloaded(story, stale_after=11.0)
    assert faults(story) == {BELOW}
    reloaded(story, values=())
    assert faults(story) == set()


def test_an_expected_component_that_is_missing_is_a_fault_of_its_check():
    motors = Check("motors", (re.compile("Motor"),), expect=2)
    story = settled(MOTOR, checks=(Check("all"), motors))
    assert faults(story) == {("check", "critical", "r", "motors")}
    (fault,) = story.state.faults.all()
    assert fault.evidence == "1 of 2 components"
    story.raw(MOTOR, Status(OK, "Motor 2"))
    assert faults(story) == set()

    story.state.forget("r", "Motor 2", story.now)
    stand(story, 12, MOTOR)
    assert faults(story) == {("check", "critical", "r", "motors")}
    reloaded(story, checks=(Check("all"),))
    assert faults(story) == set()


# -- people, config, restarts ----------------------------------------------------------------------


def test_what_a_person_takes_out_is_no_fault_any_more():
    story = settled(MOTOR, LASER)
    stand(story, 12, HOT, LASER)
    story.state.forget("r", "Motor", story.now)
    assert faults(story) == set()


def test_a_robot_that_the_config_no_longer_has_has_no_faults():
    story = settled(MOTOR)
    stand(story, 12, HOT)
    story.state.configure(Fleet("f"), story.now)
    assert faults(story) == set()
    with pytest.raises(LookupError):
        story.state.faults.problems(story.now, "r")


def test_time_forgets_no_component_with_a_problem():
    """It is missing on a robot that is there: STALE, until a person takes it out."""
    story = Story(Source.AGG, forget_after=100.0)
    for second in range(400):
        story.at(second)
        story.agg(*tree(Parts=[MOTOR, LASER] if second < SETTLED else [LASER]))
    assert faults(story) == {("component", "stale", "r", "/Parts", "Motor")}


def test_a_discovered_robot_that_lacked_a_component_when_it_left_is_kept():
    motors = Check("motors", (re.compile("Motor"),), expect=2)
    pattern = re.compile(r"/(?P<robot>[^/]+)/diagnostics")
    profile = Profile(forget_after=100.0, checks=(Check("all"), motors))
    found = Discovery(pattern, "/{robot}/diagnostics", source=Source.RAW, profile=profile)
    story = Story(fleet=Fleet("f", discoveries=(found,)))
    story.state.graph(0, {"/r/diagnostics": Endpoint(1)}, story.now)
    story.raw_every(1, SETTLED, MOTOR)
    story.state.graph(0, {}, story.now)
    story.at(500)
    assert ("check", "critical", "r", "motors") in faults(story)
    story.state.forget("r", None, story.now)
    assert faults(story) == set()


def test_a_fault_survives_a_restart_until_the_component_is_received_better():
    before = Recorded(confirm_after=10.0)
    before.raw_every(1, SETTLED, MOTOR)
    stand(before, 12, HOT)
    after = restarted(before, before.written())
    critical = {("component", "critical", "r", "Motor")}
    assert faults(after) == critical
    assert after.state.faults.all() == before.state.faults.all()
    assert not after.state.faults.settled(after.now)
    after.at(after.now.mono + 20)
    assert faults(after) == critical  # nothing received yet, within restart_grace
    stand(after, 20, HOT)
    assert faults(after) == critical
    assert after.state.faults.settled(after.now)
    after.raw(MOTOR)
    assert faults(after) == set()


def test_a_component_that_never_returns_after_a_restart_is_stale():
    before = Recorded()
    before.raw_every(1, SETTLED, MOTOR, LASER)
    after = restarted(before, before.written())
    stand(after, 60, LASER)
    assert faults(after) == set()  # its driver may be slow
    stand(after, 60, LASER)
    assert faults(after) == {("component", "stale", "r", "Motor")}


def test_a_restart_without_rows_finds_the_fault_again():
    before = Recorded()
    before.raw_every(1, SETTLED, MOTOR)
    stand(before, 12, HOT)
    after = restarted(before, [])
    assert faults(after) == set()
    stand(after, 12, HOT)
    assert faults(after) == {("component", "critical", "r", "Motor")}


def test_rows_of_a_robot_that_is_no_longer_wanted_are_dropped():
    before = Recorded()
    before.raw_every(1, SETTLED, HOT)
    before.state.fleet = Fleet("f")
    assert faults(restarted(before, before.written())) == set()


def test_rows_that_cannot_be_read_change_nothing():
    story = settled(MOTOR)
    stand(story, 12, HOT)
    with pytest.raises(LookupError):
        story.state.faults.restore([Row("problem", ("component", "critical"), {})], story.now)
    assert faults(story) == {("component", "critical", "r", "Motor")}


def test_an_array_in_which_nothing_changed_reports_nothing(monkeypatch):
    story = settled(HOT, LASER)
    reported = []
    for name in ("components_changed", "values_changed", "check_changed", "robot_back"):
        monkeypatch.setattr(Faults, name, lambda _self, *args: reported.append(args) or [])
    story.raw(HOT, LASER)
    assert reported == []
    story.raw(MOTOR, LASER)
    assert [robot for robot, *_more in reported] == ["r"]
