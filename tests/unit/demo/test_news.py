"""What changed between two looks is told once, in a sentence."""

from __future__ import annotations

import pytest

from demo.changes import changes
from demo.observation import Alert, Robot, Sight, Trouble

HOT = Trouble("Motor 2", "ERROR", "hot")


def robot(*troubles: Trouble, up: bool = True) -> Robot:
    return Robot("robot_3", up, 0.5, 10, troubles)


def alert(state: str) -> Alert:
    return Alert("RosDiagnosticsComponentCritical", "robot_3", "Motor 2", state)


WELL = Sight((robot(),))


@pytest.mark.parametrize(
    ("before", "now", "told"),
    [
        (WELL, WELL, []),
        (WELL, Sight((robot(HOT),)), ["exporter: robot_3 Motor 2 is ERROR: hot"]),
        (Sight((robot(HOT),)), WELL, ["exporter: robot_3 Motor 2 is OK again"]),
        (WELL, Sight((robot(up=False),)), ["exporter: robot_3 is silent"]),
        (Sight((robot(up=False),)), WELL, ["exporter: robot_3 is heard again"]),
        (Sight(), WELL, []),
        (WELL, Sight((robot(),), (), ("Prometheus",)), ["Prometheus does not answer"]),
        (Sight((), (), ("Prometheus",)), Sight(), ["Prometheus answers again"]),
        (
            Sight(alerts=(alert("firing"),)),
            Sight(alerts=(alert("active"),)),
            ["Alertmanager: RosDiagnosticsComponentCritical robot_3 Motor 2 has arrived"],
        ),
        (
            Sight(alerts=(alert("active"),)),
            Sight(),
            ["Alertmanager: RosDiagnosticsComponentCritical robot_3 Motor 2 is over"],
        ),
    ],
)
def test_each_change_is_one_sentence(before, now, told):
    assert list(changes(before, now)) == told


def test_an_alert_is_not_over_because_nobody_answers():
    before, now = Sight(alerts=(alert("active"),)), Sight(silent=("Alertmanager", "Prometheus"))

    assert not [sentence for sentence in changes(before, now) if "is over" in sentence]
