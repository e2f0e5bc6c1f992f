"""The faults' samples as bytes; a fault that lasts is rendered once."""

from __future__ import annotations

from collections.abc import Iterable

from ros_diagnostics_exporter.faults.model import Fault, Identity
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.cache import number
from ros_diagnostics_exporter.texts import escape

# A robot's own labels by these names are left out: they would be read as the fault's identity.
_IDENTITY = {*metrics.FAULT_START.labels, *metrics.FAULT_INFO.labels} - {"site"}


class FaultText:
    """The text of both families of faults."""

    def __init__(self) -> None:
        self._fleet = ""
        self._lines: dict[Identity, tuple[Fault, str, str]] = {}

    def render(self, fleet: str, faults: Iterable[Fault]) -> dict[str, bytes]:
        """By the family's name; ``faults`` are all that last."""
        known = self._lines if fleet == self._fleet else {}
        lines: dict[Identity, tuple[Fault, str, str]] = {}
        for fault in sorted(faults, key=lambda fault: fault.identity):
            kept = known.get(fault.identity)
            if kept is None or kept[0] is not fault:
                kept = fault, *_lines(fleet, fault)
            lines[fault.identity] = kept
        self._fleet, self._lines = fleet, lines
        return {
            metrics.FAULT_START.name: "".join(each[1] for each in lines.values()).encode(),
            metrics.FAULT_INFO.name: "".join(each[2] for each in lines.values()).encode(),
        }


def _lines(fleet: str, fault: Fault) -> tuple[str, str]:
    """Its sample of fault_start and of fault_info."""
    identity = {
        "fleet": fleet,
        **fault.identity._asdict(),
        "scope": fault.identity.scope.value,
        "state": fault.identity.state.value,
        "site": fault.identity.site or fault.labels.get("site", ""),
    }
    own = {name: text for name, text in fault.labels.items() if name not in _IDENTITY}
    start = f"{metrics.FAULT_START.name}{{{_labels(identity | own)}}}"
    info = f"{metrics.FAULT_INFO.name}{{{_labels(identity | {'evidence': fault.evidence})}}}"
    return f"{start} {number(round(fault.since, 3))}\n", f"{info} 1\n"


def _labels(labels: dict[str, str]) -> str:
    return ",".join(f'{name}="{escape(text)}"' for name, text in labels.items() if text)
