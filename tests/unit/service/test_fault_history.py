"""What the service finds of one fault by its id: its events, and its recording."""

from types import MappingProxyType
from unittest.mock import Mock

from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.faults.model import Fault, Identity, Scope, State, fault_id
from ros_diagnostics_exporter.fleet.state import FleetState
from ros_diagnostics_exporter.loops import read_clocks
from ros_diagnostics_exporter.service import Service

CLOCK = Identity(Scope.EXPORTER, State.CRITICAL, component="database")


def began(state: FleetState) -> Fault:
    """Have a fault of the exporter itself."""
    now = read_clocks()
    fault = Fault(CLOCK, now.wall - 60, now.wall - 50, MappingProxyType({}), "disk full")
    state.adopt([fault], now)
    return fault


def test_an_event_of_a_fault_is_found_by_the_fault_of_which_it_is(tmp_path):
    service = Service(Fleet("f", exporter="x"), tmp_path / "fleet.yml", None)
    began(service.state)
    fault = fault_id(Fleet("f", exporter="x"), CLOCK)

    [known] = service.fault_history(fault)["occurrences"]

    assert (known["component"], known["until"]) == ("database", None)
    assert service.fault_history("0123456789ab")["occurrences"] == []


def test_a_recording_is_the_last_complete_one_or_what_there_is_of_the_fault_that_lasts(tmp_path):
    service = Service(Fleet("f", exporter="x"), tmp_path / "fleet.yml", None)
    kept = service._recordings = Mock()
    since, lasting = began(service.state).since, fault_id(Fleet("f", exporter="x"), CLOCK)

    assert service.recording(lasting) is kept.read.return_value
    assert not kept.read_so_far.called
    for fault, begin in (lasting, since), ("0123456789ab", None):
        assert service.recording(fault, so_far=True) is kept.read_so_far.return_value
        assert kept.read_so_far.call_args.args[:2] == (fault, begin)
