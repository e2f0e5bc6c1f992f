"""Goals of a robot's actions -> its components, faults and rows; time is given."""

import pytest

from ros_diagnostics_exporter.config.load import load
from ros_diagnostics_exporter.decode.goals import ABORTED, EXECUTING, SUCCEEDED, Goal
from ros_diagnostics_exporter.model import Instant, Stream, Topic
from ros_diagnostics_exporter.robots.marks import Mark
from ros_diagnostics_exporter.sources.action_servers import GOALS_TYPE, MOST, STATUS
from ros_diagnostics_exporter.sources.graph_topics import Peer, TopicView
from support.goal_lists import encode_goals
from support.missions import DOCK, FLEET, GOTO, MODES, SPIN, Mission, drive, topic
from support.state_driver import ERROR, LASER, OK, SETTLED, StateDriver


@pytest.fixture
def mission(tmp_path):
    return Mission.of(tmp_path, FLEET)


def test_each_action_that_an_entry_names_is_a_component(mission):
    found = {each.label: each.group for each in mission.driver.robot.components}

    assert found == {"Laser 1": "", **dict.fromkeys((DOCK, GOTO, SPIN), "Actions")}
    assert (mission.level(GOTO), mission.message(GOTO)) == (OK, "OK")


def test_the_mail_of_an_aborted_goal_names_what_was_faulty_at_that_moment(mission):
    broken = LASER._replace(level=ERROR, message="no scan")
    mission.begin(DOCK)
    mission.driver.stand(20, broken)
    mission.end(DOCK, ABORTED)
    mission.driver.stand(11, broken)

    (fault,) = (each for each in mission.driver.state.faults() if each.identity.component == DOCK)
    assert "aborted 1 of the last 1 goals" in fault.evidence
    assert "also faulty: Laser 1 CRITICAL" in fault.evidence


def test_an_aborted_goal_is_recorded_with_what_was_wrong_at_that_moment(mission):
    broken = LASER._replace(level=ERROR, message="no scan")
    mission.begin(GOTO)
    mission.driver.stand(2, broken)
    mission.end(GOTO, ABORTED)
    mission.driver.stand(2, LASER)
    mission.run(GOTO, ABORTED)

    first, second = (each for each in mission.driver.events if each.kind == "goal")
    assert (first.component, first.after) == (GOTO, "aborted")
    assert first.message == "while Laser 1 was CRITICAL"
    assert first.details == {"problems": [{"about": "Laser 1", "state": "CRITICAL"}]}
    assert (second.message, second.details) == ("nothing else was wrong", None)


def test_bytes_that_are_no_list_of_goals_are_left_out(mission):
    mission.begin(GOTO)
    mission.driver.state.receive_goals(0, topic(GOTO), b"\0\1\0\0\7", mission.driver.now)

    assert mission.driver.sample("goals_running", action=GOTO) == 1


def test_a_list_of_the_same_goals_changes_nothing(mission):
    marks = mission.begin(GOTO).driver.robot.marks
    before = marks.last(Mark.GOALS)
    mission.send(GOTO)
    assert marks.last(Mark.GOALS) == before
    mission.end(GOTO, SUCCEEDED)
    assert marks.last(Mark.GOALS) > before


def test_goals_that_are_no_mission_and_all_beyond_ten_a_minute_are_only_counted(mission):
    mission.run(SPIN, ABORTED)
    for _ in range(12):
        mission.begin(GOTO)
        mission.end(GOTO, ABORTED)

    events = [each.component for each in mission.driver.events if each.kind == "goal"]
    assert events == [GOTO] * 10


def test_an_exporter_that_is_killed_ends_no_fault_and_begins_none_again(tmp_path):
    path = tmp_path / "x.db"
    mission = Mission.of(tmp_path, FLEET + "    confirm_after: 2s\n")
    mission.driver.keep(path)
    mission.run(DOCK, ABORTED)
    mission.stand(3)
    mission.driver.save()
    assert mission.faults == {DOCK}

    again = Mission(mission.driver.state.fleet, mission.driver.restart(path))
    assert again.stand(20).faults == {DOCK}
    assert again.run(DOCK, SUCCEEDED).faults == set()
    again.driver.save()

    last = Mission(mission.driver.state.fleet, again.driver.restart(path))
    assert last.stand(20).faults == set()


