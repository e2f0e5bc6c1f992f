"""What ended a fault is kept for whoever holds it; what was restored is served once confirmed."""

import pytest

from ros_diagnostics_exporter.config.fleet import CauseSettings, FaultSettings
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import Fault, Identity, PartName, Scope, State
from ros_diagnostics_exporter.faults.needs import AtLeast, WantedCapability
from support.fault_histories import (
    ERROR,
    OK,
    WALL,
    Player,
    back,
    forget,
    level,
    on_robots,
    play,
    player,
    restart,
    robot_settings,
    texts,
    words,
)

MOTOR = Identity(Scope.COMPONENT, State.CRITICAL, robot="r1", component="motor")
SILENT = Identity(Scope.ROBOT, State.SILENT, robot="r1")
SITE = Identity(Scope.SITE, State.SILENT, site="hall")
LIFTING = WantedCapability("lifting at hall", AtLeast(1, (PartName(check="lifting", robot="r1"),)))


def ends(faults: Faults) -> list[tuple[str, str, float]]:
    return [
        (words(end.fault.identity) if end.fault else end.robot, end.reason, end.at - WALL)
        for end in faults.ends()
    ]


def served(faults: Faults) -> list[str]:
    return [words(fault.identity) for fault in faults.served()]


def started_again(last: Player, second: float) -> None:
    last.reborn(second)
    assert texts(last.faults.started(last.at(second), 0.0)) == []


def broken_and_repaired() -> Player:
    return play(
        (20, level("motor", ERROR)),
        (30, None, "began component/critical r1 motor"),
        (60, level("motor", OK), "recovered component/critical r1 motor"),
    )


def test_the_end_of_a_fault_is_kept_for_an_hour_after_it_was_served_and_over_restarts():
    last = broken_and_repaired()
    known = [("component/critical r1 motor", "recovered", 60.0)]
    assert ends(last.faults) == known
    last.go(50_000)
    assert ends(last.faults) == known  # nobody has asked

    last.reborn(50_000)
    last.faults.forget("no such", last.at(50_000))
    known.append(("no such", "removed", 50_000.0))
    last.faults.note_served(last.at(50_000))
    last.go(53_000, level("arm", ERROR))
    last.go(53_010)
    last.go(53_020, level("arm", OK))
    not_served = ("component/critical r1 arm", "recovered", 53_020.0)
    last.go(53_599)
    assert ends(last.faults) == [known[0], not_served, known[1]]
    last.go(53_600)
    assert ends(last.faults) == [not_served]
    last.reborn(53_600)
    assert ends(last.faults) == [not_served]


def test_what_begins_again_has_not_ended():
    last = broken_and_repaired()
    last.go(100, level("motor", ERROR))
    assert len(ends(last.faults)) == 1
    last.go(110)
    assert ends(last.faults) == []


def test_what_a_person_takes_out_is_removed():
    last = play(
        (20, level("motor", ERROR)),
        (30, None, "began component/critical r1 motor"),
        (60, forget(), "removed component/critical r1 motor"),
    )
    last.faults.forget("no such", last.at(61))
    assert ends(last.faults) == [
        ("component/critical r1 motor", "removed", 60.0),
        ("no such", "removed", 61.0),
    ]


def test_an_end_is_never_before_the_begin_however_the_clock_was_set():
    last = player(["r1"], FaultSettings())
    last.go(20, level("motor", ERROR))
    last.go(30)
    early = last.at(40)._replace(wall=WALL - 200_000)
    level("motor", OK)(last.faults, early)
    assert ends(last.faults) == [("component/critical r1 motor", "recovered", 20.0)]


def test_the_number_that_is_kept_is_limited(monkeypatch):
    monkeypatch.setattr("ros_diagnostics_exporter.faults.ends.MOST", 2)
    last = player(["r1"], FaultSettings())
    for number in range(3):
        last.go(20 + number, level(f"m{number}", ERROR))
        last.go(40 + number)
        last.go(60 + number, level(f"m{number}", OK))
        last.faults.forget(f"x{number}", last.at(70))
    names = [name for name, *_ in ends(last.faults)]
    assert names == ["component/critical r1 m1", "component/critical r1 m2", "x1", "x2"]


