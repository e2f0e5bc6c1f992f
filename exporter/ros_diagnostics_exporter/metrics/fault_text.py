"""The faults' samples as bytes; a fault that lasts is rendered once."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import NamedTuple

from ros_diagnostics_exporter.alertmanager import Acknowledgement, identity_of
from ros_diagnostics_exporter.faults.model import End, Fault, Identity, as_texts, fault_id
from ros_diagnostics_exporter.metrics import families as metrics
from ros_diagnostics_exporter.metrics.cache import number
from ros_diagnostics_exporter.metrics.families import Family
from ros_diagnostics_exporter.model import ALL_PARTS, Part
from ros_diagnostics_exporter.notifications import Key
from ros_diagnostics_exporter.texts import encodable, escape

# A robot's own labels by these names are left out: they would be read as the fault's identity.
_RESERVED = {label for family in metrics.FAULT_FAMILIES for label in family.labels} - {
    "site",
    "team",
}


class _Lines(NamedTuple):
    """What is rendered of one fault; ``labels`` without braces, ``key`` as `identity_of`."""

    fault: Fault
    labels: str
    key: tuple[str, ...]
    start: str
    info: str


class FaultText:
    """The text of the families of faults."""

    def __init__(self) -> None:
        self._source = ("", "")
        self._lines: dict[Identity, _Lines] = {}

    def render(
        self,
        fleet: str,
        exporter: str,
        faults: Iterable[Fault],
        ends: Iterable[End] = (),
        acknowledgements: Iterable[Acknowledgement] = (),
        *,
        notified: Mapping[Key, Mapping[str, float]] | None = None,
        parts: Collection[Part] = ALL_PARTS,
    ) -> dict[str, bytes]:
        """By the family's name, those of ``parts``.

        Args:
            fleet: The fleet's name.
            exporter: The exporter's; "" for none.
            faults: All that last.
            ends: What ended of late.
            acknowledgements: Those in force, the newest last; of other faults, too.
            notified: Of each fault, when each receiver was last notified; None: not known.
            parts: Of the exposition.
        """
        source = fleet, exporter
        known = self._lines if source == self._source else {}
        lines: dict[Identity, _Lines] = {}
        for fault in sorted(faults, key=lambda fault: fault.identity):
            kept = known.get(fault.identity)
            if kept is None or kept.fault is not fault:
                kept = _render(fleet, exporter, fault)
            lines[fault.identity] = kept
        self._source, self._lines = source, lines
        all_lines = lines.values()
        samples: dict[Family, Iterable[str]] = {  # generators: what is not wanted is not rendered
            metrics.FAULT_START: (each.start for each in all_lines),
            metrics.FAULT_INFO: (each.info for each in all_lines),
            metrics.FAULT_END: (_end(fleet, exporter, each) for each in ends),
            metrics.FAULT_ACKNOWLEDGED: _acknowledged(all_lines, acknowledgements),
            metrics.FAULT_NOTIFIED: _notified(all_lines, notified),
        }
        return {
            family.name: "".join(each).encode()
            for family, each in samples.items()
            if family.part in parts
        }


def _all_labels(fleet: str, exporter: str, fault: Fault) -> dict[str, str]:
    identity = as_texts(fault.identity, fault.labels)
    own = {name: text for name, text in fault.labels.items() if name not in _RESERVED}
    source = {"fleet": fleet, "exporter": exporter}
    return {**source, "fault": fault_id(fleet, exporter, fault.identity), **identity, **own}


def _end(fleet: str, exporter: str, end: End) -> str:
    if end.fault is None:
        labels = {"fleet": fleet, "exporter": exporter, "robot": end.robot}
    else:
        labels = _all_labels(fleet, exporter, end.fault)
    of_end = {"reason": end.reason, "evidence": end.message}
    return _sample(metrics.FAULT_END, label_pairs(labels), of_end, end.at)


def _render(fleet: str, exporter: str, fault: Fault) -> _Lines:
    identity = _all_labels(fleet, exporter, fault)
    labels = label_pairs(identity)
    return _Lines(
        fault,
        labels,
        tuple(encodable(text) for text in identity_of(identity)),
        start=_sample(metrics.FAULT_START, labels, {}, fault.since),
        info=_sample(metrics.FAULT_INFO, labels, {"evidence": fault.evidence, "work": fault.work}),
    )


def _acknowledged(
    lines: Iterable[_Lines], acknowledgements: Iterable[Acknowledgement]
) -> Iterator[str]:
    """The samples of the faults that are acknowledged, each by its newest acknowledgement."""
    by_fault: dict[tuple[str, ...], list[Acknowledgement]] = {}
    for each in acknowledgements:
        by_fault.setdefault(each.fault, []).append(each)
    for line in lines if by_fault else ():
        named = by_fault.get(line.key, ())
        found = [each for each in named if each.is_of(line.fault.since)]
        if found:
            words = {"author": found[-1].author, "comment": found[-1].comment}
            yield _sample(metrics.FAULT_ACKNOWLEDGED, line.labels, words, found[-1].at)


def _notified(
    lines: Iterable[_Lines], notified: Mapping[Key, Mapping[str, float]] | None
) -> Iterator[str]:
    """Who was notified when; of a fault of which nobody was, one sample without a receiver: 0."""
    if notified is None:
        return
    for line in lines:
        receivers = notified.get(line.key[1:]) or {"": 0.0}
        for receiver, at in receivers.items():
            yield _sample(metrics.FAULT_NOTIFIED, line.labels, {"receiver": receiver}, at)


def _sample(family: Family, labels: str, more: Mapping[str, str], value: float = 1) -> str:
    further = label_pairs(more)
    return f"{family.name}{{{labels}{further and ','}{further}}} {number(round(value, 3))}\n"


def label_pairs(labels: Mapping[str, str]) -> str:
    """The labels of a sample that are not empty, without braces."""
    return ",".join(f'{name}="{escape(text)}"' for name, text in labels.items() if text)
