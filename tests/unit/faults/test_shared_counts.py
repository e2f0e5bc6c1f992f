"""Larger faults of robots that several exporters share: each exporter judges the sum."""

from ros_diagnostics_exporter.config.fleet import FaultSettings
from ros_diagnostics_exporter.faults.engine import Faults
from ros_diagnostics_exporter.faults.model import (
    ComponentName,
    ComponentReport,
    ComponentSettings,
    Count,
    Identity,
    Others,
    RobotSettings,
    Scope,
    State,
)
from ros_diagnostics_exporter.model import Instant, Level

MOTOR = Identity(Scope.COMMON, State.CRITICAL, component="Motor")
ALL = (Scope.COMMON, "")
OF_MOTOR = (Scope.COMMON, "Motor")


def at(second: float) -> Instant:
    return Instant(second, 1_700_000_000.0 + second)


def broken(number: int, others: Others) -> Faults:
    """So many robots whose motors have failed for a minute."""
    faults = Faults(FaultSettings(), others)
    for name in (f"r{each}" for each in range(number)):
        faults.configure_robot(name, RobotSettings(), at(0), declared=True)
        faults.robot_back(name, at(0))
        settings = ComponentSettings(10.0)
        for second, level in ((1, Level.OK), (40, Level.ERROR)):
            report = ComponentReport(ComponentName("", "Motor"), level, settings)
            faults.components_changed(name, [report], 2, at(second))
    faults.advance(at(100))
    return faults


def common(faults: Faults) -> bool:
    return MOTOR in {each.identity for each in faults.faults()}


def test_what_the_others_count_makes_a_few_robots_many():
    """Five robots are needed, and a quarter of all."""
    assert not common(broken(2, Others({ALL: Count(6), OF_MOTOR: Count(0, 2, 2)})))
    assert common(broken(2, Others({ALL: Count(6), OF_MOTOR: Count(0, 3, 3)})))
    assert not common(broken(2, Others({ALL: Count(60), OF_MOTOR: Count(0, 3, 3)})))


def test_the_robots_of_exporters_that_are_not_known_yet_are_guessed():
    """Six are a quarter of 24, and too few if these are the robots of one exporter of four."""
    few = {ALL: Count(18)}
    assert common(broken(6, Others(few, known=1.0)))
    assert not common(broken(6, Others(few, known=0.25)))


def test_a_robot_that_another_exporter_counts_is_not_counted_twice():
    faults = broken(5, Others(twice=frozenset({"r1", "ap"})))
    assert faults.counts() == {
        (Scope.SITE, ""): Count(4),
        ALL: Count(4),
        OF_MOTOR: Count(0, 4, 4),
    }
    assert not common(faults)


def test_a_larger_fault_of_robots_of_other_exporters_is_here_too_and_ends_with_theirs():
    faults = broken(0, Others())
    faults.take_others(Others({ALL: Count(20), OF_MOTOR: Count(0, 9, 9)}), at(100))
    faults.advance(at(120))
    assert common(faults)
    unknown = Others({ALL: Count(10)}, known=0.5)
    faults.take_others(unknown, at(130))
    assert common(faults)
    faults.take_others(Others({ALL: Count(20)}), at(140))
    assert not common(faults)
    assert [each.reason for each in faults.ends()] == ["recovered"]