@pytest.mark.parametrize(
    ("name", "status", "times"), [(DOCK, ABORTED, 1), (GOTO, ABORTED, 2), (SPIN, SUCCEEDED, 3)]
)
def test_without_its_database_an_exporter_ends_no_fault_of_goals(mission, name, status, times):
    mission.run(name, status, times).stand(12)
    (fault,) = mission.driver.state.faults()

    driver = StateDriver(fleet=mission.driver.state.fleet)
    driver.now = Instant(0.0, mission.driver.now.wall)
    driver.state.adopt([fault], driver.now)
    again = Mission(driver.state.fleet, driver)
    assert again.stand(500).faults == {name}
    assert again.stand(100).faults == set()

    driver.state.adopt([fault], driver.now)  # its alert fires a little longer
    assert again.stand(20).faults == set()


def test_an_entry_that_says_when_components_are_stale_says_nothing_of_goals(tmp_path):
    rule = "    components: [{match: dock, stale_after: 5s, confirm_after: 20s}]\n"
    mission = Mission.of(tmp_path, FLEET + rule).run(DOCK, ABORTED).stand(8)
    mission.run(GOTO, SUCCEEDED).stand(8)

    assert (mission.level(DOCK), mission.faults) == (ERROR, {DOCK})


def test_what_a_person_forgets_of_an_action_is_no_fault_with_the_next_goal(mission, tmp_path):
    mission.driver.keep(tmp_path / "x.db")
    mission.run(DOCK, ABORTED).stand(12)
    mission.driver.state.forget("r", DOCK, mission.driver.now)
    assert mission.begin(DOCK).stand(45).faults == set()

    again = Mission(mission.driver.state.fleet, mission.driver.again(tmp_path / "x.db"))
    assert again.begin(DOCK).stand(45).faults == set()
    assert again.end(DOCK, ABORTED).stand(12).faults == {DOCK}


def test_after_a_restart_a_goal_whose_robot_does_not_return_is_unknown(mission, tmp_path):
    driver = mission.begin(GOTO).driver.again(tmp_path / "x.db")
    assert driver.sample("goals_total", action=GOTO, result="unknown") == 0
    driver.at(601)

    assert driver.sample("goals_total", action=GOTO, result="unknown") == 1


def test_a_server_that_leaves_the_graph_leaves_its_goal_unknown_after_a_time(mission):
    mission.begin(GOTO)
    del mission.types[topic(GOTO)]
    mission.stand(605)

    assert mission.driver.robot.missions.actions[GOTO].goals.counts.results["unknown"] == 1


def view(process: str) -> TopicView:
    return TopicView((Peer("/r/bt_navigator", process * 32),), ())


def test_another_process_that_serves_an_action_knows_nothing_of_its_goals(mission):
    counts = mission.driver.robot.missions.actions[GOTO].goals.counts
    mission.begin(GOTO)
    for process in "aab":
        mission.stand(20)
        views = {topic(GOTO): view(process)}
        mission.driver.state.update_endpoints(0, views, mission.driver.now)
        assert counts.results["unknown"] == (process == "b")


def test_a_list_since_the_last_look_may_be_of_the_process_that_serves_it_now(mission):
    counts = mission.driver.robot.missions.actions[GOTO].goals.counts
    mission.driver.state.update_endpoints(0, {topic(GOTO): view("a")}, mission.driver.now)
    mission.stand(1)
    mission.begin(GOTO)
    mission.driver.state.update_endpoints(0, {topic(GOTO): view("b")}, mission.driver.now)

    assert counts.results["unknown"] == 0


