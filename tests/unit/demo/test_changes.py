"""Each change between two snapshots is one line."""

import pytest

from demo.snapshot import Alert, Problem, RobotStatus, Snapshot, changes

HOT = Problem("Motor 2", "ERROR", "hot")


def robot(*problems: Problem, up: bool = True) -> RobotStatus:
    return RobotStatus("robot_3", up, 0.5, 10, problems)


def alert(state: str) -> Alert:
    return Alert("RosDiagnosticsComponentCritical", "robot_3", "Motor 2", state)


HEALTHY = Snapshot((robot(),))


@pytest.mark.parametrize(
    ("before", "now", "lines"),
    [
        (HEALTHY, HEALTHY, []),
        (HEALTHY, Snapshot((robot(HOT),)), ["exporter: robot_3 Motor 2 is ERROR: hot"]),
        (Snapshot((robot(HOT),)), HEALTHY, ["exporter: robot_3 Motor 2 is OK again"]),
        (HEALTHY, Snapshot((robot(up=False),)), ["exporter: robot_3 is silent"]),
        (Snapshot((robot(up=False),)), HEALTHY, ["exporter: robot_3 is back"]),
        (Snapshot(), HEALTHY, []),
        (HEALTHY, Snapshot((robot(),), (), ("Prometheus",)), ["Prometheus does not answer"]),
        (Snapshot((), (), ("Prometheus",)), Snapshot(), ["Prometheus answers again"]),
        (
            Snapshot(alerts=(alert("firing"),)),
            Snapshot(alerts=(alert("active"),)),
            ["Alertmanager: RosDiagnosticsComponentCritical robot_3 Motor 2 is active"],
        ),
        (
            Snapshot(alerts=(alert("active"),)),
            Snapshot(),
            ["Alertmanager: RosDiagnosticsComponentCritical robot_3 Motor 2 is resolved"],
        ),
    ],
)
def test_each_change_is_one_line(before, now, lines):
    assert list(changes(before, now)) == lines


def test_an_alert_is_not_resolved_because_its_servers_do_not_answer():
    before, now = (
        Snapshot(alerts=(alert("active"),)),
        Snapshot(unreachable=("Alertmanager", "Prometheus")),
    )

    assert not [line for line in changes(before, now) if "is resolved" in line]
