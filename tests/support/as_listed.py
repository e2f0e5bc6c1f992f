"""What the exporter reads of the JSON that Alertmanager lists."""

from typing import Any

from ros_diagnostics_exporter import acknowledging, firing, silences
from ros_diagnostics_exporter.acknowledging import Acknowledgeable
from ros_diagnostics_exporter.config.fleet import Fleet
from ros_diagnostics_exporter.faults.model import Fault
from ros_diagnostics_exporter.model import Downtime
from ros_diagnostics_exporter.silences import Acknowledgement, Alert, Forgotten, Silence, valid


def read(listed: Any, fleet: str) -> list[Acknowledgement]:
    return silences.read(valid(Silence, listed), fleet)


def read_downtimes(listed: Any, fleet: str) -> list[Downtime]:
    return silences.read_downtimes(valid(Silence, listed), fleet)


def read_forgotten(listed: Any, fleet: str) -> list[Forgotten]:
    return silences.read_forgotten(valid(Silence, listed), fleet)


def read_firing(listed: Any, fleet: str, exporter: str) -> list[Fault]:
    return firing.read(valid(Alert, listed), Fleet(fleet, exporter=exporter))


def problems(listed: Any) -> list[Acknowledgeable]:
    return acknowledging.problems(valid(Alert, listed))