def test_a_fault_of_an_earlier_process_is_served_once_the_first_message_confirms_it():
    last = player(["r1", "r2"], FaultSettings())
    last.go(20, level("motor", ERROR), level("motor", ERROR, "r2"))
    last.go(30)
    started_again(last, 40)
    assert len(list(last.faults.faults())) == 2  # the API shows them
    assert served(last.faults) == []

    last.go(50, back("r1", level("motor", ERROR)))
    assert served(last.faults) == ["component/critical r1 motor"]
    last.go(69)
    assert served(last.faults) == ["component/critical r1 motor"]
    last.go(70)  # restart_grace: r2's silence confirms that nothing is better
    assert len(served(last.faults)) == 3  # and it is silent
    assert next(iter(last.faults.faults())).since == WALL + 20


def test_a_common_cause_of_an_earlier_process_is_served_once_enough_robots_confirm_it():
    robots = ["r1", "r2", "r3"]
    last = player(robots, FaultSettings(common=CauseSettings(3, 0.5)))
    last.go(20, on_robots(robots, level, "motor", ERROR))
    last.go(30)
    started_again(last, 40)
    last.go(50, *(back(robot, level("motor", ERROR, robot)) for robot in robots[:1]))
    assert served(last.faults) == []
    last.go(51, *(back(robot, level("motor", ERROR, robot)) for robot in robots[1:]))
    assert served(last.faults) == ["common/critical motor"]


def test_an_old_database_is_not_served_at_all_where_the_first_message_is_well():
    last = player(["r1"], FaultSettings())
    last.go(20, level("motor", ERROR))
    last.go(30)
    started_again(last, 1_000)
    changes = last.go(1_001, back("r1", level("motor", OK)))
    assert texts(changes) == ["recovered component/critical r1 motor"]
    assert served(last.faults) == []


# -- adopted -----------------------------------------------------------------------------------


def fault(identity: Identity) -> Fault:
    return Fault(identity, WALL - 1_000, WALL - 990, {"site": "hall"}, "hot")


def fresh(*robots: str, settings: FaultSettings | None = None) -> Player:
    """A process without a database, at second 0."""
    last = Player(settings or FaultSettings())
    last.go(0, restart(), *(robot_settings(robot, site="hall") for robot in robots))
    return last


def adopt(last: Player, second: float, *identities: Identity) -> list[str]:
    events = [lambda faults, now, each=each: faults.adopt(fault(each), now) for each in identities]
    return texts(last.go(second, *events))


@pytest.mark.parametrize("reborn", [False, True])
def test_a_robot_that_stays_off_without_a_database_stays_silent_until_it_is_received(reborn):
    last = fresh("r1")
    assert adopt(last, 1, SILENT) == ["began robot/silent r1"]
    last.reborn_at_events = reborn
    assert texts(last.go(100_000, lambda *_: [])) == []
    (found,) = last.faults.faults()
    assert (found.since, found.evidence, found.labels) == (WALL - 1_000, "hot", {"site": "hall"})
    assert texts(last.go(100_001, back())) == ["recovered robot/silent r1"]


def test_a_component_is_judged_on_by_what_is_received():
    last = fresh("r1")
    assert adopt(last, 1, MOTOR) == ["began component/critical r1 motor"]
    assert texts(last.go(5, back("r1", level("motor", ERROR)))) == []
    assert served(last.faults) == ["component/critical r1 motor"]
    assert texts(last.go(60, level("motor", ERROR))) == []
    assert texts(last.go(61, level("motor", OK))) == ["recovered component/critical r1 motor"]


def test_what_was_adopted_in_the_restart_grace_is_served_once_confirmed_and_later_at_once():
    for second, expected in ((29, []), (30, ["component/critical r1 motor"])):
        last = fresh("r1")
        adopt(last, second, MOTOR)
        assert served(last.faults) == expected


@pytest.mark.parametrize("levels", [(), (ERROR, OK)], ids=["never received", "received"])
@pytest.mark.parametrize(
    "states",
    ["flapping", "intermittent", "flapping intermittent", "intermittent flapping"],
)
def test_a_component_that_changed_comes_to_rest_in_time(states, levels):
    last, begin = fresh("r1"), 10.0 if levels else 100.0
    for second, each in enumerate(levels):
        last.go(second + 1, back("r1", level("motor", each)))
    motor = MOTOR._replace(scope=Scope.FLAPPING)
    adopt(last, 10, *(motor._replace(state=State(each)) for each in states.split()))
    assert texts(last.go(100, back("r1", level("motor", OK)))) == []
    for state, seconds in (("flapping", 240), ("intermittent", 600)):
        if state in states:
            assert texts(last.go(begin + seconds - 1)) == []
            assert texts(last.go(begin + seconds)) == [f"recovered flapping/{state} r1 motor"]


