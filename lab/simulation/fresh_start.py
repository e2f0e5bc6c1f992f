"""What an exporter says that has just started, and whether another says as much."""

from __future__ import annotations

from collections.abc import Callable, Iterable

from ros_diagnostics_exporter.faults.model import Identity, Scope, State, severity_of
from ros_diagnostics_exporter.model import Instant
from simulation.fleet_files import SHARED
from support.state_driver import StateDriver

TO_FAIL = 400  # seconds, of which every second one is played


def at_start(driver: StateDriver, publish: Callable[[StateDriver], None]) -> set[Identity]:
    """The faults of an exporter to which is published from its start on."""
    for _ in range(0, TO_FAIL, 2):
        publish(driver)
        driver.now = Instant(driver.now.mono + 2, driver.now.wall + 2)
        driver.state.tick(driver.now)
    return {each.identity for each in driver.state.faults()}


def unsaid(lasting: Iterable[Identity], wanted: set[Identity]) -> set[Identity]:
    """Those wanted that are no faults, and of which no fault that lasts says as much."""
    lasting = set(lasting)
    return {each for each in wanted - lasting if not any(_says(fault, each) for fault in lasting)}


def _says(one: Identity, other: Identity) -> bool:
    """Whether a fault may say as much as another would, as larger ones last longer."""
    if one.scope is Scope.COMMON:
        is_larger = other.scope is Scope.CAPABILITY or other.state is State.MANY
        return is_larger or one.component == other.component
    if one.robot != other.robot or not one.robot:
        return False
    if one.scope is Scope.CAPABILITY:
        return True  # who writes it says what a part is worth
    is_part = one.scope is Scope.ROBOT or one.component in (other.component, *SHARED)
    is_enough = "critical" in (severity_of(one), one.severity) or one.scope is Scope.FLAPPING
    return is_part and (is_enough or severity_of(other) == "warning")
