"""The service gives each event of a fault the fault's id, by which its page finds it."""

from types import MappingProxyType

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.faults.model import Fault, Identity, Scope, State, fault_id
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.service import Service

CLOCK = Identity(Scope.EXPORTER, State.CRITICAL, component="database")


def began(state: FleetState) -> None:
    """Have a fault of the exporter itself."""
    now = read_clocks()
    fault = Fault(CLOCK, now.wall - 60, now.wall - 50, MappingProxyType({}), "disk full")
    state.adopt([fault], now)


def test_an_event_of_a_fault_is_found_by_the_fault_of_which_it_is(tmp_path):
    service = Service(Fleet("f", exporter="x"), tmp_path / "fleet.yml", None)
    began(service.state)
    fault = fault_id(Fleet("f", exporter="x"), CLOCK)

    [known] = service.fault_history(fault)["occurrences"]

    assert (known["component"], known["until"]) == ("database", None)
    assert service.fault_history("0123456789ab")["occurrences"] == []