def test_a_robot_that_flapped_comes_to_rest_in_time():
    last = player(["r1"], FaultSettings())
    flapping = Identity(Scope.ROBOT, State.FLAPPING, robot="r1")
    assert adopt(last, 1, flapping) == ["began robot/flapping r1"]
    assert texts(last.go(200)) == []
    assert texts(last.go(5_000)) == ["recovered robot/flapping r1"]


def test_what_is_known_here_is_not_adopted():
    last = broken_and_repaired()
    unknown = SILENT._replace(robot="r9")
    assert adopt(last, 61, MOTOR, unknown) == []  # ended here; no such robot
    last.faults.forget("r1", last.at(62))
    assert adopt(last, 63, SILENT) == []
    for since, expected in ((62.0, []), (62.5, ["began robot/silent r1"])):
        later = Fault(SILENT, WALL + since, WALL + since, {})
        changes = last.go(64, lambda faults, now, later=later: faults.adopt(later, now))
        assert texts(changes)[:1] == expected
    last.go(100, level("motor", ERROR))
    last.go(110)
    assert adopt(last, 111, MOTOR) == []  # lasts


def test_a_robot_that_is_received_is_not_silent():
    last = player(["r1"], FaultSettings())
    assert adopt(last, 1, SILENT) == ["began robot/silent r1", "recovered robot/silent r1"]


@pytest.mark.parametrize("reborn", [False, True])
def test_a_site_stays_silent_until_enough_robots_are_received(reborn):
    settings = FaultSettings(site=CauseSettings(3, 0.5))
    robots = [f"r{number}" for number in range(1, 7)]
    last = fresh(*robots, settings=settings)
    assert adopt(last, 1, SITE) == ["began site/silent hall"]
    last.reborn_at_events = reborn
    assert texts(last.go(10_000, lambda *_: [])) == []
    assert texts(last.go(10_001, back("r1"))) == []
    changes = last.go(10_002, *(back(robot) for robot in robots[1:]))
    assert texts(changes) == ["recovered site/silent hall"]


def test_many_components_go_on_until_the_robot_had_time_to_report_them():
    many = Identity(Scope.ROBOT, State.MANY, robot="r1", severity="critical")
    last = fresh("r1")
    assert adopt(last, 1, many) == ["began robot/many r1 critical"]
    assert texts(last.go(100, back("r1", level("motor", OK)))) == []
    assert texts(last.go(109)) == []
    assert texts(last.go(110)) == ["recovered robot/many r1 critical"]


@pytest.mark.parametrize("robots", [(), ("r1",)])
def test_what_no_robot_has_is_not_adopted_because_nothing_could_end_it(robots):
    lifting = Identity(Scope.CAPABILITY, State.LOST, check="lifting at hall")
    last = fresh(*robots)
    assert adopt(last, 1, SITE._replace(site="yard"), lifting) == []


def test_a_site_with_too_few_robots_is_over_once_all_of_them_are_received():
    last = fresh("r1", settings=FaultSettings(site=CauseSettings(3, 0.5)))
    assert adopt(last, 1, SITE) == ["began site/silent hall"]
    assert texts(last.go(1_000)) == []
    assert texts(last.go(1_001, back("r1"))) == ["recovered site/silent hall"]


@pytest.mark.parametrize(
    "identity",
    [
        Identity(Scope.COMMON, State.CRITICAL, component="motor"),
        Identity(Scope.ROBOT, State.MANY, robot="r1", severity="critical"),
        Identity(Scope.FLAPPING, State.FLAPPING, robot="r1", component="motor"),
        Identity(Scope.ROBOT, State.FLAPPING, robot="r1"),
        Identity(Scope.CHECK, State.CRITICAL, robot="r1", check="motors"),
        Identity(Scope.CAPABILITY, State.LOST, robot="r1", check="driving"),
        Identity(Scope.CAPABILITY, State.LOST, check="lifting at hall"),
        Identity(
            Scope.VALUE, State.WARNING, robot="r1", component="battery", key="charge", bound="low"
        ),
    ],
    ids=words,
)
def test_nothing_that_was_adopted_ends_while_nothing_is_received(identity):
    last = fresh("r1")
    last.go(0.5, lambda faults, now: faults.configure_capabilities(None, [LIFTING], now))
    assert len(adopt(last, 1, identity)) == 1
    for second in (5, 100, 300):
        last.go(second, lambda *_: [])
        assert [fault.identity for fault in last.faults.faults()] == [identity]
    started_again(last, 301)
    last.go(600, lambda *_: [])
    assert [fault.identity for fault in last.faults.faults()] == [identity]
    found = last.go(601, back()) + last.go(700)
    assert {change.what for change in found} <= {"recovered"}