@pytest.fixture
def driven(tmp_path):
    """A robot that says in which mode it is; it begins with auto."""
    mission = Mission.of(tmp_path, FLEET + MODES)
    drive(mission, "auto")
    return mission


def interventions(mission: Mission) -> int:
    return mission.driver.robot.missions.autonomy.interventions


def test_a_robot_that_is_taken_over_before_its_goal_has_succeeded_is_an_intervention(driven):
    driven.begin(GOTO)
    drive(driven, "Mission")
    assert interventions(driven) == 0
    drive(driven, "manual")

    assert interventions(driven) == 1
    (event,) = (each for each in driven.driver.events if each.kind == "intervention")
    assert event.message == "nothing else was wrong"
    assert driven.driver.robot.missions.autonomy.read(driven.driver.now.mono) == 10.0


def test_a_robot_that_is_parked_after_its_goal_has_succeeded_is_none(driven):
    driven.begin(GOTO)
    driven.end(GOTO, SUCCEEDED)
    drive(driven, "manual")

    assert interventions(driven) == 0


def test_an_emergency_stop_is_an_intervention_where_an_entry_names_it(driven):
    drive(driven, "auto", pressed="true")

    assert interventions(driven) == 1


def test_of_a_robot_with_many_actions_those_with_an_entry_come_first(mission):
    others = [topic(f"a{number:02}") for number in range(MOST)]
    mission.types |= {each: [GOALS_TYPE] for each in others}

    found = mission.look()

    assert len(found) == MOST
    assert {topic(DOCK), topic(GOTO), topic(SPIN)} <= found


def test_an_action_that_the_graph_ignores_is_not_subscribed(tmp_path):
    mission = Mission.of(tmp_path, FLEET + "    graph: {ignore: ['follow_*']}\n")

    assert topic("follow_path") not in mission.look()


def test_goals_of_actions_with_an_entry_are_recorded_as_they_were_received(mission):
    kept = []
    state, now = mission.driver.state, mission.driver.now
    state.recorder = lambda stream, data, _now: kept.append((stream, data))
    for action in (GOTO, "follow_path"):
        state.record_watched(0, topic(action), GOALS_TYPE, b"a list", now)

    assert kept == [(Stream(Topic(0, topic(GOTO)), GOALS_TYPE, "r"), b"a list")]


def test_where_the_graph_is_not_watched_no_goal_is(tmp_path):
    mission = Mission.of(tmp_path, FLEET + "    graph: {mode: 'off'}\n")

    assert mission.look() == set()
    assert mission.driver.robot.missions is None


def test_goals_of_one_action_that_fail_on_many_robots_are_one_fault(tmp_path):
    names = [f"r{number}" for number in range(6)]
    robots = ", ".join(f"{{name: {each}, namespace: /{each}, source: raw}}" for each in names)
    path = tmp_path / "fleet.yml"
    path.write_text(
        f"fleet: f\nrobots: [{robots}]\n"
        f"profiles: {{default: {{actions: [{{match: {DOCK}, aborted: {{critical: 1}}}}]}}}}\n",
        encoding="utf-8",
    )
    driver = StateDriver(fleet=load(path))
    topics = [f"/{each}/{DOCK}{STATUS}" for each in names]

    def stand(seconds: int) -> None:
        for _ in driver.seconds(seconds):
            for name in names:
                driver.receive(f"/{name}/diagnostics", LASER)

    driver.state.update_nodes(0, [("dock", f"/{each}") for each in names], driver.now)
    driver.state.watched_topics(0, {each: [GOALS_TYPE] for each in topics}, driver.now)
    stand(int(SETTLED))
    for goals in ((), (Goal(b"0" * 16, 1.0, EXECUTING),), (Goal(b"0" * 16, 1.0, ABORTED),)):
        for each in topics:
            driver.state.receive_goals(0, each, encode_goals(goals), driver.now)
        stand(1)
    stand(30)

    assert driver.fault_names() == {("common", "critical", DOCK)}
